"""3DHV: 3D Hough voting, Tombari and Di Stefano 2010 (paper 3.2, Eq. 14 to 16).

Eq. 16 is applied with the transposed frame, which is what the rows-are-axes convention
of the paper requires.

Decisions where the paper is open
---------------------------------
* Only correspondences with both frames vote; the votes' bounding box is theirs alone.
* Linear bin index: x fastest, then y, then z. Ties go to the lowest one.
* grid: an axis with hi - lo <= 1e-9 times the target's bounding-box diagonal (all rows)
  has index 0 everywhere. With bin_size the bins are cubes from the minimum and the last
  bin is clamped; `bins` and the flat-axis rule are not used then.
* pcl: bins per axis = max(1, ceil(range / bin_size)), so that a flat axis has one bin.
  A vote whose own bin lies outside (range an exact multiple) is dropped altogether,
  with and without interpolation.
* pcl: bins are visited by linear index; only bins with a value > 0 can be maxima. A
  negative vote_threshold stands for -vote_threshold times the greatest value.
* pcl: RANSAC (iterations, seed, strict < bin_size) gets the voters in ascending row
  order. The greatest filtered set wins, ties: first maximum.
* distance_weight (pcl only): d_max is taken over all rows with finite similarity; d_max
  <= 0 gives weight 1. A non-finite similarity has weight 0. Weight 0 is not recorded.
* Neither scores nor a threshold are reported.
"""

from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from .pairwise import bounding_box_diagonal, centred
from .ransac import ransac
from .result import BoolArray, FloatArray, IntArray, ReferenceGrouping, as_rows, has_frame

FLAT = 1e-9
Bin = tuple[int, int, int]


def hough3d(
    source: ArrayLike,
    target: ArrayLike,
    *,
    source_lrf: ArrayLike,
    target_lrf: ArrayLike,
    source_centroid: ArrayLike | None = None,
    bins: int = 15,
    neighbors: Literal[0, 6, 26] = 6,
    bin_size: float | None = None,
    variant: Literal["grid", "pcl"] = "grid",
    interpolation: bool = True,
    vote_threshold: float = -1.0,
    similarity: ArrayLike | None = None,
    distance_weight: bool = False,
    iterations: int = 10_000,
    seed: int = 0,
) -> ReferenceGrouping:
    p, q = as_rows(source, 3), as_rows(target, 3)
    source_frames, target_frames = as_rows(source_lrf, 3, 3), as_rows(target_lrf, 3, 3)
    if source_centroid is None:
        centroid = p.mean(axis=0) if len(p) else np.zeros(3)
    else:
        centroid = np.asarray(source_centroid, dtype=np.float64)
    framed = has_frame(source_frames, target_frames)
    votes = cast_votes(p, centred(q), source_frames, target_frames, centroid)
    details = {"votes": votes, "framed": framed}
    rows = np.flatnonzero(framed)
    mask = np.zeros(len(p), dtype=bool)
    if variant == "grid":
        if len(rows):
            cells = grid_cells(votes[rows], bounding_box_diagonal(q), bins, bin_size)
            peak = fullest(cells)
            mask[rows] = within(cells, peak, neighbors)
            details |= {"cells": cells, "peak": peak}
        return ReferenceGrouping(mask, None, None, details)

    assert bin_size is not None
    weights = vote_weights(len(p), similarity) if distance_weight else np.ones(len(p))
    if len(rows):
        space = accumulate(rows, votes, weights, bin_size, interpolation=interpolation)
        for voters in maxima(space, vote_threshold):
            kept = ransac(p[voters], q[voters], tolerance=bin_size, iterations=iterations, seed=seed).mask
            if kept.sum() > mask.sum():
                mask[:] = False
                mask[voters[kept]] = True
        details["space"] = space
    return ReferenceGrouping(mask, None, None, details)


def cast_votes(
    source: FloatArray,
    target: FloatArray,
    source_lrf: FloatArray,
    target_lrf: FloatArray,
    centroid: FloatArray,
) -> FloatArray:
    """(n,3) predicted places of the source centroid; NaN without frames."""
    global_vector = centroid - source  # V_G^S = c_S - p_i, Eq. 14
    local_vector = np.einsum("iab,ib->ia", source_lrf, global_vector)  # V_L^S, Eq. 15
    return np.einsum("iba,ib->ia", target_lrf, local_vector) + target  # V_G^S', Eq. 16


