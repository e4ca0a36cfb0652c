"""The table of a configuration that compares ways to register two clouds."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, Field, model_validator

from cgroup.benchmark.config.table import Positive, Table, as_list
from cgroup.benchmark.pipelines import Pipeline, make_pipeline
from cgroup.errors import InputError
from cgroup.evaluation.protocols import PROTOCOLS


class PipelineEntry(Table):
    """A way to register, its options, and the label that tells it from its variants.

    Attributes
    ----------
    name : str
        One of `cgroup.benchmark.pipelines.PIPELINES`, or ``module:function``.
    label : str
        Name in tables and figures; the name by default.
    options : dict
        Keyword arguments.
    refined : bool
        Whether small_gicp refines its pose.

    Raises
    ------
    pydantic.ValidationError
        For an unknown key, pipeline or option, or a value of another type.

    Examples
    --------
    >>> from cgroup.benchmark.config import PipelineEntry
    >>> PipelineEntry(name="cgroup", label="quick", options={"effort": "low"}).refined
    False
    """

    name: str
    label: str = ""
    options: dict[str, Any] = Field(default_factory=dict[str, Any])
    refined: bool = False

    @model_validator(mode="before")
    @classmethod
    def _from_name(cls, value: object) -> object:
        return {"name": value} if isinstance(value, str) else value

    @model_validator(mode="after")
    def _exists(self) -> PipelineEntry:
        self.pipeline()
        return self

    def pipeline(self) -> Pipeline:
        """Return what the runner runs.

        Returns
        -------
        Pipeline
            The way to register with its options; its name stands for a label that isn't given.

        Raises
        ------
        InputError
            For a function that can't be imported any more.

        Examples
        --------
        >>> from cgroup.benchmark.config import PipelineEntry
        >>> PipelineEntry(name="cgroup").pipeline().label
        'cgroup'
        """
        return make_pipeline(self.label, self.name, self.options, refined=self.refined)


Count = Annotated[int, Field(ge=0)]


class PairSetEntry(Table):
    """Pairs that stand in one column of the comparison.

    Attributes
    ----------
    id : str
        Names the column.
    dataset : tuple of str
        Built-in names or ``module:attribute``; of clouds, not of ready-made correspondences.
    loose, strict : str
        Names in `cgroup.evaluation.PROTOCOLS`: limits of a pose that counts as right, and as accurate.
    pairs : int or tuple of str, optional
        At most so many pairs, drawn at random by the seed, or those named; all by default.
    mirrored, mixed : int
        At most so many of these pairs with a mirrored target, and of pairs of different subjects; drawn by
        the seed.
    voxel : float, optional
        Edge length of the voxels in the data's unit; chosen for each pair by
        `cgroup.features.choose_voxel` by default.
    split_overlap : float, optional
        Pairs that overlap less stand in a column of their own.
    without : tuple of str
        Labels of pipelines that are not run on them.

    Raises
    ------
    pydantic.ValidationError
        For an unknown key, a value of another type or out of range, or a protocol without a limit of the
        rotation.

    Examples
    --------
    >>> from cgroup.benchmark.config import PairSetEntry
    >>> entry = PairSetEntry(
    ...     id="stones", dataset="standin-views", loose="5deg+5pr", strict="2deg+2pr"
    ... )
    >>> entry.mirrored, entry.voxel
    (0, None)
    """

    id: str
    dataset: Annotated[tuple[str, ...], BeforeValidator(as_list), Field(min_length=1)]
    loose: str
    strict: str
    pairs: Annotated[int, Field(ge=1)] | tuple[str, ...] | None = None
    mirrored: Count = 0
    mixed: Count = 0
    voxel: Positive | None = None
    split_overlap: Annotated[float, Field(gt=0, lt=1)] | None = None
    without: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _fits(self) -> PairSetEntry:
        for name in (self.loose, self.strict):
            if name not in PROTOCOLS or PROTOCOLS[name].max_rotation is None:
                known = (each.name for each in PROTOCOLS.values() if each.max_rotation is not None)
                message = f"loose, strict: got {name!r}; choose a limit of the rotation: {', '.join(known)}"
                raise InputError(message)
        return self


class RegistrationEntry(Table):
    """Ways to register two clouds, each run alone on every pair.

    Attributes
    ----------
    threads : int
        Threads for each.
    pipelines : tuple of PipelineEntry
        Which ways.
    sets : tuple of PairSetEntry
        Which pairs.

    Raises
    ------
    pydantic.ValidationError
        For an unknown key, a value of another type or out of range, or two sets or pipelines of one name.

    Examples
    --------
    >>> from cgroup.benchmark.config import RegistrationEntry
    >>> stones = {
    ...     "id": "stones",
    ...     "dataset": "standin-views",
    ...     "loose": "5deg+5pr",
    ...     "strict": "2deg+2pr",
    ... }
    >>> entry = RegistrationEntry(pipelines=["cgroup", "cgroup-paper"], sets=[stones])
    >>> [pipeline.name for pipeline in entry.pipelines], entry.threads
    (['cgroup', 'cgroup-paper'], 2)
    """

    threads: Annotated[int, Field(ge=1)] = 2
    pipelines: Annotated[tuple[PipelineEntry, ...], Field(min_length=1)]
    sets: Annotated[tuple[PairSetEntry, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _fits(self) -> RegistrationEntry:
        ids = [each.id for each in self.sets]
        if len(set(ids)) < len(ids):
            message = f"sets: {', '.join(ids)}; give each an id of its own"
            raise InputError(message)
        labels = [entry.pipeline().label for entry in self.pipelines]
        if len(set(labels)) < len(labels):
            message = f"pipelines: {', '.join(labels)}; give each variant a label of its own"
            raise InputError(message)
        unknown = [label for each in self.sets for label in each.without if label not in labels]
        if unknown:
            message = f"sets: without {unknown[0]!r}, but the pipelines are {', '.join(labels)}"
            raise InputError(message)
        return self
