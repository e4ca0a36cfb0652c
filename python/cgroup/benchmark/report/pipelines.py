"""Sections of the report on pipelines that register two clouds or many scans."""

import numpy as np
import pandas as pd

from cgroup.benchmark.report.cells import MISSING, Cell, Table, median, number, share, tabulate, words
from cgroup.benchmark.report.charts import FigureFiles, Section
from cgroup.benchmark.report.curves import pipelines_chart, scenes_chart
from cgroup.evaluation import ecdf
from cgroup.evaluation.scene_scores import ROTATION_LIMITS, TRANSLATION_LIMITS
from cgroup.registration.pairwise import count_false_accepts, is_accepted
from cgroup.types import FloatArray

_ELLIPSOID = 12.59  # 95th percentile of chi-squared with 6 degrees of freedom
_BY = {"method": "pipeline"}
_BY_SET = {"set": "set", "method": "pipeline"}


def make_registration_section(frame: pd.DataFrame, figures: FigureFiles) -> Section | None:
    """Make the section; None without results on related pairs."""
    if frame.empty or not (frame["kind"] == "related").any():
        return None
    good = frame[frame["error"] == ""]
    related = good[good["kind"] == "related"]
    counts = related.drop_duplicates(["set", "dataset", "pair"]).groupby("set", sort=False).size()
    title = ", ".join(f"{name} ({count})" for name, count in counts.items())
    chart = pipelines_chart(good)
    shares = related.groupby("method")["right"].mean()
    alt = (
        f"Share of correct poses of {len(shares)} pipelines by overlap, by reported probability, and over "
        f"time; over all pairs {shares.idxmax()} has the most, {shares.max():.2f}."
    )
    drawn = figures.draw("registration", alt, chart, f"Registered pairs: {title}")
    tables = [answer_table(related), trust_table(good), calibration_table(good), detail_table(related)]
    return Section("Registration of whole clouds", tables, drawn)


def answer_table(related: pd.DataFrame) -> Table:
    """Tabulate the numbers of correct and of accurate poses."""
    names = [
        column
        for name in dict.fromkeys(related["set"])
        # The side with more overlap comes first.
        for column in sorted(related[related["set"] == name]["column"].unique(), reverse=True)
    ]
    sizes = related.drop_duplicates(["column", "dataset", "pair"]).groupby("column").size()

    def count(rows: pd.DataFrame, name: str) -> Cell:
        chosen = rows[rows["column"] == name]
        if chosen.empty:
            return Cell(MISSING, -1.0)
        right = int(chosen["right"].sum())
        return Cell(f"{right} / {int((chosen['right'] & chosen['accurate']).sum())}", float(right))

    columns = {f"{name} ({sizes[name]})": lambda rows, name=name: count(rows, name) for name in names}
    return tabulate("Correct poses / accurate poses", related, _BY, columns, best=True)


def trust_table(frame: pd.DataFrame) -> Table:
    """Tabulate seconds, and the accepted poses."""

    def related(rows: pd.DataFrame) -> pd.DataFrame:
        return rows[rows["kind"] == "related"]

    def seconds(rows: pd.DataFrame, name: str) -> Cell:
        chosen = related(rows)
        return number(float(chosen[chosen["set"] == name]["seconds"].median()), "{:.2f}")

    columns = {
        **{f"s, {name}": lambda rows, name=name: seconds(rows, name) for name in dict.fromkeys(frame["set"])},
        "right refused": lambda rows: share(~related(rows[rows["right"]])["ok"]),
        "wrong accepted": lambda rows: share(related(rows[~rows["right"]])["ok"]),
        "mirrored accepted": lambda rows: share(rows[rows["kind"] == "mirrored"]["ok"]),
        "unrelated accepted": lambda rows: share(rows[rows["kind"] == "mixed"]["ok"]),
    }
    return tabulate("Median seconds per pair, and accepted poses", frame, _BY, columns)


def calibration_table(frame: pd.DataFrame) -> Table:
    """Tabulate accepted poses and the calibration of the probabilities by set.

    The calibration error is the mean distance between probability and share of correct poses over ten classes
    of probability, weighted by their pairs. NEES is the squared error of accepted correct poses normalized by
    their covariance: 6 on average and below 12.6 for 95 of 100 if the covariance is correct. The stated
    number of wrong accepted poses is that of the mirrored sources that would be accepted, with its 95 %
    interval; of mirrored pairs this source would be the right one, so they do not count.
    """

    def calibration(rows: pd.DataFrame) -> Cell:
        chance = rows["probability"]
        classes = (rows["right"] - chance).groupby((10 * chance).clip(0, 9).astype(int))
        return number(float(classes.sum().abs().sum()) / len(rows), "{:.3f}")

    def nees(rows: pd.DataFrame) -> pd.Series:
        return rows[rows["right"] & rows["ok"]]["nees"].dropna()

    def stated(rows: pd.DataFrame) -> Cell:
        searched = rows[rows["decoy"].notna() & (rows["kind"] != "mirrored")]
        found = count_false_accepts(searched["ok"], searched["decoy"].map(is_accepted))
        if not found.accepted:
            return words(MISSING)
        wrong, (low, high) = (searched["ok"] & ~searched["right"]).sum(), found.interval
        interval = f"{low * found.accepted:.1f} to {high * found.accepted:.1f}"
        return words(f"{wrong}; {found.decoys} ({interval})")

    columns = {
        "right accepted": lambda rows: share(rows[rows["right"]]["ok"]),
        "wrong accepted": lambda rows: share(rows[~rows["right"]]["ok"]),
        "wrong accepted, mirrored pairs left out: true; stated": stated,
        "Brier score": lambda rows: number(float(((rows["right"] - rows["probability"]) ** 2).mean())),
        "calibration error": calibration,
        "NEES": lambda rows: number(float(nees(rows).mean()), "{:.1f}"),
        "in the 95 % ellipsoid": lambda rows: share(nees(rows) < _ELLIPSOID),
    }
    known = frame[frame["probability"].notna()].astype({"right": bool, "ok": bool})
    caption = "Calibration of the probabilities, unrelated and mirrored pairs included"
    return tabulate(caption, known, _BY_SET, columns)


