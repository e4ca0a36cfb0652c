"""Tables of a configuration: methods, sets of problems, and comparisons."""

import itertools
import json
from collections.abc import Iterable, Sequence
from typing import Annotated, Any, ClassVar, Literal, TypeAlias, TypeVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from cgroup._checks.values import LARGEST_COUNT
from cgroup.benchmark.problem import COMBINATIONS, DENSE_MATCHES, Task
from cgroup.benchmark.solver import Solver, SolverKind, make_solver
from cgroup.datasets.generated_matches import Recipe, read_recipe
from cgroup.errors import InputError
from cgroup.evaluation.protocols import PROTOCOLS
from cgroup.registry import METHODS, PAPER_METHODS, PRESETS

# Names of several methods together: the nine of the paper, and all
METHOD_SETS = {"paper": PAPER_METHODS, "all": tuple(METHODS)}
FEWEST = 4  # generated problems with 1 to 3 correct matches are left out: these fix no pose


class Table(BaseModel):
    """Table of a configuration; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def as_list(value: object) -> object:
    """Return a single value as a list of one."""
    return [value] if isinstance(value, (str, int, float)) else value


def _expand_method_sets(value: object) -> object:
    """Replace names of method sets by the names of their methods; other values are validated later."""
    entries = [value] if isinstance(value, str) else value
    if not isinstance(entries, list):
        return entries
    known = (METHOD_SETS.get(each.strip().casefold()) if isinstance(each, str) else None for each in entries)
    return [name for entry, names in zip(entries, known, strict=True) for name in names or (entry,)]


def _one_of(choices: Iterable[str], what: str = "one of ") -> AfterValidator:
    def check(value: str) -> str:
        if value not in choices:
            raise InputError(f"got {value!r}; choose {what}{', '.join(filter(None, choices))}")
        return value

    return AfterValidator(check)


Item = TypeVar("Item")
Several: TypeAlias = Annotated[tuple[Item, ...], BeforeValidator(as_list), Field(min_length=1)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0)]
Seed = Annotated[int, Field(ge=0, le=LARGEST_COUNT)]
AtLeastOne = Annotated[int, Field(ge=1)]
Share = Annotated[float, Field(ge=0, le=1)]
_ROTATING = [name for name, each in PROTOCOLS.items() if each.max_rotation is not None]
RotationLimit = Annotated[str, _one_of(_ROTATING, "a limit of the rotation: ")]


class MethodEntry(Table):
    """A grouping method with its options; variants of a method differ in their labels."""

    kind: ClassVar[SolverKind] = "method"
    name: str
    label: str = ""
    options: dict[str, Any] = Field(default_factory=dict[str, Any])

    @model_validator(mode="before")
    @classmethod
    def _from_name(cls, value: object) -> object:
        return {"name": value} if isinstance(value, str) else value

    @model_validator(mode="after")
    def _exists(self) -> "MethodEntry":
        self.solver()
        return self

    def solver(self) -> Solver:
        """Make the solver; an empty label is replaced by the name."""
        refined = getattr(self, "refined", False)
        return make_solver(self.kind, self.label, self.name, self.options, refined=refined)


class PipelineEntry(MethodEntry):
    """A pipeline that registers two clouds."""

    kind: ClassVar[SolverKind] = "pipeline"
    refined: bool = False


class SceneSolverEntry(MethodEntry):
    """A pipeline that registers many scans."""

    kind: ClassVar[SolverKind] = "scene solver"


Methods = Annotated[tuple[MethodEntry, ...], BeforeValidator(_expand_method_sets), Field(min_length=1)]


class FrontEntry(Table):
    """Changes to the paper's front end in an experiment; lengths in pr."""

    matching: Literal["nearest", "mutual"] = "nearest"
    normals: Literal["mesh", "pca"] | None = None
    frames: Literal["shot", "toldi"] = "shot"
    harris_radius: Positive | None = None
    iss_radii: tuple[Positive, Positive] | None = None
    resolution: Literal["pair", "undisturbed", "source", "target"] = "pair"
    similarity: Literal["unit", "raw"] = "unit"

    def changes(self, detector: str, nuisance: str) -> str:
        """Return the differences from the default as JSON with sorted keys; empty without differences.

        Radii of another detector are no difference, nor is the resolution before a nuisance if there is none.
        """
        without = {"iss_radii" if detector == "h3d" else "harris_radius"}
        if not nuisance and self.resolution == "undisturbed":
            without.add("resolution")
        changed = self.model_dump(mode="json", exclude=without, exclude_defaults=True)
        return json.dumps(changed, sort_keys=True) if changed else ""


class SetEntry(Table):
    """A set of problems."""

    task: ClassVar[Task]
    id: str
    dataset: Several[str]


class PairsEntry(SetEntry):
    """A set of problems that are pairs of data sets."""

    pairs: AtLeastOne | tuple[str, ...] | None = None


class ExperimentEntry(PairsEntry):
    """Pairs at every level and combination, for grouping methods; entries may share an id."""

    task: ClassVar[Task] = "experiment"
    nuisance: str = ""
    levels: tuple[float, ...] = ()
    sweep: Literal["nms_radius"] | None = None
    combinations: Several[Annotated[str, _one_of(COMBINATIONS)]] = ("C1",)
    front: FrontEntry = FrontEntry()
    epsilons: Several[Positive] = (5.0,)
    limit: Positive = 600.0
    methods: Methods | None = None

    @model_validator(mode="after")
    def _fits(self) -> "ExperimentEntry":
        if self.nuisance and self.sweep:
            raise InputError("nuisance, sweep: the levels can belong to one of them only")
        if bool(self.levels) != bool(self.nuisance or self.sweep):
            raise InputError("levels: needed with a nuisance or a sweep, and only there")
        if self.sweep and min(self.levels) <= 0:
            raise InputError(f"levels: got {min(self.levels)}; a radius is greater than 0")
        return self


