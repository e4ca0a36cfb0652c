"""Writes THIRD-PARTY-LICENSES.txt: the licence texts of the crates that are linked into the compiled core.

`--check` compares it with the crates of Cargo.lock instead, and writes nothing.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
WRITTEN = ROOT / "THIRD-PARTY-LICENSES.txt"
LICENSE_FILE = re.compile(r"(licen[cs]e|copying|notice|unlicense|copyright)", re.IGNORECASE)
RULE = "=" * 80

HEAD = """\
The compiled core of cgroup contains the Rust standard library (https://github.com/rust-lang/rust,
MIT OR Apache-2.0) and the crates below, whose sources are at
https://crates.io/crates/<name>/<version>. Where a crate may be used under one of several licences,
it is used under the MIT licence if that is one of them, or else under Apache-2.0. Written by
tools/collect_licenses.py.
"""

# For crates that name the MIT licence and come without its text.
MIT = """\
MIT License

Copyright (c) {authors}

Permission is hereby granted, free of charge, to any person obtaining a copy of this software and
associated documentation files (the "Software"), to deal in the Software without restriction,
including without limitation the rights to use, copy, modify, merge, publish, distribute,
sublicense, and/or sell copies of the Software, and to permit persons to whom the Software is
furnished to do so, subject to the following conditions:

The above copyright notice and this permission notice shall be included in all copies or substantial
portions of the Software.

THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR IMPLIED, INCLUDING BUT
NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY, FITNESS FOR A PARTICULAR PURPOSE AND
NONINFRINGEMENT. IN NO EVENT SHALL THE AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES
OR OTHER LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM, OUT OF OR IN
CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE.
"""


@dataclass(frozen=True)
class Crate:
    """A crate that is linked into the core."""

    name: str
    version: str
    license: str
    authors: str
    folder: Path

    def texts(self) -> list[str]:
        """Return the texts that come with it, or else the standard one."""
        files = sorted(
            path for path in self.folder.iterdir() if path.is_file() and LICENSE_FILE.match(path.name)
        )
        texts = [path.read_text(encoding="utf-8", errors="replace") for path in files]
        # Beside MIT's own text only those of parts that stem from elsewhere matter.
        offers_mit = "MIT" in re.split(r"[ /()]+", self.license)
        chosen = [
            text for path, text in zip(files, texts, strict=True) if not (offers_mit and is_other(path.name))
        ]
        if not any("Permission is hereby granted" in text for text in chosen) and offers_mit:
            chosen.append(MIT.format(authors=self.authors or f"the authors of {self.name}"))
        if not chosen:
            message = f"{self.name} {self.version}: no licence text in {self.folder}"
            raise SystemExit(message)
        return [tidy(text) for text in chosen]


def is_other(name: str) -> bool:
    """Whether a file holds a licence that is offered beside MIT."""
    return bool(re.search(r"apache|zlib|unlicense|^copying$", name, re.IGNORECASE))


def tidy(text: str) -> str:
    """Return the text without blanks at ends of lines, so that equal ones are found."""
    return "\n".join(line.rstrip() for line in text.strip().splitlines())


def cargo(*arguments: str) -> str:
    """Return the output of cargo."""
    command = ["cargo", *arguments]
    return subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout  # noqa: S603


def linked_crates() -> list[Crate]:
    """Return the crates that the core is linked with on any platform, ours left out."""
    edges = ["--edges", "normal,no-proc-macro", "--target", "all", "--prefix", "none", "--format", "{p}"]
    tree = cargo("tree", "--locked", "--package", "cgroup-py", *edges)
    linked = {(name, version.removeprefix("v")) for name, version, *_ in map(str.split, tree.splitlines())}
    packages = json.loads(cargo("metadata", "--locked", "--format-version", "1"))["packages"]
    crates = [
        Crate(
            package["name"],
            package["version"],
            package["license"] or "",
            ", ".join(package["authors"]),
            Path(package["manifest_path"]).parent,
        )
        for package in packages
        if package["source"] and (package["name"], package["version"]) in linked
    ]
    return sorted(crates, key=lambda crate: (crate.name, crate.version))


def report(crates: list[Crate]) -> str:
    """Return the list of the crates, and each text once with those it is the licence of."""
    owners: dict[str, list[Crate]] = {}
    for crate in crates:
        for text in crate.texts():
            owners.setdefault(text, []).append(crate)
    listed = [f"{crate.name} {crate.version}: {crate.license}" for crate in crates]
    parts = [HEAD, "\n".join(listed)]
    for text, whose in owners.items():
        parts.append(
            "\n".join([RULE, ", ".join(f"{crate.name} {crate.version}" for crate in whose), RULE, "", text])
        )
    return "\n\n".join(parts) + "\n"


def main() -> None:
    """Write the file, or check it."""
    text = report(linked_crates())
    if "--check" not in sys.argv[1:]:
        WRITTEN.write_text(text, encoding="utf-8")
    elif not WRITTEN.exists() or WRITTEN.read_text(encoding="utf-8") != text:
        message = (
            f"{WRITTEN.name} is not what Cargo.lock asks for: run python {Path(__file__).relative_to(ROOT)}"
        )
        raise SystemExit(message)


if __name__ == "__main__":
    main()
