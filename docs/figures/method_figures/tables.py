"""Tables of measured figures and docstrings: pages include them, README has them between two marks."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from cgroup.registry import METHOD_INFO, find_method
from method_figures.measured import (
    FOLDER,
    METHODS_CSV,
    OPTIONS_CSV,
    ROOT,
    load_methods,
    load_origin,
    load_table,
)
from method_figures.option_table import option_table

if TYPE_CHECKING:
    from collections.abc import Iterable

    import pandas as pd

    from cgroup.registry import MethodInfo

PAGES = [ROOT / "README.md", *sorted(ROOT.glob("docs/*.md")), *sorted(ROOT.glob("docs/[hms]*/*.md"))]
"""README, and the pages written by hand: those of docs, how-tos, methods, and the start."""

SIZES = (200, 1000, 5000, 20_000)
SHARES = (0.5, 0.2, 0.1, 0.05, 0.02, 0.01)
CLOSE = 0.02
"""Methods whose F is less than this below the best are as good."""

VERDICTS = (
    "cgroup",
    "cgroup, no viewpoint",
    "Open3D RANSAC",
    "KISS-Matcher",
    "KISS-Matcher + small_gicp",
)
SPEED_PEERS = ("cgroup", "PCL", "NumPy")

_OPENING = re.compile(r"<!-- measured: ([^\n]+?) -->\n.*?<!-- end of measured -->", re.DOTALL)

_INFOS = METHOD_INFO.values()
GROUPS = {
    "individual": tuple(info for info in _INFOS if info.individual),
    "group": tuple(info for info in _INFOS if info.in_paper and not info.individual),
    "modern": tuple(info for info in _INFOS if not info.in_paper),
}
"""Methods by kind, as the pages list them."""

_CAPTIONS = {"individual": "Individual", "group": "Group-based", "modern": "Modern"}

_NUMERIC = "0123456789.,-+e/*% of°"
"""What cells of numbers, of shares, and of counts such as 3 of 7 consist of."""

_NEEDS = {"source": "points", "similarity": "similarities", "ratio": "ratios", "source_lrf": "frames"}


def write_tables() -> None:
    """Write the tables into all pages."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        page.write_text(fill(text), encoding="utf-8")


def fill(text: str) -> str:
    """Return the text of a page with its tables made anew."""

    def render(found: re.Match[str]) -> str:
        kind, _, name = found[1].partition(" ")
        table = {"table": measured_table, "verdicts": verdict_table}[kind](name)
        return f"<!-- measured: {found[1]} -->\n{table}\n<!-- end of measured -->"

    return _OPENING.sub(render, text)


def included() -> dict[str, str]:
    """Return the Markdown that pages include, by the name of its file."""
    shown = [path.stem for path in sorted(FOLDER.glob("*.csv")) if path not in {METHODS_CSV, OPTIONS_CSV}]
    found = {name: measured_table(name) for name in shown}
    found |= {"all-methods": all_table(), "best-methods": best_table(), "needs": needs_table()}
    found["speed-beside-pcl"] = speed_table()
    found |= {f"toctree-{group}": toctree(group) for group in GROUPS}
    for info in _INFOS:
        name = info.function.__name__
        found[f"{name}-options"] = _options(name, info.label)
        found[f"{name}-cost"] = _cost(name)
        found[f"{name}-limits"] = _limits(name)
    return found


def _options(name: str, label: str) -> str:
    """Return tables of what a method takes, and the figure of its main options."""
    caption = (
        "One option is changed at a time; means over the problems. *Views* are from "
        "`cgroup.datasets.standin_pair`, *generated* matches from `cgroup.datasets.make_problem`."
    )
    alt = f"Precision, recall, F and time of {label} over the values of its main options"
    return f"{option_table(name)}\n\n{_figure(f'{name}-options', alt, caption)}"


def _cost(name: str) -> str:
    """Return the figure and the table of a method's time and memory."""
    alt = "Time and peak memory over the number of matches, with other methods"
    return f"{_figure(f'{name}-cost', alt)}\n\n{cost_table(name)}"


def _limits(name: str) -> str:
    """Return the figure of a method's F on harder and harder problems."""
    alt = "F over the share of correct matches, the noise, and kinds of wrong matches or of frames"
    caption = (
        "Generated problems of 1,000 matches, means of five to eight. [Which method](choose.md) compares all."
    )
    return _figure(f"{name}-limits", alt, caption)


def _figure(name: str, alt: str, caption: str = "") -> str:
    opening = f"```{{figure}} ../_generated/methods/{name}.png\n:alt: {alt}\n:width: 100%\n"
    return f"{opening}\n{caption}\n```" if caption else f"{opening}```"


def sized(n: int | None = None, share: float | None = None) -> pd.DataFrame:
    """Return the figures on problems of some size, uniform and with good frames."""
    table = load_methods()
    chosen = table[table["set"].isin([str(size) for size in SIZES])]
    if n is not None:
        chosen = chosen[chosen["n"] == n]
    return chosen if share is None else chosen[chosen["inliers"] == share]


def cost_table(function: str) -> str:
    """List time and memory of a method over the number of matches."""
    rows = sized()[lambda table: table["method"] == public(function)]
    lines = [
        "| matches | ms, 50 % correct | ms, 10 % correct | ms, 2 % correct | MiB, 10 % correct |",
        "|---:|---:|---:|---:|---:|",
    ]
    for n in SIZES:
        at = rows[rows["n"] == n].set_index("inliers")
        times = [time(at["milliseconds"].get(share)) for share in (0.5, 0.1, 0.02)]
        lines.append(f"| {n:,} | {' | '.join(times)} | {memory(at['mebibytes'].get(0.1))} |")
    return _captioned(lines, f"Medians of 8, 8, 3 and 1 problems. {_source()}")


