"""For each claim, changes of the records after which nothing that it says is true any more.

A change touches the numbers that the statement is about and nothing else, so that other columns need not fit.
Where a claim has bounds on both sides, there is a contradiction for each.
"""

from __future__ import annotations

from typing import NamedTuple

from record_changes import Change, above, add, below, but, put, turn_around


class Contradiction(NamedTuple):
    """What is the case instead, and the changes of records and of times that bring it about."""

    instead: str
    records: tuple[Change, ...] = ()
    times: tuple[Change, ...] = ()


def _records(instead: str, *changes: Change) -> Contradiction:
    return Contradiction(instead, records=changes)


def _times(instead: str, *changes: Change) -> Contradiction:
    return Contradiction(instead, times=changes)


NOISE = {"nuisance": "noise"}
DENSITY = {"nuisance": "density"}
SCENES = {"dataset": "u3or"}
VIEWS = {"experiment": "overlap"}
COUNTS = {"experiment": "matches"}
ON_B3R, ON_U3OR, ON_U3M = (
    {"experiment": "combinations", "dataset": dataset} for dataset in ("b3r", "u3or", "stanford")
)
LFSH, RCS = ("C2", "C5"), ("C3", "C6")

CONTRADICTIONS = {
    "C-01": [_records("half of the matches are correct", put("inlier_ratio", 0.5, level=0.05, **NOISE))],
    "C-02": [_records("more than 3 % are correct", put("inlier_ratio", 0.031, **SCENES))],
    "C-03": [_records("no method does well", put("precision", 0.39, level=below(0.2), **NOISE))],
    "C-04": [
        _records(
            "CV and GTM are ahead of both",
            put("f_score", 0.9, method=("ransac", "st"), level=below(0.2), **NOISE),
        )
    ],
    "C-05": [
        _records(
            "the lead stays the same",
            put("f_score", 0.9, method=("ransac", "st"), **NOISE),
            put("f_score", 0.8, method=but("ransac", "st"), **NOISE),
        )
    ],
    "C-06": [
        _records("the three tie", put("precision", 0.9, method=("nnsr", "gc", "3dhv"), **NOISE)),
    ],
    "C-07": [_records("recall is lower", put("recall", 0.89, **NOISE))],
    "C-08": [_records("GC drops further", add("f_score", -0.3, method="gc", level=above(0.4), **NOISE))],
    "C-09": [_records("CV and GTM are ahead", put("f_score", 0.8, method=("ransac", "st"), **DENSITY))],
    "C-10": [_records("recall is lower", put("recall", 0.89, method=("gtm", "cv"), **DENSITY))],
    "C-11": [
        _records("SS and SI tie", put("precision", 0.5, method=("ss", "si"), level=below(0.35), **DENSITY))
    ],
    "C-12": [_records("recall doesn't depend on density", put("recall", 0.8, **DENSITY))],
    "C-13": [
        _records("scenes are as easy as models", put("f_score", 0.5, **NOISE), put("f_score", 0.5, **SCENES))
    ],
    "C-14": [_records("RANSAC is ahead", put("precision", 0.4, method="gtm", experiment="clutter"))],
    "C-15": [_records("RANSAC is ahead", put("precision", 0.4, method="gtm", experiment="occlusion"))],
    "C-16": [
        _records("GTM recalls second most", put("recall", 0.85, method="gtm", **SCENES)),
        _records("GTM recalls least", put("recall", 0.0, method="gtm", **SCENES)),
    ],
    "C-17": [
        _records(
            "GTM's groups are like all others",
            put("selected", 100, **SCENES),
            put("precision", 0.3, **SCENES),
        )
    ],
    "C-18": [_records("SI recalls more", put("recall", 0.7, method="cv", **SCENES))],
    "C-19": [_records("the lead is the same along both", put("recall", 0.92, method="cv", **SCENES))],
    "C-20": [
        _records(
            "ST is fourth on both",
            put("f_score", 0.36, method="st", **SCENES),
            put("f_score", 0.92, method="st", **NOISE),
        )
    ],
    "C-21": [
        _records("F falls as views overlap more", put("f_score", lambda rows: 1 - rows["overlap"], **VIEWS))
    ],
    "C-22": [_records("RANSAC is ahead", put("precision", 0.5, method="gtm", **VIEWS))],
    "C-23": [
        _records(
            "GTM leads by 45 points",
            put("precision", 0.95, method="gtm", **VIEWS),
            put("precision", 0.5, method=but("gtm"), **VIEWS),
        ),
        _records(
            "GTM leads by 5 points",
            put("precision", 0.55, method="gtm", **VIEWS),
            put("precision", 0.5, method=but("gtm"), **VIEWS),
        ),
    ],
    "C-24": [
        _records(
            "GTM is more precise",
            put("precision", 0.61, method="gtm", **VIEWS),
            put("precision", 0.5, method="ransac", **VIEWS),
        ),
        _records(
            "RANSAC is more precise",
            put("precision", 0.5, method="gtm", **VIEWS),
            put("precision", 0.61, method="ransac", **VIEWS),
        ),
    ],
    "C-25": [_records("SI and CV recall little", put("recall", 0.1, method=("si", "cv"), **VIEWS))],
    "C-26": [_records("GC and CV are ahead", put("f_score", 0.2, method=("gtm", "ransac"), **VIEWS))],
    "C-27": [_records("P falls", put("precision", lambda rows: 1 - rows["epsilon"] / 20, **SCENES))],
    "C-28": [_records("the two gain nothing", put("precision", 0.8, method=("ransac", "gtm"), **SCENES))],
    "C-29": [
        _records(
            "only the others gain",
            put("recall", 0.5, method=("si", "cv", "ss"), **SCENES),
            put("recall", lambda rows: rows["epsilon"] / 100, method=but("si", "cv", "ss"), **SCENES),
        )
    ],
    "C-29b": [_records("the ranking turns around", put("f_score", turn_around("epsilon"), **SCENES))],
    "C-30": [_records("all are equally precise", put("precision", 0.3, **COUNTS))],
    "C-31": [_records("precision stays", put("precision", 0.3, **COUNTS))],
    "C-32": [_records("CV is imprecise", put("precision", 0.1, method="cv", **COUNTS))],
    "C-33": [_records("SI and CV recall little", put("recall", 0.1, method=("si", "cv"), **COUNTS))],
    "C-34": [
        _records("F only rises", put("f_score", lambda rows: rows["n"] / 10_000, **COUNTS)),
        _records("F only falls", put("f_score", lambda rows: 1 - rows["n"] / 10_000, **COUNTS)),
    ],
    "C-35": [
        _records(
            "LFSH gives just more than half",
            put("correct", 301, combination=LFSH, **ON_B3R),
            put("correct", 600, combination=but(*LFSH), **ON_B3R),
        )
    ],
    "C-36": [_records("RANSAC is ahead", put("precision", 0.96, method="gtm", **ON_B3R))],
    "C-37": [_records("recall is lower", put("recall", 0.94, method=("cv", "gc", "ransac"), **ON_B3R))],
    "C-38": [
        _records(
            "RCS is worse than the others",
            put("f_score", 0.5, combination=RCS, **ON_U3OR),
            put("f_score", 0.52, combination=but(*RCS), **ON_U3OR),
        )
    ],
    "C-39": [
        _records(
            "the ranking turns around, and the leaders do badly",
            put("f_score", turn_around("combination"), **ON_U3OR),
            put("precision", 0.1, method="gtm", **ON_U3OR),
            put("recall", 0.1, method=("si", "cv"), **ON_U3OR),
        )
    ],
    "C-40": [
        _records(
            "C5 is worse than the others",
            put("f_score", 0.5, combination="C5", **ON_U3M),
            put("f_score", 0.52, combination=but("C5"), **ON_U3M),
        )
    ],
    "C-41": [
        _records(
            "CV, SI, 3DHV and NNSR lead, always in this order",
            put("f_score", 0.1, method=("gtm", "gc", "ransac", "st"), **ON_U3M),
            put("f_score", 0.6, method="cv", **ON_U3M),
            put("f_score", 0.5, method="si", **ON_U3M),
            put("f_score", 0.4, method="3dhv", **ON_U3M),
            put("f_score", 0.3, method="nnsr", **ON_U3M),
        )
    ],
    "C-42": [_records("both find half", put("recall", 0.5, method=("si", "cv")))],
    "C-43": [_records("one pair is never registered", put("registered", False, pair="scene0", **NOISE))],
    "C-44": [_records("precision is lower", put("precision", 0.39, **NOISE))],
    "C-45": [
        _records(
            "only sparse data are registered",
            put("registered", False, pair="scene0", level=above(0.35), **DENSITY),
            put("registered", True, level=below(0.35), **DENSITY),
        )
    ],
    "C-46": [_records("the two register nothing", put("registered", False, method=("gc", "gtm"), **SCENES))],
    "C-47": [
        _records(
            "RANSAC and GC do the same",
            put("precision", 0.3, method=("ransac", "gc"), **SCENES),
            put("registered", True, method=("ransac", "gc"), **SCENES),
        )
    ],
    "C-48": [
        _records(
            "GC is precise but on one pair, RANSAC middling on all",
            put("precision", 0.6, method="gc", **SCENES),
            put("precision", 0.1, method="gc", pair="rs0", **SCENES),
            put("precision", 0.5, method="ransac", **SCENES),
        )
    ],
    "C-49": [
        _records(
            "the three register nothing", put("registered", False, method=("gtm", "ransac", "gc"), **VIEWS)
        )
    ],
    "C-50": [_records("all pairs are registered", put("registered", True, **VIEWS))],
    "C-51": [_records("the ranking turns around", put("registered", turn_around("epsilon"), **SCENES))],
    "C-52": [
        _records(
            "all register all pairs, but for GTM on few matches",
            put("registered", True, **COUNTS),
            put("registered", False, method="gtm", n=below(1000), **COUNTS),
        )
    ],
    "C-53": [
        _records(
            "the rate is lower, and lowest with C1",
            put("registered", 0.85, **ON_B3R),
            put("registered", 0.7, combination="C1", **ON_B3R),
        )
    ],
    "C-54": [
        _records(
            "the three register nothing", put("registered", False, method=("gc", "gtm", "nnsr"), **ON_U3OR)
        )
    ],
    "C-55": [
        _records(
            "GTM registers little, and nothing with C5",
            put("registered", 0.1, method="gtm", **ON_U3M),
            put("registered", 0.0, method="gtm", combination="C5", **ON_U3M),
        )
    ],
    "C-56": [_times("the two are fast", put("seconds", 1e-6, method=("st", "ransac")))],
    "C-57": [_times("the two are slow", put("seconds", 1e3, method=("nnsr", "3dhv")))],
    "C-58": [_times("they take the same time", put("seconds", 1e-3, method=("ss", "nnsr")))],
    "C-59": [_times("the two are fast", put("seconds", 1e-6, method=("gtm", "si")))],
    "C-60": [
        _times("CV takes 60 % of it", put("seconds", 1.0, method="si"), put("seconds", 0.6, method="cv")),
    ],
    "C-61": [
        _times("3DHV grows faster", put("seconds", lambda rows: 2e-7 * rows["n"] ** 1.5, method="3dhv"))
    ],
    "C-62": [
        _records(
            "the two are precise, but not on B3R",
            put("precision", 0.51, method=("ss", "nnsr")),
            put("precision", 0.49, method=("ss", "nnsr"), **NOISE),
        )
    ],
    "C-63": [_times("ST is fast", put("seconds", 1e-6, method="st"))],
    "C-64": [
        _records(
            "GC is precise on B3R, and registers nothing elsewhere",
            put("precision", 1.0, method="gc", **NOISE),
            put("registered", False, method="gc", dataset=("u3or", "stanford")),
        )
    ],
    "C-65": [_records("all do the same", put("precision", 0.5), put("recall", 0.5))],
    "C-66": [
        Contradiction(
            "CV and SI do the same, in the same time",
            (put("precision", 0.5, method=("cv", "si")),),
            (put("seconds", 1.0, method=("cv", "si")),),
        )
    ],
    "C-67": [_records("RANSAC registers all pairs anyway", put("registered", True))],
}
