"""Every public name says what it takes, returns and raises, and shows one example, which runs."""

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
from public_names import MODULES, PROPERTIES, Public, public_names
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
    "PR01",  # a parameter that isn't described
    "PR02",  # one that doesn't exist
    "PR03",  # another order
    "PR04",  # no type
    "PR07",  # no description
    "RT01",  # no Returns
    "RT03",  # no description
    "YD01",  # no Yields
    "EX01",  # no example
}
"""What numpydoc finds, and what is a fault here."""

POINTERS = re.compile(r"[Ss]ee (the (module|class|docstring)|`)|[Aa]s in `|[Ll]ikewise[;.]|docs/\w")
"""What leaves the reader of a single page, or of `help`, without an answer."""


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


@EVERY
def test_a_docstring_is_complete(public: Public) -> None:
    doc = docstring_of(public)
    faults = dict(validate(doc)["errors"])
    if inspect.isclass(public.value) and doc["Attributes"] and not doc["Parameters"]:
        described = [name for each in doc["Attributes"] for name in each.name.split(", ")]
        assert set(described) >= set(fields_of(public.value))
        known = {*fields_of(public.value), *inspect.get_annotations(public.value), *dir(public.value)}
        assert set(described) <= known
        faults.pop("PR01", None)
    if isinstance(public.value, PROPERTIES):
        faults.pop("RT01", None)  # its summary says what it is
    assert {code: text for code, text in faults.items() if code in FAULTS} == {}
    assert len(" ".join(doc["Summary"])) <= LONGEST_SUMMARY
    assert POINTERS.search(inspect.getdoc(public.documented) or "") is None


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


# Libraries, beyond those of the tests, that examples of a module need.
NEEDED = {"cgroup.pages.recording": "rerun"}


@pytest.mark.parametrize("module", ["cgroup", *modules_with_code()])
def test_examples_run(module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if module in NEEDED:
        pytest.importorskip(NEEDED[module], reason=f"the examples of {module} need {NEEDED[module]}")
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
    assert raised - {"NotImplementedError"} <= raised_by(public)


@EVERY
def test_what_is_documented_is_raised(
    public: Public, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Memory that is refused, and the `InputError` of `called_names`, are tested elsewhere."""
    monkeypatch.chdir(tmp_path)
    provoked = {"InputError"} if public.name.removeprefix("cgroup.") in called_names() else set()
    for call in WRONG_CALLS.get(public.name, ()):
        with pytest.raises(Exception) as caught:
            call(public.value)
        provoked.add(type(caught.value).__name__)
    assert provoked == raised_by(public) - {"OutOfMemoryError"}
