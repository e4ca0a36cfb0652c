"""How many files a new method, and a new option, have to be written into."""

import re
import subprocess
from functools import cache
from pathlib import Path

import pytest

from cgroup.registry import METHOD_INFO

ROOT = Path(__file__).parents[2]

OWN = 5
"""Its share of files that don't name all others: core, Python's words, page, figure of its idea, NumPy twin."""

CORES_LIST = "rust/core/grouping/mod.rs"
"""It names the methods by their modules, not by the functions of Python."""

MOST_FILES = 8
FILES_OF_AN_OPTION = 3
MOST_LINES_OF_AN_OPTION = 3

MEASURED = ("docs/figures/measured/", "docs/methods/choose.md", "tests/golden/", "CHANGELOG.md")
"""What is measured, or records the past: none of it is written for a method to exist."""

GENERATED = ("python/cgroup/methods/__init__.pyi",)

_MADE = re.compile(r"<!-- measured: [^\n]+? -->\n.*?<!-- end of measured -->", re.DOTALL)


@cache
def texts() -> dict[str, str]:
    """Return what is written by hand in each file of the repository, by its path."""
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("counts the files of a repository")
    kept = [name for name in listed.stdout.splitlines() if not name.startswith((*MEASURED, *GENERATED))]
    kinds = {".rs", ".py", ".md", ".toml", ".pyi"}
    paths = [name for name in kept if Path(name).suffix in kinds and (ROOT / name).is_file()]
    return {name: _MADE.sub("", (ROOT / name).read_text(encoding="utf-8")) for name in paths}


def names(text: str, word: str) -> bool:
    return re.search(rf"\b{word}\b", text) is not None


def test_few_files_list_all_methods() -> None:
    """A file that names every method has to be changed for a new one."""
    functions = [info.function.__name__ for info in METHOD_INFO.values()]
    lists = [path for path, text in texts().items() if all(names(text, function) for function in functions)]
    assert len([CORES_LIST, *lists]) + OWN <= MOST_FILES, lists


def lines_naming(text: str, word: str) -> int:
    return sum(names(line, word) for line in text.splitlines())


@pytest.mark.parametrize("method", ["mac", "sc2pcr", "turboreg"])  # whose options have names of their own
def test_few_places_list_all_options_of_a_method(method: str) -> None:
    """A file that names every option of a method has to be changed for a new one.

    Lines that declare it count, one less than those that name it in the core and in its NumPy twin: these use it.
    """
    options = METHOD_INFO[method].options
    files = [path for path, text in texts().items() if all(names(text, option) for option in options)]
    places = {path: min(lines_naming(texts()[path], option) for option in options) for path in files}
    for path in places:
        places[path] -= path.startswith(("rust/", "tests/python/reference/"))
    assert len(places) == FILES_OF_AN_OPTION, places
    assert sum(places.values()) <= MOST_LINES_OF_AN_OPTION, places
