"""Types that the signatures of several methods share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeAlias

OtsuMode: TypeAlias = Literal["minmax", "exact", "covis", "legacy"]

Progress: TypeAlias = Callable[[float], Any]
