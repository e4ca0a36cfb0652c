"""What a user would write in NumPy and SciPy, dense and vectorised: the very methods, with the same masks.

Conversions that a user could do once are done before the timer starts.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from scipy.sparse.linalg import eigsh
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from peers.cases import INLIER_RESIDUAL, Array, Case, Mask

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from peers.answers import Answer, Call, Make

Solver: TypeAlias = Literal["power", "eigsh", "eigh"]

GC_TOLERANCE = 3.0
ST_MIN_RATIO, ST_TIE, ST_NO_SUPPORT = 0.6, 1e-9, 1e-12
GTM_STEPS = 100
POWER_STEPS, POWER_TOLERANCE, POWER_SHIFT = 1000, 1e-10, 0.05
RANSAC_ITERATIONS, RANSAC_BATCH = 10_000, 500
CV_VOTERS, CV_DISTANCE, CV_ANGLE = 200, 10.0, 10.0
SI_NEIGHBORS, SI_MIN_RATIO, SI_LOWE = 250, 0.9, 0.8
HOUGH_BINS = 15
OTSU_BINS = 100


def gc(case: Case, _threads: int) -> Call:
    """Find the largest star of consistent matches, from the n x n matrix."""
    source, target = _floats(case, "src", "tgt")

    def call() -> Answer:
        consistent = np.abs(cdist(source, source) - cdist(target, target)) < GC_TOLERANCE
        return consistent[np.argmax(consistent.sum(axis=1))], None

    return call


def gc_rows(case: Case, _threads: int) -> Call:
    """Find the same star row by row, without an n x n matrix."""
    source, target = _floats(case, "src", "tgt")

    def call() -> Answer:
        most, star = -1, None
        for i in range(len(source)):
            ds, dt = np.linalg.norm(source - source[i], axis=1), np.linalg.norm(target - target[i], axis=1)
            consistent = np.abs(ds - dt) < GC_TOLERANCE
            size = int(consistent.sum())
            if size > most:
                most, star = size, consistent
        return star, None

    return call


def gtm(case: Case, _threads: int) -> Call:
    """Run 100 steps of the replicator dynamics on the ratios of lengths."""
    source, target = _floats(case, "src", "tgt")

    def call() -> Answer:
        payoff = _ratio_matrix(source, target)
        share = np.full(len(payoff), 1 / len(payoff))
        for _ in range(GTM_STEPS):
            gain = payoff @ share
            share = share * gain / (share @ gain)
        return above_otsu(share), None

    return call


def st(case: Case, _threads: int, solver: Solver) -> Call:
    """Take greedily from the principal eigenvector of the ratios of lengths."""
    source, target = _floats(case, "src", "tgt")

    def call() -> Answer:
        affinity = _ratio_matrix(source, target)
        return _without_conflicts(_principal(affinity, solver), affinity), None

    return call


def ransac(case: Case, _threads: int) -> Call:
    """Fit 10,000 triples in batches, the same that cgroup draws, and judge every fit by every match."""
    source, target = _floats(case, "src", "tgt")

    def call() -> Answer:
        drawn = _triples(len(source))
        best = np.zeros(len(source), bool)
        for first in range(0, RANSAC_ITERATIONS, RANSAC_BATCH):
            rows = drawn[first : first + RANSAC_BATCH]
            for rotation, translation in zip(*_kabsch(source[rows], target[rows]), strict=True):
                offsets = source @ rotation.T + translation - target
                inliers = np.einsum("ij,ij->i", offsets, offsets) < INLIER_RESIDUAL**2
                if inliers.sum() > best.sum():
                    best = inliers
        return best, None

    return call


def cv(case: Case, _threads: int) -> Call:
    """Let the 200 most distinctive matches vote by length and frame."""
    source, target, source_frames, target_frames = _floats(case, "src", "tgt", "lrf_src", "lrf_tgt")
    ratio = case["ratio"]

    def angles(frames: Array, voters: Array) -> Array:
        trace = np.tensordot(frames, frames[voters], axes=([1, 2], [1, 2]))
        return np.degrees(np.arccos(np.clip((trace - 1) / 2, -1, 1)))

    def call() -> Answer:
        voters = np.argsort(ratio, kind="stable")[:CV_VOTERS]
        rigidity = cdist(source, source[voters]) - cdist(target, target[voters])
        turn = angles(source_frames, voters) - angles(target_frames, voters)
        score = np.exp(-((rigidity / CV_DISTANCE) ** 2) - (turn / CV_ANGLE) ** 2).sum(axis=1)
        return above_otsu(score), None

    return call


def si(case: Case, _threads: int) -> Call:
    """Let 250 neighbours vote by length, and the 250 most distinctive matches by length and pose."""
    source, target, source_frames, target_frames = _floats(case, "src", "tgt", "lrf_src", "lrf_tgt")
    ratio = case["ratio"]
    count = min(SI_NEIGHBORS, len(source))

    def lengths(points: Array, others: Array) -> Array:
        return np.linalg.norm(points[:, None] - others, axis=2)

    def call() -> Answer:
        near = cKDTree(source).query(source, k=min(count + 1, len(source)))[1]
        others = near != np.arange(len(source))[:, None]
        voters = (ratio < SI_LOWE)[near] & others
        rigidity = _ratios(lengths(source, source[near]), lengths(target, target[near]))
        local = (voters & (rigidity > SI_MIN_RATIO)).sum(axis=1)

        leaders = np.argsort(ratio, kind="stable")[:count]
        rotation = np.einsum("nai,naj->nij", target_frames, source_frames)
        steps = source[leaders][:, None] - source[None]
        moved = np.einsum("nij,gnj->gni", rotation, steps) + target[None]
        residual = np.linalg.norm(moved - target[leaders][:, None], axis=2).T
        rigidity = _ratios(lengths(source, source[leaders]), lengths(target, target[leaders]))
        distant = ((rigidity > SI_MIN_RATIO) & (residual < INLIER_RESIDUAL)).sum(axis=1)

        asked = voters.sum(axis=1) + count
        asked[leaders] -= 1  # nobody votes for itself
        score = (local + distant) / np.maximum(asked, 1)
        return above_otsu(score), None

    return call


def hough(case: Case, _threads: int) -> Call:
    """Vote for the centroid in 15 bins per axis; the voters of the peak and of its six neighbours."""
    source, target, source_frames, target_frames = _floats(case, "src", "tgt", "lrf_src", "lrf_tgt")

    def call() -> Answer:
        local = np.einsum("nai,ni->na", source_frames, source.mean(axis=0) - source)
        votes = np.einsum("nai,na->ni", target_frames, local) + target
        low, high = votes.min(axis=0), votes.max(axis=0)
        bins = np.minimum((votes - low) * (HOUGH_BINS / (high - low)), HOUGH_BINS - 1).astype(int)
        z, y, x = np.unravel_index(
            np.argmax(np.bincount(bins @ [1, HOUGH_BINS, HOUGH_BINS**2])), (HOUGH_BINS,) * 3
        )
        return np.abs(bins - [x, y, z]).sum(axis=1) <= 1, None

    return call


def above_otsu(scores: Array) -> Mask:
    """Tell which scores lie above Otsu's cut between equal bins."""
    low, high = scores.min(), scores.max()
    places = np.minimum((scores - low) / ((high - low) / OTSU_BINS), OTSU_BINS - 1).astype(int)
    below = np.bincount(places, minlength=OTSU_BINS).cumsum()
    sums = np.bincount(places, scores, OTSU_BINS).cumsum()
    above = below[-1] - below[:-1]
    means = sums[:-1] / below[:-1], (sums[-1] - sums[:-1]) / above
    return places > np.argmax(below[:-1] * above * (means[0] - means[1]) ** 2)


