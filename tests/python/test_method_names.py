"""Methods go by their name, their label and the name of their function, in any case."""

import numpy as np
import pytest
from public_calls import MATCHES, PAIR, VOXEL

import cgroup
from cgroup.benchmark.config import parse_config, replace_methods
from cgroup.benchmark.solver import make_solver
from cgroup.comparison import compare
from cgroup.errors import InputError
from cgroup.group import check_method
from cgroup.registration import register
from cgroup.registry import METHOD_INFO, label_of

SPELLINGS = {
    "3dhv": ("Hough3D", "HOUGH_3D", "3d-hv"),
    "sc2pcr": ("SC2-PCR", "sc2_pcr", "Sc2Pcr"),
    "teaser": ("Teaser",),
    "turboreg": ("turbo-reg",),
    "gtm": (" gtm ",),
}


@pytest.mark.parametrize("info", METHOD_INFO.values(), ids=lambda info: info.name)
def test_a_method_goes_by_all_its_spellings(info):
    names = (info.name, info.label, info.function.__name__)
    for spelling in (*names, *map(str.upper, names), *map(str.lower, names), *SPELLINGS.get(info.name, ())):
        assert check_method(spelling) == info.name
        assert label_of(spelling) == info.label


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        ("gmt", "gtm"),
        ("RANSACK", "ransac"),
        ("hough", "3dhv"),
        ("icp", None),
    ],
)
def test_an_unknown_method_is_refused_with_the_one_probably_meant(given: str, meant: str | None):
    with pytest.raises(InputError, match=rf"^method: got '{given}'; choose one of ss, nnsr, si.*") as caught:
        cgroup.group(MATCHES, given)
    assert str(caught.value).endswith(f"; did you mean {meant!r}?" if meant else [*METHOD_INFO][-1])


def test_every_function_that_takes_a_method_takes_all_spellings():
    expected = cgroup.group(MATCHES, "3dhv").mask
    np.testing.assert_array_equal(cgroup.group(MATCHES, "Hough3D").mask, expected)
    np.testing.assert_array_equal(cgroup.group_many([MATCHES], "HOUGH3D")[0].mask, expected)
    (result,) = compare(MATCHES, np.eye(4), methods=["Hough3D"])
    assert result.method == "3dhv"
    a, b = (register(PAIR.source, PAIR.target, voxel=VOXEL, method=name) for name in ("gc", "GC"))
    np.testing.assert_array_equal(a.T_target_source, b.T_target_source)


def test_a_configuration_takes_all_spellings_and_keeps_its_labels():
    text = """name = "mine"
methods = ["GTM", { name = "hough3d", label = "Hough (mine)" }]
[[experiment]]
id = "a"
dataset = "standin"
"""
    config = parse_config(text)
    candidates = [entry.solver() for entry in config.methods]
    assert [(each.name, each.label) for each in candidates] == [("gtm", "gtm"), ("3dhv", "Hough (mine)")]
    assert candidates[0] == make_solver("method", "", "gtm", {})
    replaced = replace_methods(config, ["Paper", " SC2-PCR"])
    assert [entry.solver().name for entry in replaced.methods] == [*cgroup.PAPER_METHODS, "sc2pcr"]
    assert replaced.experiment == config.experiment
    with pytest.raises(InputError, match="or give module:function; did you mean 'gtm'"):
        parse_config(text.replace('"GTM"', '"GMT"'))
