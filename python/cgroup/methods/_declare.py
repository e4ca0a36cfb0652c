"""Functions of methods: parameters from the compiled core, texts from the files in this folder."""

import re
import textwrap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import wraps
from inspect import Parameter, Signature, cleandoc
from itertools import groupby
from types import MappingProxyType
from typing import Any, NamedTuple

from cgroup import _core
from cgroup._checks.calls import bind_arguments
from cgroup.methods._call import call
from cgroup.types import Grouping


class MethodOption(NamedTuple):
    """Option of a method, as described by the compiled core.

    Attributes
    ----------
    kind : str
        "flag"; "seed", "count" or "rounds" (whole numbers); "length" (data's unit), "number"; "choice";
        "cut" (a number, or "otsu"); or "scale" (a truth value, or two bounds).
    optional : bool
        Whether it may be None.
    default : bool, int, float, str or None
        Default value; None for a length that follows from another one.
    range : tuple
        The least and the greatest value, or the choices; empty if the kind determines them.
    text : str
        Description in Markdown.
    """

    kind: str
    optional: bool
    default: bool | float | str | None
    range: tuple[Any, ...]
    text: str


@dataclass(frozen=True)
class MethodInfo:
    """Facts about a method, except its parameters.

    Attributes
    ----------
    name : str
        Public name: the key of `METHODS`, of options and of records.
    function : callable
        The method.
    label, idea, complexity, citation : str
        Short name for figures and tables, how it groups, cost in the number n of matches, and source.
    color, marker : str
        How figures draw it, in matplotlib's notation.
    in_paper : bool
        Whether the evaluation of Yang et al., TPAMI 2019, compares it.
    individual : bool
        Whether it judges correspondences one by one (paper, section 3.1) rather than in groups (3.2).
    fields, optional_fields : tuple of str
        Fields of `Correspondences` that it needs, and fields that it uses if given.
    options : dict of str to MethodOption
        Options, in the signature's order.
    """

    name: str
    function: Callable[..., Grouping]
    label: str
    idea: str
    complexity: str
    color: str
    marker: str
    citation: str
    in_paper: bool
    individual: bool
    fields: tuple[str, ...]
    optional_fields: tuple[str, ...]
    options: Mapping[str, MethodOption]


DESCRIBED = dict(_core.describe_methods())  # fields, optional fields and options of each method
DECLARED: dict[str, MethodInfo] = {}  # methods by their public names

_POINTS = ("AnyCloud", "(n,3) array_like of float", "Matched points.")
_NUMBERS = ("ArrayLike", "(n,) array_like of float")
_AXES = "Local reference frames; rows are the x, y and z axes; NaN for no frame."
_FRAMES = ("ArrayLike", "(n,3,3) array_like of float", _AXES)
_FIELDS = {
    "source": _POINTS,
    "target": _POINTS,
    "similarity": (*_NUMBERS, "Descriptor similarity ``1 - |f_norm - f'_norm|``, higher is better."),
    "ratio": (*_NUMBERS, "Nearest / second-nearest descriptor distance, in [0,1], lower is better."),
    "source_lrf": _FRAMES,
    "target_lrf": _FRAMES,
    "resolution": ("float", "float", "Mean nearest-neighbour distance of the clouds."),
    "source_centroid": ("ArrayLike", "(3,) array_like of float", "Centroid of the whole source cloud."),
    "candidates": (
        "ArrayLike", "(n,k,3) array_like of float",
        "Target points that each source point may match, the likeliest first.",
    ),
}  # fmt: skip
"""Annotation, type in words, and meaning of each field."""

_CONTROLS = {
    "max_seconds": ("float | None", "float, optional", ""),
    "threads": ("int | None", "int, optional", "Number of threads, None for all. It changes no result."),
    "max_memory": (
        "int | None", "int, optional",
        "Bytes for pairwise matrices and graphs; by default a quarter of the free memory, at most 1.5 GiB.",
    ),
    "progress": (
        "Callable[[float], Any] | None", "callable, optional",
        "Called with the share of the work done, in [0,1]; an error that it raises ends the work.",
    ),
}  # fmt: skip
"""How a run is controlled: annotation, type in words, and meaning."""

_EXAMPLE = """\
>>> from cgroup.datasets import make_problem
>>> problem = make_problem(np.random.default_rng(0), 500, inlier_ratio={ratio})
>>> matches = problem.source, problem.target
{call}
>>> bool(problem.inlier_mask[group.mask].mean() > 0.7)
True"""
"""Example of a method that takes points."""

_NEEDED = ("ratio", "source_lrf", "target_lrf", "resolution")  # fields in the example, if a method has them

_CODE, _NAME = re.compile(r"`([^`]+)`"), re.compile(r"[\w.]+")

_KINDS = {
    "flag": ("bool", "bool"), "seed": ("int", "int"), "count": ("int", "int"), "rounds": ("int", "int"),
    "length": ("float", "float"), "number": ("float", "float"),
    "cut": ('float | Literal["otsu"]', 'float or "otsu"'),
    "scale": ("bool | tuple[float, float]", "bool or (float, float)"),
}  # fmt: skip
"""Annotation, and type in words, of the kinds of options; choices list their values."""


