"""Readings of what the paper leaves open: each changes a configuration as its table states."""

from typing import Any

import pytest

from cgroup.benchmark.config import Config, apply_readings, parse_config, read_config, read_questions
from cgroup.errors import InputError

READINGS = {reading.name: reading for question in read_questions() for reading in question.readings}
PAPER = read_config("paper")

SMALL = """
name = "small"
methods = ["gc", { name = "gtm", options = { payoff = "threshold" } }, "cv"]
[[experiment]]
id = "noise"
dataset = "standin-full"
nuisance = "noise"
levels = [0.1]
[timing]
dataset = "standin-full"
"""


def read(text: str, *names: str) -> Config:
    return Config.model_validate(apply_readings(parse_config(text).model_dump(exclude_none=True), names))


def fronts(config: Config) -> dict[tuple[str, str, str], dict[str, Any]]:
    """Changes of the front end, by experiment, data set and combination."""
    return {
        (entry.id, dataset, combination): entry.front.model_dump(exclude_defaults=True)
        for entry in config.experiment
        for dataset in entry.dataset
        for combination in entry.combinations
    }


@pytest.mark.parametrize("name", READINGS)
def test_every_reading_changes_the_preset_and_keeps_its_problems(name):
    config = read_config(f"paper+{name}")
    assert config.name == f"paper+{name}"
    assert config.model_dump(exclude={"name"}) != PAPER.model_dump(exclude={"name"})
    if not READINGS[name].without:
        assert set(fronts(config)) == set(fronts(PAPER))
    labels = [{each.solver().label for each in made.methods} for made in (config, PAPER)]
    assert labels[0] == labels[1]


def test_an_option_changes_one_method_everywhere_and_keeps_its_label():
    config = read(SMALL, "gtm-20")
    assert config.timing is not None
    for methods in (config.methods, read_config("paper+gtm-20").methods):
        options = {each.solver().label: each.options for each in methods}
        assert options["gtm"]["iterations"] == 20
        assert not options["gc"]
    assert config.methods[1].options == {"payoff": "threshold", "iterations": 20}
    variants = next(each for each in read_config("paper+gtm-20").experiment if each.id == "variants")
    changed = [each.label for each in variants.methods or () if each.options.get("iterations") == 20]
    assert changed == ["gtm+ransac"]


def test_a_front_changes_all_that_is_not_excluded():
    assert all(front == {"matching": "mutual"} for front in fronts(read_config("paper+mutual")).values())
    for (experiment, _, combination), front in fronts(read_config("paper+frames-toldi")).items():
        reached = experiment == "combinations" and combination in {"C2", "C3", "C5", "C6"}
        assert front == ({"frames": "toldi"} if reached else {})
    for (_, dataset, combination), front in fronts(read_config("paper+normals-fitted")).items():
        reached = dataset == "u3or" and combination in {"C1", "C2", "C4", "C5"}
        assert front == ({"normals": "pca"} if reached else {})


def test_a_front_of_the_configuration_stays():
    config = read(SMALL.replace("levels = [0.1]", 'levels = [0.1]\nfront = { normals = "pca" }'), "mutual")
    [front] = fronts(config).values()
    assert front == {"normals": "pca", "matching": "mutual"}


def test_a_nuisance_replaces_another():
    for entry, before in zip(read_config("paper+density-voxels").experiment, PAPER.experiment, strict=False):
        if before.id == "density":
            assert (entry.nuisance, entry.levels) == ("voxel-density", before.levels)
            break
        assert entry.nuisance == before.nuisance


def test_thresholds_change_in_their_experiment_only():
    for entry in read_config("paper+epsilon-5").experiment:
        assert entry.epsilons == ((1, 2, 3, 4, 5) if entry.id == "epsilon" else (5,))


def test_a_data_set_is_left_out_of_one_experiment_only():
    config = read_config("paper+counts-u3m")
    with_u3or = {entry.id for entry in PAPER.experiment if "u3or" in entry.dataset}
    assert with_u3or - {entry.id for entry in config.experiment if "u3or" in entry.dataset} == {"matches"}
    assert [entry.dataset for entry in config.experiment if entry.id == "matches"] == [("stanford",)]


def test_readings_combine_in_their_order():
    config = read_config("paper+gtm-20+gtm-50+mutual")
    assert next(each.options for each in config.methods if each.name == "gtm") == {"iterations": 50}
    assert all(front == {"matching": "mutual"} for front in fronts(config).values())


def test_an_unknown_reading_is_an_error_that_lists_the_known_ones():
    with pytest.raises(InputError, match=r"reading: got 'gtm-30'; choose from .*gtm-20"):
        read_config("paper+gtm-30")
