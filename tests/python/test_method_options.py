"""The options of every method are those that the compiled core describes."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from public_calls import PROBLEM
from wrong_values import wrong_for

import cgroup
from cgroup.errors import InputError
from cgroup.registry import METHOD_INFO, MethodInfo

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

from write_stubs import STUB, stub

OPTIONS = [(info, name) for info in METHOD_INFO.values() for name in info.options]


def test_the_stub_has_the_signatures() -> None:
    assert STUB.read_text(encoding="utf-8") == stub(), "run: python tools/write_stubs.py"


def test_arguments_are_bound_as_python_binds_them() -> None:
    matches = PROBLEM.correspondences()
    by_name = cgroup.ransac(target=matches.target, source=matches.source, tolerance=1.0)
    np.testing.assert_array_equal(
        by_name.mask, cgroup.ransac(matches.source, matches.target, tolerance=1.0).mask
    )
    with pytest.raises(TypeError, match="missing a required.* argument: 'source_lrf'"):
        cgroup.hough3d(matches.source, matches.target)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="multiple values for argument 'source'"):
        cgroup.gtm(matches.source, matches.target, source=matches.source)  # type: ignore[misc]


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
