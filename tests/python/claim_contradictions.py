"""For each claim, changes of the records after which nothing that it says is true any more.

A change touches the numbers that the statement is about and nothing else, so that other columns need not fit.
Ranks are missed by one, where that is possible. Where a claim has bounds on both sides, there is a
contradiction for each. The form of no claim keeps a comparison from failing: all of them can fail at once.
"""

from typing import NamedTuple

from record_changes import Change, above, add, below, but, put, put_behind, put_faster, put_slower, reorder


class Contradiction(NamedTuple):
    """What is the case instead, and the changes of records and of times that bring it about."""

    instead: str
    records: tuple[Change, ...] = ()
    times: tuple[Change, ...] = ()


def contradict(instead: str, *changes: Change) -> Contradiction:
    return Contradiction(instead, records=changes)


def contradict_times(instead: str, *changes: Change) -> Contradiction:
    return Contradiction(instead, times=changes)


NOISE = {"nuisance": "noise"}
DENSITY = {"nuisance": "density"}
SCENES = {"dataset": "u3or"}
VIEWS = {"experiment": "overlap"}
COUNTS = {"experiment": "matches"}
ON_B3R, ON_U3OR, ON_U3M = (
    {"experiment": "combinations", "dataset": dataset} for dataset in ("b3r", "u3or", "stanford")
)
# Of seven levels, the lowest first: the rank correlation is 0.79.
UP_AND_DOWN = dict(enumerate((0.3, 0.1, 0.2, 0.6, 0.4, 0.5, 0.7), start=1))
LFSH, RCS = ("C2", "C5"), ("C3", "C6")

