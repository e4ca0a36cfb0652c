"""The questions that the paper leaves open, and the readings that are tried: the data in readings.toml."""

from __future__ import annotations

import functools
import sys
from importlib.resources import files
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from cgroup.benchmark.config import Table
from cgroup.benchmark.readings.reading import Reading
from cgroup.errors import InputError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib  # pyright: ignore[reportMissingImports] - on Python 3.10 only

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


class Question(Table):
    """Something that the paper leaves open.

    Attributes
    ----------
    id : str
        Short.
    title : str
        What it is about.
    silent : str
        What the paper says of it, and doesn't.
    default : str
        How it is read by default.
    readings : tuple of Reading
        The other ways.

    Raises
    ------
    pydantic.ValidationError
        For an unknown key, or a value of another type.

    Examples
    --------
    >>> from cgroup.benchmark.readings import read_questions
    >>> question = read_questions()[0]
    >>> question.id, [reading.name for reading in question.readings]
    ('nnsr', ['nnsr-letter'])
    """

    id: str
    title: str
    silent: str
    default: str
    readings: Annotated[tuple[Reading, ...], Field(min_length=1)]


@functools.cache
def read_questions() -> tuple[Question, ...]:
    """Read all questions.

    Returns
    -------
    tuple of Question
        In the order of their tables.

    Examples
    --------
    >>> from cgroup.benchmark.readings import read_questions
    >>> sum(len(question.readings) for question in read_questions()) > 30
    True
    """
    text = files("cgroup.benchmark.readings").joinpath("readings.toml").read_text(encoding="utf-8")
    questions = tuple(Question.model_validate(table) for table in tomllib.loads(text)["question"])
    known = {reading.name: reading for question in questions for reading in question.readings}
    return tuple(
        question.model_copy(update={"readings": tuple(_resolve(each, known) for each in question.readings)})
        for question in questions
    )


def list_readings(names: Sequence[str] | None = None) -> list[Reading]:
    """List readings.

    Parameters
    ----------
    names : sequence of str, optional
        Which, by reading or question; all by default.

    Returns
    -------
    list of Reading
        In the order of the questions.

    Raises
    ------
    InputError
        If there is no reading or question of a name.

    Examples
    --------
    >>> from cgroup.benchmark.readings import list_readings
    >>> [reading.name for reading in list_readings(["cv", "mutual"])]
    ['cv-5', 'cv-20', 'mutual']
    """
    questions = read_questions()
    known = {question.id for question in questions}
    known |= {reading.name for question in questions for reading in question.readings}
    for name in names or ():
        if name not in known:
            message = f"reading: got {name!r}; choose from {', '.join(sorted(known))}"
            raise InputError(message)
    return [
        reading
        for question in questions
        for reading in question.readings
        if names is None or question.id in names or reading.name in names
    ]


def name_questions(questions: Iterable[Question]) -> dict[str, str]:
    """Name the question that each reading answers.

    Parameters
    ----------
    questions : iterable of Question
        With their readings.

    Returns
    -------
    dict of str to str
        Ids of questions, by the readings' names.
    """
    return {reading.name: question.id for question in questions for reading in question.readings}


def _resolve(reading: Reading, known: dict[str, Reading]) -> Reading:
    return reading.model_copy(update={"parts": tuple(known[name] for name in reading.together)})
