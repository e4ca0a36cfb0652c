"""Tables of the methods' pages that are made from the measured figures and docstrings, between two marks."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from cgroup.registry import METHOD_INFO, find_method
from method_figures.measured import METHODS_CSV, heading, load_methods
from method_figures.option_table import option_table

if TYPE_CHECKING:
    from collections.abc import Iterable

    import pandas as pd

    from cgroup.registry import MethodInfo

PAGES = Path(__file__).parents[2] / "methods"
SIZES = (200, 1000, 5000, 20_000)
SHARES = (0.5, 0.2, 0.1, 0.05, 0.02, 0.01)
CLOSE = 0.02
"""Methods whose F is less than this below the best are as good."""

_OPENING = re.compile(r"<!-- (made|measured): ([^\n]+?) -->\n.*?<!-- end of \1 -->", re.DOTALL)

_INFOS = METHOD_INFO.values()
GROUPS = {
    "individual": tuple(info for info in _INFOS if info.individual),
    "group": tuple(info for info in _INFOS if info.in_paper and not info.individual),
    "modern": tuple(info for info in _INFOS if not info.in_paper),
}
"""Methods by kind, as the pages list them."""

_CAPTIONS = {"individual": "Individual", "group": "Group-based", "modern": "Modern"}

_NEEDS = {"source": "points", "similarity": "similarities", "ratio": "ratios", "source_lrf": "frames"}


def write_tables() -> None:
    """Write the tables into all pages."""
    for page in sorted(PAGES.glob("*.md")):
        text = page.read_text(encoding="utf-8")
        page.write_text(fill(text), encoding="utf-8")


def fill(text: str) -> str:
    """Return the text of a page with its tables made anew."""

    def render(found: re.Match[str]) -> str:
        how, what = found.groups()
        return f"<!-- {how}: {what} -->\n{_render(what)}\n<!-- end of {how} -->"

    return _OPENING.sub(render, text)


def _render(what: str) -> str:
    kind, _, name = what.partition(" ")
    tables = {
        "cost": cost_table,
        "all": all_table,
        "best": best_table,
        "needs": needs_table,
        "options": option_table,
        "toctree": toctree,
    }
    return tables[kind](name)


def sized(n: int | None = None, share: float | None = None) -> pd.DataFrame:
    """Return the figures on problems of some size, uniform and with good frames."""
    table = load_methods()
    chosen = table[table["set"].isin([str(size) for size in SIZES])]
    if n is not None:
        chosen = chosen[chosen["n"] == n]
    return chosen if share is None else chosen[chosen["inliers"] == share]


def cost_table(function: str) -> str:
    """List time and memory of one method over the number of matches."""
    rows = sized()[lambda table: table["method"] == public(function)]
    lines = [
        "| matches | ms, 50 % right | ms, 10 % right | ms, 2 % right | MiB, 10 % right |",
        "|---:|---:|---:|---:|---:|",
    ]
    for n in SIZES:
        at = rows[rows["n"] == n].set_index("inliers")
        times = [time(at["milliseconds"].get(share)) for share in (0.5, 0.1, 0.02)]
        lines.append(f"| {n:,} | {' | '.join(times)} | {memory(at['mebibytes'].get(0.1))} |")
    return _captioned(
        lines, "Medians of 8, 8, 3 and 1 problems, one thread of a machine that had other work too."
    )


def all_table(_: str) -> str:
    """List all methods with what they need, their cost, and what they reach."""
    lines = [
        "| method | idea | needs | cost | F at 10 / 2 / 1 % | ms |",
        "|---|---|---|---|---:|---:|",
    ]
    for group, infos in GROUPS.items():
        lines.append(f"| ***{group}*** |" + " |" * 5)
        lines.extend(map(_method_row, infos))
    return _captioned(lines, _source())


def _method_row(info: MethodInfo) -> str:
    rows = sized(1000)[lambda table: table["method"] == info.name].set_index("inliers")
    scores = " / ".join(two(rows["f_score"][share]) for share in (0.1, 0.02, 0.01))
    needs = ", ".join(_NEEDS[field] for field in info.fields if field in _NEEDS)
    return (
        f"| {link(info.name)} | {info.idea} | {needs} | {info.complexity} | {scores} "
        f"| {time(rows['milliseconds'][0.1])} |"
    )


def toctree(group: str) -> str:
    """List the pages of a group of methods."""
    names = [info.function.__name__ for info in GROUPS[group]]
    return "\n".join(["```{toctree}", ":hidden:", f":caption: {_CAPTIONS[group]}", "", *names, "```"])


def best_table(_: str) -> str:
    """List the fastest of the best methods by size and share of right matches."""
    lines = [
        "| right | " + " | ".join(f"{n:,} matches" for n in SIZES) + " |",
        "|---:|" + "---|" * len(SIZES),
    ]
    for share in SHARES:
        cells = [_best(_on_points(sized(n, share))) for n in SIZES]
        lines.append(f"| {100 * share:g} % | " + " | ".join(cells) + " |")
    return _captioned(lines, _source())


def _on_points(rows: pd.DataFrame) -> pd.DataFrame:
    """Leave out what can't do without ratios, similarities or frames."""
    able = [info.name for info in METHOD_INFO.values() if info.fields == ("source", "target")]
    return rows[rows["method"].isin(able)]


