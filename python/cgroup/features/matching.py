"""Nearest descriptors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from cgroup import _core
from cgroup._options import run_options
from cgroup.features._rows import as_descriptors

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.types import FloatArray, IndexArray


@dataclass(frozen=True, eq=False)
class Matches:
    """Nearest target descriptor of every source descriptor; row i of every field is one match.

    Attributes
    ----------
    source_indices, target_indices : (n,) array of int64
        Rows of the two descriptor tables; source rows ascend.
    distance, second_distance : (n,) array of float64
        Euclidean distance to the nearest and the second-nearest target descriptor; the second is
        infinite where there is only one.
    similarity : (n,) array of float64
        ``1 - |f_norm - f'_norm|`` on descriptors scaled to unit length, higher is better; -inf where one
        is zero (paper, section 3.1).
    ratio : (n,) array of float64
        Nearest over second-nearest distance, in [0,1], lower is better; 1 where there is no second or its
        square is at most 1e-7 (paper, section 3.1).
    """

    source_indices: IndexArray
    target_indices: IndexArray
    distance: FloatArray
    second_distance: FloatArray
    similarity: FloatArray
    ratio: FloatArray

    def __len__(self) -> int:
        return len(self.source_indices)

    def __repr__(self) -> str:
        return f"Matches(n={len(self)})"


def match(
    source: ArrayLike,
    target: ArrayLike,
    *,
    mutual: bool = False,
    max_distance: float | None = None,
    threads: int | None = None,
) -> Matches:
    """Find the nearest and second-nearest target descriptor of every source descriptor, exactly.

    Rows that are not finite are left out on both sides. Distances are Euclidean; ties take the lowest
    row. Cost O(n n' d).

    Parameters
    ----------
    source, target : (n,d), (n',d) array_like of float
        Descriptors, one row per keypoint.
    mutual : bool
        Keep a match only if the source is also the nearest of its target.
    max_distance : float, optional
        Keep a match only if its distance is at most this.
    threads : int, optional
        Threads to compute on, None for all cores.

    Returns
    -------
    Matches
        In the order of the source rows.

    Examples
    --------
    >>> from cgroup import features
    >>> matches = features.match([[0.0, 1.0], [1.0, 0.0]], [[1.0, 0.1], [0.1, 1.0]])
    >>> matches.target_indices.tolist()
    [1, 0]
    """
    fields = _core.match_descriptors(
        as_descriptors("source", source),
        as_descriptors("target", target),
        run_options(threads),
        mutual,
        max_distance,
    )
    return Matches(*fields)
