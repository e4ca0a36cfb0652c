"""Correspondences, the data of a method besides its options, and checks of their fields."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cgroup._checks.arrays import RealArray, as_reals, real_candidates, real_frames, real_points, real_vector
from cgroup._checks.values import as_number
from cgroup._show.drawing import plot
from cgroup._show.words import result_table
from cgroup.errors import InputError
from cgroup.types.point_cloud import AnyCloud


class Fields(NamedTuple):
    """Fields of valid shapes, in the caller's precision; None for missing ones."""

    source: RealArray | None = None
    target: RealArray | None = None
    similarity: RealArray | None = None
    ratio: RealArray | None = None
    source_lrf: RealArray | None = None
    target_lrf: RealArray | None = None
    resolution: float | None = None
    source_centroid: RealArray | None = None
    candidates: RealArray | None = None


FIELDS = Fields._fields

OPTIONAL_FIELDS = FIELDS[2:]
"""All but the points."""


def check_fields(**given: Any) -> Fields:  # noqa: ANN401 - by name, None for those not given
    """Check shapes and types, with as few copies as possible. Methods of scores alone need no points."""
    source = real_points("source", given.pop("source")) if "source" in given else None
    rows = None if source is None else len(source)
    missing = [name for name in ("source_lrf", "target_lrf") if given.get(name) is None]
    if len(missing) == 1:
        raise InputError(missing[0], remedy="missing; frames are needed on both sides or on neither")
    taken = {name: value for name, value in given.items() if value is not None or name == "target"}
    return Fields(source=source, **{name: _CHECKS[name](name, taken[name], rows) for name in taken})


def _partners(name: str, target: object, rows: int) -> RealArray:
    points = real_points(name, target)
    if len(points) != rows:
        got = f"{len(points)} rows, but source has {rows}"
        raise InputError(name, got, "row i of one matches row i of the other")
    return points


def _centroid(name: str, value: ArrayLike, _rows: int) -> RealArray:
    array = as_reals(name, value)
    if array.shape != (3,):
        raise InputError(name, f"shape {array.shape}", "give the three coordinates of one point")
    return array


_CHECKS: dict[str, Callable[..., Any]] = {
    "target": _partners, "similarity": real_vector, "ratio": real_vector,
    "source_lrf": real_frames, "target_lrf": real_frames, "candidates": real_candidates,
    "resolution": lambda name, value, _rows: as_number(name, value),
    "source_centroid": _centroid,
}  # fmt: skip
"""What checks a field: a function of its name, its value and the number of matches."""


@dataclass(frozen=True, eq=False)
class Correspondences:
    """Putative matches between two shapes; row i of every field is the same match.

    The arrays are read-only copies: float32 if they were given so, else float64.

    Parameters
    ----------
    source, target : (n,3) array_like of float
        Matched points in the data's unit; the transform maps `source` into `target`.
    similarity : (n,) array_like of float, optional
        Descriptor similarity ``1 - |f_norm - f'_norm|``, higher is better; -inf for no descriptor.
    ratio : (n,) array_like of float, optional
        Nearest / second-nearest descriptor distance, in [0,1], lower is better.
    source_lrf, target_lrf : (n,3,3) array_like of float, optional
        Local reference frames; rows are the x, y and z axes; a block with NaN means no frame.
    resolution : float, optional
        Mean nearest-neighbour distance of the clouds (the unit *pr*), in the data's unit.
    source_centroid : (3,) array_like of float, optional
        Centroid of the whole source cloud; `hough3d` uses the mean of `source` without it.
    candidates : (n,k,3) array_like of float, optional
        Target points that each source point may match, the likeliest first, such as those of its k nearest
        descriptors.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import Correspondences, group
    >>> source = np.random.default_rng(0).uniform(size=(50, 3))
    >>> target = source + [1.0, 0.0, 0.0]
    >>> target[40:] = 0.0
    >>> matches = Correspondences(source, target, resolution=0.01)
    >>> group(matches, "gc").size
    40
    """

    source: RealArray
    target: RealArray
    similarity: RealArray | None = None
    ratio: RealArray | None = None
    source_lrf: RealArray | None = None
    target_lrf: RealArray | None = None
    resolution: float | None = None
    source_centroid: RealArray | None = None
    candidates: RealArray | None = None

    def __init__(
        self,
        source: AnyCloud,
        target: AnyCloud,
        *,
        similarity: ArrayLike | None = None,
        ratio: ArrayLike | None = None,
        source_lrf: ArrayLike | None = None,
        target_lrf: ArrayLike | None = None,
        resolution: float | None = None,
        source_centroid: ArrayLike | None = None,
        candidates: ArrayLike | None = None,
    ) -> None:
        given = {name: value for name, value in locals().items() if name != "self"}
        fields = check_fields(**given)
        copies: list[Any] = [each.copy() if isinstance(each, np.ndarray) else each for each in fields]
        _take_fields(self, Fields(*copies))

    def __len__(self) -> int:
        return len(self.source)

    def __repr__(self) -> str:
        given = [name for name in OPTIONAL_FIELDS if getattr(self, name) is not None]
        return f"Correspondences(n={len(self)}, fields={['source', 'target', *given]})"

    def _repr_html_(self) -> str:
        given = [name for name in OPTIONAL_FIELDS if getattr(self, name) is not None and name != "resolution"]
        resolution = "" if self.resolution is None else f"{self.resolution:.4g}"
        rows = [("besides the points", ", ".join(given) or "nothing"), ("resolution (pr)", resolution)]
        return result_table(f"Correspondences: {len(self)} matches", None, rows)

    def plot(
        self,
        source: AnyCloud | None = None,
        target: AnyCloud | None = None,
        *,
        T_target_source: ArrayLike | None = None,
        correct: ArrayLike | None = None,
        interactive: bool = False,
    ) -> Any:  # noqa: ANN401 - matplotlib's Figure or plotly's
        """Draw both sides and lines between matched points.

        Parameters
        ----------
        source, target : PointCloud or (N,3) array_like of float, optional
            The whole clouds; by default the matched points.
        T_target_source : (4,4) array_like of float, optional
            Pose that rotates the source, so that lines of correct matches are parallel.
        correct : (n,) array_like of bool, optional
            Which matches are correct; lines are coloured by it.
        interactive : bool
            Return a figure to rotate and zoom, with hover texts.

        Returns
        -------
        matplotlib.figure.Figure or plotly.graph_objects.Figure
            Not shown; notebooks show the return value of a cell.
        """
        given = {"source": source, "target": target, "pose": T_target_source, "correct": correct}
        everything = np.ones(len(self), dtype=bool)
        return plot(given, self, everything, interactive=interactive, title=f"{len(self)} matches")


def own_correspondences(fields: Fields) -> Correspondences:
    """Return correspondences of checked arrays without copies; the caller must not change the arrays."""
    made = object.__new__(Correspondences)
    _take_fields(made, fields)
    return made


def _take_fields(matches: Correspondences, fields: Fields) -> None:
    for name, value in fields._asdict().items():
        if isinstance(value, np.ndarray):
            value.flags.writeable = False
        object.__setattr__(matches, name, value)
