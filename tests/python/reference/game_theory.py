"""GTM: game theory matching, Rodola et al. 2013 (paper 3.2, Eq. 17 and 18).

``dynamics="infection_immunisation"`` is the solver of

    S. Rota Bulo, I. M. Bomze, "Infection and immunization: a new class of evolutionary
    game dynamics", Games and Economic Behavior 71 (2011) 193-211,

which the authors of GTM used. It starts here from the exactly uniform population, not
from a randomly disturbed one as in their source: a deliberate, deterministic deviation.

Decisions where the paper is open
---------------------------------
* A game without any payoff (x' Pi x <= 1e-300) stops at the uniform population, and
  nothing is selected: nobody agrees with anybody.
* replicator: convergence_tolerance is tested on the L1 norm of the renormalised step,
  after taking the step.
* payoff="distance_difference" is 1 where delta <= tolerance, 0 on the diagonal; zero
  edges do not matter unless one_to_one.
* Infection-immunisation: values of r = y - mean within 1e-12 max|y| of the extreme one
  count as equal to it, and those within 1e-12 max|y| of 0 as 0. Of equal strategies the
  lowest index is taken, and infection comes before immunisation. An immunised strategy
  that reaches the bound x_i / (x_i - 1) gets exactly x_i = 0. After each step x is
  clipped at 0 and divided by its sum. It stops also when there is neither an infective
  nor an immunisable strategy.
* Infection-immunisation selects x > 1e-9 (threshold 1e-9 is reported) unless a fixed
  threshold is given; `otsu` is not used.
"""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from .otsu import OtsuMode, select_above
from .pairwise import distance_difference, distance_ratio, shares_an_endpoint
from .result import FloatArray, ReferenceGrouping, as_rows, length

NO_PAYOFF = 1e-300
TIE = 1e-12
NASH_ERROR = 1e-8
EXTINCT = 1e-9


def gtm(
    source: ArrayLike,
    target: ArrayLike,
    *,
    iterations: int = 100,
    threshold: float | Literal["otsu"] = "otsu",
    otsu: OtsuMode = "minmax",
    one_to_one: bool = False,
    payoff: Literal["distance_ratio", "distance_difference"] = "distance_ratio",
    resolution: float | None = None,
    tolerance: float | None = None,
    convergence_tolerance: float | None = None,
    dynamics: Literal["replicator", "infection_immunisation"] = "replicator",
) -> ReferenceGrouping:
    p, q = as_rows(source, 3), as_rows(target, 3)
    n = len(p)
    if payoff == "distance_ratio":
        pi = distance_ratio(p, q)  # Pi_ij = r(c_i, c_j), Eq. 18 with Eq. 12
    else:
        limit = length(tolerance, resolution, 3.0)
        pi = (distance_difference(p, q) <= limit).astype(np.float64)
    np.fill_diagonal(pi, 0.0)  # Eq. 18, c_i = c_j
    if one_to_one:
        pi[shares_an_endpoint(p, q)] = 0.0

    start = np.full(n, 1.0 / max(n, 1))  # barycentre of the simplex
    if dynamics == "replicator":
        x, steps = replicator(pi, start, iterations, convergence_tolerance)
        mask, cut = select_above(x, threshold, otsu)  # x_i > t_gtm, adaptive (Table 1)
    else:
        nash_error = NASH_ERROR if convergence_tolerance is None else convergence_tolerance
        x, steps = infection_immunisation(pi, start, iterations, nash_error)
        mask, cut = select_above(x, EXTINCT if threshold == "otsu" else threshold, otsu)
    if start @ pi @ start <= NO_PAYOFF:  # nobody agrees with anybody
        mask, cut = np.zeros(n, dtype=bool), None
    return ReferenceGrouping(mask, x, cut, {"payoff": pi, "iterations": steps})


def mean_payoffs(pi: FloatArray, x: FloatArray) -> FloatArray:
    """Pi x, each row summed in the same order."""
    return (pi * x).sum(axis=1)


def replicator(
    pi: FloatArray, x: FloatArray, iterations: int, convergence_tolerance: float | None
) -> tuple[FloatArray, int]:
    """Replicator dynamics, Eq. 17; returns the population and the steps taken."""
    for step in range(iterations):
        y = mean_payoffs(pi, x)  # (Pi x)_i
        z = x @ y  # x' Pi x
        if z <= NO_PAYOFF:
            return x, step
        previous, x = x, x * y / z  # Eq. 17
        x = x / x.sum()
        change = np.abs(x - previous).sum()
        if convergence_tolerance is not None and change < convergence_tolerance:
            return x, step + 1
    return x, iterations


def infection_immunisation(
    pi: FloatArray, x: FloatArray, iterations: int, nash_error: float
) -> tuple[FloatArray, int]:
    """Infection-immunisation dynamics; returns the population and the steps taken."""
    for step in range(iterations):
        y = mean_payoffs(pi, x)
        mean = x @ y
        if (np.minimum(x, mean - y) ** 2).sum() < nash_error**2:
            return x, step
        r = y - mean  # advantage of each pure strategy over the population
        tie = TIE * np.abs(y).max()
        infective = r > tie
        immunisable = (r < -tie) & (x > 0.0)
        gain = r[infective].max(initial=0.0)
        loss = -r[immunisable].min(initial=0.0)
        if gain == 0.0 and loss == 0.0:
            return x, step
        if gain >= loss - tie and gain > 0.0:
            i = int(np.flatnonzero(infective & (r >= gain - tie))[0])
            bound = 1.0
        else:
            i = int(np.flatnonzero(immunisable & (r <= -loss + tie))[0])
            bound = x[i] / (x[i] - 1.0)
        curvature = pi[i, i] - 2.0 * y[i] + mean  # (e_i - x)' Pi (e_i - x)
        mu = bound
        if curvature < 0.0:
            best = -r[i] / curvature  # stationary point along e_i - x
            mu = min(bound, best) if bound > 0.0 else max(bound, best)
        vertex = np.zeros(len(x))
        vertex[i] = 1.0
        x = np.maximum(x + mu * (vertex - x), 0.0)
        if mu == bound and bound < 0.0:
            x[i] = 0.0
        x = x / x.sum()
    return x, iterations
