"""The claims of the paper, and the verdict of the records on each."""

import math
from dataclasses import dataclass

import pandas as pd

from cgroup.benchmark.paper.checks import (
    Check,
    best_with,
    between,
    bound,
    higher,
    higher_mean,
    in_top,
    most,
    share,
)
from cgroup.benchmark.paper.evidence import Evidence
from cgroup.benchmark.paper.numbers import (
    TIE,
    Numbers,
    behind,
    beside_median,
    change,
    count_orders,
    distance,
    everywhere,
    growth,
    lead,
    levels,
    lowest,
    mean_of,
    over_others,
    overall,
    rank,
    spread,
    stability,
    swing,
    times,
    together,
)
from cgroup.benchmark.paper.table import ClaimTable, Source, at, make_table, named, nearest
from cgroup.benchmark.paper.verdicts import CRITERIA, OUTCOMES, Outcome, Verdict, judge, read_explanations
from cgroup.benchmark.problem import COMBINATIONS

__all__ = ["CLAIMS", "CRITERIA", "OUTCOMES", "Outcome", "check_claims"]

CLEAR, LARGE = 0.05, 0.1  # a clear and a large difference of scores


@dataclass(frozen=True)
class Claim:
    """A statement of the paper in our words, its section, and its check on the records."""

    id: str
    section: str
    statement: str
    check: Check

    @property
    def criterion(self) -> str:
        """The test, in one sentence."""
        text = self.check.criterion
        return f"{text[0].upper()}{text[1:]}."


NOISE, DENSITY = Source("noise", "B3R"), Source("density", "B3R")
CLUTTER, OCCLUSION = Source("clutter", "U3OR"), Source("occlusion", "U3OR")
OVERLAP, EPSILON = Source("overlap", "U3M"), Source("epsilon", "U3OR")
MATCHES = Source("matches", "U3OR", otherwise="U3M")  # the paper does not state its data
TIMES = Source("timing", "")
ON_B3R, ON_U3OR, ON_U3M = (Source("combinations", place) for place in ("B3R", "U3OR", "U3M"))
PLACES = (NOISE, CLUTTER, OVERLAP)  # the experiment of each data set that summaries are checked on
ALL_SIX = named(*COMBINATIONS)

GROUP_BASED = ("ransac", "st", "gc", "3dhv", "gtm")
INDIVIDUAL = ("ss", "nnsr", "si", "cv")
ON_SAME_CASES = (Source("variants", "U3OR"), Source("variants", "U3M"))


def _gtm_far_ahead(source: Source) -> Check:
    precision = levels("precision", source)
    return in_top({"gtm": 1}, precision) & bound(lead(["gtm"], precision), ">", LARGE)


def _mean_lead_of_cv(source: Source) -> Numbers:
    return mean_of(lead(["cv"], levels("recall", source)), skipna=False)


def _section(section: str, *claims: tuple[str, str, Check]) -> tuple[Claim, ...]:
    return tuple(Claim(name, section, statement, check) for name, statement, check in claims)


