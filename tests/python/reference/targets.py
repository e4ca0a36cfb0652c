"""The pose of surveyed targets, written from the equations of least squares and of Baarda's tests.

The pose is Horn's unit quaternion, one subset of the targets at a time; derivatives are differences.
"""

import itertools
import math

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import f

NAMED, POSSIBLE = 0.001, 0.01
KNOWN = 10


def fit(source, target):
    """Horn's pose (4,4) of (n,3) targets: the eigenvector of the largest eigenvalue of a 4x4 matrix."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    s = a.T @ b
    table = np.empty((4, 4))
    table[0, 0] = np.trace(s)
    table[0, 1:] = table[1:, 0] = [s[1, 2] - s[2, 1], s[2, 0] - s[0, 2], s[0, 1] - s[1, 0]]
    table[1:, 1:] = s + s.T - np.trace(s) * np.eye(3)
    w, x, y, z = np.linalg.eigh(table)[1][:, -1]
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat([x, y, z, w]).as_matrix()
    pose[:3, 3] = target.mean(axis=0) - pose[:3, :3] @ source.mean(axis=0)
    return pose


def residuals(pose, source, target):
    return np.array([q - pose[:3, :3] @ p - pose[:3, 3] for p, q in zip(source, target, strict=True)])


def squares(source, target):
    return float((residuals(fit(source, target), source, target) ** 2).sum())


def variance(sum_of_squares, redundancy, sigma):
    known = 0 if sigma is None else KNOWN
    return (sum_of_squares + known * (sigma or 0.0) ** 2) / (redundancy + known)


def covariance(source, target, sigma=None):
    """Covariance (6,6) of (rotation vector, translation) in the target's frame, of Student's distribution."""
    pose, step = fit(source, target), 1e-5
    columns = []
    for k in range(6):
        moved = []
        for sign in (1, -1):
            motion = sign * step * np.eye(6)[k]
            change = np.eye(4)
            change[:3, :3], change[:3, 3] = Rotation.from_rotvec(motion[:3]).as_matrix(), motion[3:]
            moved.append(residuals(change @ pose, source, target).ravel())
        columns.append((moved[0] - moved[1]) / (2 * step))
    jacobian = np.array(columns).T
    r = 3 * len(source) - 6
    freedom = r + (0 if sigma is None else KNOWN)
    student = variance(squares(source, target), r, sigma) * freedom / (freedom - 2)
    return student * np.linalg.inv(jacobian.T @ jacobian)


def leave_one_out(source, target, used):
    """Distance of each target from the place by the other used ones."""
    away = []
    for i in range(len(source)):
        rows = [k for k in used if k != i]
        if len(rows) < 3:
            away.append(math.nan)
            continue
        pose = fit(source[rows], target[rows])
        away.append(float(np.linalg.norm(target[i] - pose[:3, :3] @ source[i] - pose[:3, 3])))
    return np.array(away)


def find_blunders(source, target, sigma=None):
    """Rows of the used targets, of the named blunders, and of the suspects."""
    used, named, suspects = list(range(len(source))), [], []
    known = 0 if sigma is None else KNOWN
    while not suspects:
        found = find_set(source, target, used, sigma, known)
        if found is None:
            break
        best, possible = found
        sure = set.intersection(*possible)
        named += sorted(sure)
        suspects = sorted(set.union(*possible) - sure)
        used = [row for row in used if row not in best]
    return used, sorted(named), suspects


def find_set(source, target, used, sigma, known):
    """The smallest significant set of blunders, and all sets of its size that explain them as well.

    A larger one is taken if none of its size equals it.
    """
    first = None
    everything = squares(source[used], target[used])
    for size in range(1, len(used) - max(3, len(source) // 2 + 1) + 1):
        sums = {}
        for some in itertools.combinations(used, size):
            rows = [row for row in used if row not in some]
            sums[some] = squares(source[rows], target[rows])
        best = min(sums, key=lambda some: sums[some])
        r = 3 * (len(used) - size) - 6
        noise = variance(sums[best], r, sigma)
        chance = f.sf((everything - sums[best]) / (3 * size) / noise, 3 * size, r + known)
        if 2 ** (size - 1) * len(sums) * chance < NAMED:
            possible = [
                {*some}
                for some, value in sums.items()
                if f.sf((value - sums[best]) / 3 / noise, 3, r + known) >= POSSIBLE
            ]
            if len(possible) == 1:
                return {*best}, possible
            first = first or ({*best}, possible)
    return first
