"""ST: spectral technique, Leordeanu and Hebert 2005 (paper 3.2, Eq. 12).

Decisions where the paper is open
---------------------------------
* The shift of the power iteration is 0.05 times the mean row sum of M as built, with
  whatever diagonal it has.
* Entries of v are compared in units of 1e-9 of the largest: power iteration yields no more
  digits. Equal ones are taken by lowest index.
* The dense solver's vector is made non-negative by taking absolute values (for a
  symmetric non-negative M that is again a principal eigenvector).
* M without a positive entry, or n < 2 whatever the diagonal: empty mask, the scores
  are the uniform unit vector.
* "rigidity" conflict: rho < min_distance_ratio. As rho = 0 on zero-length edges, "both"
  differs from it only for min_distance_ratio = 0.
* recompute=True: every round works on the submatrix of what is still alive; the
  selected ones are no longer alive. In a later round a submatrix without positive entry
  counts as a uniform vector (the lowest index is taken), else the last correspondence
  of an all-inlier set would be lost. The scores are those of the first round, and the
  stop v_a <= 1e-12 max v cannot occur because a is the maximum of its own round.
"""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from .pairwise import distance_ratio, shares_an_endpoint
from .result import BoolArray, FloatArray, ReferenceGrouping, as_rows

Affinity = Literal["raw", "threshold", "binary"]
Diagonal = Literal["zero", "one", "score"]
Eigensolver = Literal["power", "dense"]
Conflict = Literal["rigidity", "one_to_one", "both"]

SHIFT = 0.05
CONVERGED = 1e-10
MAX_STEPS = 1000
NEGLIGIBLE = 1e-12
TIE = 1e-9


def st(
    source: ArrayLike,
    target: ArrayLike,
    *,
    min_distance_ratio: float = 0.6,
    affinity: Affinity = "raw",
    diagonal: Diagonal = "zero",
    similarity: ArrayLike | None = None,
    recompute: bool = False,
    eigensolver: Eigensolver = "power",
    conflict: Conflict = "rigidity",
) -> ReferenceGrouping:
    p, q = as_rows(source, 3), as_rows(target, 3)
    n = len(p)
    matrix = affinity_matrix(p, q, min_distance_ratio, affinity)  # M_ij = r(c_i, c_j), Eq. 12
    np.fill_diagonal(matrix, diagonal_values(n, diagonal, similarity))
    conflicts = conflict_matrix(p, q, min_distance_ratio, conflict)
    v = principal_eigenvector(matrix, eigensolver)
    if n < 2 or not (matrix > 0.0).any():  # v' M v = 0: nobody supports anybody
        mask = np.zeros(n, dtype=bool)
    elif recompute:
        mask = greedy_recomputed(matrix, conflicts, eigensolver)
    else:
        mask = greedy(v, conflicts)
    return ReferenceGrouping(mask, v, None, {"matrix": matrix, "conflicts": conflicts})


def affinity_matrix(
    source: FloatArray, target: FloatArray, min_distance_ratio: float, affinity: Affinity
) -> FloatArray:
    """(n,n) off-diagonal entries of M; the diagonal is still 0 or meaningless."""
    rho = distance_ratio(source, target)
    compatible = rho >= min_distance_ratio
    if affinity == "threshold":
        return np.where(compatible, rho, 0.0)
    if affinity == "binary":
        return compatible.astype(np.float64)
    return rho


def diagonal_values(n: int, diagonal: Diagonal, similarity: ArrayLike | None) -> FloatArray:
    if diagonal == "zero":
        return np.zeros(n)
    if diagonal == "one":
        return np.ones(n)
    assert similarity is not None
    return np.maximum(as_rows(similarity), 0.0)


def conflict_matrix(
    source: FloatArray, target: FloatArray, min_distance_ratio: float, conflict: Conflict
) -> BoolArray:
    """(n,n) True where two correspondences must not be selected together."""
    not_rigid = distance_ratio(source, target) < min_distance_ratio
    shared = shares_an_endpoint(source, target)
    return {"rigidity": not_rigid, "one_to_one": shared, "both": not_rigid | shared}[conflict]


def principal_eigenvector(matrix: FloatArray, eigensolver: Eigensolver) -> FloatArray:
    """Return the unit vector v >= 0 with M v = lambda_max v.

    Uniform when M has no positive entry.
    """
    n = len(matrix)
    v = np.full(n, 1.0 / np.sqrt(max(n, 1)))
    if not (matrix > 0.0).any():
        return v
    if eigensolver == "dense":
        return np.abs(np.linalg.eigh(matrix)[1][:, -1])
    shift = SHIFT * matrix.sum(axis=1).mean()
    for _ in range(MAX_STEPS):
        product = (matrix * v).sum(axis=1) + shift * v  # (M + s I) v
        previous, v = v, product / np.linalg.norm(product)
        if np.abs(v - previous).max() < CONVERGED:
            break
    return v


def greedy(v: FloatArray, conflicts: BoolArray) -> BoolArray:
    """Take the strongest, drop what conflicts with it, repeat."""
    alive, selected = np.ones(len(v), dtype=bool), np.zeros(len(v), dtype=bool)
    support = np.round(v / (TIE * v.max()))
    while alive.any():
        strongest = int(np.argmax(np.where(alive, support, -np.inf)))  # ties: lowest index
        if v[strongest] <= NEGLIGIBLE * v.max():
            break
        selected[strongest] = True
        alive &= ~conflicts[strongest]
        alive[strongest] = False
    return selected


def greedy_recomputed(matrix: FloatArray, conflicts: BoolArray, eigensolver: Eigensolver) -> BoolArray:
    """Like `greedy`, with the eigenvector of what is alive in every round."""
    alive, selected = (np.ones(len(matrix), dtype=bool), np.zeros(len(matrix), dtype=bool))
    while alive.any():
        rows = np.flatnonzero(alive)
        v = principal_eigenvector(matrix[np.ix_(rows, rows)], eigensolver)
        strongest = rows[np.argmax(np.round(v / (TIE * v.max())))]
        selected[strongest] = True
        alive &= ~conflicts[strongest]
        alive[strongest] = False
    return selected
