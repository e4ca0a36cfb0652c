"""Small files of every format, changed at random: each has to end in a cloud or an `InputError`, soon.

    python test_io_mutations.py SEED COUNT MEGABYTES

reads COUNT changed files in a process of at most so much memory, and prints a tally. What a file does that it may not
is printed with what makes it again.
"""

import os
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from cloud_files import CLOUDS, png
from e57_files import seal

from cgroup.errors import InputError
from cgroup.io import read_cloud, read_correspondences, read_depth, read_transform

SECONDS = 2.0
"""Of computing; longer than that no small file may take."""

WORDS = b"nan -1 0 1e400 999999999999 18446744073709551615 -9223372036854775808 \xff \\".split()


def mutate(rng: np.random.Generator, content: bytes) -> bytes:
    """Change a file in one to three ways."""
    for _ in range(rng.integers(1, 4)):
        content = CHANGES[rng.integers(len(CHANGES))](rng, content) or b"\n"
    return content


def flip_bits(rng: np.random.Generator, content: bytes) -> bytes:
    changed = bytearray(content)
    for _ in range(rng.integers(1, 9)):
        changed[rng.integers(len(changed))] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def cut(rng: np.random.Generator, content: bytes) -> bytes:
    first, last = sorted(rng.integers(len(content) + 1, size=2).tolist())
    return content[:first] + content[last:] if rng.random() < 0.5 else content[:last]


def blow_up(rng: np.random.Generator, content: bytes) -> bytes:
    """Put a number where another one stands."""
    numbers = list(re.finditer(rb"-?\d+(\.\d+)?", content))
    if not numbers:
        return content
    found = numbers[rng.integers(len(numbers))]
    digits = rng.integers(10, size=rng.integers(1, 21))
    word = WORDS[rng.integers(len(WORDS))] if rng.random() < 0.5 else "".join(map(str, digits)).encode()
    return content[: found.start()] + word + content[found.end() :]


def set_bytes(rng: np.random.Generator, content: bytes) -> bytes:
    """Make four bytes a large or a small number, as counts in binary files are."""
    start = int(rng.integers(len(content)))
    word = [b"\xff" * 4, b"\0" * 4, b"\xff\xff\xff\x7f", b"\0\0\0\x10", b"\x01\0\0\0"][rng.integers(5)]
    return content[:start] + word + content[start + 4 :]


def repeat_lines(rng: np.random.Generator, content: bytes) -> bytes:
    lines = content.splitlines(keepends=True)
    line = int(rng.integers(len(lines)))
    return b"".join(lines[:line] + [lines[line]] * int(rng.integers(2, 60)) + lines[line:])


def drop_line(rng: np.random.Generator, content: bytes) -> bytes:
    lines = content.splitlines(keepends=True)
    del lines[rng.integers(len(lines))]
    return b"".join(lines)


def insert(rng: np.random.Generator, content: bytes) -> bytes:
    start = int(rng.integers(len(content) + 1))
    return content[:start] + rng.bytes(rng.integers(1, 20)) + content[start:]


CHANGES = [flip_bits, cut, blow_up, blow_up, set_bytes, repeat_lines, drop_line, insert]


def read_all(seed: int, count: int, folder: Path) -> Counter[str]:
    """Read changed files; the tally says how they ended."""
    ends: Counter[str] = Counter()
    files = CLOUDS | {"depth.png": png(np.arange(48, dtype=np.uint16).reshape(6, 8))}
    names = list(files)
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        name = names[number % len(names)]
        path = folder / name
        content = mutate(rng, files[name])
        # Otherwise the checksums of its pages were all that is looked at.
        path.write_bytes(seal(content) if name == "scan.e57" and rng.random() < 0.9 else content)
        read = [read_cloud, read_cloud, read_cloud, read_correspondences, read_transform][rng.integers(5)]
        if name == "depth.png":
            read = partial(read_depth, intrinsics=(500, 500, 3, 4))
        start = time.process_time()
        try:
            read(path)
            end = "read"
        except InputError as error:
            plain = str(error).startswith(str(path)) and str(error).isprintable()
            end = "refused" if plain else f"said {error!r}"
        except BaseException as error:  # noqa: BLE001 - whatever it is, it may not be
            end = f"raised {error!r}"
        if time.process_time() - start > SECONDS:
            end = "took long"
        if end not in {"read", "refused"}:
            sys.stdout.write(f"{name}, seed {seed}, number {number}, {read}: {end}\n")
            end = "wrong"
        ends[end] += 1
    return ends


def main() -> None:
    seed, count, megabytes = map(int, sys.argv[1:])
    if os.name == "posix":
        import resource  # noqa: PLC0415 - not everywhere

        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + (megabytes << 20),) * 2)
    with tempfile.TemporaryDirectory() as folder:
        ends = read_all(seed, count, Path(folder))
    sys.stdout.write(" ".join(f"{end}={ends[end]}" for end in ("read", "refused", "wrong")) + "\n")


@pytest.mark.skipif(sys.platform != "linux", reason="memory is bounded through /proc and setrlimit")
def test_changed_files_end_in_a_cloud_or_an_error() -> None:
    command = [sys.executable, __file__, "8", "4000", "256"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    tally = re.fullmatch(r"read=(\d+) refused=(\d+) wrong=0\n", done.stdout)
    assert tally, done.stdout[-4000:] + done.stderr[-4000:]
    # Changes that are all refused at the first line would test little.
    assert min(int(count) for count in tally.groups()) > 400


if __name__ == "__main__":
    main()