def detail_table(related: pd.DataFrame) -> Table:
    """Tabulate errors and times."""

    def right(rows: pd.DataFrame) -> pd.DataFrame:
        return rows[rows["right"]].assign(shift=lambda chosen: chosen["translation_error"] / chosen["voxel"])

    columns = {
        "right": lambda rows: number(len(right(rows)), "{:.0f}"),
        "rotation (degrees)": lambda rows: median("rotation_error", "{:.2f}")(right(rows)),
        "translation (voxels)": lambda rows: median("shift", "{:.2f}")(right(rows)),
        "total (ms)": median("seconds", "{:.0f}", 1e3),
    }
    return tabulate("Median errors of correct poses, and median times of all", related, _BY_SET, columns)


def make_scene_section(frame: pd.DataFrame, figures: FigureFiles) -> Section | None:
    """Make the section; None without results."""
    good = frame[frame["error"] == ""] if len(frame) else frame
    if good.empty:
        return None
    sizes = good.drop_duplicates(["set", "pair"]).groupby("set", sort=False)["scans"].sum()
    title = ", ".join(f"{name} ({size})" for name, size in sizes.items())
    chart = scenes_chart(good)
    shares = {
        name: ecdf(np.concatenate(rows["rotation"].tolist()), ROTATION_LIMITS[:1])[0]
        for name, rows in good.groupby("method", sort=False)
    }
    best = max(shares, key=lambda name: shares[name])
    alt = (
        f"Share of pairs of scans up to each error, of {len(shares)} pipelines for many scans; over all sets "
        f"{best} has the most within {ROTATION_LIMITS[0]:g} degrees, {shares[best]:.2f}."
    )
    drawn = figures.draw("scenes", alt, chart, f"Many scans: {title}", columns=2)
    return Section("Many scans", [scene_table(good)], drawn)


def scene_table(good: pd.DataFrame) -> Table:
    """Tabulate components, errors of every two scans of one place, and costs; seeds are taken together."""

    def fraction(rows: pd.DataFrame, part: str, whole: str) -> Cell:
        done, wanted = int(rows[part].sum()), int(rows[whole].sum())
        return Cell(f"{done} of {wanted}", done / max(wanted, 1))

    def errors(rows: pd.DataFrame, column: str) -> FloatArray:
        return np.concatenate(rows[column].tolist())

    def known(rows: pd.DataFrame, column: str) -> FloatArray:
        """Return the errors of pairs in one component."""
        every = errors(rows, column)
        finite = every[np.isfinite(every)]
        return finite if len(finite) else np.array([np.nan])

    def within(rows: pd.DataFrame, column: str, limits: tuple[float, ...]) -> Cell:
        shares = 100 * ecdf(errors(rows, column), limits)
        return Cell(" ".join(f"{share:.0f}" for share in shares), float(shares[0]))

    def limits_of(limits: tuple[float, ...]) -> str:
        return "/".join(f"{limit:g}" for limit in limits)

    columns = {
        "components right": lambda rows: fraction(rows, "right", "wanted"),
        "mixed": lambda rows: number(rows["mixed"].sum(), "{:.0f}"),
        "placed": lambda rows: fraction(rows, "placed", "scans"),
        "median degrees": lambda rows: number(float(np.median(known(rows, "rotation"))), "{:.3g}"),
        "largest degrees": lambda rows: number(float(known(rows, "rotation").max()), "{:.3g}"),
        "median shift": lambda rows: number(float(np.median(known(rows, "translation"))), "{:.3g}"),
        "largest shift": lambda rows: number(float(known(rows, "translation").max()), "{:.3g}"),
        f"% within {limits_of(ROTATION_LIMITS)} degrees": lambda rows: within(
            rows, "rotation", ROTATION_LIMITS
        ),
        f"% within {limits_of(TRANSLATION_LIMITS)} shift": lambda rows: within(
            rows, "translation", TRANSLATION_LIMITS
        ),
        "pairs tried": lambda rows: number(rows["tried"].sum(), "{:.0f}"),
        "s": median("seconds", "{:.1f}"),
    }
    caption = "Components, errors, registered pairs of scans, and seconds"
    return tabulate(caption, good, {"set": "set", "method": "solver"}, columns)
