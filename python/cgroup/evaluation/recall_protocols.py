"""Recalls as papers define them, scores of results, and tests of results on the same pairs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from itertools import combinations
from math import comb
from statistics import NormalDist
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cgroup._checks.values import as_choice, as_flag, as_instance, as_length, guess_word, refuse_word
from cgroup._runtime.toml import tomllib
from cgroup.errors import InputError
from cgroup.evaluation.recalls import redwood_errors, registration_recall
from cgroup.evaluation.result_files import Key, PairErrors, PairPoses, show_pair
from cgroup.io.files import load_text
from cgroup.types import BoolArray, FloatArray

_LIMITS = {"max_rotation": "rotation in deg", "max_translation": "translation", "max_rmse": "RMSE"}
_PRESETS = resources.files("cgroup.evaluation") / "presets"


@dataclass(frozen=True)
class Recall:
    """Definition of a recall: limits of a registered pair, pairs that count, and averages.

    Limits are in the data's unit and in degrees; that of the RMSE is for the root of Redwood's error.
    `first`: whether the first pair of a scene counts; `errors`: statistic of the errors of registered pairs.
    """

    name: str
    source: str = ""
    max_rmse: float | None = None
    max_rotation: float | None = None
    max_translation: float | None = None
    inclusive: bool = False
    consecutive: bool = True
    first: bool = True
    average: Literal["pairs", "scenes"] = "pairs"
    errors: Literal["mean", "median"] = "mean"

    def __post_init__(self) -> None:
        for name in ("inclusive", "consecutive", "first"):
            as_flag(name, getattr(self, name))
        for name, choices in (("average", ("pairs", "scenes")), ("errors", ("mean", "median"))):
            as_choice(name, getattr(self, name), choices)
        if not [as_length(name, limit) for name, limit in self._limits()]:
            raise InputError("recall", "no limit", f"give {', '.join(_LIMITS)}")

    def _limits(self) -> list[tuple[str, float]]:
        return [(name, limit) for name in _LIMITS if (limit := getattr(self, name)) is not None]

    def describe(self) -> str:
        """Describe the definition in words."""
        sign = "<=" if self.inclusive else "<"
        limits = [f"{_LIMITS[name]} {sign} {limit:g}" for name, limit in self._limits()]
        pairs = "pairs" if self.consecutive else "pairs but those of i, i+1"
        pairs += "" if self.first else " and the first of a scene"
        source = f" ({self.source})" if self.source else ""
        return f"{', '.join(limits)}; all {pairs}; mean of {self.average}{source}"

    def counted(self, found: PairErrors) -> BoolArray:
        """Return the mask of the pairs that count."""
        counts = np.array([self.consecutive or abs(source - target) > 1 for _, target, source in found.keys])
        if not self.first:
            counts[np.unique([scene for scene, _, _ in found.keys], return_index=True)[1]] = False
        return counts

    def is_known(self, found: PairErrors) -> bool:
        """Whether the recall can be computed: from Redwood's errors, numbers of clouds, and counted pairs."""
        if not (self.consecutive and self.first) and min(source for *_, source in found.keys) < 0:
            return False
        counts = self.counted(found)
        return bool(counts.any() and (self.max_rmse is None or not np.isnan(found.rmse[counts]).any()))

    def excess(self, found: PairErrors) -> FloatArray:
        """Return the greatest error of each pair as a multiple of its limit; NaN if an error is unknown."""
        errors = dict(zip(_LIMITS, (found.rotation, found.translation, found.rmse), strict=True))
        return np.max([errors[name] / limit for name, limit in self._limits()], axis=0)

    def registered(self, found: PairErrors, factor: float = 1.0) -> BoolArray:
        """Return the mask of the pairs within the limits times a factor."""
        excess = self.excess(found)
        return excess <= factor if self.inclusive else excess < factor

    def score(self, found: PairErrors) -> dict[str, Any] | None:
        """Return the recall and its interval, errors of registered pairs, and counts; None if unknown."""
        if not self.is_known(found):
            return None
        counts, average = self.counted(found), np.median if self.errors == "median" else np.mean
        right = self.registered(found) & counts
        scenes = np.array([scene if self.average == "scenes" else "" for scene, _, _ in found.keys])
        groups = [right & (scenes == scene) for scene in np.unique(scenes[right])]
        rotation, translation = (
            float(np.mean([average(values[rows]) for rows in groups])) if groups else np.nan
            for values in (found.rotation, found.translation)
        )
        recall = registration_recall(right[counts], scenes=scenes[counts].tolist())
        low, high = _interval(right[counts], scenes[counts])
        numbers = {"recall": recall, "low": low, "high": high, "registered": int(right.sum())}
        return {**numbers, "pairs": int(counts.sum()), "rotation_deg": rotation, "translation": translation}


