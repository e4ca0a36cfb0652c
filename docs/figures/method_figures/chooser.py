"""The chooser: a form that sorts the methods by their measurements."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from cgroup.registry import METHOD_INFO, MethodInfo
from method_figures.measured import METHODS_CSV, load_origin
from method_figures.tables import SHARES, SIZES, function_of, sized

_TEMPLATE = Path(__file__).with_suffix(".html")
_PLACE = "/*DATA*/"
_NEEDS = {"source": "points", "similarity": "similarity", "ratio": "ratio", "source_lrf": "frames"}
_FREE_OF_LENGTHS = {"ss", "nnsr", "st", "3dhv", "gtm"}
_FIGURES = {
    "f": "f_score",
    "precision": "precision",
    "recall": "recall",
    "ms": "milliseconds",
    "mib": "mebibytes",
}


def render_chooser() -> str:
    """Return the chooser as self-contained HTML."""
    data = json.dumps(chooser_data(), separators=(",", ":"), ensure_ascii=False).replace("</", "<\\/")
    return _TEMPLATE.read_text(encoding="utf-8").replace(_PLACE, data)


def chooser_data() -> dict[str, Any]:
    """Return the data of the form: methods with their input, and measurements by size and fraction."""
    rows = [
        {
            "method": row["method"],
            "n": int(row["n"]),
            "share": float(row["inliers"]),
            **{key: round(float(row[column]), 3) for key, column in _FIGURES.items()},
        }
        for _, row in sized().iterrows()
    ]
    return {
        "sizes": list(SIZES),
        "shares": list(SHARES),
        "methods": [_method(info) for info in METHOD_INFO.values()],
        "rows": rows,
        "source": str(load_origin(METHODS_CSV)),
    }


def _method(info: MethodInfo) -> dict[str, Any]:
    needs = [_NEEDS[field] for field in info.fields if field in _NEEDS]
    if info.name not in _FREE_OF_LENGTHS:
        needs.append("length")
    return {"name": info.name, "label": info.label, "page": f"{function_of(info.name)}.html", "needs": needs}
