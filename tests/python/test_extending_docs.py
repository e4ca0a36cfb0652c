"""What the pages say of extensions and configurations is true: all of it runs as it is written."""

import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from benchmark_runs import serial
from cgroup._runtime.progress import StageClock
from cgroup.benchmark import tables
from cgroup.benchmark.config import parse_config
from cgroup.benchmark.pipelines import Clouds
from cgroup.datasets import open_dataset, standin_pair
from cgroup.io import write_cloud, write_transform
from cgroup.nuisances import apply_nuisance
from cgroup.rigid import rotation_error

DOCS = Path(__file__).parents[2] / "docs"
PAGES = {name: (DOCS / f"{name}.md").read_text(encoding="utf-8") for name in ("extending", "benchmark")}


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGES[page], flags=re.DOTALL)


@pytest.fixture(scope="module")
def mymodule() -> ModuleType:
    """Make the module that the page is."""
    module = ModuleType("mymodule")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "mymodule", module)
        for block in blocks("extending", "python"):
            exec(compile(block, "extending.md", "exec"), vars(module))
        yield module


@pytest.mark.parametrize("text", [block for page in PAGES for block in blocks(page, "toml")])
@pytest.mark.usefixtures("mymodule")
def test_configurations_are_read(text: str) -> None:
    assert parse_config(text if text.startswith("name") else f'name = "a part"\n{text}').sets


@pytest.mark.usefixtures("mymodule")
def test_the_data_set_is_read(tmp_path: Path) -> None:
    pair = standin_pair(pixels=60)
    home = tmp_path / "my-scans"
    home.mkdir()
    for name in ("b", "a"):
        write_cloud(home / f"{name}-source.ply", pair.source)
        write_cloud(home / f"{name}-target.ply", pair.target)
        write_transform(home / f"{name}.txt", pair.T_target_source)
    dataset = open_dataset("mymodule:MyScans", tmp_path)
    assert dataset.pair_names() == ["a", "b"]
    loaded = dataset.load("b")
    np.testing.assert_array_equal(loaded.source.points, pair.source.points)
    assert not dataset.note()


@pytest.mark.usefixtures("mymodule")
def test_the_nuisance_is_done() -> None:
    pair = standin_pair(pixels=60)
    changed = apply_nuisance("mymodule:holes", pair, 5, np.random.default_rng(0))
    assert 0 < len(changed.target) < len(pair.target)


def test_the_pipeline_registers(mymodule: ModuleType) -> None:
    pair = standin_pair(pixels=100)
    problem = Clouds(pair.source.points, pair.target.points, None, None, voxel=9.5)
    answer = mymodule.mypipeline(problem, StageClock(lambda _: None), effort=2)
    assert answer.ok
    assert rotation_error(answer.T_target_source, pair.T_target_source) < 5


def test_the_configuration_of_the_method_runs(mymodule: ModuleType, tmp_path: Path) -> None:
    assert 0 < mymodule.score.precision <= 1
    text = blocks("extending", "toml")[0] + "pairs = 1\n"
    serial(text, tmp_path)
    frame = tables.load(tmp_path)
    assert set(frame["method"]) == {"gtm", "closest"}
    assert not frame["error"].astype(bool).any()


def test_records_are_read_as_the_page_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (
        'name = "a"\nmethods = ["gc", "gtm"]\n[[experiment]]\nid = "x"\ndataset = "benchmark_fakes:Matches"\n'
    )
    serial(text, tmp_path / "paper")
    monkeypatch.chdir(tmp_path)
    namespace: dict[str, object] = {}
    for block in blocks("benchmark", "python"):
        exec(compile(block, "benchmark.md", "exec"), namespace)
    assert len(namespace["means"]) == 2
