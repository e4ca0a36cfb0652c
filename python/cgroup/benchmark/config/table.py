"""What all tables of a configuration have in common."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field


class Table(BaseModel):
    """What all tables have in common: unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=False)


Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


def as_list(value: object) -> object:
    """Accept one in place of a list of one."""
    return [value] if isinstance(value, (str, int, float)) else value
