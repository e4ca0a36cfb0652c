"""Values that a caller may pass by mistake, for any parameter."""

import math
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from cgroup.registry import MethodOption

ENDLESS: list[Any] = []
ENDLESS += [ENDLESS, ENDLESS]

HUGE = 10**400
"""A whole number that no float can hold."""


class Hostile:
    """Raises in whatever conversion it is put through, and when it is shown."""

    def _refuse(self, *_: object) -> Any:
        message = "a conversion of this object fails"
        raise RuntimeError(message)

    __float__ = __index__ = __int__ = __bool__ = __len__ = __iter__ = __array__ = __eq__ = _refuse
    __hash__ = __repr__ = __fspath__ = _refuse


class FloatLike:
    """Has a value as a float, as tensors of one element do."""

    def __float__(self) -> float:
        return 0.5


class HugeRepr:
    """Says a lot when it is shown."""

    def __repr__(self) -> str:
        return "x" * 10**6


def ignore(*_: object) -> None:
    """Do nothing: a function where a value is expected."""


WRONG: dict[str, Any] = {
    "None": None,
    "True": True,
    "-1": -1,
    "2**64": 2**64,
    "-10**5000": -(10**5000),
    "-1.5": -1.5,
    "nan": float("nan"),
    "-inf": float("-inf"),
    "5e-324": 5e-324,
    "Decimal": Decimal("0.5"),
    "Fraction": Fraction(HUGE),
    "float-like": FloatLike(),
    "longdouble": np.longdouble("1e4000"),
    "complex128": np.complex128(1 + 1j),
    "datetime64": np.datetime64("2026-01-01"),
    "0-d array": np.array(1.0),
    "1-element mask": np.array([True]),
    "empty string": "",
    "surrogate": "\ud800",
    "zero byte": "a\0b",
    "escape": "\x1b[31m\n",
    "bytes": b"0.5",
    "path": Path("nowhere"),
    "empty list": [],
    "list": [1, 2, 3],
    "ragged": [[1, 2, 3], [4, 5]],
    "long list": ["x"] * 10**5,
    "dict": {"a": 1},
    "set": {1, 2},
    "iterator": iter([1, 2, 3]),
    "function": ignore,
    "type": int,
    "object": object(),
    "hostile": Hostile(),
    "huge repr": HugeRepr(),
    "masked": np.ma.masked,
    "masked rows": np.ma.masked_less(np.arange(9.0).reshape(3, 3), 2),
    "masked in a list": [np.ma.masked_less(np.arange(3.0), 2)] * 3,
    "masked element": [[np.ma.masked, 1.0, 2.0]] * 3,
    "no rows": np.empty((0, 3)),
    "many axes": np.zeros((2, 2, 2, 2)),
    "NaN rows": np.full((3, 3), np.nan),
    "complex rows": np.zeros((3, 3), complex),
    "records": np.zeros(3, [("x", float), ("y", float)]),
    "objects": np.array([object(), None], dtype=object),
    "endless list": ENDLESS,
    "huge row": [[HUGE, 0, 0]],
}


def wrong_for(option: MethodOption) -> list[Any]:
    """Return values that an option of a method refuses, by its description."""
    numbers: list[Any] = ["1", [1.0], 1j, True]
    wrong: list[Any] = {
        "flag": [0, 1, "True"],
        "seed": [*numbers, 1.0, -1, 2**64],
        "count": [*numbers, 1.0],
        "rounds": [*numbers, 1.0],
        "length": [*numbers, 0.0, -1.0, np.nan, np.inf],
        "number": [*numbers, np.nan],
        "choice": ["nonsense", 7, 1.0, b"", []],
        "cut": ["nonsense", True, np.nan, []],
        "scale": ["x", -1, 1.0, (3, 1), (0, 1), (1, np.inf), (1, 2, 3), (1, "2"), []],
    }[option.kind]
    if option.kind in {"count", "rounds"}:
        wrong += [option.range[0] - 1, option.range[1] + 1]
    if option.kind == "number":
        wrong += [
            math.nextafter(end, away) for end, away in zip(option.range, (-np.inf, np.inf), strict=True)
        ]
    return [value for value in wrong if value not in option.range] + ([] if option.optional else [None])
