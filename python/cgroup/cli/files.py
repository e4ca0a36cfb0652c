"""Clouds that commands read, and files of a pair of clouds, named after both to share a folder."""

import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from cgroup import io
from cgroup._checks.quoting import escape
from cgroup._show.words import counted
from cgroup.cli.documents import Document
from cgroup.cli.registration_facts import Clouds
from cgroup.cli.terminal import print_line, show_stages, shown_name, write_figure
from cgroup.errors import InputError
from cgroup.io.attributes import unkept_attributes
from cgroup.io.files import check_outputs, number_lines
from cgroup.io.moved import check_movable
from cgroup.io.result_folders import Results
from cgroup.registration import Registration
from cgroup.types import FloatArray, PointCloud, RealArray

_LONGEST = 100  # bytes of a cloud's name in that of a file; file systems allow some 255 in all

_POSE, _ALIGNED, _MATCHES, _MERGED, _PAGE = ".txt", "_aligned.ply", ".npz", "_merged.ply", ".html"
PAIR_FILES = {
    "_targets.csv": "residuals of the targets",
    "_targets.html": "report of the targets",
    _POSE: "pose",
    _ALIGNED: "source in the target's frame",
    _MERGED: "both clouds merged",
    _MATCHES: "matches",
    ".png": "picture",
    _PAGE: "interactive page",
}
"""Contents of the files, by the end of the name."""


def read_cloud(file: Path, begin: Callable[[str], object]) -> PointCloud:
    """Read a cloud, and show that stage."""
    begin(f"reading {file.name}")
    return io.read_cloud(file)


def read_both(source: Path, target: Path) -> tuple[PointCloud, PointCloud]:
    """Read two clouds."""
    with show_stages() as begin:
        return read_cloud(source, begin), read_cloud(target, begin)


def crop_clouds(clouds: Clouds, given: Mapping[str, Any]) -> Clouds:
    """Return the parts of source and target within the boxes of their options, if any."""
    parts: list[PointCloud] = []
    for cloud, name in zip(clouds, ("source_crop", "target_crop"), strict=True):
        box = given[name]
        parts.append(cloud if box is None else cloud.crop(box[:3], box[3:]))
        if not len(parts[-1]):
            low, high = cloud.points.min(axis=0), cloud.points.max(axis=0)
            raise InputError(name, f"{box}", f"it has none of the points, which span {low} to {high}")
    return parts[0], parts[1]


def describe_cloud(role: str, file: Path, cloud: PointCloud) -> dict[str, Any]:
    """Return the description of a cloud for a document."""
    return {
        "role": role,
        "file": file,
        "points": len(cloud),
        "dropped": cloud.dropped,
        "centroid": cloud.points.mean(axis=0),
        "extent": extent_of(cloud.points),
        "not_kept": unkept_attributes(file),
    }


def extent_of(points: RealArray) -> float:
    """Return the diagonal of the box around points."""
    return float(np.linalg.norm(np.ptp(points.astype(np.float64, copy=False), axis=0)))


def describe_pair(files: tuple[Path, Path], clouds: tuple[PointCloud, PointCloud]) -> list[dict[str, Any]]:
    """Return the descriptions of source and target for a document."""
    return [describe_cloud(*one) for one in zip(("source", "target"), files, clouds, strict=True)]


def name_of_pair(source: Path, target: Path, how: str = "on") -> str:
    """Return the common prefix of the names of a pair's files."""
    names = (os.fsencode(file.stem)[:_LONGEST].decode(errors="ignore") for file in (source, target))
    return f"_{how}_".join(names)


def name_frames(source: Path, target: Path) -> str:
    """Return the comment by which the file of a pose identifies its pair."""
    places = (escape(os.path.abspath(file)) for file in (source, target))  # noqa: PTH100 - links stay
    return "# pose of {} in the frame of {}".format(*places)


def find_source(text: str) -> str | None:
    """Return the source that the comment of `name_frames` in a text names."""
    found = re.search(r"^# pose of (.+) in the frame of ", text, re.MULTILINE)
    return None if found is None else found[1]


def write_pose(file: Path, pose: FloatArray, frames: str) -> None:
    """Write a pose, exact to the last bit, with the comment of `name_frames`."""
    io.write_file(file, "\n".join([*number_lines(pose), frames, ""]).encode())


def refuse_others(files: Iterable[Path], frames: str) -> None:
    """Raise `InputError` for an existing file that isn't the pose of this pair."""
    for file in files:
        if file.is_file() and frames not in file.read_text(encoding="utf-8", errors="replace").splitlines():
            message = f"{file}: is not the pose of these clouds; rename it, or give another --out"
            raise InputError(message)


def unique_names(files: Sequence[Path], names: Sequence[str]) -> list[str]:
    """Return unique names of files: the whole path if a name is empty or occurs twice."""
    count = Counter(names)
    return [name if name and count[name] == 1 else str(file) for name, file in zip(names, files, strict=True)]


