"""Similar scans: a global descriptor of each scan, from the descriptors of its voxels."""

from collections.abc import Collection, Sequence

import numpy as np
from numpy.random import default_rng

from cgroup.registration import PreparedScan
from cgroup.scenes import settings
from cgroup.scenes.links import Pair
from cgroup.types import FloatArray


def describe_scans(scans: Sequence[PreparedScan]) -> FloatArray:
    """Return the Fisher vector of each scan's FPFH, (N,D), of unit length.

    Gradients of the likelihood of a scan's descriptors (whitened, 16 dimensions) with respect to the means
    and variances of a mixture of 64 Gaussians that is fitted to all scans, with signed square roots (F.
    Perronnin, J. Sanchez, T. Mensink, *Improving the Fisher kernel for large-scale image classification*,
    ECCV 2010).
    """
    rng = default_rng(0)
    mixed = any(scan.by_frames for scan in scans)
    found = [(scan.turned_by_frames if mixed else scan).described.descriptors for scan in scans]
    drawn = [
        values[rng.permutation(len(values))[: settings.TRAINING_OF_EACH]].astype(np.float64)
        for values in found
    ]
    training = np.concatenate([values[: max(settings.TRAINING // len(drawn), 50)] for values in drawn])
    mean, deviation = training.mean(axis=0), training.std(axis=0) + 1e-9
    _, sizes, axes = np.linalg.svd((training - mean) / deviation, full_matrices=False)
    axes, sizes = axes[: settings.DIMENSIONS].T, sizes[: settings.DIMENSIONS]
    axes = axes / (sizes / np.sqrt(len(training)) + 1e-3)
    mixture = _fit_mixture(((training - mean) / deviation) @ axes, rng)
    return np.array([_fisher_vector(((values - mean) / deviation) @ axes, *mixture) for values in drawn])


def _fit_mixture(values: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    count = min(settings.GAUSSIANS, len(values))
    means = values[rng.choice(len(values), count, replace=False)]
    variances, weights = np.ones_like(means), np.full(count, 1.0 / count)
    for _ in range(settings.MIXTURE_ROUNDS):
        sums, first, second = _moments(values, weights, means, variances)
        sums += 1e-9
        means = first / sums
        variances = np.maximum(second / sums - means**2, settings.LEAST_VARIANCE)
        weights = sums[:, 0] / sums.sum()
    return weights, means, variances


def _moments(
    values: FloatArray, weights: FloatArray, means: FloatArray, variances: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Assign each value to K Gaussians; return sums of the weights, (K,1), values, and squares."""
    precision = 1.0 / variances
    squares = values**2 @ precision.T - 2.0 * values @ (means * precision).T
    squares += (means**2 * precision).sum(axis=1)
    logs = np.log(weights) - 0.5 * (squares + np.log(variances).sum(axis=1))
    shares = np.exp(logs - logs.max(axis=1, keepdims=True))
    shares /= shares.sum(axis=1, keepdims=True)
    return shares.sum(axis=0)[:, None], shares.T @ values, shares.T @ values**2


def _fisher_vector(
    values: FloatArray, weights: FloatArray, means: FloatArray, variances: FloatArray
) -> FloatArray:
    sums, first, second = _moments(values, weights, means, variances)
    roots = np.sqrt(weights)[:, None]
    slopes = (first - sums * means) / np.sqrt(variances) / roots
    curves = ((second - 2 * means * first + sums * means**2) / variances - sums) / (np.sqrt(2) * roots)
    both = np.concatenate([slopes.ravel(), curves.ravel()])
    vector = np.sign(both) * np.sqrt(np.abs(both))
    return vector / max(float(np.linalg.norm(vector)), 1e-300)


def choose_partners(
    similarity: FloatArray, tried: Collection[Pair], labels: Sequence[int] | None, each: int
) -> list[Pair]:
    """Return pairs (larger row, smaller row) of each scan and the most similar ones, the most similar first.

    Tried pairs are left out, and with labels of components also pairs within one.
    """
    left = similarity.copy()
    np.fill_diagonal(left, -np.inf)
    for one, other in tried:
        left[one, other] = left[other, one] = -np.inf
    if labels is not None:
        left[np.equal.outer(labels, labels)] = -np.inf
    chosen: set[Pair] = set()
    for row in range(len(left)):
        order = np.argsort(-left[row], kind="stable")[:each]
        chosen.update((max(row, k), min(row, k)) for k in order.tolist() if np.isfinite(left[row, k]))
    return sorted(chosen, key=lambda pair: (-left[pair], pair))
