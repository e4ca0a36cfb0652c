"""The options of every method are those that the compiled core describes."""

import inspect
import typing
from typing import Any, Literal

import pytest
from public_calls import PROBLEM
from wrong_values import wrong_for

import cgroup
from cgroup._checks.fields import FIELDS
from cgroup._checks.run_options import RunOptions
from cgroup.errors import InputError
from cgroup.methods import types
from cgroup.registry import METHOD_INFO, MethodInfo, MethodOption

EVERY = pytest.mark.parametrize("info", METHOD_INFO.values(), ids=lambda info: info.name)
OPTIONS = [(info, name) for info in METHOD_INFO.values() for name in info.options]
TYPES = {
    "flag": bool,
    "seed": int,
    "count": int,
    "rounds": int,
    "length": float,
    "number": float,
    "scale": bool | tuple[float, float],
}


@EVERY
def test_the_signature_has_what_the_core_describes(info: MethodInfo) -> None:
    control = {*RunOptions._fields}
    parameters = inspect.signature(info.function).parameters.values()
    written = [(p.name, p.default) for p in parameters if p.name not in {*FIELDS, *control}]
    described = [(name, option.default) for name, option in info.options.items()]
    assert written == described
    assert [type(default) for _, default in written] == [type(default) for _, default in described]


@EVERY
def test_annotations_tell_what_the_core_takes(info: MethodInfo) -> None:
    names = {**vars(types), "AnyCloud": Any, "ArrayLike": Any, "Grouping": cgroup.Grouping}
    hints = typing.get_type_hints(info.function, localns=names)
    for name, option in info.options.items():
        assert hints[name] == annotation(option), name


def annotation(option: MethodOption) -> Any:
    """Return the type of an option's values."""
    if option.kind == "choice":
        return Literal[option.range]
    if option.kind == "cut":
        return float | Literal["otsu"]
    kind = TYPES[option.kind]
    return kind | None if option.optional else kind


@pytest.mark.parametrize(("info", "name"), OPTIONS, ids=lambda each: getattr(each, "name", each))
def test_values_out_of_range_are_refused(info: MethodInfo, name: str) -> None:
    for value in wrong_for(info.options[name]):
        with pytest.raises(InputError, match=rf"^{name}: got .+; \w+ ") as caught:
            cgroup.group(PROBLEM.correspondences(), info.name, **{name: value})
        assert caught.value.parameter == name
        assert caught.value.remedy


@pytest.mark.parametrize(("info", "name"), OPTIONS, ids=lambda each: getattr(each, "name", each))
def test_the_ends_of_a_range_belong_to_it(info: MethodInfo, name: str) -> None:
    option = info.options[name]
    ends = option.range if option.kind in {"number", "choice"} else option.range[:1]
    for value in (*ends, *([None] if option.optional else [])):
        assert refused_parameter(info.name, {name: value}) != name


def refused_parameter(method: str, options: dict[str, Any]) -> str | None:
    """Return which parameter a call refuses, such as a length that a variant needs."""
    try:
        cgroup.group(PROBLEM.correspondences(), method, **options)
    except InputError as error:
        return error.parameter
    return None
