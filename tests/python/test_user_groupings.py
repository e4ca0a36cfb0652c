"""Groups that users make themselves, in any layout, and bounds of rules that are no lengths."""

import numpy as np
import pytest

import cgroup
from cgroup import Correspondences
from cgroup.errors import InputError
from cgroup.types import Grouping

SOURCE = np.random.default_rng(0).uniform(0, 100, (50, 3))
TURN = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]])
POSE = np.eye(4)
POSE[:3, :3], POSE[:3, 3] = TURN, (1, 2, 3)
TARGET = SOURCE @ TURN.T + [1, 2, 3]
TARGET[40:] = SOURCE[:10]
MASK = np.arange(50) < 40
MATCHES = Correspondences(SOURCE, TARGET, resolution=1)


def grouping(mask: object = MASK, model: object = POSE) -> Grouping:
    return Grouping(mask, None, None, model, {})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "one",
    [
        grouping(model=np.asfortranarray(POSE)),
        grouping(model=POSE.astype(np.float32)),
        grouping(model=POSE.tolist()),
        grouping(mask=np.repeat(MASK, 2)[::2]),
        grouping(mask=MASK.tolist()),
        grouping(model=None),
    ],
)
def test_layouts_and_types_do_not_matter(one: Grouping) -> None:
    if one.model is not None:
        found = cgroup.certify(MATCHES, one, tolerance=1.0)
        assert (found.diagnostics["inliers"], found.diagnostics["optimal"]) == (40, 1)
    wanted = cgroup.match_probabilities(MATCHES, grouping(model=None if one.model is None else POSE))
    np.testing.assert_allclose(cgroup.match_probabilities(MATCHES, one), wanted, atol=1e-4)


@pytest.mark.parametrize(
    "call", [cgroup.match_probabilities, lambda *all_: cgroup.certify(*all_, tolerance=1.0)]
)
@pytest.mark.parametrize(
    ("one", "message"),
    [
        (grouping(model=POSE[:3]), r"grouping\.model: got shape \(3, 4\); give \(4,4\), or None"),
        (grouping(model=np.diag([2, 0.5, 1, 1.0])), "a model that is no rigid motion"),
        (grouping(model=np.diag([1, 1, -1, 1.0])), "a model that is no rigid motion"),
        (grouping(mask=MASK[:20]), "grouping: got one of 20 matches; give a group of these 50"),
        (grouping(mask=np.ones(50)), r"grouping\.mask: got shape \(50\) of float64"),
    ],
)
def test_others_are_refused(call: object, one: Grouping, message: str) -> None:
    with pytest.raises(InputError, match=message):
        call(MATCHES, one)  # type: ignore[operator]


@pytest.mark.parametrize("method", ["st", "nnsr", "3dhv", "ss"])
def test_certify_needs_a_length(method: str) -> None:
    fields = {"ratio": np.full(50, 0.5), "similarity": np.ones(50), "source_lrf": None}
    lrf = np.tile(np.eye(3), (50, 1, 1))
    fields |= {"source_lrf": lrf, "target_lrf": lrf @ TURN.T}
    matches = Correspondences(SOURCE, TARGET, resolution=1, **fields)
    found = cgroup.group(matches, method)
    with pytest.raises(InputError, match=f"tolerance: got None; {method} compares no lengths"):
        cgroup.certify(matches, Grouping(MASK, None, None, POSE, {}, rule=found.rule))


def test_one_match_far_away_does_not_stop_ransac() -> None:
    rng = np.random.default_rng(1)
    source = rng.uniform(0, 50, (300, 3))
    target = source + np.array([5, 6, 7])
    target[200:] = rng.uniform(0, 50, (100, 3))
    source, target = (points + np.array([5e5, 5e6, 100]) for points in (source, target))
    source[250] = 0
    assert cgroup.ransac(source, target, resolution=0.5).size == 200


def test_auto_replaces_the_tolerance_of_a_preset() -> None:
    matches = Correspondences(100 * SOURCE, 100 * SOURCE + 1)
    found = cgroup.group(matches, "teaser", tolerance="auto", preset="3dmatch")
    assert found.rule.bound == cgroup.group(matches, "teaser", tolerance="auto").rule.bound > 1
