"""Configurations, plans and methods from outside."""

import pytest

import benchmark_fakes
from benchmark_runs import MATCHES, contents, serial
from cgroup import METHODS, PAPER_METHODS, group
from cgroup.benchmark import entries, tables
from cgroup.benchmark.config import parse_config, preset_names, read_config
from cgroup.benchmark.plan import make_plan
from cgroup.benchmark.problem import Problem
from cgroup.benchmark.solver import make_solver
from cgroup.benchmark.store import read_plan
from cgroup.errors import InputError

WRONG_EXPERIMENTS = [
    ("epsilons = [-1]", "[0].epsilons[0]: Input"),
    ("levles = [1]", "[0].levles: Extra"),
    ('fact = "clutter"', "[0].fact: Extra inputs are not permitted"),
    ("levels = [1]", "[0]: levels: needed with"),
    ('nuisance = "noise"', "[0]: levels: needed with"),
    ('sweep = "nms_radius", levels = [0]', "[0]: levels: got 0.0; a radius is greater than 0"),
    ('combinations = ["C7"]', "[0].combinations[0]: got 'C7'; choose one of C1"),
    (
        'sweep = "nms_radius", nuisance = "noise", levels = [1]',
        "[0]: nuisance, sweep: the levels can belong to one of them only",
    ),
    ('front = {matching = "both"}', "[0].front.matching: Input should be 'nearest' or 'mutual'"),
    ("front = {harris_radius = 0}", "[0].front.harris_radius: Input should be greater than 0"),
    ("front = {iss_radii = [6]}", "[0].front.iss_radii[1]: Field required"),
    ("front = {scale = 2}", "[0].front.scale: Extra inputs"),
]

WRONG_METHODS = [
    (
        '{name = "gtm", options = {iteration = 5}}',
        "[0]: option: gtm has no 'iteration'; it takes iterations",
    ),
    ('"benchmark_fakes:missing"', "[0]: method: module 'benchmark_fakes' has no 'missing'"),
    (
        '"gtm", {name = "gtm", options = {one_to_one = true}}',
        ": two are called 'gtm'; give each variant a label",
    ),
]

WRONG_TRIALS = [
    (', grid = { n = 10 }, dataset = "corr"', "[0]: dataset, grid: give one of the two"),
    ("", "[0]: dataset, grid: give one of the two"),
    (', grid = { scene = "mountains" }', "[0].grid: generated-matches: has no pair"),
    (', dataset = "stanford", matches = "best"', "[0].matches: got 'best'; choose one of C1"),
    (', dataset = "stanford", matches = "C1", voxel = 1', "[0]: voxel: only for dense matches"),
    (', dataset = "stanford", matches = "mutual", loose = "rmse<=1pr"', "[0].loose: got"),
    (', grid = {}, preset = "mine"', "[0].preset: got"),
]

TWO_FRONTS = (
    'experiment = [{id = "x", dataset = "b3r"}, {id = "x", dataset = "b3r", front = {frames = "toldi"}}]'
)
BARE = 'experiment = [{id = "x", dataset = "b3r"}]'
WRONG = [
    *((BARE.replace("}", f", {more}}}"), f"experiment{says}") for more, says in WRONG_EXPERIMENTS),
    *((f"methods = [{each}]\n{BARE}", f"methods{says}") for each, says in WRONG_METHODS),
    *((f'trials.sets = [{{id = "x"{more}}}]', f"trials.sets{says}") for more, says in WRONG_TRIALS),
    (TWO_FRONTS, "experiment: 'x' has two fronts; give each an id"),
    ('experiment = [{id = "x"}]', "experiment[0].dataset: Field required"),
    (f'seed = "much"\n{BARE}', "seed: Input should be a valid integer"),
    (f"seed = {2**64}\n{BARE}", f"seed: Input should be less than or equal to {2**64 - 1}"),
    ("", "experiment, registration, scenes, trials: all are missing"),
    ("experiment = [", "not TOML"),
]


