"""Facts about pairs, measured again with the bounds of a reading."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup.datasets import open_dataset

if TYPE_CHECKING:
    from pathlib import Path

    import pandas as pd

    from cgroup.benchmark.readings.reading import Reading


def measure_again(frame: pd.DataFrame, reading: Reading, root: Path | None) -> pd.DataFrame:
    """Measure facts about pairs as a reading has it.

    Parameters
    ----------
    frame : DataFrame
        Records.
    reading : Reading
        Which.
    root : Path, optional
        Folder that holds the data sets' folders; by default that in the environment variable ``CGROUP_DATA``.

    Returns
    -------
    DataFrame
        The records, with the facts of the reading in the place of those measured by default; those of pairs
        that a nuisance changed stay, and those of data sets that don't measure it.

    Raises
    ------
    InputError
        If a pair isn't there any more.
    """
    if frame.empty:
        return frame
    for change in reading.changes:
        for fact, bound in change.facts.items():
            # A nuisance changes a pair, and what a data set has is the pair before it.
            chosen = frame[fact].notna() & (frame["nuisance"] == "")
            values = frame[fact].copy()
            values[chosen] = _measure(frame[chosen], fact, bound, root)
            frame = frame.assign(**{fact: values.fillna(frame[fact])})
    return frame


def _measure(frame: pd.DataFrame, fact: str, bound: float, root: Path | None) -> list[float]:
    """Return the fact about the pair of each record; NaN where its data set doesn't measure it."""
    datasets = {name: open_dataset(name, root) for name in frame["dataset"].unique()}
    rows = list(zip(frame["dataset"], frame["pair"], strict=True))
    facts = {(name, pair): datasets[name].measure_facts(pair, bound=bound) for name, pair in set(rows)}
    return [facts[row].get(fact, np.nan) for row in rows]