@dataclass(frozen=True)
class RecallProtocol:
    """Recalls of a benchmark, RR first, and points that its papers leave open."""

    title: str
    recalls: Sequence[Recall]
    citation: str = ""
    pairs: int | None = None
    left_open: Sequence[str] = ()

    def __post_init__(self) -> None:
        if not self.recalls:
            raise InputError("[[recall]]", "none", "give one or more")
        texts = [text for one in self.recalls for text in (one.name, one.source)]
        for text in (self.title, self.citation, *self.left_open, *texts):
            as_instance("text", text, str)


def protocol_names() -> list[str]:
    """Return the names of the package's protocols."""
    return sorted(entry.name.removesuffix(".toml") for entry in _PRESETS.iterdir())


def read_protocol(name: str) -> RecallProtocol:
    """Read a protocol by its name, or from a TOML file such as those in ``evaluation/presets``."""
    if name.lower() in protocol_names():
        text = (_PRESETS / f"{name.lower()}.toml").read_text(encoding="utf-8")
    elif name.endswith(".toml"):
        text = load_text(name)
    else:
        known = protocol_names()
        refuse_word("protocol", name, known, guess_word(name, known), ", or a .toml file")
    try:
        table = tomllib.loads(text)
        recalls = [Recall(**one) for one in table.pop("recall", ())]
        return RecallProtocol(recalls=recalls, **table)
    except (ValueError, TypeError, AttributeError, RecursionError, OverflowError) as error:
        raise InputError(f"{name}: not a protocol: {error}") from error


def score_poses(truth: PairPoses, found: PairPoses, *, inverse: bool = False) -> PairErrors:
    """Compare poses with the true ones, pair by pair in the order of the truth."""
    rows = {key: row for row, key in enumerate(truth.keys)}
    poses, missing = np.full(truth.poses.shape, np.nan), np.ones(len(rows), dtype=bool)
    unknown: list[str] = []
    for key, pose in zip(found.keys, np.linalg.inv(found.poses) if inverse else found.poses, strict=True):
        swapped = (key[0], key[2], key[1])
        if key in rows:
            poses[rows[key]], missing[rows[key]] = pose, False
        elif swapped in rows:  # source and target are swapped
            poses[rows[swapped]], missing[rows[swapped]] = np.linalg.inv(pose), False
        else:
            unknown.append(show_pair(key))
    if missing.all():
        known = show_pair(truth.keys[0])
        message = f"{found.name}: none of its pairs, such as {unknown[0]}, is in the truth, as {known} is"
        raise InputError(message)
    answered = np.isfinite(poses).all(axis=(1, 2))
    ours, theirs = poses[answered], truth.poses[answered]
    rotation, translation, rmse = np.full((3, len(rows)), np.inf)
    # As in all scripts; rotations of 3DLoMatch are off by 5e-4, and sines would add 1 degree.
    cosine = (np.einsum("nij,nij->n", ours[:, :3, :3], theirs[:, :3, :3]) - 1) / 2
    rotation[answered] = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    translation[answered] = np.linalg.norm(ours[:, :3, 3] - theirs[:, :3, 3], axis=1)
    is_known = ~np.isnan(truth.information[:, 0, 0])
    rows_known, among = answered & is_known, is_known[answered]
    squares = redwood_errors(ours[among], theirs[among], truth.information[rows_known])
    rmse[rows_known], rmse[~is_known] = np.sqrt(np.maximum(squares, 0)), np.nan
    notes = [f"{len(unknown)} pairs are not in the truth, such as {unknown[0]}: left out"] if unknown else []
    refused, overlap = ~answered & ~missing, truth.overlap
    return PairErrors(found.name, truth.keys, rotation, translation, rmse, refused, missing, overlap, notes)