@pytest.mark.parametrize(("text", "says"), WRONG)
def test_wrong_configuration_is_one_line_with_the_keys_path(text, says):
    with pytest.raises(InputError) as raised:
        parse_config(f'name = "x"\n{text}', "x.toml")
    assert str(raised.value).startswith(f"x.toml: {says}")
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("seed", [2**63 - 1, 2**63, 2**64 - 1])
def test_seeds_are_as_large_as_methods_take_them(seed, tmp_path):
    text = f"seed = {seed}\n{MATCHES}pairs = 2"
    assert serial(text, tmp_path).counts["experiment"] == (4, 0, 4)
    frame = tables.load(tmp_path)
    assert [int(each) for each in frame["seed"]] == [seed] * 4
    assert read_plan(tmp_path, "config")["seed"] == seed
    known = contents(tmp_path)
    assert serial(text, tmp_path).failed == 0
    assert contents(tmp_path) == known


def test_sets_of_methods(monkeypatch):
    """With a tenth method, "paper" stays the nine, and the default is what exists."""
    monkeypatch.setitem(entries.METHOD_SETS, "all", (*METHODS, "benchmark_fakes:first"))
    text = MATCHES.replace('methods = ["ransac", "gtm"]', "methods = {}")

    def names(methods: str) -> list[str]:
        return [entry.name for entry in parse_config(text.replace("{}", methods)).methods]

    assert names('"paper"') == list(PAPER_METHODS)
    assert names('"all"') == [*METHODS, "benchmark_fakes:first"]
    assert names('["paper", {name = "st", label = "dense", options = {eigensolver = "dense"}}]') == [
        *PAPER_METHODS,
        "st",
    ]
    assert [entry.name for entry in parse_config(text.replace("methods = {}\n", "")).methods] == list(METHODS)
    with pytest.raises(InputError, match=r"methods\[0\]: method: got 'everything'"):
        names('"everything"')


@pytest.mark.parametrize("name", ["smoke", "paper-small", "paper"])
def test_the_papers_presets_run_the_papers_methods(name):
    preset = read_config(name)
    assert tuple(entry.name for entry in preset.methods) == PAPER_METHODS
    assert preset.timing is not None
    timed = preset.timing.methods or preset.methods
    assert tuple(entry.label or entry.name for entry in timed)[:9] == PAPER_METHODS


def test_presets_can_be_read():
    named = {"smoke", "paper-small", "paper", "registration", "scenes", "matches", "3dmatch", "kitti"}
    assert named <= set(preset_names())
    ids = ["noise", "density", "clutter", "occlusion", "overlap", "epsilon", "matches", "combinations"]
    for name in preset_names():
        preset = read_config(name)
        assert preset.name == name
        if not preset.experiment:
            continue
        assert set(ids) <= {entry.id for entry in preset.experiment}
        assert preset.timing is not None
    with pytest.raises(InputError, match="neither a readable configuration nor one of 3dmatch"):
        read_config("nowhere.toml")


def test_a_small_draw_of_pairs_is_part_of_a_larger_one():
    text = MATCHES + "pairs = {}"
    drawn = [
        {case.pair for case in make_plan(parse_config(text.replace("{}", n)), None).sets[0].problems}
        for n in ("2", "5", "100")
    ]
    assert [len(pairs) for pairs in drawn] == [2, 5, 8]
    assert drawn[0] < drawn[1] < drawn[2]


def test_absent_data_is_left_out_and_named(tmp_path):
    both = MATCHES.replace(
        '"benchmark_fakes:Matches"', '["benchmark_fakes:Matches", "benchmark_fakes:Absent"]'
    )
    summary = serial(both + "pairs = 2", tmp_path)
    assert summary.missing == {"benchmark_fakes:Absent": "absent: get it from nowhere"}
    assert read_plan(tmp_path, "missing") == summary.missing
    assert summary.counts["experiment"].done == 4
    with pytest.raises(InputError, match="all data sets are missing.*get it from nowhere"):
        serial(MATCHES.replace("Matches", "Absent"), tmp_path)


@pytest.mark.parametrize(
    ("table", "dataset", "more", "says"),
    [
        ("experiment", "Matches", 'pairs = ["m0", "m99"]', "has no pair 'm99'; the first is 'm0'"),
        ("experiment", "Partial", 'pairs = ["never"]', "has no pair 'never'; the first is 'm0'"),
        ("experiment", "Matches", 'nuisance = "noise"\nlevels = [1]', "takes no nuisance, sweep or front"),
        ("experiment", "Matches", 'front = {matching = "mutual"}', "takes no nuisance, sweep or front"),
        ("trials.sets", "Matches", 'matches = "C1"', "consists of correspondences; leave out matches"),
        ("trials.sets", "Clouds", "", "has clouds; give matches, the way"),
    ],
)
def test_what_the_data_set_does_not_have(table, dataset, more, says):
    text = f'name = "x"\n[[{table}]]\nid = "bare"\ndataset = "benchmark_fakes:{dataset}"\n{more}\n'
    with pytest.raises(InputError, match=f"bare: benchmark_fakes:{dataset} .*{says}"):
        make_plan(parse_config(text), None)


