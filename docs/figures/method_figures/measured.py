"""The measured figures that figures, tables and the chooser are made from."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pandas as pd

FOLDER = Path(__file__).parents[1] / "measured"
METHODS_CSV = FOLDER / "methods.csv"
OPTIONS_CSV = FOLDER / "options.csv"


@cache
def load_methods() -> pd.DataFrame:
    """Return the means of all methods on generated matches, one row per method and kind of problem."""
    return pd.read_csv(METHODS_CSV, comment="#", dtype={"set": str}, keep_default_na=False)


@cache
def load_options() -> pd.DataFrame:
    """Return what the values of options make of generated matches."""
    return pd.read_csv(OPTIONS_CSV, comment="#", dtype={"value": str}, keep_default_na=False)


def heading(path: Path) -> str:
    """Return what a file says of where its figures come from."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return " ".join(line.removeprefix("# ") for line in lines if line.startswith("#"))