def _floats(case: Case, *keys: str) -> list[Array]:
    return [case[key].astype(float) for key in keys]


def _ratios(a: Array, b: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.nan_to_num(np.minimum(a / b, b / a))


def _ratio_matrix(source: Array, target: Array) -> Array:
    matrix = _ratios(cdist(source, source), cdist(target, target))
    np.fill_diagonal(matrix, 0)
    return matrix


def _principal(matrix: Array, solver: Solver) -> Array:
    if solver == "eigsh":
        return np.abs(eigsh(matrix, k=1, which="LA")[1][:, 0])
    if solver == "eigh":
        return np.abs(np.linalg.eigh(matrix)[1][:, -1])
    shift = POWER_SHIFT * matrix.sum(axis=1).mean()  # so that -lambda can't oscillate
    vector = np.full(len(matrix), len(matrix) ** -0.5)
    for _ in range(POWER_STEPS):
        product = matrix @ vector + shift * vector
        product /= np.linalg.norm(product)
        change = np.abs(product - vector).max()
        vector = product
        if change < POWER_TOLERANCE:
            break
    return vector


def _without_conflicts(vector: Array, affinity: Array) -> Mask:
    """Take the largest entry, drop what conflicts with it, and again (Leordeanu, Hebert)."""
    left = vector > ST_NO_SUPPORT * vector.max()
    selected = np.zeros(len(vector), bool)
    for i in np.argsort(-np.round(vector / (ST_TIE * vector.max())), kind="stable"):
        if left[i]:
            selected[i] = True
            left &= affinity[i] >= ST_MIN_RATIO
    return selected


def _triples(n: int) -> NDArray[np.intp]:
    """Three different rows for each iteration, from the random words that cgroup's RANSAC uses."""
    words = np.random.Philox(key=0).random_raw(4 * RANSAC_ITERATIONS).reshape(-1, 4)
    first, second, third = (_below(words[:, i], n - i) for i in range(3))
    second += second >= first
    third += third >= np.minimum(first, second)
    third += third >= np.maximum(first, second)
    return np.stack([first, second, third], axis=1)


def _below(words: NDArray[np.uint64], bound: int) -> NDArray[np.intp]:
    """Upper 64 bits of the product of a 64-bit word and a bound below 2^32."""
    high, low, bound = words >> np.uint64(32), words & np.uint64(0xFFFFFFFF), np.uint64(bound)
    return ((high * bound + (low * bound >> np.uint64(32))) >> np.uint64(32)).astype(np.intp)


def _kabsch(source: Array, target: Array) -> tuple[Array, Array]:
    """Least-squares rotations (k,3,3) and translations (k,3) of k small sets."""
    source_center, target_center = source.mean(axis=1, keepdims=True), target.mean(axis=1, keepdims=True)
    covariance = np.einsum("kmi,kmj->kij", source - source_center, target - target_center)
    u, _, vt = np.linalg.svd(covariance)
    vt[:, 2] *= np.sign(np.linalg.det(u) * np.linalg.det(vt))[:, None]
    rotations = np.einsum("kia,kja->kij", vt.transpose(0, 2, 1), u)
    return rotations, target_center[:, 0] - np.einsum("kij,kj->ki", rotations, source_center[:, 0])


PEERS: dict[str, Make] = {
    "np_gc": gc,
    "np_gc_rows": gc_rows,
    "np_ransac_10k": ransac,
    "np_st_ratio_power": functools.partial(st, solver="power"),
    "np_st_ratio_eigsh": functools.partial(st, solver="eigsh"),
    "np_st_ratio_eigh": functools.partial(st, solver="eigh"),
    "np_gtm": gtm,
    "np_si": si,
    "np_cv": cv,
    "np_hough": hough,
}
