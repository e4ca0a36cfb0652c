"""Format values for tables."""

from __future__ import annotations

UNKNOWN = "-"
"""Stands for what isn't known."""


def show_value(value: object, form: str = ".3g") -> str:
    """Return a value of a document as text; numbers with a fraction in the form that is asked for."""
    if value is None:
        return UNKNOWN
    if isinstance(value, bool):
        return "yes" if value else "no"
    return format(value, form) if isinstance(value, float) else str(value)


def show_date(date: str | None) -> str:
    """Return the day and the minute of a date in ISO's notation."""
    return UNKNOWN if date is None else date[:16].replace("T", " ")


def milliseconds(value: float) -> str:
    """Return a duration in milliseconds: with a decimal where it is short."""
    return f"{value:.1f}" if value < 100 else f"{value:.0f}"
