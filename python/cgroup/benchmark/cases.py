"""What is computed once: a pair, disturbed and described in one way; to be registered; or its matches."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from cgroup.registration import Descriptor, Detector

COMBINATIONS: Mapping[str, tuple[Detector, Descriptor]] = {
    "C1": ("h3d", "shot"),
    "C2": ("h3d", "lfsh"),
    "C3": ("h3d", "rcs"),
    "C4": ("iss", "shot"),
    "C5": ("iss", "lfsh"),
    "C6": ("iss", "rcs"),
}
"""The paper's detectors and descriptors (section 4.3)."""

DENSE_MATCHES = ("nearest", "mutual", "three nearest", "nearest, unit length")
"""How voxels described by FPFH are matched: each with its nearest, with those whose nearest it is, with its
three nearest; or with the nearest by descriptors of unit length, as for published results on 3DMatch."""

Kind: TypeAlias = Literal["related", "mirrored", "mixed"]

READY_MADE = ""
"""The combination of pairs that come as correspondences."""


@dataclass(frozen=True)
class Case:
    """One problem for the methods; experiments that ask for the same one share it.

    Attributes
    ----------
    dataset, pair : str
        Which pair.
    nuisance : str
        What is done to it; nothing if empty.
    level : float, optional
        How much.
    combination : str
        One of `COMBINATIONS`, or `READY_MADE`.
    nms_radius : float, optional
        Of the detector, in pr; its own by default.
    seed : int
        Key of all random numbers.
    front : str
        What differs from the paper's front end, as `FrontEntry.changes` writes it; empty for nothing.
    """

    dataset: str
    pair: str
    nuisance: str = ""
    level: float | None = None
    combination: str = "C1"
    nms_radius: float | None = None
    seed: int = 0
    front: str = ""

    @property
    def key(self) -> str:
        """Hash of all fields, the same in every process and on every machine."""
        fields = asdict(self)
        if not self.front:  # so that records from before there were other fronts are found
            del fields["front"]
        return _digest(fields).hex()[:24]

    @property
    def detector(self) -> str:
        """Keypoint detector; empty for ready-made correspondences."""
        return COMBINATIONS[self.combination][0] if self.combination else ""

    @property
    def descriptor(self) -> str:
        """Descriptor; empty for ready-made correspondences."""
        return COMBINATIONS[self.combination][1] if self.combination else ""

    def rng(self, purpose: str) -> np.random.Generator:
        """Random numbers that depend on seed, pair, nuisance and level alone."""
        return keyed_rng(purpose, self.seed, self.dataset, self.pair, self.nuisance, self.level)


@dataclass(frozen=True)
class PairCase:
    """Two clouds to be registered; sets that ask for the same ones share them.

    Attributes
    ----------
    dataset, pair : str
        Which pair.
    kind : {"related", "mirrored", "mixed"}
        The pair itself, the pair with a mirrored target, or its source with the target of another pair.
    other : str
        That other pair.
    voxel : float, optional
        Edge length of the voxels in the data's unit; chosen for the pair by default.
    seed : int
        Key of all random numbers.
    """

    dataset: str
    pair: str
    kind: Kind = "related"
    other: str = ""
    voxel: float | None = None
    seed: int = 0

    @property
    def key(self) -> str:
        """Hash of all fields, the same in every process and on every machine."""
        return _digest(asdict(self)).hex()[:24]

    def rng(self, purpose: str) -> np.random.Generator:
        """Random numbers that depend on seed and pair alone."""
        return keyed_rng(purpose, self.seed, self.dataset, self.pair)


@dataclass(frozen=True)
class Problem:
    """Matches to be grouped; sets that ask for the same ones share them.

    Attributes
    ----------
    dataset, pair : str
        Which pair.
    kind : {"related", "mirrored", "mixed"}
        As in `PairCase`. Ready-made matches that have no right one are "mixed".
    other : str
        That other pair.
    matches : str
        How clouds are matched: one of `COMBINATIONS` or `DENSE_MATCHES`, or `READY_MADE`.
    voxel : float, optional
        Edge length of the voxels of dense matches in the data's unit; chosen for the pair by default.
    epsilon : float
        A match is correct when it misses its place by at most so many times the matches' resolution.
    seed : int
        Key of all random numbers.
    """

    dataset: str
    pair: str
    kind: Kind = "related"
    other: str = ""
    matches: str = READY_MADE
    voxel: float | None = None
    epsilon: float = 5.0
    seed: int = 0

    @property
    def key(self) -> str:
        """Hash of all fields, the same in every process and on every machine."""
        return _digest(asdict(self)).hex()[:24]

    def rng(self, purpose: str) -> np.random.Generator:
        """Random numbers that depend on seed and pair alone."""
        return keyed_rng(purpose, self.seed, self.dataset, self.pair)


def keyed_rng(*key: object) -> np.random.Generator:
    """Random numbers by a key, the same in every process (unlike those seeded by `hash`)."""
    return np.random.default_rng(np.frombuffer(_digest(key), dtype="<u4"))


def _digest(value: object) -> bytes:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).digest()
