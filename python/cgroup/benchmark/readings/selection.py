"""The records as one reading has them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup.benchmark.readings.expansion import SEPARATOR, plain_label

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterator

    import pandas as pd

    from cgroup.benchmark.averages import Average
    from cgroup.benchmark.readings.reading import Reading


def select_default(frame: pd.DataFrame) -> pd.DataFrame:
    """Keep the records of the default.

    Parameters
    ----------
    frame : DataFrame
        Records of a configuration from `add_readings`.

    Returns
    -------
    DataFrame
        Those of experiments that no reading asks for, with these in the column ``experiments``.
    """
    if frame.empty:
        return frame
    ids = [tuple(name for name in names if SEPARATOR not in name) for names in frame["experiments"]]
    return _take(frame, ids)


def select_reading(frame: pd.DataFrame, reading: Reading) -> pd.DataFrame:
    """Put the records of a reading in place of those of the default.

    Parameters
    ----------
    frame : DataFrame
        Records of a configuration from `add_readings`.
    reading : Reading
        Which.

    Returns
    -------
    DataFrame
        The reading's records, under the plain ids of experiments and labels of methods; and the default's,
        but for those of an experiment, data set, combination and method that the reading has records of.
    """
    if frame.empty:
        return frame
    suffix = SEPARATOR + reading.name
    own = [
        tuple(name.removesuffix(suffix) for name in names if name.endswith(suffix))
        for names in frame["experiments"]
    ]
    methods = [
        plain_label(label, reading) if mine else label
        for label, mine in zip(frame["method"], own, strict=True)
    ]
    stands_for = {new: old for change in reading.changes for old, new in change.datasets.items()}
    what = list(
        zip(
            frame["dataset"].map(lambda name: stands_for.get(name, name)),
            frame["combination"],
            methods,
            strict=True,
        )
    )
    replaced = {(name, *row) for names, row in zip(own, what, strict=True) for name in names}
    without = {pair for change in reading.changes for pair in change.without.items()}
    rows = zip(own, frame["experiments"], frame["dataset"], what, strict=True)
    ids = [(*mine, *_list_kept(names, dataset, row, replaced, without)) for mine, names, dataset, row in rows]
    chosen = _take(frame.assign(method=methods), ids)
    if any(change.solvable for change in reading.changes):
        chosen = chosen[(chosen["correct"] > 0) | (chosen["error"] != "")]
    return chosen


def select_times(timing: pd.DataFrame, reading: Reading | None = None) -> pd.DataFrame:
    """Keep the times of the default, or put a reading's in their place.

    Parameters
    ----------
    timing : DataFrame
        Times of the timing experiment.
    reading : Reading, optional
        Which; none for the default.

    Returns
    -------
    DataFrame
        Where a method has the times of another, only at the sizes at which that one has been timed.
    """
    for change in () if reading is None else reading.changes:
        for method, other in change.times.items():
            found = timing[timing["method"] == other].assign(method=method)
            rest = timing[(timing["method"] != method) & timing["n"].isin(found["n"])]
            timing = found if rest.empty else _concat(rest, found)
    return timing


def find_average(reading: Reading) -> Average:
    """Find how a reading averages pairs.

    Parameters
    ----------
    reading : Reading
        Which.

    Returns
    -------
    "macro", "pooled" or "f_of_means"
        Of several readings together, what the last one that differs from the default has.
    """
    averages = [change.average for change in reading.changes if change.average != "macro"]
    return averages[-1] if averages else "macro"


def _concat(*frames: pd.DataFrame) -> pd.DataFrame:
    import pandas as pd  # noqa: PLC0415 - slow to load

    return pd.concat(frames, ignore_index=True)


def _list_kept(
    names: tuple[str, ...],
    dataset: str,
    row: tuple[Hashable, ...],
    replaced: set[tuple[Hashable, ...]],
    without: set[tuple[str, str]],
) -> Iterator[str]:
    """Experiments for which a record of the default goes on to speak."""
    for name in names:
        if SEPARATOR not in name and (name, *row) not in replaced and (name, dataset) not in without:
            yield name


def _take(frame: pd.DataFrame, ids: list[tuple[str, ...]]) -> pd.DataFrame:
    """Keep the records that speak for an experiment, and name those that they speak for."""
    chosen = frame.assign(experiments=ids)
    return chosen[[bool(names) for names in ids]]