def method(
    name: str,
    facts: Mapping[str, tuple[str, str, str, str, str]],
    *,
    individual: bool = False,
    notes: Mapping[str, str] = MappingProxyType({}),
) -> Callable[[Callable[[], None]], Callable[..., Grouping]]:
    """Return a decorator that replaces a function without a body by that of a method.

    `facts` has by name the label, idea, complexity, color and marker, and citation of `MethodInfo`. `notes`
    add to the meaning of a field (of both frames: "lrf"), of `max_memory` and of `max_seconds`; the method
    takes the last two if there is a note. The last paragraph of the docstring describes the result; it lacks
    Parameters, the Examples of a method that takes points, and the imports of others.
    """
    label, idea, complexity, style, citation = facts[name]
    fields, optional_fields, options = DESCRIBED[name]
    described = {each: MethodOption(*what) for each, what in options.items()}
    controls = _controls(notes, has_progress="source" in fields)
    parameters = [*_fields(fields, optional_fields, notes), *_options(described), *controls]
    signature = Signature([each for each, _, _ in parameters], return_annotation="Grouping")

    def make(written: Callable[[], None]) -> Callable[..., Grouping]:
        in_paper = written.__module__.endswith(".paper")

        @wraps(written)
        def function(*given: Any, **named: Any) -> Grouping:  # noqa: ANN401 - as the core describes them
            return call(name, bind_arguments(function, signature, given, named))

        vars(function)["__signature__"] = signature
        function.__annotations__ = {each.name: each.annotation for each, _, _ in parameters}
        function.__doc__ = _complete(written, parameters, in_paper)
        drawn = style[:-2], style[-1]  # color and marker
        about = name, function, label, idea, complexity, *drawn, citation, in_paper, individual
        DECLARED[name] = MethodInfo(*about, tuple(fields), tuple(optional_fields), described)
        return function

    return make


_Described = tuple[Parameter, str, str]  # a parameter, its type in words, and its meaning


def _fields(fields: list[str], optional: list[str], notes: Mapping[str, str]) -> Iterator[_Described]:
    by_position = {"source", "target"} if "source" in fields else fields
    for name in (*fields, *optional):
        annotation, words, meaning = _FIELDS[name]
        kind = Parameter.POSITIONAL_OR_KEYWORD if name in by_position else Parameter.KEYWORD_ONLY
        default = Parameter.empty
        if name in optional:
            default, annotation, words = None, f"{annotation} | None", f"{words}, optional"
        note = notes.get("lrf" if name.endswith("_lrf") else name, "")
        parameter = Parameter(name, kind, default=default, annotation=annotation)
        yield parameter, words, f"{meaning} {note}".strip()


def _options(options: Mapping[str, MethodOption]) -> Iterator[_Described]:
    for name, option in options.items():
        annotation, words = _type_of(option)
        parameter = Parameter(name, Parameter.KEYWORD_ONLY, default=option.default, annotation=annotation)
        yield parameter, words, _in_docstring(option.text)


def _controls(notes: Mapping[str, str], *, has_progress: bool) -> Iterator[_Described]:
    taken = {"threads", *notes, *(["progress"] if has_progress else [])}
    for name, (annotation, words, meaning) in _CONTROLS.items():
        if name in taken:
            parameter = Parameter(name, Parameter.KEYWORD_ONLY, default=None, annotation=annotation)
            yield parameter, words, f"{meaning} {notes.get(name, '')}".strip()


def _type_of(option: MethodOption) -> tuple[str, str]:
    if option.kind == "choice":
        choices = ", ".join(f'"{one}"' if isinstance(one, str) else str(one) for one in option.range)
        return f"Literal[{choices}]", f"{{{choices}}}"
    annotation, words = _KINDS[option.kind]
    return (f"{annotation} | None", f"{words}, optional") if option.optional else (annotation, words)


def _in_docstring(markdown: str) -> str:
    """Return docstring markup: code in double backticks, names in single ones."""
    return _CODE.sub(lambda code: code[0] if _NAME.fullmatch(code[1]) else f"`{code[0]}`", markdown)


def _complete(written: Callable[[], None], parameters: list[_Described], in_paper: bool) -> str:  # noqa: FBT001
    """Return the docstring of a method with its Parameters, Returns and Examples."""
    name, taken = written.__name__, [each.name for each, _, _ in parameters]
    text, _, own = cleandoc(written.__doc__ or "").partition("\n\nExamples\n--------\n")
    head, _, result = text.rpartition("\n\n")
    entries = [
        f"{', '.join(each.name for each, _, _ in alike)} : {words}\n{_indented(meaning)}"
        for (words, meaning), alike in groupby(parameters, key=lambda entry: entry[1:])
    ]
    given = [f"{each}=problem.{each}" for each in _NEEDED if each in taken]
    call = f">>> group = {name}({', '.join(['*matches', *given])})"
    call = textwrap.fill(call, 80, subsequent_indent="...     ")
    example = own or _EXAMPLE.format(ratio=0.3 if in_paper else 0.05, call=call)
    sections = {"Parameters": "\n".join(entries), "Returns": f"Grouping\n{_indented(result)}"}
    sections["Examples"] = f">>> import numpy as np\n>>> from cgroup import {name}\n{example}"
    return "\n\n".join([head, *(f"{title}\n{'-' * len(title)}\n{text}" for title, text in sections.items())])


def _indented(text: str) -> str:
    return textwrap.fill(text, 100, initial_indent="    ", subsequent_indent="    ")
