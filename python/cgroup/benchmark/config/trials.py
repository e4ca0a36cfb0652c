"""The table of a configuration that compares grouping methods on matches of any kind."""

from __future__ import annotations

import itertools
from typing import Annotated

from pydantic import BeforeValidator, Field, model_validator

from cgroup.benchmark.cases import COMBINATIONS, DENSE_MATCHES
from cgroup.benchmark.config.entries import Methods
from cgroup.benchmark.config.table import Positive, Table, as_list
from cgroup.datasets.generated_matches import Recipe, read_recipe
from cgroup.errors import InputError
from cgroup.evaluation.protocols import PROTOCOLS
from cgroup.registry import PRESETS

FEWEST = 4
"""Generated problems with fewer right matches, but not none, are left out: hardly anything fixes a pose."""

Count = Annotated[int, Field(ge=0)]
Counts = Annotated[tuple[Count, ...], BeforeValidator(as_list), Field(min_length=1)]
Shares = Annotated[
    tuple[Annotated[float, Field(ge=0, le=1)], ...], BeforeValidator(as_list), Field(min_length=1)
]
Lengths = Annotated[
    tuple[Annotated[float, Field(ge=0, allow_inf_nan=False)], ...],
    BeforeValidator(as_list),
    Field(min_length=1),
]
Names = Annotated[tuple[str, ...], BeforeValidator(as_list), Field(min_length=1)]


class GridEntry(Table):
    """Generated problems: every combination of the values.

    Attributes
    ----------
    n : tuple of int
        Numbers of matches.
    inliers : tuple of float
        Shares of right ones; with 0 there is nothing to be found.
    noise : tuple of float
        Standard deviation of the right ones per axis, in pr.
    scene : tuple of str
        What wrong matches are like: "uniform", "second-pose", "planes", "mirror", "one-to-three".
    frames : tuple of str
        How good the local reference frames are: "good", "bad", "none".
    repeats : int
        Problems of each kind.

    Raises
    ------
    pydantic.ValidationError
        For an unknown key, or a value of another type or out of range.

    Examples
    --------
    >>> from cgroup.benchmark.config import GridEntry
    >>> len(GridEntry(n=[200, 1000], inliers=[0.1, 0.3], repeats=3).recipes())
    12
    """

    n: Counts = (1000,)
    inliers: Shares = (0.1,)
    noise: Lengths = (1.5,)
    scene: Names = ("uniform",)
    frames: Names = ("good",)
    repeats: Annotated[int, Field(ge=1)] = 1

    @model_validator(mode="after")
    def _fits(self) -> GridEntry:
        for recipe in self.recipes():
            read_recipe(recipe.name)
        return self

    def recipes(self) -> list[Recipe]:
        """List all combinations that have enough right matches or none, small ones first.

        Returns
        -------
        list of Recipe
            What `cgroup.datasets.make_scene` draws each problem from.

        Examples
        --------
        >>> from cgroup.benchmark.config import GridEntry
        >>> [recipe.n for recipe in GridEntry(n=[1000, 200], inliers=0.1).recipes()]
        [200, 1000]
        """
        kinds = itertools.product(
            sorted(self.n), self.inliers, self.noise, self.scene, self.frames, range(self.repeats)
        )
        made = (Recipe(scene, n, share, noise, frames, i) for n, share, noise, scene, frames, i in kinds)
        return [each for each in made if each.inliers == 0 or round(each.inliers * each.n) >= FEWEST]