class UnrelatedSetEntry(PairsEntry):
    """Pairs, and numbers of mirrored and mixed ones; poses are judged by two limits."""

    loose: RotationLimit
    strict: RotationLimit
    voxel: Positive | None = None
    mirrored: Count = 0
    mixed: Count = 0


class PairSetEntry(UnrelatedSetEntry):
    """Pairs of clouds to register."""

    task: ClassVar[Task] = "registration"
    split_overlap: Annotated[float, Field(gt=0, lt=1)] | None = None
    without: tuple[str, ...] = ()


class SceneSetEntry(SetEntry):
    """Scans of all these places, mixed; a new random set per seed."""

    task: ClassVar[Task] = "scenes"
    mirrored: bool = False
    seeds: Annotated[tuple[Seed, ...], BeforeValidator(as_list)] = ()


class GridEntry(Table):
    """Generated matches, one problem per combination of the values."""

    n: Several[Count] = (1000,)
    inliers: Several[Share] = (0.1,)
    noise: Several[Annotated[float, Field(ge=0, allow_inf_nan=False)]] = (1.5,)
    scene: Several[str] = ("uniform",)
    frames: Several[str] = ("good",)
    repeats: AtLeastOne = 1

    @model_validator(mode="after")
    def _fits(self) -> "GridEntry":
        for recipe in self.recipes():
            read_recipe(recipe.name)
        return self

    def recipes(self) -> list[Recipe]:
        """List the combinations with enough correct matches or with none, small ones first."""
        kinds = itertools.product(
            sorted(self.n), self.inliers, self.noise, self.scene, self.frames, range(self.repeats)
        )
        made = (Recipe(scene, n, share, noise, frames, i) for n, share, noise, scene, frames, i in kinds)
        return [each for each in made if each.inliers == 0 or round(each.inliers * each.n) >= FEWEST]


class TrialSetEntry(UnrelatedSetEntry):
    """Matches of any kind; methods are ranked on each set."""

    task: ClassVar[Task] = "matches"
    dataset: Annotated[tuple[str, ...], BeforeValidator(as_list)] = ()
    grid: GridEntry | None = None
    matches: Annotated[str, _one_of(("", *COMBINATIONS, *DENSE_MATCHES))] = ""
    epsilon: Positive = 5.0
    loose: RotationLimit = "5deg+5pr"
    strict: RotationLimit = "2deg+2pr"
    preset: Annotated[str, _one_of(PRESETS)] = "paper"
    whole: AtLeastOne | None = None
    methods: Methods | None = None

    @model_validator(mode="after")
    def _fits(self) -> "TrialSetEntry":
        if bool(self.dataset) == bool(self.grid):
            raise InputError("dataset, grid: give one of the two")
        if self.voxel is not None and self.matches not in DENSE_MATCHES:
            raise InputError(f"voxel: only for dense matches: {', '.join(DENSE_MATCHES)}")
        return self


class TimingEntry(Table):
    """The paper's timing experiment: growing numbers of matches from one pair, one method at a time."""

    task: ClassVar[Task] = "timing"

    dataset: Several[str]
    pair: str | None = None
    sizes: tuple[Annotated[int, Field(ge=3)], ...] = (500, 1000, 2000, 3000, 5000, 10_000, 20_000)
    repeats: AtLeastOne = 10
    threads: Several[Count] = (1, 0)
    budget: Positive = 60.0
    methods: Methods | None = None


class RegistrationEntry(Table):
    """Comparison of pipelines, run one at a time on every pair."""

    threads: AtLeastOne = 2
    limit: Positive = 600.0
    pipelines: Several[PipelineEntry]
    sets: Several[PairSetEntry]

    @model_validator(mode="after")
    def _fits(self) -> "RegistrationEntry":
        labels = _refuse_twins(self.sets, self.pipelines, "pipelines")
        for label in (label for each in self.sets for label in each.without if label not in labels):
            raise InputError(f"sets: without {label!r}, but the pipelines are {', '.join(labels)}")
        return self


class ScenesEntry(Table):
    """Comparison of pipelines for many scans, run one at a time on every bag of scans."""

    threads: AtLeastOne = 2
    limit: Positive = 600.0
    solvers: Several[SceneSolverEntry]
    sets: Several[SceneSetEntry]

    @model_validator(mode="after")
    def _fits(self) -> "ScenesEntry":
        _refuse_twins(self.sets, self.solvers, "solvers")
        return self


class TrialsEntry(Table):
    """Comparison of grouping methods, run one at a time on every set of matches."""

    threads: Several[Count] = (1,)
    limit: Positive = 60.0
    methods: Methods | None = None
    sets: Several[TrialSetEntry]

    @model_validator(mode="after")
    def _fits(self) -> "TrialsEntry":
        _refuse_twins(self.sets, (), "methods")
        return self


def _refuse_twins(sets: Sequence[SetEntry], solvers: Sequence[MethodEntry], what: str) -> list[str]:
    """Return the labels; raise if two sets have the same id, or two solvers the same label."""
    labels = [entry.solver().label for entry in solvers]
    checks = (("sets", [each.id for each in sets], "each an id"), (what, labels, "each variant a label"))
    for names, given, wanted in checks:
        if len(set(given)) < len(given):
            raise InputError(f"{names}: {', '.join(given)}; give {wanted} of its own")
    return labels
