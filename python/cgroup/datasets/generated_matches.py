"""Generated matches as a data set: the name of a pair holds its parameters."""

from __future__ import annotations

import hashlib
import itertools
import re
from dataclasses import dataclass, replace

import numpy as np

from cgroup.datasets.base import CorrespondencePair, Dataset
from cgroup.datasets.matching_scenes import FRAMES, SCENES, make_scene
from cgroup.errors import InputError

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
    some usual ones. The same name gives the same problem; ``inliers0`` has nothing to be found.
    """

    name, title = "generated-matches", "Generated matches"
    role, origin, citation = "correspondences", "synthetic", "this library"

    def pair_names(self) -> list[str]:
        """Return usual ones: each scene at some sizes and shares of right matches."""
        kinds = itertools.product(SCENES, (200, 1000, 5000), (0.02, 0.1, 0.3))
        return [Recipe(scene, n, inliers).name for scene, n, inliers in kinds]

    def check_name(self, name: str) -> None:
        """Raise `InputError` for a name that isn't of the form."""
        read_recipe(name)

    def load(self, name: str) -> CorrespondencePair:
        """Draw the problem."""
        recipe = read_recipe(name)
        # Of scene and frames only what they are about differs.
        key = repr((recipe.n, recipe.inliers, recipe.noise, recipe.number))
        seed = np.frombuffer(hashlib.sha256(key.encode()).digest(), dtype="<u4")
        drawn = make_scene(
            np.random.default_rng(seed),
            recipe.n,
            inliers=recipe.inliers,
            noise=recipe.noise,
            scene=recipe.scene,
            frames=recipe.frames,
        )
        matches = drawn.correspondences()
        if recipe.frames == "none":
            matches = replace(matches, source_lrf=None, target_lrf=None)
        return CorrespondencePair(name, matches, drawn.T_target_source)


def read_recipe(name: str) -> Recipe:
    """Read the name of a pair; raises `InputError` unless it is of the form."""
    found = _NAME.fullmatch(name)
    if found is None or found["scene"] not in SCENES or found["frames"] not in FRAMES:
        message = (
            f"{GeneratedMatches.name}: has no pair {name!r}; names are like {Recipe().name!r}, with a scene "
            f"of {', '.join(SCENES)} and frames {', '.join(FRAMES)}"
        )
        raise InputError(message)
    scene, n, inliers, noise, frames, number = found.groups()
    return Recipe(scene, int(n), float(inliers), float(noise), frames, int(number))
