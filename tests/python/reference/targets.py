"""The pose of surveyed targets in NumPy and SciPy, from the equations of least squares and of Baarda's tests.

Poses are Horn's unit quaternions, of many subsets of the targets at once; a subset is a mask (n,).
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import f

NAMED, DOUBTED = 0.001, 0.01
KNOWN, MOST_SUBSETS = 10, 5000
ROUNDING, ON_A_LINE, LINE, BETTER = 1e-15, 1e-12, 20, 100


@dataclass
class Poses:
    """Rotations (m,3,3) and translations (m,3) of subsets, residuals (m,n,3), squares (m,)."""

    rotations: np.ndarray
    translations: np.ndarray
    residuals: np.ndarray
    squares: np.ndarray
    condition: np.ndarray
    """Largest by second singular value of the cross-covariance (m,): what the rotation multiplies rounding by."""


def fit(source, target, masks):
    """Horn's poses: the eigenvector of the largest eigenvalue of a 4x4 matrix."""
    weights = masks / masks.sum(axis=1, keepdims=True)
    origins = [points.mean(axis=0) for points in (source, target)]  # subtracted first: they may be large
    local = [source - origins[0], target - origins[1]]
    middles = [np.einsum("mn,ni->mi", weights, points) for points in local]
    a, b = (points - middle[:, None] for points, middle in zip(local, middles, strict=True))
    s = np.einsum("mn,mni,mnj->mij", weights, a, b)
    trace = np.trace(s, axis1=1, axis2=2)
    tables = np.empty((len(masks), 4, 4))
    tables[:, 0, 0] = trace
    skew = s - s.transpose(0, 2, 1)
    tables[:, 0, 1:] = tables[:, 1:, 0] = np.stack([skew[:, 1, 2], skew[:, 2, 0], skew[:, 0, 1]], axis=1)
    tables[:, 1:, 1:] = s + s.transpose(0, 2, 1) - trace[:, None, None] * np.eye(3)
    w, x, y, z = np.linalg.eigh(tables)[1][:, :, -1].T
    rotations = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)
    translations = middles[1] + origins[1] - np.einsum("mij,mj->mi", rotations, middles[0] + origins[0])
    residuals = b - np.einsum("mij,mnj->mni", rotations, a)
    sizes = np.linalg.svd(s, compute_uv=False)
    with np.errstate(divide="ignore"):
        condition = sizes[:, 0] / sizes[:, 1]
    return Poses(rotations, translations, residuals, np.einsum("mn,mni->m", masks, residuals**2), condition)


def floor(source, target):
    return (ROUNDING * max(np.abs(source).max(), np.abs(target).max())) ** 2


def variance(squares, redundancy, sigma, least):
    known = 0 if sigma is None else KNOWN
    return (squares + known * (sigma or 0.0) ** 2) / (redundancy + known) + least


def covariance(rotation, source, target, variance, freedom):
    """Covariance (6,6) of (rotation vector, translation of the origin), of Student's distribution."""
    places = (source - source.mean(axis=0)) @ rotation.T
    jacobian = np.zeros((len(places), 3, 6))
    jacobian[:, :, :3] = -cross(places)
    jacobian[:, :, 3:] = np.eye(3)
    jacobian = jacobian.reshape(-1, 6)
    size = np.sqrt((jacobian**2).sum(axis=0))  # the unit of each column, for a better inverse
    cofactors = np.linalg.inv((jacobian / size).T @ (jacobian / size)) / np.outer(size, size)
    change = np.eye(6)
    change[3:, :3] = cross(target.mean(axis=0)[None])[0]
    return variance * freedom / (freedom - 2) * change @ cofactors @ change.T


def cross(vectors):
    """Matrices (n,3,3) of the cross products with vectors."""
    return np.array([[np.cross(v, unit) for unit in np.eye(3)] for v in vectors]).transpose(0, 2, 1)