class TrialSetEntry(Table):
    """Problems that stand in one table of the comparison.

    Attributes
    ----------
    id : str
        Names the table.
    dataset : tuple of str
        Built-in names or ``module:attribute``; empty for a `grid`.
    grid : GridEntry, optional
        Generated problems in place of a data set.
    matches : str
        How clouds are matched: C1 to C6 (Harris 3D with SHOT, LFSH, RCS, then ISS with the same three), or
        voxels described by FPFH: "nearest", "mutual", "three nearest", "nearest, unit length"; ready-made
        matches take none.
    voxel : float, optional
        Edge length of the voxels of dense matches, in the data's unit; chosen for each pair by
        `cgroup.features.choose_voxel` by default.
    epsilon : float
        A match is correct when it misses its place by at most so many times the matches' resolution.
    loose, strict : str
        Names in `cgroup.evaluation.PROTOCOLS`: limits of a pose that counts as registered, and as accurate.
    preset : str
        One of `cgroup.registry.PRESETS`; options of the configuration win over it.
    pairs : int or tuple of str, optional
        At most so many pairs, drawn at random by the seed, or those named; all by default.
    whole : int, optional
        Pairs of the whole test set that `pairs` are of; the report names a share of it as one.
    mirrored, mixed : int
        At most so many of these pairs with a mirrored target, and of pairs of different subjects.
    methods : tuple of MethodEntry, optional
        In place of the configuration's.

    Raises
    ------
    pydantic.ValidationError
        For an unknown key, a value of another type or out of range, an unknown name, both or neither of
        `dataset` and `grid`, or a voxel for matches that take none.

    Examples
    --------
    >>> from cgroup.benchmark.config import TrialSetEntry
    >>> entry = TrialSetEntry(
    ...     id="stones", dataset="standin-views", matches="C1", pairs=4
    ... )
    >>> entry.loose, entry.preset
    ('5deg+5pr', 'paper')
    """

    id: str
    dataset: Annotated[tuple[str, ...], BeforeValidator(as_list)] = ()
    grid: GridEntry | None = None
    matches: str = ""
    voxel: Positive | None = None
    epsilon: Positive = 5.0
    loose: str = "5deg+5pr"
    strict: str = "2deg+2pr"
    preset: str = "paper"
    pairs: Annotated[int, Field(ge=1)] | tuple[str, ...] | None = None
    whole: Annotated[int, Field(ge=1)] | None = None
    mirrored: Count = 0
    mixed: Count = 0
    methods: Methods | None = None

    @model_validator(mode="after")
    def _fits(self) -> TrialSetEntry:
        if bool(self.dataset) == bool(self.grid):
            message = "dataset, grid: give one of the two"
            raise InputError(message)
        known: dict[str, tuple[str, ...]] = {
            "matches": ("", *COMBINATIONS, *DENSE_MATCHES),
            "preset": tuple(PRESETS),
            "loose": (rotating := tuple(p.name for p in PROTOCOLS.values() if p.max_rotation is not None)),
            "strict": rotating,
        }
        for name, choices in known.items():
            if (given := getattr(self, name)) not in choices:
                message = f"{name}: got {given!r}; choose one of {', '.join(filter(None, choices))}"
                raise InputError(message)
        if self.voxel is not None and self.matches not in DENSE_MATCHES:
            message = f"voxel: only for dense matches: {', '.join(DENSE_MATCHES)}"
            raise InputError(message)
        return self


class TrialsEntry(Table):
    """Grouping methods, each run alone on every problem.

    Attributes
    ----------
    threads : tuple of int
        Numbers of threads, each of them for every call; 0 for all cores.
    limit : float
        Seconds after which a call is given up.
    methods : tuple of MethodEntry, optional
        In place of the configuration's.
    sets : tuple of TrialSetEntry
        Which problems.

    Raises
    ------
    pydantic.ValidationError
        For an unknown key, a value of another type or out of range, or two sets of one id.

    Examples
    --------
    >>> from cgroup.benchmark.config import TrialsEntry
    >>> entry = TrialsEntry(
    ...     sets=[{"id": "easy", "grid": {"n": 200, "inliers": 0.3}}], limit=10
    ... )
    >>> entry.threads, entry.sets[0].grid.n
    ((1,), (200,))
    """

    threads: Annotated[tuple[Count, ...], BeforeValidator(as_list), Field(min_length=1)] = (1,)
    limit: Positive = 60.0
    methods: Methods | None = None
    sets: Annotated[tuple[TrialSetEntry, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _fits(self) -> TrialsEntry:
        ids = [each.id for each in self.sets]
        if len(set(ids)) < len(ids):
            message = f"sets: {', '.join(ids)}; give each an id of its own"
            raise InputError(message)
        return self
