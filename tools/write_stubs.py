"""Write the type stub of `cgroup.methods` from the signatures of the methods."""

from __future__ import annotations

import inspect
import json
from pathlib import Path
from typing import TYPE_CHECKING

import cgroup
from cgroup.methods import METHOD_INFO

if TYPE_CHECKING:
    from cgroup.registry import MethodInfo

STUB = Path(cgroup.__file__).parent / "methods" / "__init__.pyi"

_HEAD = """# Made by tools/write_stubs.py.

from collections.abc import Callable
from typing import Any, Literal, TypeAlias

from numpy.typing import ArrayLike

from cgroup.methods._declare import MethodInfo
from cgroup.types import AnyCloud, Grouping
"""


def stub() -> str:
    """Return the text of the stub."""
    infos = METHOD_INFO.values()
    names = "".join(f"    {json.dumps(info.name)},\n" for info in infos)
    functions = sorted(info.function.__name__ for info in infos)
    listed = "".join(f"    {json.dumps(name)},\n" for name in functions)
    return "\n".join(
        [
            f"{_HEAD}",
            f"__all__ = [\n{listed}]\n",
            f"MethodName: TypeAlias = Literal[\n{names}]",
            "METHOD_INFO: dict[str, MethodInfo]\n",
            *map(_function, infos),
            "",
        ]
    )


def _function(info: MethodInfo) -> str:
    lines: list[str] = []
    for parameter in inspect.signature(info.function).parameters.values():
        if parameter.kind is parameter.KEYWORD_ONLY and "    *," not in lines:
            lines.append("    *,")
        lines.append(f"    {parameter.name}: {parameter.annotation}{_default(parameter.default)},")
    return "\n".join([f"def {info.function.__name__}(", *lines, ") -> Grouping: ..."])


def _default(value: object) -> str:
    if value is inspect.Parameter.empty:
        return ""
    return f" = {json.dumps(value)}" if isinstance(value, str) else f" = {value!r}"


if __name__ == "__main__":
    STUB.write_text(stub(), encoding="utf-8")
