"""Size budgets of the package, its rooms, files and functions."""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

import cgroup

PACKAGE = Path(cgroup.__file__).parent
FILES = sorted(PACKAGE.rglob("*.py"))

MOST_LINES = {
    "": 34_200,
    "benchmark/": 6_615,
    "cli/": 3_775,
    "datasets/": 3_060,
    "evaluation/": 1_435,
    "features/": 1_205,
    "fronts/": 828,
    "io/": 3_165,
    "maps/": 1_020,
    "methods/": 670,
    "pages/": 1_256,
    "plots/": 1_030,
    "recognition/": 444,
    "registration/": 2_200,
    "scenes/": 2_150,
}
"""Lines of the package and of its rooms, with docstrings and blank lines."""

MOST_FILES = 208
LONGEST_FILE = 400
LONGEST_FUNCTION = 40  # without its docstring
MOST_PARAMETERS = 8

_MOVES = "moves to the core"
_COMMAND = "each parameter is an option of the command, documented where it is declared"
_OPTIONS = "each parameter is a documented option"

LONG_FILES = {
    "registration/prepare.py": _MOVES,
    "registration/register.py": _MOVES,
}
LONG_FUNCTIONS = {
    "cli/commands/recognize.py:recognize_command": "parameters and their help take half of it",
    "datasets/matching_problems.py:make_problem": "steps that draw from one generator, in a fixed order",
}
MANY_PARAMETERS = {
    "cli/commands/benchmark.py:run_command": _COMMAND,
    "cli/commands/group.py:group_command": _COMMAND,
    "cli/commands/locate.py:locate_command": _COMMAND,
    "cli/commands/merge.py:merge_command": _COMMAND,
    "cli/commands/register.py:register_command": _COMMAND,
    "datasets/matching_problems.py:make_problem": _OPTIONS,
    "features/keypoints.py:harris3d": _OPTIONS,
    "features/keypoints.py:iss": _OPTIONS,
    "maps/locate.py:locate": _OPTIONS,
    "fronts/paper_front.py:correspond": _OPTIONS,
    "fronts/paper_front.py:describe": _OPTIONS,
    "registration/register.py:assess": _OPTIONS,
    "registration/register.py:refine": _OPTIONS,
    "registration/register.py:register": _OPTIONS,
    "registration/register.py:register_many": _OPTIONS,
    "scenes/register_all.py:register_all": _OPTIONS,
    "types/fields.py:__init__": "the fields of correspondences",
}
"""Exceptions, with their reasons."""


class Function(NamedTuple):
    """A function: where it is, the lines of its body, and how many parameters it has."""

    name: str
    lines: int
    parameters: int


def functions() -> Iterator[Function]:
    for path in FILES:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                body = node.body[1:] if ast.get_docstring(node) is not None else node.body
                lines = (body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0
                given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
                is_method = bool(given) and given[0].arg in ("self", "cls")
                yield Function(f"{name_of(path)}:{node.name}", lines, len(given) - is_method)


def name_of(path: Path) -> str:
    return path.relative_to(PACKAGE).as_posix()


def lines_of(path: Path) -> int:
    return len(path.read_text().splitlines())


@pytest.mark.parametrize("room", MOST_LINES)
def test_lines(room: str) -> None:
    lines = sum(lines_of(path) for path in FILES if name_of(path).startswith(room))
    assert lines <= MOST_LINES[room], f"{room or 'cgroup'}: {lines} lines"


def test_number_of_files() -> None:
    assert len(FILES) <= MOST_FILES


def test_length_of_files() -> None:
    assert {name_of(path) for path in FILES if lines_of(path) > LONGEST_FILE} == {*LONG_FILES}


def test_length_of_functions() -> None:
    assert {one.name for one in functions() if one.lines > LONGEST_FUNCTION} == {*LONG_FUNCTIONS}


def test_number_of_parameters() -> None:
    assert {one.name for one in functions() if one.parameters > MOST_PARAMETERS} == {*MANY_PARAMETERS}
