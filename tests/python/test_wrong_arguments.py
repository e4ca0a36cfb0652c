"""Whatever a caller passes by mistake: an `InputError` that says what, got what, and what to do; or a result."""

import contextlib
import inspect
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from public_calls import PAIR, PROBLEM, Call, called_names, public_calls
from wrong_calls import drawn
from wrong_values import HUGE, WRONG, FloatLike

from cgroup import plots, registration
from cgroup.benchmark.solver import make_solver
from cgroup.errors import CgroupError, InputError
from cgroup.io import PointCloud

pytestmark = pytest.mark.usefixtures("elsewhere")  # as wrong values may be file names

LONGEST = 500
NAMES = sorted(called_names())


@pytest.fixture(scope="module")
def calls(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Call]:
    return public_calls(tmp_path_factory.mktemp("files"))


def parameters(call: Call) -> list[inspect.Parameter]:
    every = inspect.signature(call.function).parameters.values()
    return [parameter for parameter in every if parameter.kind is not parameter.VAR_KEYWORD]


def plain(parameter: inspect.Parameter) -> str:
    """Return the name of its type, whether or not it may be None."""
    return str(parameter.annotation).removesuffix(" | None")


def run(call: Call, parameter: inspect.Parameter, value: Any) -> str | None:
    """Call with a value; return what the error says, None where there is a result."""
    is_callback = parameter.name == "progress" and value is int  # whose own errors are the caller's
    given = [value] if parameter.kind is parameter.VAR_POSITIONAL else value
    try:
        call.run(**{parameter.name: print if is_callback else given})
    except CgroupError as error:
        return str(error)
    return None


@pytest.mark.parametrize(
    ("parameter", "call"),
    [
        ("models", lambda: registration.recognize({1: PAIR.source}, PAIR.target)),  # pyright: ignore[reportArgumentType]
        ("keypoints", lambda: plots.keypoints_figure(PROBLEM.source, {b"iss": [0]}, title="")),  # pyright: ignore[reportArgumentType]
        ("options", lambda: make_solver("method", "", "gc", {1: 2})),  # pyright: ignore[reportArgumentType]
        ("options", lambda: make_solver("pipeline", "", "cgroup", {1: 2})),  # pyright: ignore[reportArgumentType]
    ],
)
def test_names_that_are_no_text_are_refused(parameter: str, call: Callable[[], object]) -> None:
    with pytest.raises(
        InputError, match=f"^{parameter}: got the key .*, which is no text; give a dict of .* by "
    ):
        call()


@pytest.mark.parametrize(
    ("parameter", "call"),
    [
        ("models", lambda: registration.recognize({}, PAIR.target)),
        ("keypoints", lambda: plots.keypoints_figure(PROBLEM.source, {}, title="")),
        ("masks", lambda: drawn(correct=PROBLEM.inlier_mask, masks={})(plots.comparison_figure)),
    ],
)
def test_no_names_are_refused(parameter: str, call: Callable[[], object]) -> None:
    with pytest.raises(InputError, match=f"^{parameter}: got none; give a dict of .* by "):
        call()


def test_every_public_function_is_called(calls: dict[str, Call]) -> None:
    assert sorted(calls) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_a_wrong_value_is_refused_or_worked_with(calls: dict[str, Call], name: str) -> None:
    call = calls[name]
    call.run()
    for parameter in parameters(call):
        for value in WRONG.values():
            message = run(call, parameter, value)
            assert message is None or len(message) <= LONGEST
            assert message is None or name.startswith("io.") or message.isprintable()


@pytest.mark.parametrize("name", NAMES)
def test_an_object_is_refused_by_name(calls: dict[str, Call], name: str) -> None:
    call = calls[name]
    for parameter in parameters(call):
        message = run(call, parameter, object())
        assert message is not None, parameter.name
        assert all(part in message for part in (parameter.name, "got <object", ";")), message


@pytest.mark.parametrize("name", NAMES)
def test_masked_arrays_are_refused(calls: dict[str, Call], name: str) -> None:
    """Also those that hide nothing, and those within a list."""
    call = calls[name]
    for parameter in parameters(call):
        annotation = str(parameter.annotation)
        if "ArrayLike" not in annotation or "[" in annotation.partition("ArrayLike")[0]:
            continue
        whole = np.ma.asarray(np.asarray(call.arguments.get(parameter.name, np.zeros(3)), dtype=object))
        for masked in (whole, [whole], np.ma.asarray(np.zeros((12, 3))), [np.ma.masked]):
            message = run(call, parameter, masked)
            assert message is not None
            assert "masked" in message, parameter.name


@pytest.mark.parametrize("name", NAMES)
def test_one_rule_for_numbers_counts_and_flags(calls: dict[str, Call], name: str) -> None:
    strange: list[Any] = ["1", b"1", 1j, np.array(True), np.array([1]), [1], FloatLike(), {}]
    strange += [WRONG["Decimal"], WRONG["datetime64"]]
    refused = {
        "float": [*strange, True, np.True_, HUGE, Fraction(HUGE)],
        "int": [*strange, True, np.True_, 1.0, np.float64(1), Fraction(1), HUGE, -1],
        "bool": [*strange, 0, 1, np.int64(1), 1.0],
    }
    call = calls[name]
    for parameter in parameters(call):
        for value in refused.get(plain(parameter), []):
            message = run(call, parameter, value)
            assert message is not None, f"{parameter.name}={value!r}"
            assert message.startswith(f"{parameter.name}: got ")


@pytest.mark.parametrize("name", NAMES)
def test_scalars_of_numpy_are_what_they_stand_for(calls: dict[str, Call], name: str) -> None:
    same = {
        "int": [np.int64, np.uint32, np.intp, np.array],
        "float": [np.float64, np.float32, np.array],
        "bool": [np.bool_],
    }
    call = calls[name]
    for parameter in parameters(call):
        value = call.arguments.get(parameter.name, parameter.default)
        if isinstance(value, int | float):
            for kind in same.get(plain(parameter), []):
                assert run(call, parameter, kind(value)) is None, f"{parameter.name}={kind}"


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_several_wrong_values_at_once(calls: dict[str, Call], data: st.DataObject) -> None:
    call = calls[data.draw(st.sampled_from(NAMES), label="function")]
    names = [each.name for each in parameters(call) if each.kind is not each.VAR_POSITIONAL]
    chosen = data.draw(st.lists(st.sampled_from(names), unique=True) if names else st.just([]), label="names")
    values = {name: WRONG[data.draw(st.sampled_from(sorted(WRONG)), label=name)] for name in chosen}
    if callable(values.get("progress")):
        values["progress"] = print
    with contextlib.suppress(CgroupError):
        call.run(**values)


@pytest.mark.parametrize("call", [registration.register, registration.correspond])
def test_a_callback_is_checked_before_work_begins(call: Any) -> None:
    with pytest.raises(InputError, match="progress: got 5; give a function that takes the name of a stage"):
        call(PAIR.source, PAIR.target, progress=5)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"normals": [[0, 0, 1]]}, r"cloud\.normals: got 1 for 643 points"),
        ({"faces": [[0, 1, 643]]}, r"cloud\.faces: got row 643, but there are 643 points"),
        ({"faces": [[0, 1, -1]]}, r"cloud\.faces: got index -1"),
    ],
)
def test_clouds_with_wrong_parts(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        registration.describe(PointCloud(PAIR.source.points, **wrong))