def grid_cells(votes: FloatArray, target_diagonal: float, bins: int, bin_size: float | None) -> IntArray:
    """(m,3) bin index of each vote on the grid over the votes' bounding box."""
    lo, extent = votes.min(axis=0), np.ptp(votes, axis=0)
    if bin_size is not None:
        last = np.floor(extent / bin_size)
        return np.clip(np.floor((votes - lo) / bin_size), 0, last).astype(np.int64)
    flat = extent <= FLAT * target_diagonal
    side = np.where(flat, 1.0, extent / bins)
    index = np.clip(np.floor((votes - lo) / side), 0, bins - 1)
    return np.where(flat, 0, index).astype(np.int64)


def fullest(cells: IntArray) -> IntArray:
    """(3,) the bin with the most votes, ties: x fastest, lowest linear index."""
    zyx, counts = np.unique(cells[:, ::-1], axis=0, return_counts=True)  # sorted by z, y, x
    return zyx[np.argmax(counts), ::-1]


def within(cells: IntArray, peak: IntArray, neighbors: int) -> BoolArray:
    """(m,) True for votes in the peak bin or in its 0, 6 or 26 neighbours."""
    offset = np.abs(cells - peak)
    if neighbors == 26:
        return offset.max(axis=1) <= 1
    return offset.sum(axis=1) <= (1 if neighbors == 6 else 0)


def vote_weights(n: int, similarity: ArrayLike | None) -> FloatArray:
    """(n,) 1 - d / d_max with d = 1 - similarity."""
    assert similarity is not None
    d = 1.0 - as_rows(similarity)
    finite = np.isfinite(d)
    d_max = d[finite].max(initial=0.0)
    weights = np.zeros(n)
    weights[finite] = 1.0 - d[finite] / d_max if d_max > 0.0 else 1.0
    return weights


def accumulate(
    rows: IntArray, votes: FloatArray, weights: FloatArray, bin_size: float, *, interpolation: bool
) -> dict[Bin, dict[int, float]]:
    """Hough space: bin -> {row: weight} for every bin that received weight > 0."""
    lo, extent = votes[rows].min(axis=0), np.ptp(votes[rows], axis=0)
    count = np.maximum(1, np.ceil(extent / bin_size)).astype(np.int64)
    space: dict[Bin, dict[int, float]] = {}
    for row in rows:
        position = (votes[row] - lo) / bin_size
        own = np.floor(position).astype(np.int64)
        if (own >= count).any():
            continue
        if interpolation:
            base = np.floor(position - 0.5).astype(np.int64)
            part = position - 0.5 - base
            shares = [
                (base + corner, float(np.prod(np.where(corner, part, 1.0 - part))))
                for corner in np.array(list(product((0, 1), repeat=3)))
            ]
        else:
            shares = [(own, 1.0)]
        for index, fraction in shares:
            weight = fraction * weights[row]
            if weight > 0.0 and (index >= 0).all() and (index < count).all():
                x, y, z = (int(i) for i in index)
                space.setdefault((x, y, z), {})[int(row)] = weight
    return space


def maxima(space: dict[Bin, dict[int, float]], vote_threshold: float) -> list[IntArray]:
    """Voters, ascending, of each local maximum that reaches the threshold."""
    if not space:
        return []
    value = {cell: sum(voters.values()) for cell, voters in space.items()}
    greatest = max(value.values())
    least = -vote_threshold * greatest if vote_threshold < 0.0 else vote_threshold
    found = []
    for x, y, z in sorted(space, key=lambda cell: cell[::-1]):
        faces = [(x - 1, y, z), (x + 1, y, z), (x, y - 1, z), (x, y + 1, z)]
        faces += [(x, y, z - 1), (x, y, z + 1)]
        here = value[x, y, z]
        if here >= least and all(here >= value.get(face, 0.0) for face in faces):
            found.append(np.array(sorted(space[x, y, z])))
    return found
