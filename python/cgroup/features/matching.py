"""Matching of nearest descriptors."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from cgroup import _core
from cgroup._checks.arrays import as_reals
from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.values import as_count, as_flag, as_number, run_options
from cgroup.errors import InputError
from cgroup.types import BoolArray, FloatArray, IndexArray, RealArray

MOST_BYTES = 2**30  # memory of matches during the computation; some sixteen million matches


@dataclass(frozen=True, eq=False)
class Matches:
    """Nearest targets of every source descriptor; row i of every field is one match.

    Attributes
    ----------
    source_indices, target_indices : (n,) array of int64
        Rows of the two descriptor tables; source rows ascend.
    rank : (n,) array of int64
        1 for a source's nearest target, 2 for the next; ascending for each source.
    distance, second_distance : (n,) array of float64
        Euclidean distance between the two, and from the source to its second-nearest target; the second is
        infinite if there is only one.
    similarity : (n,) array of float64
        ``1 - |f_norm - f'_norm|`` on descriptors scaled to unit length, higher is better; -inf where one
        is zero (paper, section 3.1).
    ratio : (n,) array of float64
        Distance over second-nearest distance, in [0,1], lower is better; 1 where there is no second or its
        square is at most 1e-7 (paper, section 3.1), and for all ranks but the first.
    is_mutual : (n,) array of bool
        Whether the source is the nearest of the target; of equally near ones the lowest row is. Where the
        rank is 1 too, each is the other's nearest.
    """

    source_indices: IndexArray
    target_indices: IndexArray
    rank: IndexArray
    distance: FloatArray
    second_distance: FloatArray
    similarity: FloatArray
    ratio: FloatArray
    is_mutual: BoolArray

    def __len__(self) -> int:
        return len(self.source_indices)

    def __repr__(self) -> str:
        return f"Matches(n={len(self)})"


@explain_wrong_calls
def match(
    source: ArrayLike,
    target: ArrayLike,
    *,
    k: int = 1,
    mutual: bool = False,
    max_distance: float | None = None,
    threads: int | None = None,
) -> Matches:
    """Find the exact nearest target descriptors of every source descriptor.

    Rows that are not finite are left out on both sides. Distances are Euclidean; ties take the lowest
    row. Cost O(n n' d), once for both directions. `threads` is as for `shot`.

    Parameters
    ----------
    source, target : (n,d), (n',d) array_like of float
        Descriptors, one row per keypoint.
    k : int
        Targets per source, the nearest ones.
    mutual : bool
        Keep a match only if the source is also the nearest of its target.
    max_distance : float, optional
        Keep a match only if its distance is at most this.

    Returns
    -------
    Matches
        In the order of the source rows, then of the rank.

    Examples
    --------
    >>> from cgroup import features
    >>> matches = features.match([[0.0, 1.0], [1.0, 0.0]], [[1.0, 0.1], [0.1, 1.0]])
    >>> matches.target_indices.tolist(), matches.is_mutual.tolist()
    ([1, 0], [True, True])
    """
    fields = _core.match_descriptors(
        as_descriptors("source", source),
        as_descriptors("target", target),
        run_options(threads, max_memory=MOST_BYTES),
        as_count("k", k, 1),
        as_flag("mutual", mutual),
        None if max_distance is None else as_number("max_distance", max_distance),
    )
    return Matches(*fields)


def as_descriptors(name: str, value: ArrayLike) -> RealArray:
    """Return a table of descriptors as (n,d) float32 or float64."""
    array = as_reals(name, value)
    if array.ndim != 2 or array.shape[1] == 0:
        raise InputError(name, f"shape {array.shape}", "give (n,d), one descriptor per row")
    return array
