"""Registration criteria, at and around their limits."""

import math

import pytest

from cgroup.evaluation import PROTOCOLS

NAN, INF = math.nan, math.inf


@pytest.mark.parametrize(
    ("name", "errors", "verdict"),
    [
        ("precision>0.1", (0.1, NAN, NAN, NAN), False),
        ("precision>0.1", (0.1000001, INF, INF, INF), True),
        ("precision>0.1", (0.0, 0, 0, 0), False),
        ("rmse<=1pr", (0.0, NAN, NAN, 1.0), True),
        ("rmse<=1pr", (1.0, 0, 0, 1.01), False),
        ("rmse<=5pr", (0.0, 90, 90, 5.0), True),
        ("rmse<=5pr", (1.0, INF, INF, INF), False),
        ("3dmatch", (0.0, 15.0, 0.3, NAN), True),
        ("3dmatch", (0.0, 15.1, 0.1, NAN), False),
        ("3dmatch", (0.0, 1.0, 0.31, NAN), False),
        ("kitti", (0.0, 5.0, 0.6, NAN), True),
        ("kitti", (0.0, 5.0, 0.61, NAN), False),
        ("kitti-2m", (0.0, 5.0, 2.0, NAN), True),
        ("kitti-2m", (0.0, 5.1, 0.1, NAN), False),
        ("3dmatch", (1.0, INF, INF, INF), False),
    ],
)
def test_limits(name: str, errors: tuple[float, float, float, float], verdict: bool) -> None:
    assert PROTOCOLS[name].judge(*errors) is verdict


@pytest.mark.parametrize("name", PROTOCOLS)
def test_unknown_values_are_no_verdict(name: str) -> None:
    assert PROTOCOLS[name].judge(NAN, NAN, NAN, NAN) is None


def test_half_known_is_no_verdict() -> None:
    assert PROTOCOLS["3dmatch"].judge(1.0, 3.0, NAN, NAN) is None


def test_names_are_keys() -> None:
    assert all(protocol.name == name for name, protocol in PROTOCOLS.items())
