"""Data sets in files, the folder that holds them, and its manifest."""

import os
from abc import abstractmethod
from collections.abc import Iterable
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar, cast

from cgroup.datasets.base import Dataset
from cgroup.errors import InputError
from cgroup.io.files import load_json, load_text

Entry = TypeVar("Entry")


class FileDataset(Dataset, Generic[Entry]):
    """Pairs in files of one folder; a subclass lists pairs and their files, and reads a pair.

    docs/datasets.md has the layout of each folder.
    """

    folder: ClassVar[str]
    """Its name below the data root."""
    url: ClassVar[str]
    """Where to get the files."""
    inside: ClassVar[str] = ""
    """A folder of the root itself, which then takes the place of a missing `folder`; empty for none."""
    example: ClassVar[str] = ""
    """A file of the folder, for the error where no pair is listed; empty where that is none."""

    def __init__(self, root: Path | str | None = None) -> None:
        self._folder = self._find_folder(data_root(root))
        listed = self._list_pairs()
        first_missing = {name: self._find_lacking(entry) for name, entry in listed.items()}
        self._lacking = {name: path for name, path in first_missing.items() if path is not None}
        self._pairs = {name: entry for name, entry in listed.items() if name not in self._lacking}
        if not self._pairs and (self._lacking or self.example):
            raise self._missing(next(iter(self._lacking.values()), self._folder / self.example))

    def pair_names(self) -> list[str]:
        """Return the names of all pairs whose files exist."""
        return list(self._pairs)

    def _find_folder(self, root: Path) -> Path:
        path = root / self.folder
        if self.inside and not path.is_dir() and (root / self.inside).is_dir():
            return root
        if not path.is_dir():
            got = f"{path}: no such folder, so {self.title} isn't there"
            raise InputError(f"{got}; get it from {self.url} (docs/datasets.md)")
        return path

    @abstractmethod
    def _list_pairs(self) -> dict[str, Entry]:
        """List all pairs by name, including pairs with missing files."""

    def _needed(self, entry: Entry) -> Iterable[tuple[Path, ...]]:
        """Return the files of a pair, each as a tuple of its possible paths."""
        return [(each,) for each in cast("tuple[object, ...]", entry) if isinstance(each, Path)]

    def _find_lacking(self, entry: Entry) -> Path | None:
        lacking = (places[0] for places in self._needed(entry) if not any(map(Path.is_file, places)))
        return next(lacking, None)

    def _entry(self, name: str) -> Entry:
        self.check_name(name)
        return self._pairs[name]

    def _locate(self, places: tuple[Path, ...]) -> Path:
        found = next(filter(Path.is_file, places), None)
        if found is None:
            raise self._missing(places[0])
        return found

    def _missing(self, path: Path) -> InputError:
        message = f"{path}: isn't there, but {self.title} needs it; get it from {self.url} (docs/datasets.md)"
        return InputError(message)


def data_root(given: Path | str | None = None) -> Path:
    """Return the folder that holds the data sets' folders.

    Parameters
    ----------
    given : path-like, optional
        Taken if given; else the environment variable ``CGROUP_DATA``.

    Returns
    -------
    Path
        An existing folder.

    Examples
    --------
    >>> from cgroup.datasets import data_root
    >>> data_root(".").is_dir()
    True
    """
    value = given if given is not None else os.environ.get("CGROUP_DATA")
    if not value:
        more = (
            "docs/datasets.md lists the contents and the sources. The data sets named standin-... need none"
        )
        raise InputError(f"no folder with data: give one, or set CGROUP_DATA to it; {more}")
    root = Path(value)
    if not root.is_dir():
        source = "" if given is not None else " (from CGROUP_DATA)"
        raise InputError(f"{root}: no such folder{source}; give the one that holds the data sets' folders")
    return root


def manifest_pairs(root: Path, dataset: str) -> list[dict[str, Any]]:
    """Return the pairs of a data set in the root's ``manifest.json``, for data without an official list."""
    path = root / "manifest.json"
    if not path.is_file():
        return []
    try:
        entries: Any = load_json(load_text(path))
    except ValueError as error:
        raise InputError(f"{path}: not a readable manifest ({error})") from error
    if not isinstance(entries, dict) or not isinstance(entries.get(dataset, {}), dict):
        raise InputError(f"{path}: has to be an object with one object per data set")
    return entries[dataset]["pairs"] if entries.get(dataset) else []