def leave_one_out(source, target, used):
    """Distance of each target from its place by the other used ones, and the condition of the fit."""
    masks = used & ~np.eye(len(used), dtype=bool)
    poses = fit(source, target, masks)
    away = np.linalg.norm(poses.residuals[range(len(used)), range(len(used))], axis=1)
    is_fixed = (masks.sum(axis=1) >= 3) & (poses.condition < 1 / ON_A_LINE)
    return np.where(is_fixed, away, math.nan), poses.condition


def find_blunders(source, target, sigma=None):
    """Masks of the used targets, of the named blunders, and of the suspects; chance of one more blunder."""
    used = np.ones(len(source), dtype=bool)
    named, suspects, chance = np.zeros_like(used), np.zeros_like(used), 1.0
    while not suspects.any():
        found, chance = find_set(source, target, used, sigma)
        if found is None:
            return used, named, suspects, chance
        best, possible = found
        named = named | possible.all(axis=0)
        suspects = possible.any(axis=0) & ~possible.all(axis=0)
        used = used & ~best
    return used, named, suspects, 1.0


def find_set(source, target, used, sigma):
    """The smallest significant set of blunders, and all sets of its size that explain them as well.

    A larger one is taken if none of its size equals it. Sets are masks of what they remove.
    """
    first, least_chance = None, 1.0
    count, known = used.sum(), 0 if sigma is None else KNOWN
    everything = fit(source, target, used[None]).squares[0]
    for size in range(1, count - max(3, len(source) // 2 + 1) + 1):
        if math.comb(count, size) > MOST_SUBSETS:
            break
        sets = np.array(
            [
                np.isin(np.arange(len(used)), some)
                for some in itertools.combinations(np.flatnonzero(used), size)
            ]
        )
        poses = fit(source, target, used & ~sets)
        squares = np.where(poses.condition < 1 / ON_A_LINE, poses.squares, math.inf)
        best = int(np.argmin(squares))
        if math.isinf(squares[best]):
            continue
        r = 3 * (count - size) - 6
        noise = variance(squares[best], r, sigma, floor(source, target))
        chance = f.sf((everything - squares[best]) / (3 * size) / noise, 3 * size, r + known)
        chance *= 2 ** (size - 1) * len(sets)
        if size == 1:
            least_chance = min(1.0, chance)
        if chance < NAMED:
            possible = sets[f.sf((poses.squares - squares[best]) / 3 / noise, 3, r + known) >= DOUBTED]
            if len(possible) == 1:
                return (sets[best], possible), least_chance
            first = first or (sets[best], possible)
    return first, least_chance


def doubts(source, target, sigma, used, suspects, chance):
    """First words of the notes on what is doubtful."""
    found, everything = [], np.ones((1, len(used)), dtype=bool)
    a, b = (points - points.mean(axis=0) for points in (source, target))
    changes = {"": a, "one file has x and y swapped": a[:, [1, 0, 2]]}
    changes["the units differ"] = a * (np.linalg.norm(b) / np.linalg.norm(a))
    squares = {words: fit(changed, b, everything).squares[0] for words, changed in changes.items()}
    if used.sum() > 3:
        found += [words for words, value in squares.items() if words and BETTER * value < squares[""]][:1]
    if used.sum() == 3 and sigma is None:
        found.append("three targets have no redundancy")
    r, least = 3 * int(used.sum()) - 6, floor(source, target)
    own = fit(source, target, used[None]).squares[0]
    if sigma is not None and f.sf(own / r / (sigma**2 + least), r, KNOWN) < DOUBTED:
        found.append("the residuals are larger than sigma explains")
    width = np.linalg.svd(source[used] - source[used].mean(axis=0), compute_uv=False)[1]
    if width < LINE * math.sqrt(variance(own, r, sigma, least)):
        found.append("the targets are almost on one line")
    if suspects.any():
        found.append("a blunder exists that cannot be named")
    elif chance < DOUBTED:
        found.append("a blunder is possible")
    return found
