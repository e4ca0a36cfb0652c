"""How a group came about: what `Grouping.explain` needs besides the group."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    from cgroup._checks.fields import Fields


@dataclass(frozen=True, eq=False)
class Run:
    """A method as it was called.

    Attributes
    ----------
    method : str
        Public name; "register" for the verified group of a registration.
    options : mapping of str to value
        All options of the method that say what it selects.
    frames : Fields or None
        Frames and centroid, for a method that votes by them (3DHV).
    resolution : float or None
        The unit pr, in the data's unit, where it is known.
    """

    method: str
    options: Mapping[str, Any]
    frames: Fields | None = None
    resolution: float | None = None
