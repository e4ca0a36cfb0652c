"""Data sets that a configuration names, and the pairs that are drawn from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

from cgroup.benchmark.cases import keyed_rng
from cgroup.datasets import open_dataset
from cgroup.errors import InputError
from cgroup.evaluation.protocols import PROTOCOLS

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from cgroup.datasets import Dataset

Item = TypeVar("Item")


@dataclass(frozen=True)
class DatasetFacts:
    """What records and figures say about a data set.

    Attributes
    ----------
    name, title, role, origin, citation : str
        As the data set has them; the name is the one that the configuration uses.
    pairs : dict of str to (str, tuple of str)
        Of each pair that is used: its origin, and the registration protocols that make sense for it.
    """

    name: str
    title: str
    role: str
    origin: str
    citation: str
    pairs: dict[str, tuple[str, tuple[str, ...]]]


class OpenDatasets:
    """Data sets, opened once.

    Parameters
    ----------
    root : path, optional
        Folder with the data; the environment says by default.

    Attributes
    ----------
    found : dict of str to Dataset
        Those that are at hand.
    pairs : dict of str to list of str
        Names of their pairs.
    lacking : dict of str to set of str
        Names of pairs of which files aren't there.
    missing : dict of str to str
        Why others aren't at hand, and what those that are lack.
    """

    def __init__(self, root: Path | None) -> None:
        self._root = root
        self.found: dict[str, Dataset] = {}
        self.pairs: dict[str, list[str]] = {}
        self.lacking: dict[str, set[str]] = {}
        self.missing: dict[str, str] = {}

    def open(self, name: str) -> bool:
        """Open a data set unless that has been tried; return whether it is at hand."""
        if name not in self.found and name not in self.missing:
            try:
                dataset = open_dataset(name, self._root)
                self.pairs[name] = dataset.pair_names()
                self.lacking[name] = set(dataset.lacking_pairs())
                self.found[name] = dataset
                if note := dataset.note():
                    self.missing[name] = note
            except InputError as error:
                self.missing[name] = str(error)
        return name in self.found


def draw_pairs(
    where: str, wanted: int | tuple[str, ...] | None, name: str, opened: OpenDatasets, seed: int
) -> list[str]:
    """Choose pairs of a data set; a smaller draw is part of every larger one, so that cases are shared.

    Parameters
    ----------
    where : str
        What wants them, for the error.
    wanted : int or tuple of str, optional
        How many, or which; all by default.
    name : str
        Of the data set.
    opened : OpenDatasets
        What it has.
    seed : int
        Of the draw.

    Returns
    -------
    list of str
        In the data set's order, unless they are named; without those of which files aren't there.

    Raises
    ------
    InputError
        If a pair is named that doesn't exist.
    """
    pairs = opened.pairs[name]
    if wanted is None:
        return pairs
    if isinstance(wanted, int):
        return draw("pairs", wanted, pairs, seed, name)
    unknown = [pair for pair in wanted if pair not in pairs and pair not in opened.lacking[name]]
    if unknown:
        message = f"{where}: {name} has no pair {unknown[0]!r}; the first is {pairs[0]!r}"
        raise InputError(message)
    return [pair for pair in wanted if pair in pairs]


def draw(purpose: str, count: int, items: Sequence[Item], seed: int, name: str) -> list[Item]:
    """Draw some of a data set's items without replacement, in their order; all if there are fewer."""
    order = keyed_rng(purpose, seed, name).permutation(len(items))
    return [items[i] for i in sorted(order[:count])]


def describe_dataset(name: str, dataset: Dataset, used: Iterable[str]) -> DatasetFacts:
    """Collect what is said about a data set of which some pairs are used.

    Raises
    ------
    InputError
        If it names a protocol that doesn't exist.
    """
    return DatasetFacts(
        name,
        dataset.title,
        dataset.role,
        dataset.origin,
        dataset.citation,
        {pair: (dataset.origin_of(pair), _check_protocols(dataset, pair)) for pair in sorted(used)},
    )


def _check_protocols(dataset: Dataset, pair: str) -> tuple[str, ...]:
    names = dataset.protocols_of(pair)
    unknown = [name for name in names if name not in PROTOCOLS]
    if unknown:
        message = f"{dataset.name}: there is no protocol {unknown[0]!r}; there are {', '.join(PROTOCOLS)}"
        raise InputError(message)
    return names