def refuse_inverses(truth: PairPoses, found: PairPoses, scored: PairErrors, recall: Recall) -> None:
    """Raise `InputError` if the inverses of the scored poses fit far better."""
    turned = score_poses(truth, found, inverse=True)
    fit, as_inverses = (int((recall.registered(one) & recall.counted(one)).sum()) for one in (scored, turned))
    if as_inverses > 2 * fit + 2:
        counts = f"{fit} of its poses fit, and {as_inverses} of their inverses"
        message = f"{found.name}: {counts}: they map the target into the source's frame; give `inverse`"
        raise InputError(message)


def _interval(right: BoolArray, scenes: NDArray[np.str_]) -> tuple[float, float]:
    """Return the 95 % interval of the mean recall of scenes, from Wilson's interval of each, JASA 1927."""
    # Those of several are combined as Zou and Donner do, Statistics in Medicine 2008.
    scene = np.unique(scenes, return_inverse=True)[1]
    sizes = np.bincount(scene)
    shares, squares = np.bincount(scene, weights=right) / sizes, NormalDist().inv_cdf(0.975) ** 2 / sizes
    middle = (shares + squares / 2) / (1 + squares)
    margin = np.sqrt(squares * (shares * (1 - shares) + squares / 4)) / (1 + squares)
    below, above = (np.linalg.norm(margin + way) / len(sizes) for way in (shares - middle, middle - shares))
    return max(0.0, float(shares.mean() - below)), min(1.0, float(shares.mean() + above))


def compare_results(found: Mapping[str, PairErrors], recall: Recall) -> list[dict[str, Any]]:
    """Test every two results on the same pairs: pairs registered by one only, and p adjusted by Holm."""
    # Pairs without numbers are identified by their order in the scene.
    keys: dict[str, list[Key]] = {}
    registered: dict[str, BoolArray] = {}
    for name, one in found.items():
        rows = sorted(np.flatnonzero(recall.counted(one)).tolist(), key=one.keys.__getitem__)
        keys[name], registered[name] = [one.keys[row] for row in rows], recall.registered(one)[rows]
    tests: list[dict[str, Any]] = []
    for one, other in combinations(found, 2):
        if keys[one] == keys[other]:
            first, second = registered[one], registered[other]
            only = {"only_one": int((first & ~second).sum()), "only_other": int((second & ~first).sum())}
            tests.append({"one": one, "other": other, **only, "p": mcnemar(first, second)})
    for test, p in zip(tests, holm([test["p"] for test in tests]), strict=True):
        test["p"] = p
    return tests


def mcnemar(one: ArrayLike, other: ArrayLike) -> float:
    """Return the p of McNemar's exact test on paired successes."""
    first, second = np.asarray(one, dtype=bool), np.asarray(other, dtype=bool)
    only_first, only_second = int((first & ~second).sum()), int((second & ~first).sum())
    count = only_first + only_second
    tail = sum(comb(count, k) for k in range(min(only_first, only_second) + 1))
    return min(1.0, 2 * tail / 2**count)


def holm(p: Sequence[float]) -> list[float]:
    """Adjust the p of several tests for the family-wise error (Holm, Scand. J. Statistics 1979)."""
    order = np.argsort(p, kind="stable")
    adjusted = np.empty(len(p))
    adjusted[order] = np.maximum.accumulate(np.minimum(1.0, np.arange(len(p), 0, -1) * np.array(p)[order]))
    return adjusted.tolist()