# fmt: off
CONTRADICTIONS = {
    "C-01": [contradict("half of the matches are correct", put("inlier_ratio", 0.5, level=0.05, **NOISE))],
    "C-02": [contradict("more than 3 % are correct", put("inlier_ratio", 0.031, **SCENES))],
    "C-03": [contradict("no method does well", put("precision", 0.39, level=below(0.2), **NOISE))],
    "C-04": [contradict("the two are third",
                 put_behind("f_score", ("ransac", "st"), 2, "level", level=below(0.2), **NOISE))],
    "C-05": [contradict("the lead stays the same", put("f_score", 0.9, method=("ransac", "st"), **NOISE),
                 put("f_score", 0.8, method=but("ransac", "st"), **NOISE))],
    "C-06": [contradict("the three tie", put("precision", 0.9, method=("nnsr", "gc", "3dhv"), **NOISE))],
    "C-07": [contradict("recall is lower", put("recall", 0.89, **NOISE))],
    "C-08": [contradict("GC drops further", add("f_score", -0.3, method="gc", level=above(0.4), **NOISE))],
    "C-09": [contradict("the two are third", put_behind("f_score", ("ransac", "st"), 2, "level", **DENSITY))],
    "C-10": [contradict("recall is lower", put("recall", 0.89, method=("gtm", "cv"), **DENSITY))],
    "C-11": [contradict("SS and SI tie",
                 put("precision", 0.5, method=("ss", "si"), level=below(0.35), **DENSITY))],
    "C-12": [contradict("recall doesn't depend on density", put("recall", 0.8, **DENSITY))],
    "C-13": [contradict("scenes are as easy as models", put("f_score", 0.5, **NOISE),
                 put("f_score", 0.5, **SCENES))],
    "C-14": [contradict("RANSAC is ahead", put("precision", 0.4, method="gtm", experiment="clutter"))],
    "C-15": [contradict("RANSAC is ahead", put("precision", 0.4, method="gtm", experiment="occlusion"))],
    "C-16": [contradict("GTM recalls second most",
                 put_behind("recall", "gtm", 1, experiment="clutter", epsilon=5)),
             contradict("GTM recalls second least",
                 put_behind("recall", "gtm", 7, experiment="clutter", epsilon=5))],
    "C-17": [contradict("GTM's groups are like all others", put("selected", 100, **SCENES),
                 put("precision", 0.3, **SCENES))],
    "C-18": [contradict("SI recalls more", put("recall", 0.7, method="cv", **SCENES))],
    "C-19": [contradict("the lead is the same along both", put("recall", 0.92, method="cv", **SCENES))],
    "C-20": [contradict("ST is fourth on U3OR and third on B3R",
                 put_behind("f_score", "st", 3, experiment="clutter", epsilon=5),
                 put_behind("f_score", "st", 2, **NOISE))],
    "C-21": [contradict("F also falls as views overlap more",
                 put("f_score", lambda rows: rows["overlap"].rank(method="dense").map(UP_AND_DOWN), **VIEWS))],
    "C-22": [contradict("GTM is second",
                 put_behind("precision", "gtm", 1, "overlap", overlap=above(0.7), **VIEWS))],
    "C-23": [contradict("GTM leads by 45 points", put("precision", 0.95, method="gtm", **VIEWS),
                 put("precision", 0.5, method=but("gtm"), **VIEWS)),
             contradict("GTM leads by 5 points", put("precision", 0.55, method="gtm", **VIEWS),
                 put("precision", 0.5, method=but("gtm"), **VIEWS))],
    "C-24": [contradict("GTM is more precise", put("precision", 0.61, method="gtm", **VIEWS),
                 put("precision", 0.5, method="ransac", **VIEWS)),
             contradict("RANSAC is more precise", put("precision", 0.5, method="gtm", **VIEWS),
                 put("precision", 0.61, method="ransac", **VIEWS))],
    "C-25": [contradict("CV is second, SI third", put("recall", 0.0, method="si", **VIEWS),
                 put_behind("recall", "cv", 1, "overlap", **VIEWS),
                 put_behind("recall", "si", 2, "overlap", **VIEWS))],
    "C-26": [contradict("the two are third", put_behind("f_score", ("gtm", "ransac"), 2, **VIEWS))],
    "C-27": [contradict("P falls", put("precision", lambda rows: 1 - rows["epsilon"] / 20, **SCENES))],
    "C-28": [contradict("only GC and CV gain", put("precision", 0.8, method=but("gc", "cv"), **SCENES))],
    "C-29": [contradict("only the others gain", put("recall", 0.5, method=("si", "cv", "ss"), **SCENES),
                 put("recall", lambda rows: rows["epsilon"] / 100, method=but("si", "cv", "ss"), **SCENES))],
    "C-29b": [contradict("neighbours change places",
                  put("f_score", reorder("epsilon", 1, 2, 2, 2, 2), **SCENES))],
    "C-30": [contradict("all are equally precise", put("precision", 0.3, **COUNTS))],
    "C-31": [contradict("precision stays", put("precision", 0.3, **COUNTS))],
    "C-32": [contradict("CV is third", put_behind("precision", "cv", 2, "nms_radius", **COUNTS))],
    "C-33": [contradict("the two are third", put_behind("recall", ("si", "cv"), 2, "nms_radius", **COUNTS))],
    "C-34": [contradict("F only rises", put("f_score", lambda rows: rows["n"] / 10000, **COUNTS)),
             contradict("F only falls", put("f_score", lambda rows: 1 - rows["n"] / 10000, **COUNTS))],
    "C-35": [contradict("LFSH gives just more than half", put("correct", 301, combination=LFSH, **ON_B3R),
                 put("correct", 600, combination=but(*LFSH), **ON_B3R))],
    "C-36": [contradict("RANSAC is ahead", put("precision", 0.96, method=("gtm", "st"), **ON_B3R))],
    "C-37": [contradict("recall is lower", put("recall", 0.94, method=("cv", "gc", "ransac"), **ON_B3R))],
    "C-38": [contradict("RCS is worse than the others", put("f_score", 0.5, combination=RCS, **ON_U3OR),
                 put("f_score", 0.52, combination=but(*RCS), **ON_U3OR))],
    "C-39": [contradict("the ranking depends on the combination, GTM is second, SI and CV are third",
                 put("f_score", reorder("combination", 4, 5), **ON_U3OR),
                 put_behind("precision", "gtm", 1, "combination", **ON_U3OR),
                 put_behind("recall", ("si", "cv"), 2, "combination", **ON_U3OR))],
    "C-40": [contradict("C5 is worse than the others", put("f_score", 0.5, combination="C5", **ON_U3M),
                 put("f_score", 0.52, combination=but("C5"), **ON_U3M))],
    "C-41": [contradict("CV is first; GTM, SI and 3DHV follow; the order of SI, 3DHV and NNSR never changes",
                 put("f_score", 0.1, method=("gc", "ransac", "st"), **ON_U3M),
                 put("f_score", 0.6, method="cv", **ON_U3M), put("f_score", 0.55, method="gtm", **ON_U3M),
                 put("f_score", 0.5, method="si", **ON_U3M), put("f_score", 0.4, method="3dhv", **ON_U3M),
                 put("f_score", 0.05, method="nnsr", **ON_U3M))],
    "C-42": [contradict("both find half", put("recall", 0.5, method=("si", "cv")))],
    "C-43": [contradict("one pair is never registered", put("registered", False, pair="scene0", **NOISE))],
    "C-44": [contradict("precision is lower", put("precision", 0.39, **NOISE))],
    "C-45": [contradict("only sparse data are registered",
                 put("registered", False, pair="scene0", level=above(0.35), **DENSITY),
                 put("registered", True, level=below(0.35), **DENSITY))],
    "C-46": [contradict("GC is second, GTM third", put("registered", 0.0, method="gtm", **SCENES),
                 put_behind("registered", "gc", 1, experiment="clutter", epsilon=5),
                 put_behind("registered", "gtm", 2, experiment="clutter", epsilon=5))],
    "C-47": [contradict("RANSAC and GC do the same", put("precision", 0.3, method=("ransac", "gc"), **SCENES),
                 put("registered", True, method=("ransac", "gc"), **SCENES))],
    "C-48": [contradict("GC is precise but on one pair, RANSAC middling on all",
                 put("precision", 0.6, method="gc", **SCENES),
                 put("precision", 0.1, method="gc", pair="rs0", **SCENES),
                 put("precision", 0.5, method="ransac", **SCENES))],
    "C-49": [contradict("GTM is second, RANSAC and GC are fourth",
                 put("registered", 0.0, method=("ransac", "gc"), **VIEWS),
                 put_behind("registered", "gtm", 1, "overlap", **VIEWS),
                 put_behind("registered", ("ransac", "gc"), 3, "overlap", **VIEWS))],
    "C-50": [contradict("all pairs are registered", put("registered", True, **VIEWS))],
    "C-51": [contradict("neighbours change places, GC and GTM the third and the fourth",
                 put("registered", reorder("epsilon", 1, 2, 2, 2, 2), **SCENES))],
    "C-52": [contradict("four of nine rise, GC is ahead on few matches and level with GTM on many",
                 put("registered", 0.9, **COUNTS),
                 put("registered", 1.0, method="gc", n=below(1000), **COUNTS),
                 put("registered", 1.0, method=("ss", "si", "cv", "st"), n=above(1000), **COUNTS))],
    "C-53": [contradict("the rate is lower, and lowest with C1", put("registered", 0.85, **ON_B3R),
                 put("registered", 0.7, combination="C1", **ON_B3R))],
    "C-54": [contradict("GTM is third, NNSR fourth, SS close to the others",
                 put("registered", 0.0, method="nnsr", **ON_U3OR),
                 put_behind("registered", "gtm", 2, "combination", **ON_U3OR),
                 put_behind("registered", "nnsr", 3, "combination", **ON_U3OR),
                 put_behind("registered", "ss", 8, "combination", **ON_U3OR))],
    "C-55": [contradict("GTM is second, and best with C1",
                 add("registered", -0.1, combination=but("C1"), **ON_U3M),
                 put_behind("registered", "gtm", 1, "combination", **ON_U3M))],
    "C-56": [contradict_times("two others are slower", put_faster(("st", "ransac"), 2))],
    "C-57": [contradict_times("two others are faster", put_slower(("nnsr", "3dhv"), 2))],
    "C-58": [contradict_times("they take the same time", put("seconds", 0.001, method=("ss", "nnsr")))],
    "C-59": [contradict_times("four others are slower", put_faster(("gtm", "si"), 4))],
    "C-60": [contradict_times("CV takes 60 % of it", put("seconds", 1.0, method="si"),
                 put("seconds", 0.6, method="cv"))],
    "C-61": [contradict_times("3DHV grows faster",
                 put("seconds", lambda rows: 2e-07 * rows["n"] ** 1.5, method="3dhv"))],
    "C-62": [contradict("the two are precise, but not on B3R", put("precision", 0.51, method=("ss", "nnsr")),
                 put("precision", 0.49, method=("ss", "nnsr"), **NOISE))],
    "C-63": [contradict_times("one other is slower", put_faster("st", 1))],
    "C-64": [contradict("four of eight are more precise than GC on B3R, three register more elsewhere",
                 put("precision", 0.8, method="nnsr", **NOISE), put_behind("precision", "gc", 4, **NOISE),
                 put_behind("registered", "gc", 3, experiment="clutter", epsilon=5),
                 put_behind("registered", "gc", 3, **VIEWS))],
    "C-65": [contradict("all do the same", put("precision", 0.5), put("recall", 0.5))],
    "C-66": [Contradiction("CV and SI do the same, in the same time",
                 (put("precision", 0.5, method=("cv", "si")),), (put("seconds", 1.0, method=("cv", "si")),))],
    "C-67": [contradict("RANSAC registers all pairs anyway", put("registered", True))],
}
# fmt: on
