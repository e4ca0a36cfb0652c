"""Saved runs: documents in a folder, one file of JSON each, named by the user."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Iterable
from datetime import datetime
from pathlib import Path
from typing import cast

from cgroup._checks.quoting import show
from cgroup.cli.show.json import SCHEMA_VERSION, Document, as_text
from cgroup.errors import InputError
from cgroup.io._files import digest_of, digests_of_inputs, load_json, read_content, write_file
from cgroup.io._results import check_folder, make_folder

FOLDER = "CGROUP_RESULTS"
"""Environment variable: the folder in place of that in the user's data."""

_SUFFIX = ".json"
_NAME = re.compile(r"[\w][\w.+-]{0,99}")
_KEYS = {"command": str, "inputs": list, "options": dict, "results": dict, "saved": dict}


def check_run(name: str | None) -> Path | None:
    """Return the file of a run that is to be saved, having seen that it isn't there yet and can be made."""
    if name is None:
        return None
    path = file_of(name)
    if path.suffix != _SUFFIX or not path.stem:
        message = f"--save: got {show(name)}; give a name of letters, digits and . _ + -, or a .json file"
        raise InputError(message)
    if os.path.lexists(path):
        how = f"cgroup results remove {path.stem}" if path.parent == folder_of_runs() else "remove it"
        message = f"--save: {path} is there already; choose another name, or first: {how}"
        raise InputError(message)
    check_folder(path.parent)
    return path


def file_of(name: str) -> Path:
    """Return the file of a run: of a name, or the file itself with a folder or the suffix ``.json``."""
    if name.endswith(_SUFFIX) or Path(name).name != name:
        return Path(name)
    if not _NAME.fullmatch(name):
        message = f"saved run: got {show(name)}; give a name of letters, digits and . _ + -, or a .json file"
        raise InputError(message)
    return folder_of_runs() / (name + _SUFFIX)


def folder_of_runs() -> Path:
    """Return the folder of saved runs, whether or not it is there."""
    given = os.environ.get(FOLDER)
    if given:
        return Path(given)
    import platformdirs  # noqa: PLC0415 - only here

    return platformdirs.user_data_path("cgroup", appauthor=False) / "results"


def names_of_runs() -> list[str]:
    """List the names in the folder, sorted."""
    try:
        return sorted(file.stem for file in folder_of_runs().iterdir() if file.suffix == _SUFFIX)
    except FileNotFoundError:
        return []
    except OSError as error:
        message = f"{folder_of_runs()}: can't be read ({error.strerror or error})"
        raise InputError(message) from error


def save_run(path: Path, document: Document) -> None:
    """Write a document, with when and where it came about; nothing half-written is ever left."""
    read = digests_of_inputs()
    inputs = [
        {**one, "sha256": read.get(one["file"]) or digest_of(one["file"])} for one in document["inputs"]
    ]
    saved = {
        "date": datetime.now().astimezone().isoformat(timespec="seconds"),
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
    }
    text = as_text({**document, "inputs": inputs, "saved": saved}) + "\n"
    make_folder(path.parent)
    write_file(path, text.encode())


def load_run(name: str) -> Document:
    """Read a saved run."""
    path = file_of(name)
    if not path.exists():
        known = names_of_runs()
        there = f"there are {', '.join(known)}" if known else "there are none yet; --save keeps one"
        message = f"{name}: no such saved run; {there}"
        raise InputError(message)
    content = read_content(path)
    try:
        document = load_json(content)
    except ValueError as error:
        message = f"{path}: not a saved run, or cut off ({' '.join(str(error).split())[:80]})"
        raise InputError(message) from error
    if not isinstance(document, dict) or not all(
        isinstance(document.get(key), kind) for key, kind in _KEYS.items()
    ):
        message = f"{path}: not a saved run of cgroup; --save writes them"
        raise InputError(message)
    version = document.get("schema_version")
    if version != SCHEMA_VERSION:
        message = f"{path}: saved in layout {show(version)}, and {SCHEMA_VERSION} is known; update cgroup"
        raise InputError(message)
    return cast("Document", document)


def remove_runs(names: Iterable[str]) -> list[Path]:
    """Delete saved runs, after all were found; return their files."""
    files = [file_of(name) for name in names]
    for name, file in zip(names, files, strict=True):
        if not file.exists():
            load_run(name)  # says what there is
    try:
        for file in files:
            file.unlink()
    except OSError as error:
        message = f"{error.filename}: can't be removed ({error.strerror or error})"
        raise InputError(message) from error
    return files