def all_table() -> str:
    """List all methods with their input, cost and F."""
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


def best_table() -> str:
    """List the fastest of the best methods by size and share of correct matches."""
    lines = [
        "| correct | " + " | ".join(f"{n:,} matches" for n in SIZES) + " |",
        "|---:|" + "---|" * len(SIZES),
    ]
    for share in SHARES:
        cells = [_best(_on_points(sized(n, share))) for n in SIZES]
        lines.append(f"| {100 * share:g} % | " + " | ".join(cells) + " |")
    return _captioned(lines, _source())


def _on_points(rows: pd.DataFrame) -> pd.DataFrame:
    """Keep methods that need points only."""
    able = [info.name for info in METHOD_INFO.values() if info.fields == ("source", "target")]
    return rows[rows["method"].isin(able)]


def _best(rows: pd.DataFrame) -> str:
    if rows.empty:
        return "-"
    good = rows[rows["f_score"] >= rows["f_score"].max() - CLOSE]
    first = good.sort_values("milliseconds").iloc[0]
    return f"{link(first['method'])} {two(first['f_score'])}, {time(first['milliseconds'])} ms"


def needs_table() -> str:
    """List the methods of highest precision, of highest recall, and of least time, for 1,000 matches."""
    lines = [
        "| correct | highest precision; recall | precision >= .9; highest recall | fastest with F >= .9 |",
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
    """Format a size with two digits; the system does not resolve less than 0.1 MiB."""
    return "-" if mebibytes is None else "below 0.1" if mebibytes < 0.1 else _short(mebibytes)


def _short(value: float) -> str:
    if value >= 100:
        return f"{float(f'{value:.2g}'):,.0f}"
    if value >= 10:
        return f"{value:.0f}"
    return f"{float(f'{value:.2g}'):g}"


def measured_table(name: str) -> str:
    """Return a file of measurements as a table, with numbers right-aligned."""
    path = FOLDER / f"{name}.csv"
    table = load_table(path)
    right = [all(not cell.strip(_NUMERIC) for cell in table[column]) for column in table]
    rows = [list(table), ["---:" if flush else "---" for flush in right], *table.to_numpy().tolist()]
    return _captioned(("| " + " | ".join(row) + " |" for row in rows), str(load_origin(path)))


def verdict_table(_: str) -> str:
    """List how many correct poses some pipelines find, and how many correct and wrong ones they accept."""
    path = FOLDER / "registration-trust.csv"
    rows = [row for row in load_table(path).to_dict("records") if row["pipeline"] in VERDICTS]
    lines: list[str] = []
    for row in rows:
        refused, found = _counts(row["right refused"])
        wrong, missed = _counts(row["wrong accepted"])
        others = [_counts(row[f"{kind} accepted"]) for kind in ("mirrored", "unrelated")]
        wrong += sum(accepted for accepted, _ in others)
        without = sum(of for _, of in others)
        seconds = "; ".join(row[f"s, {name}"] for name in ("range views", "rooms", "LiDAR"))
        cells = [row["pipeline"], f"{found} of {found + missed}", str(found - refused)]
        cells += [f"{wrong} of {found + missed + without}", seconds]
        lines.append(f"| {' | '.join(cells)} |")
    header = [
        "| pipeline | correct found | correct accepted | wrong accepted | s: views; rooms; LiDAR |",
        "|---|---:|---:|---:|---:|",
    ]
    return _captioned([*header, *lines], str(load_origin(path)))


def _counts(cell: str) -> tuple[int, int]:
    """Take "3 of 7" apart; where there are none, the cell is "-"."""
    some, _, of = cell.partition(" of ")
    return (int(some), int(of)) if of else (0, 0)


def speed_table() -> str:
    """List time and F of methods beside PCL and NumPy: 5,000 matches, 3 % correct, one thread."""
    path = FOLDER / "peers-5000.csv"
    shown: dict[str, dict[str, str]] = {}
    method = ""
    for row in load_table(path).to_dict("records"):
        library, _, rest = row["program"].strip("*").partition(" ")
        if library == "cgroup":
            method = rest
        if library in SPEED_PEERS and row["right"] == "3 %":
            cell = f"{_milliseconds(row['ms, 1 thread'])}, F {two(float(row['F']))}"
            shown.setdefault(method, {}).setdefault(library, cell)
    lines = ["| method | " + " | ".join(SPEED_PEERS) + " |", "|---|" + "---:|" * len(SPEED_PEERS)]
    lines += [
        f"| {method} | " + " | ".join(cells.get(library, "") for library in SPEED_PEERS) + " |"
        for method, cells in shown.items()
        if len(cells) > 1
    ]
    return _captioned(lines, str(load_origin(path)))


def _milliseconds(text: str) -> str:
    value = float(text.replace(",", ""))
    return f"{value / 1000:.2g} s" if value >= 1000 else f"{_short(value)} ms"


def _source() -> str:
    return str(load_origin(METHODS_CSV))


def _captioned(lines: Iterable[str], caption: str) -> str:
    return "\n".join([*lines, "", f"*{caption}*"])