# fmt: off
CLAIMS = (
    *_section("4.3, inputs",
        ("C-01", "On B3R with the least noise, more than half of the initial matches are correct.",
         bound(levels("inlier_ratio", NOISE, named(0.05)), ">", 0.5)),
        ("C-02", ("On U3OR, less than 3 % of the initial matches are correct at most levels of clutter and "
                  "occlusion."),
         most(bound(levels("inlier_ratio", CLUTTER, OCCLUSION), "<", 0.03)))),
    *_section("5.1 item 1, noise",
        ("C-03", "With noise below 0.2 pr, all nine methods do acceptably.",
         bound(levels("precision", NOISE, at("<", 0.2)), ">=", 0.4)),
        ("C-04", "With noise below 0.2 pr, RANSAC and ST are the two best methods.",
         in_top({"ransac": 2, "st": 2}, levels("f_score", NOISE, at("<", 0.2)))),
        ("C-05", "The more noise, the further RANSAC and ST are ahead of the rest.",
         bound(change(lead(["ransac", "st"], levels("f_score", NOISE))), ">", TIE)),
        ("C-06", "NNSR selects with higher precision than GC and than 3DHV.",
         higher("nnsr", ["gc", "3dhv"], levels("precision", NOISE))),
        ("C-07", "ST, RANSAC, GC, GTM and CV find nearly all correct matches at every noise level.",
         bound(levels("recall", NOISE), ">=", 0.9, ["st", "ransac", "gc", "gtm", "cv"])),
        ("C-08", "SI suffers most from severe noise.",
         in_top({"si": 1}, change(levels("f_score", NOISE), drop=True)))),
    *_section("5.1 item 2, density",
        ("C-09", "RANSAC and ST are the two best methods for thinned data too.",
         in_top({"ransac": 2, "st": 2}, levels("f_score", DENSITY))),
        ("C-10", "GTM and CV keep a high recall as points get fewer.",
         most(bound(levels("recall", DENSITY), ">=", 0.9, ["gtm", "cv"]))),
        ("C-11", "With 30 % of the points or fewer, even SS is more precise than SI.",
         higher("ss", ["si"], levels("precision", DENSITY, at("<=", 0.3)))),
        ("C-12", "The recall of NNSR and of SI drops dramatically for sparse data.",
         bound(change(levels("recall", DENSITY)), ">", 0.3, ["nnsr", "si"]))),
    *_section("5.1 item 3, clutter and occlusion",
        ("C-13", "All methods do far worse on cluttered, occluded scenes than on full models.",
         bound(change(overall("f_score", NOISE, CLUTTER)), "<", -TIE)),
        ("C-14", "In clutter, GTM is by far the most precise method.",
         _gtm_far_ahead(CLUTTER)),
        ("C-15", "Under occlusion, GTM is by far the most precise method.",
         _gtm_far_ahead(OCCLUSION)),
        ("C-16", "GTM's recall is mediocre in clutter and occlusion.",
         between(3, 7, rank(overall("recall", CLUTTER)), ["gtm"])),
        ("C-17", "GTM's groups are sparse but accurate.",
         bound(beside_median(overall("selected", CLUTTER)), "<", 0, ["gtm"])
         & bound(beside_median(overall("precision", CLUTTER)), ">", TIE, ["gtm"])),
        ("C-18", "CV has the best recall in clutter and occlusion.",
         in_top({"cv": 1}, levels("recall", CLUTTER, OCCLUSION))),
        ("C-19", "CV's lead in recall is clearer along clutter than along occlusion.",
         bound(change(together(_mean_lead_of_cv(CLUTTER), _mean_lead_of_cv(OCCLUSION))), "<", -TIE)),
        ("C-20", "ST, which leads on B3R, does poorly on U3OR.",
         between(1, 2, rank(overall("f_score", NOISE)), ["st"])
         & between(5, 9, rank(overall("f_score", CLUTTER)), ["st"]))),
    *_section("5.1 item 4, overlap",
        ("C-21", "All methods get worse as the views overlap less.",
         bound(growth(levels("f_score", OVERLAP)), ">=", 0.8)),
        ("C-22", "With more than 70 % overlap, GTM is the most precise.",
         in_top({"gtm": 1}, levels("precision", OVERLAP, at(">=", 0.7)))),
        ("C-23", "GTM is ahead in precision by about 30 points at 90 % overlap, and by about 20 at 80 %.",
         between(0.1, 0.3, lead(["gtm"], levels("precision", OVERLAP, named(0.8))))
         & between(0.2, 0.4, lead(["gtm"], levels("precision", OVERLAP, named(0.9))))),
        ("C-24", "With less overlap, GTM and RANSAC are about equally precise.",
         bound(distance("gtm", "ransac", levels("precision", OVERLAP, at("<", 0.7))), "<", LARGE)),
        ("C-25", "CV has the best recall at every overlap, SI the second.",
         in_top({"cv": 1, "si": 2}, levels("recall", OVERLAP))),
        ("C-26", "Weighing precision and recall together, GTM and RANSAC are preferable.",
         in_top({"gtm": 2, "ransac": 2}, overall("f_score", OVERLAP)))),
    *_section("5.1 item 5, threshold",
        ("C-27", "All methods gain precision as the threshold is relaxed.",
         bound(overall("smallest step of P", EPSILON), ">=", -1e-9)),
        ("C-28", "RANSAC and GTM gain precision fastest.",
         in_top({"ransac": 2, "gtm": 2}, change(levels("precision", EPSILON)))),
        ("C-29", "Only SI, CV and SS gain evidently in recall.",
         bound(change(levels("recall", EPSILON)), ">", CLEAR, ["si", "cv", "ss"])
         & bound(change(levels("recall", EPSILON)), "<=", CLEAR, ["nnsr", *GROUP_BASED])),
        ("C-29b", "The ranking of the methods is stable as the threshold changes.",
         bound(stability(levels("f_score", EPSILON)), ">=", 0.8))),
    *_section("5.1 item 6, number of matches",
        ("C-30", "With fewer than 1000 matches, SI and CV are imprecise.",
         bound(beside_median(levels("precision", MATCHES, at("<", 1000))), "<", 0, ["si", "cv"])),
        ("C-31", "With more than 1000 matches, the precision of SI and CV improves quickly.",
         bound(change(levels("precision", MATCHES), since=1000), ">", CLEAR, ["si", "cv"])),
        ("C-32", "With about 3000 matches, CV is the second most precise.",
         in_top({"cv": 2}, levels("precision", MATCHES, nearest(3000, 2000, 4500)))),
        ("C-33", "SI and CV recall most, clearly more than the others, for any number of matches.",
         in_top({"si": 2, "cv": 2}, levels("recall", MATCHES))
         & bound(lead(["si", "cv"], levels("recall", MATCHES), worst=True), ">", CLEAR)),
        ("C-34", "GC, RANSAC and 3DHV fluctuate as the number of matches grows.",
         bound(swing(levels("f_score", MATCHES)), ">", TIE, ["gc", "ransac", "3dhv"]))),
    *_section("5.1 item 7, detector and descriptor",
        ("C-35", ("On B3R, LFSH gives far fewer correct matches than the other descriptors, with either "
                  "detector."),
         bound(over_others(["C2", "C5"], levels("correct", ON_B3R, ALL_SIX)), "<=", 0.5)),
        ("C-36", "On B3R, GTM's precision is nearly 1 and the best, whatever the combination.",
         bound(levels("precision", ON_B3R, ALL_SIX), ">=", 0.97, ["gtm"])
         & in_top({"gtm": 1}, levels("precision", ON_B3R, ALL_SIX))),
        ("C-37", "On B3R, CV, GC and RANSAC find nearly all correct matches, whatever the combination.",
         bound(levels("recall", ON_B3R, ALL_SIX), ">=", 0.95, ["cv", "gc", "ransac"])),
        ("C-38", "On U3OR, every method does best with RCS.",
         best_with(["C3", "C6"], levels("f_score", ON_U3OR, ALL_SIX))),
        ("C-39", "On U3OR, the ranking hardly depends on the combination: GTM leads in P, SI and CV in R.",
         bound(stability(levels("f_score", ON_U3OR, ALL_SIX), mean=True), ">=", 0.6)
         & in_top({"gtm": 1}, levels("precision", ON_U3OR, ALL_SIX))
         & in_top({"si": 2, "cv": 2}, levels("recall", ON_U3OR, ALL_SIX))),
        ("C-40", "On U3M, most methods do best with ISS and LFSH.",
         most(best_with(["C5"], levels("f_score", ON_U3M, ALL_SIX)))),
        ("C-41", "On U3M, GTM is best overall, followed by GC, RANSAC and ST; SI, 3DHV and NNSR swap places.",
         in_top({"gtm": 1, "gc": 4, "ransac": 4, "st": 4}, mean_of(levels("f_score", ON_U3M, ALL_SIX)))
         & bound(count_orders(["si", "3dhv", "nnsr"], levels("f_score", ON_U3M, ALL_SIX)), ">", 1))),
    *_section("5.1, summary",
        ("C-42", "SI and CV find the majority of the correct matches under all conditions.",
         bound(everywhere("recall", ["si", "cv"], ON_B3R, ON_U3OR, ON_U3M, without="epsilon"), ">", 0.5,
               ["si", "cv"]))),
    *_section("5.2 item 1, noise and density",
        ("C-43", "All methods register all pairs of B3R under noise.",
         bound(levels("registered", NOISE), ">=", 1)),
        ("C-44", "Under noise, every method's average precision is above 0.4.",
         bound(levels("precision", NOISE), ">", 0.4)),
        ("C-45", ("All methods register all pairs while more than 30 % of the points are kept; below, SI and "
                  "SS start to fail."),
         bound(levels("registered", DENSITY, at(">", 0.3)), ">=", 1)
         & bound(lowest(levels("registered", DENSITY, at("<=", 0.3))), "<", 1, ["si", "ss"]))),
    *_section("5.2 item 2, clutter and occlusion",
        ("C-46", "In clutter and occlusion, GC registers the most pairs, GTM the second most.",
         in_top({"gc": 1, "gtm": 2}, overall("registered", CLUTTER))),
        ("C-47", "RANSAC is mostly more precise than GC, and yet registers fewer pairs.",
         share(">", 0.5, higher("ransac", ["gc"], levels("precision", CLUTTER, OCCLUSION)))
         & higher("gc", ["ransac"], overall("registered", CLUTTER))),
        ("C-48", ("Pair by pair on U3OR, GC is rarely above 0.5 in precision and always above 0.1; RANSAC is "
                  "usually above 0.5 where it succeeds, and near 0 where it fails."),
         bound(overall("pairs with P > 0.5", CLUTTER), "<=", 0.1, ["gc"])
         & bound(overall("pairs with P > 0.1", CLUTTER), ">=", 1, ["gc"])
         & bound(overall("registered pairs with P > 0.5", CLUTTER), ">", 0.5, ["ransac"])
         & bound(overall("failed pairs with P <= 0.05", CLUTTER), ">", 0.5, ["ransac"]))),
    *_section("5.2 item 3, overlap",
        ("C-49", "GTM registers most at every overlap, followed by RANSAC and GC.",
         in_top({"gtm": 1, "ransac": 3, "gc": 3}, levels("registered", OVERLAP))),
        ("C-50", "With less than 60 % overlap, all methods fail on most pairs.",
         bound(levels("registered", OVERLAP, at("<", 0.6)), "<", 0.5))),
    *_section("5.2 item 4, threshold and number of matches",
        ("C-51", "The threshold hardly changes the ranking by registration; GC and GTM are the two best.",
         bound(stability(levels("registered", EPSILON)), ">=", 0.8)
         & in_top({"gc": 2, "gtm": 2}, levels("registered", EPSILON))),
        ("C-52", ("More matches raise the registration rate of most methods a little; GTM is best near 500, "
                  "GC passes it for denser sets."),
         share(">", 0.5, bound(change(levels("registered", MATCHES)), ">", TIE))
         & in_top({"gtm": 1}, levels("registered", MATCHES, nearest(500, 250, 999, optional=True)))
         & higher("gc", ["gtm"], levels("registered", MATCHES, at(">=", 1000))))),
    *_section("5.2 item 5, detector and descriptor",
        ("C-53", "On B3R, all methods register reliably with every combination.",
         bound(levels("registered", ON_B3R, ALL_SIX), ">=", 0.9)
         & bound(spread(levels("registered", ON_B3R, ALL_SIX)), "<=", LARGE)),
        ("C-54", ("On U3OR, GC and GTM generally register most; SS is far behind with all combinations; NNSR "
                  "is sometimes competitive."),
         share(">", 0.5, in_top({"gc": 2, "gtm": 2}, levels("registered", ON_U3OR, ALL_SIX)))
         & bound(lowest(behind("ss", levels("registered", ON_U3OR, ALL_SIX))), ">", CLEAR)
         & share(">", 0, in_top({"nnsr": 3}, levels("registered", ON_U3OR, ALL_SIX)))),
        ("C-55", "On U3M, GTM registers most with every combination, and most of all with ISS and LFSH.",
         in_top({"gtm": 1}, levels("registered", ON_U3M, ALL_SIX))
         & best_with(["C5"], levels("registered", ON_U3M, ALL_SIX), ["gtm"]))),
    *_section("5.3, efficiency",
        ("C-56", "ST and RANSAC take longest, above all for large sets (this depends on the implementation).",
         in_top({"st": 2, "ransac": 2}, times("longest"))),
        ("C-57", "NNSR and 3DHV are the two fastest.",
         in_top({"nnsr": 2, "3dhv": 2}, times("shortest"))),
        ("C-58", "SS is slower than NNSR, since it looks for its threshold.",
         higher("ss", ["nnsr"], times("longest"))),
        ("C-59", "GTM and SI are slower than most others.",
         in_top({"gtm": 4, "si": 4}, times("longest"))),
        ("C-60", "CV needs far less time than SI.",
         higher("si", ["cv"], times("longest"), twice=True)),
        ("C-61", "3DHV stays fast for thousands of matches, since its cost is linear.",
         bound(overall("exponent", TIMES), "<=", 1.2, ["3dhv"])
         & bound(times("longest", largest=0), "<", math.log(0.1), ["3dhv"]))),
    *_section("5.4, visualization",
        ("C-62", "What SS and NNSR select contains many outliers, except on B3R.",
         bound(overall("precision", NOISE), ">=", 0.5, ["ss", "nnsr"])
         & bound(overall("precision", CLUTTER, OVERLAP), "<", 0.5, ["ss", "nnsr"]))),
    *_section("6, summary",
        ("C-63", "ST takes the longest of all for large sets.",
         in_top({"st": 1}, times("longest", largest=3000))),
        ("C-64", ("GC is inferior to most methods where many initial matches are correct, and good where few "
                  "are."),
         between(6, 9, rank(overall("precision", NOISE)), ["gc"])
         & in_top({"gc": 3}, overall("registered", CLUTTER, OVERLAP))),
        ("C-65", "Group-based methods are more precise; SI and CV recall more.",
         higher_mean(GROUP_BASED, INDIVIDUAL, overall("precision", *PLACES))
         & higher_mean(["si", "cv"], GROUP_BASED, overall("recall", *PLACES))),
        ("C-66", "CV is more precise than SI, and faster.",
         higher("cv", ["si"], overall("precision", *PLACES)) & higher("si", ["cv"], times("longest"))),
        ("C-67", ("Grouping by GC or GTM before the pose is estimated registers far more pairs than RANSAC "
                  "on the raw matches."),
         higher("gc+ransac", ["ransac"], overall("registered", *ON_SAME_CASES))
         & higher("gtm+ransac", ["ransac"], overall("registered", *ON_SAME_CASES)))),
)
# fmt: on
"""All claims of the paper, in its order."""


def check_claims(frame: pd.DataFrame, timing: pd.DataFrame) -> list[Verdict]:
    """Check all claims of the paper on the records.

    Parameters
    ----------
    frame : DataFrame
        Records, one row per case, method and threshold.
    timing : DataFrame
        Times of the timing experiment; may have no rows.

    Returns
    -------
    list of Verdict
        One per claim, in the paper's order; `CRITERIA` has the rules. Each has `id, paper_section, statement,
        criterion` of the claim, the `verdict` (one of `OUTCOMES`), the numbers (`measured`) or missing
        records, the `data`, and an `explanation` if one is known.
    """
    return check_evidence(Evidence(frame, timing))


def check_evidence(evidence: Evidence) -> list[Verdict]:
    """Check all claims of the paper on given evidence."""
    table, why = make_table(evidence), read_explanations()
    return [decide(claim, table, why.get(claim.id, "")) for claim in CLAIMS]


def decide(claim: Claim, table: ClaimTable, explanation: str = "") -> Verdict:
    """Check one claim."""
    named = (claim.id, claim.section, claim.statement, claim.criterion)
    return Verdict(*named, **judge(claim.check, table), explanation=explanation)
