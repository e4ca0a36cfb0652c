"""A small data set, nuisance and methods from outside the package; each call leaves a line in FAKES_LOG."""

import os
import subprocess
import sys
import threading
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cgroup import Correspondences, Grouping, group
from cgroup._runtime.progress import StageClock
from cgroup.benchmark import pipelines
from cgroup.benchmark.pipelines import Answer, SceneAnswer
from cgroup.datasets import CorrespondencePair, Dataset, MatchingPair
from cgroup.datasets.generated.stones import stone
from cgroup.errors import InputError
from cgroup.io import PointCloud


def log(line: str) -> None:
    """Append to a file, which several processes may do at a time."""
    if path := os.environ.get("FAKES_LOG"):
        with Path(path).open("a", encoding="utf-8") as file:
            file.write(line + "\n")


class _Fake(Dataset):
    origin = "synthetic"
    protocols = ("precision>0.1", "rmse<=5pr")
    citation = "tests"

    def __init__(self, root: Path | None = None) -> None:
        self.root = root


class Clouds(_Fake):
    """Small stones against posed copies of themselves; the last one can't be loaded."""

    name = "clouds"
    title = "Clouds"
    role = "full-full"

    def pair_names(self) -> list[str]:
        return ["a", "b", "c", "broken"]

    def load(self, name: str) -> MatchingPair:
        log(f"load {name}")
        if name == "broken":
            message = "this pair\nis broken"
            raise OSError(message)
        points = stone(np.random.default_rng(ord(name)), 14).vertices
        pose = np.eye(4)
        pose[:3, 3] = (1, 2, 3)
        source = PointCloud(points + np.random.default_rng(0).normal(scale=0.01, size=points.shape))
        return MatchingPair(name, source, PointCloud(points + pose[:3, 3]), pose, facts={"overlap": 0.9})


class Meshes(Clouds):
    """Stones with faces, whose normals are those of the mesh, against posed points without faces."""

    name = "meshes"
    title = "Meshes"
    role = "full-partial"

    def load(self, name: str) -> MatchingPair:
        log(f"load {name}")
        mesh = stone(np.random.default_rng(ord(name)), 14)
        pose = np.eye(4)
        pose[:3, 3] = (1, 2, 3)
        target = mesh.vertices[::2] + np.random.default_rng(0).normal(scale=0.01, size=(588, 3)) + pose[:3, 3]
        source = PointCloud(mesh.vertices, faces=mesh.faces)
        return MatchingPair(name, source, PointCloud(target), pose, normals="mesh")


class Matches(_Fake):
    """Matches without clouds: a third is correct."""

    name = "matches"
    title = "Matches"
    role = "correspondences"

    def pair_names(self) -> list[str]:
        return [f"m{number}" for number in range(8)]

    def load(self, name: str) -> CorrespondencePair:
        log(f"load {name}")
        rng = np.random.default_rng(int(name[1:]))
        source = rng.uniform(0, 100, size=(60, 3))
        target = rng.uniform(0, 100, size=(60, 3))
        pose = np.eye(4)
        pose[:3, 3] = (5, 0, 0)
        target[:20] = source[:20] + pose[:3, 3] + rng.normal(scale=0.5, size=(20, 3))
        return CorrespondencePair(name, Correspondences(source, target, resolution=1.0), pose)


class Partial(Matches):
    """Lacks the file of one more pair."""

    def lacking_pairs(self) -> dict[str, Path]:
        return {"gone": Path("nowhere", "gone.txt")}


class Absent(Matches):
    """Isn't there."""

    def pair_names(self) -> list[str]:
        message = "absent: get it from nowhere"
        raise InputError(message)


def noise(pair: MatchingPair, level: float, rng: np.random.Generator) -> MatchingPair:
    log(f"noise {pair.name} {level}")
    points = pair.target.points + rng.normal(scale=level, size=pair.target.points.shape)
    return replace(pair, target=PointCloud(points))


def busy(correspondences: Correspondences) -> np.ndarray:
    """Compute on and on, where FAKES_HOLD says so; the name of the process is in the log."""
    log(f"busy {os.getpid()}")
    while os.environ.get("FAKES_HOLD") == "busy":
        pass
    return np.ones(len(correspondences), dtype=bool)


def slow(correspondences: Correspondences) -> np.ndarray:
    """Take a moment; the name of the process is in the log."""
    log(f"slow {os.getpid()}")
    threading.Event().wait(0.1)
    return correspondences.source[:, 0] > 50


