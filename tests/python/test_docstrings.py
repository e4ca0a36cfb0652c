"""Every public name documents its parameters, results and errors; examples run; some page names it."""

import dataclasses
import doctest
import importlib
import inspect
import pkgutil
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from numpydoc.docscrape import ClassDoc, FunctionDoc, NumpyDocString
from numpydoc.validate import validate
from public_calls import called_names
from public_names import MODULES, PROPERTIES, Public, has_example, in_code, public_names
from wrong_calls import WRONG_CALLS

import cgroup

NAMES = public_names()
EVERY = pytest.mark.parametrize("public", NAMES.values(), ids=NAMES)

LONGEST_SUMMARY = 80

FAULTS = {
    "GL06",  # a section that numpydoc doesn't know
    "GL07",  # sections out of order
    "GL08",  # no docstring
    "SS01",  # no summary
    "SS03",  # no full stop after it
    "SS06",  # more than one line
    "PR02",  # one that doesn't exist
    "PR03",  # another order
    "PR04",  # no type
    "PR07",  # no description
    "RT01",  # no Returns
    "RT03",  # no description
    "YD01",  # no Yields
}
"""Faults that numpydoc finds and that are faults here."""

POINTER = re.compile(r"[Aa]s for\s+`(\w+)`")
"""Names another docstring, which describes the shared parameters."""

SHARED_ERRORS = {"InputError", "OutOfMemoryError"}
"""Errors that any function may raise; the page on errors describes them."""


def docstring_of(public: Public) -> NumpyDocString:
    value = public.documented
    return (
        ClassDoc(value, config={"show_class_members": False})
        if inspect.isclass(value)
        else FunctionDoc(value)
    )


def fields_of(value: type[Any]) -> list[str]:
    """Name the fields of a class whose objects the library makes; empty where it has none."""
    if dataclasses.is_dataclass(value):
        fields = [field.name for field in dataclasses.fields(value)]
    else:
        fields = list(getattr(value, "_fields", getattr(value, "model_fields", ())))
    return [name for name in fields if not name.startswith("_")]


def parameters_of(public: Public) -> set[str]:
    """Return the names of the parameters or fields that a docstring describes."""
    doc = docstring_of(public)
    described = [*doc["Parameters"], *doc["Attributes"]]
    return {name.lstrip("*") for each in described for name in each.name.split(", ")}


def shared_parameters(public: Public) -> set[str]:
    """Return the parameters that the docstrings describe to which this one points."""
    pointers = POINTER.findall(inspect.getdoc(public.documented) or "")
    pointed = {name: [each for each in NAMES if each.endswith(f".{name}")] for name in pointers}
    assert all(pointed.values()), "points to a name that is not public"
    return {name for names in pointed.values() for each in names for name in parameters_of(NAMES[each])}


@EVERY
def test_a_docstring_is_complete(public: Public) -> None:
    doc = docstring_of(public)
    faults = dict(validate(doc)["errors"])
    undescribed = set(re.findall(r"'\**(\w+)'", faults.pop("PR01", "")))
    if inspect.isclass(public.value) and doc["Attributes"] and not doc["Parameters"]:
        described = [name for each in doc["Attributes"] for name in each.name.split(", ")]
        assert set(described) >= set(fields_of(public.value))
        known = {*fields_of(public.value), *inspect.get_annotations(public.value), *dir(public.value)}
        assert set(described) <= known
        undescribed = set()
    if isinstance(public.value, PROPERTIES):
        faults.pop("RT01", None)  # its summary says what it is
    assert {code: text for code, text in faults.items() if code in FAULTS} == {}
    assert undescribed <= shared_parameters(public)
    assert len(" ".join(doc["Summary"])) <= LONGEST_SUMMARY


USED = in_code(blocks_only=True)
NAMED = in_code()


@EVERY
def test_what_a_page_shows_in_use_has_an_example(public: Public) -> None:
    assert public.is_member or public.last not in USED or has_example(public)


@EVERY
def test_a_page_names_it(public: Public) -> None:
    assert public.last in NAMED


@pytest.mark.parametrize("module", MODULES)
def test_a_public_module_lists_its_names(module: str) -> None:
    loaded = importlib.import_module(module)
    assert loaded.__doc__
    assert all(hasattr(loaded, name) for name in loaded.__all__)


def modules_with_code() -> Iterator[str]:
    """Name all modules but the command line, whose libraries are its own."""
    for found in pkgutil.walk_packages(cgroup.__path__, "cgroup."):
        if not found.name.startswith(("cgroup._", "cgroup.cli")):
            yield found.name


@pytest.mark.parametrize("module", ["cgroup", *modules_with_code()])
def test_examples_run(module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # for those that write files
    assert doctest.testmod(importlib.import_module(module)).failed == 0


def raised_by(public: Public) -> set[str]:
    """Name the errors that a docstring says may be raised."""
    return {each.type.rpartition(".")[2] for each in docstring_of(public)["Raises"]}


def code_of(public: Public) -> str:
    """Return what runs when it is called, as far as somebody wrote it."""
    called = [public.documented]
    if inspect.isclass(public.value):
        called = [vars(public.value).get(name) for name in ("__init__", "__post_init__")]
    written = [each for each in called if each and Path(each.__code__.co_filename).is_file()]
    return "".join(map(inspect.getsource, written))


@EVERY
def test_raise_statements_are_documented(public: Public) -> None:
    raised = set(re.findall(r"^ +raise ([A-Z]\w+)\(", code_of(public), flags=re.MULTILINE))
    assert raised - {"NotImplementedError"} <= raised_by(public) | SHARED_ERRORS


@EVERY
def test_what_is_documented_is_raised(
    public: Public, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Refused memory and the `InputError` of `called_names` are tested elsewhere."""
    monkeypatch.chdir(tmp_path)
    tested = {"OutOfMemoryError"}
    if public.name.removeprefix("cgroup.") in called_names():
        tested.add("InputError")
    provoked = set()
    for call in WRONG_CALLS.get(public.name, ()):
        with pytest.raises(Exception) as caught:
            call(public.value)
        provoked.add(type(caught.value).__name__)
    assert provoked <= raised_by(public) | SHARED_ERRORS
    assert raised_by(public) <= provoked | tested
