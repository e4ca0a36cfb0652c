"""Random matches: problems with one difficulty each, and a data set of them."""

from __future__ import annotations

import hashlib
import itertools
import re
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace

import numpy as np

from cgroup.datasets.base import CorrespondencePair, Dataset
from cgroup.datasets.matching_problems import (
    CORRECT_WITHIN,
    MatchingProblem,
    are_near,
    judged,
    make_problem,
    random_rotations,
)
from cgroup.errors import InputError
from cgroup.rigid import apply
from cgroup.types import FloatArray

_RIVALS = 0.8  # matches that follow a rival of the true motion, per match that follows the true one
_ROOM = 150.0  # pr, edge length of the walls
_CANDIDATES = 3  # of each source point, in one-to-three problems

FRAMES = {
    "good": {"frame_error": 8.0, "random_frames": 0.1},
    "bad": {"frame_error": 30.0, "random_frames": 0.7},
    "none": {},
}
"""Arguments of `make_problem` by the quality of the frames; ``none`` leaves the frames out."""


def make_scene(
    rng: np.random.Generator, n: int, *, inliers: float, noise: float, scene: str, frames: str
) -> MatchingProblem:
    """Draw a matching problem with one difficulty. `rng` is as for `make_problem`.

    Parameters
    ----------
    n : int
        Number of matches; up to two more in ``one-to-three``.
    inliers, noise : float
        Fraction of correct matches, and their standard deviation per axis in pr.
    scene : {"uniform", "second-pose", "planes", "mirror", "one-to-three"}
        Kind of wrong matches: at random positions; by a second motion, 0.8 per correct match; on a few walls,
        like all points; by a mirrored motion; or three target points per source point.
    frames : {"good", "bad", "none"}
        Whether local reference frames are off by 8 degrees and 10 % unrelated, or by 30 degrees and 70 %;
        with "none" they are all missing (NaN).

    Returns
    -------
    MatchingProblem
        Its arrays are the caller's own.
    """
    for name, given, known in (("scene", scene, SCENES), ("frames", frames, FRAMES)):
        if given not in known:
            raise InputError(name, f"{given!r}", f"choose one of {', '.join(known)}")
    share = _CANDIDATES * inliers if scene == "one-to-three" else inliers
    if share > 1:
        raise InputError("inliers", inliers, "of one-to-three matches at most a third is right")
    problem = make_problem(rng, n, inlier_ratio=share, noise=noise, **FRAMES[frames])
    made = SCENES[scene](rng, problem)
    if frames == "none":
        missing = np.full_like(made.source_lrf, np.nan)
        made = replace(made, source_lrf=missing, target_lrf=missing.copy())
    return replace(made, recipe=f"{scene}, n={n}, inliers={inliers}, noise={noise}, frames={frames}")


def _planes(rng: np.random.Generator, problem: MatchingProblem) -> MatchingProblem:
    """Move all points to a floor and two walls, where many wrong matches agree by chance."""
    # Correct matches keep their noise.
    scale, right = problem.resolution, problem.inlier_mask
    source = _on_walls(rng, len(problem)) * scale
    noise = problem.target - apply(problem.T_target_source, problem.source)
    others = _on_walls(rng, len(problem)) * scale
    near = are_near(source, others, CORRECT_WITHIN * scale)  # these would be right by accident
    partners = np.where(near, np.roll(others, 1, axis=0), others)
    target = apply(problem.T_target_source, np.where(right[:, None], source, partners))
    target[right] += noise[right]
    centroid = source.mean(axis=0) if len(source) else problem.source_centroid
    return judged(replace(problem, source=source, target=target, source_centroid=centroid))