def gated(correspondences: Correspondences) -> np.ndarray:
    """Wait until so many lines are in FAKES_GATE as calls have begun."""
    log("gated")
    place = Path(os.environ["FAKES_LOG"]).read_text(encoding="utf-8").splitlines().count("gated")
    while len(Path(os.environ["FAKES_GATE"]).read_text(encoding="utf-8").splitlines()) < place:
        threading.Event().wait(0.01)
    return correspondences.source[:, 0] > 50


def parent(correspondences: Correspondences) -> np.ndarray:
    """Start a process of its own, and wait for it."""
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    log(f"parent {os.getpid()}\nchild {child.pid}")
    child.wait()
    return np.ones(len(correspondences), dtype=bool)


def first(correspondences: Correspondences, *, count: int = 20) -> np.ndarray:
    """Select the first; a method that returns a mask."""
    log(f"first {count}")
    return np.arange(len(correspondences)) < count


def seeded(correspondences: Correspondences, *, seed: int, reach: float = 1.0) -> Grouping:
    """Take a seed, a length and what it is given."""
    return group(correspondences, "ransac", seed=seed, tolerance=reach, iterations=50)


def failing(correspondences: Correspondences) -> Grouping:
    """Can't work with some of its input."""
    if correspondences.source[0, 0] > 50:
        message = "too far to the right"
        raise ArithmeticError(message)
    return group(correspondences, "ransac")


def wrong_length(_correspondences: Correspondences) -> np.ndarray:
    return np.ones(3, dtype=bool)


def deadly(correspondences: Correspondences) -> np.ndarray:
    """Kill the process at some input."""
    if correspondences.source[0, 0] > 90:
        os._exit(9)
    return np.ones(len(correspondences), dtype=bool)


def fatal(_correspondences: Correspondences) -> np.ndarray:
    """Kill the process."""
    os._exit(9)


def endless(correspondences: Correspondences) -> np.ndarray:
    """Never return, unless FAKES_END is set."""
    if not os.environ.get("FAKES_END"):
        threading.Event().wait()
    return np.ones(len(correspondences), dtype=bool)


@dataclass(frozen=True, eq=False)
class Trusting(Grouping):
    """A group that its method trusts."""

    ok: bool | None = True


def several(correspondences: Correspondences) -> Grouping:
    """Offer a wrong pose, and behind it that of `Matches`."""
    wrong, right = np.eye(4), np.eye(4)
    wrong[0, 3], right[0, 3] = 50, 5
    mask = np.ones(len(correspondences), dtype=bool)
    return Trusting(
        mask, None, None, wrong, {"truncated": 1.0}, np.stack([wrong, right]), np.array([2.0, 1.0])
    )


def _shift(length: float) -> np.ndarray:
    """Pose of `Clouds`, (1, 2, 3) away, and so much more along x."""
    pose = np.eye(4)
    pose[:3, 3] = (1 + length, 2, 3)
    return pose


def shifting(clouds: pipelines.Clouds, clock: StageClock, *, by: float = 0.0, ok: bool = True) -> Answer:
    """Always answer the pose of `Clouds`, or one that is off."""
    log(f"shifting {by} {len(clouds.source)}")
    clock.start("source features")
    clock.start("target features")
    clock.start("pose")
    return Answer(_shift(by), ok, 0.75 if ok else 0.25)


def poseless(_clouds: pipelines.Clouds, _clock: StageClock) -> Answer:
    return Answer(None, ok=True)


def placing(scans: pipelines.Scans, _clock: StageClock, *, joined: int | None = None) -> SceneAnswer:
    """Put all scans into components of so many, of all by default, as they are."""
    log("place")
    rows = list(range(len(scans.points)))
    step = joined or len(rows)
    parts = [rows[start : start + step] for start in rows[::step]]
    return SceneAnswer(np.tile(np.eye(4), (len(rows), 1, 1)), parts, len(rows) * (len(rows) - 1) // 2)


NOT_A_FUNCTION = 3


class Views(Clouds):
    """Stones that differ from pair to pair, as scans from known viewpoints."""

    name = "views"
    role = "partial-partial"
    single_views = True

    def pair_names(self) -> list[str]:
        return ["a", "b", "c"]

    def subject_of(self, name: str) -> str:
        return name
