"""Names that other libraries have for options and results lead to ours."""

import copy
import pickle

import pytest

from cgroup import InputError, register
from cgroup.datasets import standin_pair
from cgroup.evaluation.recall_protocols import read_protocol

PAIR = standin_pair(pixels=60)


@pytest.mark.parametrize("name", ["voxel_size", "downsampling_resolution", "leaf_size"])
def test_an_option_is_that_of_register(name: str) -> None:
    with pytest.raises(InputError, match=f"there is no '{name}' .did you mean 'voxel'"):
        register(PAIR.source, PAIR.target, **{name: 2.0})


def test_an_attribute_is_that_of_a_registration() -> None:
    done = register(PAIR.source, PAIR.target)
    for theirs, ours in {"transformation": "T_target_source", "converged": "ok"}.items():
        with pytest.raises(AttributeError, match=f"no '{theirs}'; did you mean '{ours}'"):
            getattr(done, theirs)
    assert not hasattr(done, "nothing")
    for same in (copy.copy(done), pickle.loads(pickle.dumps(done))):
        assert same.probability == done.probability


def test_a_protocol_is_read_in_any_case() -> None:
    assert read_protocol("3DMatch") == read_protocol("3dmatch")
    with pytest.raises(InputError, match="did you mean '3dmatch'"):
        read_protocol("3DMtch")
