"""Agreement of poses, and descriptors of whole scans, written from the equations."""

import itertools

import numpy as np
from scipy.spatial.transform import Rotation


def squared_error(found, expected, covariance, middle, voxel):
    """``e^T (A C A^T + F)^-1 e``: e what leads from one pose to the other, about where the middle lies."""
    place = expected[:3, :3] @ middle + expected[:3, 3]
    landed = found[:3, :3] @ middle + found[:3, 3]
    turn = Rotation.from_matrix(found[:3, :3] @ expected[:3, :3].T).as_rotvec()
    error = np.concatenate([turn, landed - place])
    # a motion (w, t) about the origin moves the place by w x place + t
    change = np.block(
        [
            [np.eye(3), np.zeros((3, 3))],
            [np.array([np.cross(axis, place) for axis in np.eye(3)]).T, np.eye(3)],
        ]
    )
    floor = np.diag([np.radians(1.0) ** 2] * 3 + [(0.5 * voxel) ** 2] * 3)
    return error @ np.linalg.inv(change @ covariance @ change.T + floor) @ error


def triangles(pairs):
    """All triples of rows of pairs whose nodes are three, each in two of them."""
    found = set()
    for triple in itertools.combinations(range(len(pairs)), 3):
        nodes = [frozenset(pairs[row]) for row in triple]
        if (
            len(frozenset().union(*nodes)) == 3
            and len(set(nodes)) == 3
            and all(len(node) == 2 for node in nodes)
        ):
            found.add(triple)
    return found


def fisher_vector(values, weights, means, variances):
    """Gradients of the mean log-likelihood by means and variances, scaled (Perronnin et al. 2010, Eq. 7-8), normed."""
    first, second = np.zeros_like(means), np.zeros_like(means)
    for value in values:
        densities = [
            weight * np.prod(np.exp(-((value - mean) ** 2) / (2 * variance)) / np.sqrt(2 * np.pi * variance))
            for weight, mean, variance in zip(weights, means, variances, strict=True)
        ]
        for k, share in enumerate(np.array(densities) / np.sum(densities)):
            away = (value - means[k]) / np.sqrt(variances[k])
            first[k] += share * away / np.sqrt(weights[k])
            second[k] += share * (away**2 - 1) / np.sqrt(2 * weights[k])
    both = np.concatenate([first.ravel(), second.ravel()])
    rooted = np.sign(both) * np.sqrt(np.abs(both))
    return rooted / np.linalg.norm(rooted)