def name_moved(files: Sequence[Path]) -> list[str]:
    """Return unique names of moved files: with that of the folder if a name occurs twice."""
    count = Counter(file.name for file in files)
    folders = [f"{file.absolute().parent.name}_" if count[file.name] > 1 else "" for file in files]
    names = [folder + file.name for folder, file in zip(folders, files, strict=True)]
    for file, name in zip(files, names, strict=True):
        check_movable(file)
        if names.count(name) > 1:
            raise InputError("FILE", name, "several files would have this name; move them one by one")
    return names


def print_contents(document: Document, contents: Mapping[str, str] = PAIR_FILES) -> None:
    """Print the written files of a document and their contents, by the ends of names; count those below."""
    written = [Path(file) for file in document["files"]]
    files = [file for file in written if file.parent == written[0].parent]
    names = [escape(file.name) for file in files]
    for file, name in zip(files, names, strict=True):
        if file == files[0]:
            print_line(f"wrote to {file.parent}/")
        content = next(contents[end] for end in contents if file.name.endswith(end))
        print_line(f"  {name:<{max(map(len, names))}}  {content}")
    for name, count in Counter(f"{file.parent.name}/" for file in written if file not in files).items():
        print_line(f"  {name}: {counted(count, 'file')}, {contents[name]}")


class PairFiles:
    """Files of one registered pair: SOURCE_on_TARGET.txt and so on."""

    def __init__(
        self,
        folder: Path,
        source: Path,
        target: Path,
        run: str,
        *,
        html: bool,
        merged: bool = False,
        report: Mapping[str, bytes] = MappingProxyType({}),
    ) -> None:
        """Raise `InputError` if an input, a file of another pair, or a foreign file would be replaced.

        A report has contents by the ends of names.
        """
        self._folder, self._name, self._run = folder, name_of_pair(source, target), run
        self._frames = name_frames(source, target)
        self._title = f"{shown_name(source)} on {shown_name(target)}"
        self._page_title = f"{source.name} on {target.name}"
        self._is_wanted = {_MATCHES: False, _MERGED: merged, _PAGE: html}
        self._is_wanted |= {
            ending: ending in report for ending in PAIR_FILES if ending.startswith("_targets")
        }
        self._report = report
        self._results = Results(folder, f"register {self._name}")
        check_outputs([self._file(ending) for ending in PAIR_FILES])
        refuse_others([self._file(_POSE)], self._frames)
        self._results.check(self._wanted)

    @property
    def _wanted(self) -> list[Path]:
        return [self._file(ending) for ending in PAIR_FILES if self._is_wanted.get(ending, True)]

    def _file(self, ending: str) -> Path:
        return self._folder / f"{self._name}{ending}"

    def write(self, clouds: Clouds, done: Registration, truth: FloatArray | None) -> list[Path]:
        """Write the pose, the aligned source, matches if there are any, and a picture; return the files."""
        from cgroup.plots import registration_figure  # noqa: PLC0415 - slow to load

        pose = done.T_target_source
        figure = registration_figure(
            clouds[0].points,
            clouds[1].points,
            done.correspondences,
            mask=done.grouping.mask,
            T_target_source=pose,
            title=self._title,
        )
        self._is_wanted[_MATCHES] = len(done.correspondences) > 0
        self._results.check(self._wanted)
        with self._results.writing(self._run) as written:
            write_pose(self._file(_POSE), pose, self._frames)
            io.write_cloud(self._file(_ALIGNED), done.place(clouds[0]))
            if self._is_wanted[_MERGED]:
                io.write_cloud(self._file(_MERGED), done.merged(*clouds))
            if self._is_wanted[_MATCHES]:
                io.write_correspondences(self._file(_MATCHES), done.correspondences)
            write_figure(self._file(".png"), figure)
            if self._is_wanted[_PAGE]:
                self._write_page(clouds, done, truth)
            for ending, content in self._report.items():
                io.write_file(self._file(ending), content)
        return written

    def write_refusal(
        self, clouds: Clouds, guess: Registration | None, truth: FloatArray | None, refusal: str
    ) -> list[Path]:
        """Write only the page of a refused guess, if requested; return the files."""
        with self._results.writing(self._run) as written:
            if guess is not None and self._is_wanted[_PAGE]:
                self._write_page(clouds, guess, truth, refusal)
        return written

    def _write_page(
        self, clouds: Clouds, done: Registration, truth: FloatArray | None, refusal: str | None = None
    ) -> None:
        from cgroup.pages import registration_page, write_page  # noqa: PLC0415 - slow to load

        page = registration_page(*clouds, done, truth=truth, title=self._page_title, refusal=refusal)
        write_page(self._file(_PAGE), page)