def _best(rows: pd.DataFrame) -> str:
    if rows.empty:
        return "-"
    good = rows[rows["f_score"] >= rows["f_score"].max() - CLOSE]
    first = good.sort_values("milliseconds").iloc[0]
    return f"{link(first['method'])} {two(first['f_score'])}, {time(first['milliseconds'])} ms"


def needs_table(_: str) -> str:
    """List what to take for precision, for recall, and in a hurry, of 1,000 matches."""
    lines = [
        "| right | fewest false: precision, recall | fewest missed, at precision .9 | fastest, F .9 |",
        "|---:|---|---|---|",
    ]
    for share in SHARES:
        rows = _on_points(sized(1000, share))
        lines.append(f"| {100 * share:g} % | {_precise(rows)} | {_complete(rows)} | {_fast(rows)} |")
    return _captioned(lines, _source())


def _precise(rows: pd.DataFrame) -> str:
    first = rows.assign(rounded=rows["precision"].round(2)).sort_values(["rounded", "recall"]).iloc[-1]
    return f"{link(first['method'])} {two(first['precision'])}, {two(first['recall'])}"


def _complete(rows: pd.DataFrame) -> str:
    good = rows[rows["precision"] >= 0.9]
    if good.empty:
        return "none"
    first = good.assign(rounded=good["recall"].round(2)).sort_values(["rounded", "precision"]).iloc[-1]
    return f"{link(first['method'])} {two(first['precision'])}, {two(first['recall'])}"


def _fast(rows: pd.DataFrame) -> str:
    good = rows[rows["f_score"] >= 0.9]
    if good.empty:
        return "none"
    first = good.sort_values("milliseconds").iloc[0]
    return f"{link(first['method'])} {two(first['f_score'])}, {time(first['milliseconds'])} ms"


def public(function: str) -> str:
    """Return the public name of a method by its function's."""
    return find_method(function).name


def function_of(method: str) -> str:
    """Return the function's name of a method by its public one."""
    return METHOD_INFO[method].function.__name__


def link(method: str) -> str:
    """Return a link to the page of a method."""
    return f"[{METHOD_INFO[method].label}]({function_of(method)}.md)"


def two(value: float) -> str:
    """Format a share with two digits, as the pages do."""
    text = f"{value:.2f}"
    return "1" if text == "1.00" else text.removeprefix("0")


def time(milliseconds: float | None) -> str:
    """Format a time with two digits."""
    return "-" if milliseconds is None else _short(milliseconds)


def memory(mebibytes: float | None) -> str:
    """Format a size; what the system can't tell from nothing is said so."""
    return "-" if mebibytes is None else "below 0.1" if mebibytes < 0.1 else _short(mebibytes)


def _short(value: float) -> str:
    if value >= 100:
        return f"{float(f'{value:.2g}'):,.0f}"
    if value >= 10:
        return f"{value:.0f}"
    return f"{float(f'{value:.2g}'):g}"


def _source() -> str:
    return heading(METHODS_CSV)


def _captioned(lines: Iterable[str], caption: str) -> str:
    return "\n".join([*lines, "", f"*{caption}*"])