def _one_to_three(rng: np.random.Generator, problem: MatchingProblem) -> MatchingProblem:
    """Assign three consecutive matches to every source point, at most one of them correct."""
    # Two thirds of the matches are new ones, so that their share of right ones falls to a third; a problem of
    # as many matches as before is returned, or one or two more.
    kept = rng.permutation(len(problem))[: -(-len(problem) // _CANDIDATES)]
    groups = np.repeat(kept, _CANDIDATES)
    # The first of each three stays; the partners of the others are those of other matches.
    partners = rng.integers(0, max(len(problem), 1), size=len(groups))
    partners[::_CANDIDATES] = kept
    first = np.arange(len(groups)) % _CANDIDATES == 0
    rows = problem.subset(groups)
    unlike = rng.beta(9.0, 1.2, len(groups))
    tripled = replace(
        rows,
        target=problem.target[partners],
        target_lrf=problem.target_lrf[partners],
        ratio=np.where(first, rows.ratio, np.maximum(rows.ratio, unlike)),
        similarity=np.where(first, rows.similarity, rng.beta(4.0, 3.0, len(groups))),
    )
    order = np.argsort(rng.random((len(kept), _CANDIDATES)), axis=1)  # within each three
    return judged(tripled.subset((order + _CANDIDATES * np.arange(len(order))[:, None]).ravel()))


SCENES: dict[str, Callable[[np.random.Generator, MatchingProblem], MatchingProblem]] = {
    "uniform": lambda _, problem: problem,
    "second-pose": lambda rng, problem: _rival(rng, problem, (1.0, 1.0, 1.0)),
    "planes": _planes,
    "mirror": lambda rng, problem: _rival(rng, problem, (-1.0, 1.0, 1.0)),
    "one-to-three": _one_to_three,
}
"""What wrong matches are like, by name."""


def _rival(
    rng: np.random.Generator, problem: MatchingProblem, flip: tuple[float, float, float]
) -> MatchingProblem:
    """Move wrong matches by another motion, `_RIVALS` per correct match, next to the true image."""
    # Mirrored ones keep all distances, but no rigid motion explains them.
    rotation = random_rotations(rng, 1)[0]
    moved = (problem.source * np.array(flip)) @ rotation.T
    wrong = np.flatnonzero(~problem.inlier_mask)
    wanted = round(_RIVALS * np.count_nonzero(problem.inlier_mask))
    chosen = rng.permutation(wrong)[:wanted]
    right = problem.inlier_mask
    noise = problem.target[right] - apply(problem.T_target_source, problem.source[right])
    spread = float(noise.std()) if len(noise) else 0.0
    target, frames = problem.target.copy(), problem.target_lrf.copy()
    center = apply(problem.T_target_source, problem.source).mean(axis=0) if len(target) else np.zeros(3)
    shift = center - moved.mean(axis=0) if len(moved) else center
    target[chosen] = moved[chosen] + shift + rng.normal(scale=spread, size=(len(chosen), 3))
    frames[chosen] = problem.source_lrf[chosen] @ rotation.T
    return judged(replace(problem, target=target, target_lrf=frames))


def _on_walls(rng: np.random.Generator, n: int) -> FloatArray:
    points = rng.random((n, 3)) * _ROOM
    points[np.arange(n), rng.integers(0, 3, size=n)] = 0.0
    return points


_NUMBER = r"[0-9.]+(?:e-?[0-9]+)?"
_NAME = re.compile(
    rf"(?P<scene>[a-z-]+)/n(?P<n>[0-9]+)/inliers(?P<inliers>{_NUMBER})/noise(?P<noise>{_NUMBER})"
    r"/(?P<frames>[a-z]+)-frames/(?P<number>[0-9]+)"
)


@dataclass(frozen=True)
class Recipe:
    """Parameters of a generated problem, see `make_scene`; `number` distinguishes problems of one kind."""

    scene: str = "uniform"
    n: int = 1000
    inliers: float = 0.1
    noise: float = 1.5
    frames: str = "good"
    number: int = 0

    @property
    def name(self) -> str:
        """Name of the pair."""
        drawn = f"n{self.n}/inliers{self.inliers:g}/noise{self.noise:g}"
        return f"{self.scene}/{drawn}/{self.frames}-frames/{self.number}"


class GeneratedMatches(Dataset):
    """Matches drawn by `make_scene`, at any size; unit pr.

    Every name of the form ``planes/n1000/inliers0.02/noise1.5/good-frames/0`` is a pair; those listed are
    some usual ones. The same name gives the same problem; ``inliers0`` has no correct matches.
    """

    name, title = "generated-matches", "Generated matches"
    role, origin, citation = "correspondences", "synthetic", "this library"

    def pair_names(self) -> list[str]:
        """Return common names: each scene at some sizes and fractions of correct matches."""
        kinds = itertools.product(SCENES, (200, 1000, 5000), (0.02, 0.1, 0.3))
        return [Recipe(scene, n, inliers).name for scene, n, inliers in kinds]

    def check_name(self, name: str) -> None:
        """Raise `InputError` for a name of another form."""
        read_recipe(name)

    def load(self, name: str) -> CorrespondencePair:
        """Draw the problem."""
        recipe = read_recipe(name)
        # Problems of different scenes and frames have the same random draws.
        key = repr((recipe.n, recipe.inliers, recipe.noise, recipe.number))
        seed = np.frombuffer(hashlib.sha256(key.encode()).digest(), dtype="<u4")
        given = asdict(recipe)
        del given["number"]
        drawn = make_scene(np.random.default_rng(seed), **given)
        matches = drawn.correspondences()
        if recipe.frames == "none":
            matches = replace(matches, source_lrf=None, target_lrf=None)
        return CorrespondencePair(name, matches, drawn.T_target_source)


def read_recipe(name: str) -> Recipe:
    """Parse the name of a pair; raise `InputError` for another form."""
    found = _NAME.fullmatch(name)
    if found is None or found["scene"] not in SCENES or found["frames"] not in FRAMES:
        known = f"with a scene of {', '.join(SCENES)} and frames {', '.join(FRAMES)}"
        message = f"{GeneratedMatches.name}: has no pair {name!r}; names are like {Recipe().name!r}, {known}"
        raise InputError(message)
    scene, n, inliers, noise, frames, number = found.groups()
    return Recipe(scene, int(n), float(inliers), float(noise), frames, int(number))
