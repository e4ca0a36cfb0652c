"""How the scores of several pairs become one, which the paper doesn't say."""

from __future__ import annotations

from typing import Literal, TypeAlias

Average: TypeAlias = Literal["macro", "pooled", "f_of_means"]
"""Means over pairs, each with the same weight; the scores of all their matches taken as one set; or means,
but F of the mean precision and the mean recall."""