KEYS = {
    "5abd4fee9c4eab9cced54b4e": ("b3r", "scene0", {"nuisance": "noise", "level": 0.05, "seed": 3}),
    "f8a8b4b7df9b151eb70deffd": (
        "b3r",
        "scene0",
        {"nuisance": "noise", "level": 0.05, "seed": 3, "front": '{"matching": "mutual"}'},
    ),
    "9da047aa2e783c7ebfac5f5f": ("u3or", "rs1-chef", {"matches": "C5", "nms_radius": 1.5}),
    "6bcf63e6c9aef4d14d89db08": ("b3r-clean", "a", {"nuisance": "density", "level": 0.3}),
}


def test_keys_and_random_numbers_are_the_same_everywhere():
    cases = {
        key: Problem("experiment", dataset, pair, **{"matches": "C1", **rest})
        for key, (dataset, pair, rest) in KEYS.items()
    }
    assert {case.key: case for case in cases.values()} == cases
    default, mutual, *_ = cases.values()
    for case in (default, mutual):
        assert case.rng("nuisance").integers(1 << 30) == 1056362948
    assert default.rng("nuisance").random() == mutual.rng("nuisance").random()
    assert default.rng("nuisance").random() != default.rng("sample").random()


def test_methods_from_outside_get_seed_and_lengths(tmp_path):
    methods = """
    methods = [
      {name = "benchmark_fakes:first", label = "first 20"},
      {name = "benchmark_fakes:first", label = "first 9", options = {count = 9}},
      {name = "benchmark_fakes:seeded", label = "seeded", options = {reach_pr = 5}},
      {name = "ransac", label = "r", options = {tolerance_pr = 5, iterations = 50}},
      "benchmark_fakes:wrong_length",
    ]
    """
    text = MATCHES.replace('methods = ["ransac", "gtm"]', methods + "\nseed = 7") + "pairs = 3"
    summary = serial(text, tmp_path)
    assert summary.failed == 3
    frame = tables.load(tmp_path).set_index(["method", "pair"])
    assert set(frame.loc["first 20"]["precision"]) == {1.0}
    assert set(frame.loc["first 9"]["recall"]) == {9 / 20}
    for pair in set(frame.loc["r"].index):
        assert frame.loc["seeded", pair]["selected"] == frame.loc["r", pair]["selected"]
    [error] = set(frame.loc["benchmark_fakes:wrong_length"]["error"])
    assert "returned bool of shape (3,); return a Grouping or a mask of 60 bool" in error
    solver = make_solver("method", "r", "ransac", {"tolerance_pr": 5, "iterations": 50})
    assert solver.parameters(7, resolution=0.5) == {"seed": 7, "tolerance": 2.5, "iterations": 50}


def test_ransac_after_another_method_stays_inside_its_group():
    matches = benchmark_fakes.Matches().load("m0").correspondences
    for method in ("gc", "gtm"):
        before = group(matches, method)
        after = make_solver("method", "", f"cgroup.benchmark.chained:{method}_then_ransac", {}).group(matches)
        assert 3 <= after.size <= before.size
        assert not (after.mask & ~before.mask).any()


def test_pairs_that_lack_files_are_left_out_and_named(tmp_path):
    partial = MATCHES.replace("Matches", "Partial")
    summary = serial(partial + 'pairs = ["m1", "gone", "m0"]', tmp_path)
    assert summary.missing == {
        "benchmark_fakes:Partial": "1 of 9 pairs lack files: gone (no nowhere/gone.txt)"
    }
    assert read_plan(tmp_path, "missing") == summary.missing
    assert summary.counts["experiment"].done == 4
    assert {case.pair for case in make_plan(parse_config(partial), None).sets[0].problems} == {
        f"m{n}" for n in range(8)
    }
