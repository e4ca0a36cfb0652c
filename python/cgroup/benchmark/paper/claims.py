"""What the paper says, claim by claim, and whether the records bear it out."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from cgroup._checks.values import as_count
from cgroup.benchmark.paper.checks import (
    CLEAR,
    COMBINATIONS,
    LARGE,
    TIE,
    Check,
    NotTestableError,
    Numbers,
    Source,
    Witness,
    about,
    above,
    across,
    alike,
    below,
    beside_median,
    best_with,
    cells,
    change,
    changes,
    everywhere,
    fewer_matches,
    fluctuate,
    follows,
    from_,
    higher,
    higher_mean,
    in_top,
    lead,
    levels,
    linear,
    listed,
    match_ratio,
    mean_of,
    most,
    named,
    nearest,
    never_falls,
    orders_differ,
    over_levels,
    overall,
    pairs_with,
    ranks,
    same_cases,
    share,
    stable,
    times,
    together,
    trails,
    up_to,
    with_correlation,
    with_exponents,
    with_means,
)
from cgroup.benchmark.paper.evidence import Evidence, resample_evidence
from cgroup.benchmark.paper.verdicts import (
    CRITERIA,
    OUTCOMES,
    Outcome,
    Stability,
    Verdict,
    count_tests,
    judge,
    read_explanations,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

    import pandas as pd

__all__ = [
    "CLAIMS",
    "CRITERIA",
    "OUTCOMES",
    "RESAMPLES",
    "Claim",
    "Outcome",
    "Stability",
    "Verdict",
    "bootstrap_verdicts",
    "check_claims",
]

RESAMPLES = 200
"""Draws of the pairs that verdicts are checked on, where nothing else is asked for."""


@dataclass(frozen=True)
class Claim:
    """A statement of the paper, with the check that tests it on the records.

    Attributes
    ----------
    id, section : str
        Its name, and the section of the paper that it is from.
    statement : str
        What the paper says, in our own words.
    check : Check
        What is tested; its `criterion` is made by the combinators that test it.

    Examples
    --------
    >>> from cgroup.benchmark.paper.claims import CLAIMS
    >>> CLAIMS[2].id, CLAIMS[2].criterion
    ('C-03', 'P of each method >= 0.4 at each level of noise below 0.2 on B3R.')
    """

    id: str
    section: str
    statement: str
    check: Check

    @property
    def criterion(self) -> str:
        """What is tested, in one sentence.

        Examples
        --------
        >>> from cgroup.benchmark.paper.claims import CLAIMS
        >>> CLAIMS[5].criterion
        'P of NNSR higher than that of GC and 3DHV at each level of noise on B3R.'
        """
        text = self.check.criterion
        return f"{text[0].upper()}{text[1:]}."


NOISE, DENSITY = Source("noise", "B3R"), Source("density", "B3R")
CLUTTER, OCCLUSION = Source("clutter", "U3OR"), Source("occlusion", "U3OR")
OVERLAP, EPSILON = Source("overlap", "U3M"), Source("epsilon", "U3OR")
MATCHES = Source("matches", "U3OR", otherwise="U3M")  # the paper doesn't say which data it used
ON_B3R, ON_U3OR, ON_U3M = (Source("combinations", place) for place in ("B3R", "U3OR", "U3M"))
PLACES = (NOISE, CLUTTER, OVERLAP)  # the experiment of each data set that summaries are checked on
ALL_SIX = named(*COMBINATIONS)

GROUP_BASED = ("ransac", "st", "gc", "3dhv", "gtm")
INDIVIDUAL = ("ss", "nnsr", "si", "cv")
CHAINED = ("gc+ransac", "gtm+ransac")


def _gtm_far_ahead(source: Source) -> Check:
    precision = levels("precision", source)
    return in_top({"gtm": 1}, precision) & cells(lead(["gtm"], precision), ">", LARGE)


def _mean_lead_of_cv(source: Source) -> Numbers:
    return mean_of(lead(["cv"], levels("recall", source)), skipna=False)


def _section(section: str, *claims: tuple[str, str, Check]) -> tuple[Claim, ...]:
    return tuple(Claim(name, section, statement, check) for name, statement, check in claims)


# fmt: off
CLAIMS = (
    *_section("4.3, inputs",
        ("C-01", "On B3R with the least noise, more than half of the initial matches are correct.",
         cells(match_ratio(NOISE, named(0.05)), ">", 0.5)),
        ("C-02", ("On U3OR, less than 3 % of the initial matches are correct at most levels of clutter and "
                  "occlusion."),
         most(cells(match_ratio(CLUTTER, OCCLUSION), "<", 0.03)))),
    *_section("5.1 item 1, noise",
        ("C-03", "With noise below 0.2 pr, all nine methods do acceptably.",
         cells(levels("precision", NOISE, below(0.2)), ">=", 0.4)),
        ("C-04", "With noise below 0.2 pr, RANSAC and ST are the two best methods.",
         in_top({"ransac": 2, "st": 2}, levels("f_score", NOISE, below(0.2)))),
        ("C-05", "The more noise, the further RANSAC and ST are ahead of the rest.",
         changes(lead(["ransac", "st"], levels("f_score", NOISE)), ">", TIE)
         & with_correlation(lead(["ransac", "st"], levels("f_score", NOISE)))),
        ("C-06", "NNSR selects with higher precision than GC and than 3DHV.",
         higher("nnsr", ["gc", "3dhv"], levels("precision", NOISE))),
        ("C-07", "ST, RANSAC, GC, GTM and CV find nearly all correct matches at every noise level.",
         cells(levels("recall", NOISE), ">=", 0.9, ["st", "ransac", "gc", "gtm", "cv"])),
        ("C-08", "SI suffers most from severe noise.",
         in_top({"si": 1}, change(levels("f_score", NOISE), -1)))),
    *_section("5.1 item 2, density",
        ("C-09", "RANSAC and ST are the two best methods for thinned data too.",
         in_top({"ransac": 2, "st": 2}, levels("f_score", DENSITY))),
        ("C-10", "GTM and CV keep a high recall as points get fewer.",
         most(cells(levels("recall", DENSITY), ">=", 0.9, ["gtm", "cv"]))),
        ("C-11", "With 30 % of the points or fewer, even SS is more precise than SI.",
         higher("ss", ["si"], levels("precision", DENSITY, up_to(0.3)))),
        ("C-12", "The recall of NNSR and of SI drops dramatically for sparse data.",
         changes(levels("recall", DENSITY), ">", 0.3, ["nnsr", "si"]))),
    *_section("5.1 item 3, clutter and occlusion",
        ("C-13", "All methods do far worse on cluttered, occluded scenes than on full models.",
         changes(overall("f_score", NOISE, CLUTTER), "<", -TIE)
         & with_means(overall("f_score", NOISE, CLUTTER))),
        ("C-14", "In clutter, GTM is by far the most precise method.",
         _gtm_far_ahead(CLUTTER)),
        ("C-15", "Under occlusion, GTM is by far the most precise method.",
         _gtm_far_ahead(OCCLUSION)),
        ("C-16", "GTM's recall is mediocre in clutter and occlusion.",
         ranks("gtm", 3, 7, overall("recall", CLUTTER))),
        ("C-17", "GTM's groups are sparse but accurate.",
         beside_median(["gtm"], "<", 0, overall("selected", CLUTTER))
         & beside_median(["gtm"], ">", TIE, overall("precision", CLUTTER))),
        ("C-18", "CV has the best recall in clutter and occlusion.",
         in_top({"cv": 1}, levels("recall", CLUTTER, OCCLUSION))),
        ("C-19", "CV's lead in recall is clearer along clutter than along occlusion.",
         changes(together(_mean_lead_of_cv(CLUTTER), _mean_lead_of_cv(OCCLUSION)), "<", -TIE)),
        ("C-20", "ST, which leads on B3R, does poorly on U3OR.",
         ranks("st", 1, 2, overall("f_score", NOISE)) & ranks("st", 5, 9, overall("f_score", CLUTTER)))),
    *_section("5.1 item 4, overlap",
        ("C-21", "All methods get worse as the views overlap less.",
         follows(levels("f_score", OVERLAP), 0.8)),
        ("C-22", "With more than 70 % overlap, GTM is the most precise.",
         in_top({"gtm": 1}, levels("precision", OVERLAP, from_(0.7)))),
        ("C-23", "GTM is ahead in precision by about 30 points at 90 % overlap, and by about 20 at 80 %.",
         about({0.8: 0.2, 0.9: 0.3}, 0.1, lead(["gtm"], levels("precision", OVERLAP, named(0.8, 0.9))))),
        ("C-24", "With less overlap, GTM and RANSAC are about equally precise.",
         alike("gtm", "ransac", LARGE, levels("precision", OVERLAP, below(0.7)))),
        ("C-25", "CV has the best recall at every overlap, SI the second.",
         in_top({"cv": 1, "si": 2}, levels("recall", OVERLAP))),
        ("C-26", "Weighing precision and recall together, GTM and RANSAC are preferable.",
         in_top({"gtm": 2, "ransac": 2}, overall("f_score", OVERLAP)))),
    *_section("5.1 item 5, threshold",
        ("C-27", "All methods gain precision as the threshold is relaxed.",
         never_falls("precision", EPSILON)),
        ("C-28", "RANSAC and GTM gain precision fastest.",
         in_top({"ransac": 2, "gtm": 2}, change(levels("precision", EPSILON), +1))),
        ("C-29", "Only SI, CV and SS gain evidently in recall.",
         changes(levels("recall", EPSILON), ">", CLEAR, ["si", "cv", "ss"])
         & changes(levels("recall", EPSILON), "<=", CLEAR, ["nnsr", *GROUP_BASED])
         & listed(change(levels("recall", EPSILON), +1), "Rise of R")),
        ("C-29b", "The ranking of the methods is stable as the threshold changes.",
         stable(levels("f_score", EPSILON), 0.8))),
    *_section("5.1 item 6, number of matches",
        ("C-30", "With fewer than 1000 matches, SI and CV are imprecise.",
         beside_median(["si", "cv"], "<", 0, levels("precision", MATCHES, below(1000)))),
        ("C-31", "With more than 1000 matches, the precision of SI and CV improves quickly.",
         changes(levels("precision", MATCHES), ">", CLEAR, ["si", "cv"], since=1000)),
        ("C-32", "With about 3000 matches, CV is the second most precise.",
         in_top({"cv": 2}, levels("precision", MATCHES, nearest(3000, 2000, 4500)))),
        ("C-33", "SI and CV recall most, clearly more than the others, for any number of matches.",
         in_top({"si": 2, "cv": 2}, levels("recall", MATCHES))
         & cells(lead(["si", "cv"], levels("recall", MATCHES), worst=True), ">", CLEAR)),
        ("C-34", "GC, RANSAC and 3DHV fluctuate as the number of matches grows.",
         fluctuate(["gc", "ransac", "3dhv"], levels("f_score", MATCHES)))),
    *_section("5.1 item 7, detector and descriptor",
        ("C-35", ("On B3R, LFSH gives far fewer correct matches than the other descriptors, with either "
                  "detector."),
         fewer_matches(["C2", "C5"], 0.5, ON_B3R)),
        ("C-36", "On B3R, GTM's precision is nearly 1 and the best, whatever the combination.",
         cells(levels("precision", ON_B3R, ALL_SIX), ">=", 0.97, ["gtm"])
         & in_top({"gtm": 1}, levels("precision", ON_B3R, ALL_SIX))),
        ("C-37", "On B3R, CV, GC and RANSAC find nearly all correct matches, whatever the combination.",
         cells(levels("recall", ON_B3R, ALL_SIX), ">=", 0.95, ["cv", "gc", "ransac"])),
        ("C-38", "On U3OR, every method does best with RCS.",
         best_with(["C3", "C6"], levels("f_score", ON_U3OR, ALL_SIX))),
        ("C-39", "On U3OR, the ranking hardly depends on the combination: GTM leads in P, SI and CV in R.",
         stable(levels("f_score", ON_U3OR, ALL_SIX), 0.6, mean=True)
         & in_top({"gtm": 1}, levels("precision", ON_U3OR, ALL_SIX))
         & in_top({"si": 2, "cv": 2}, levels("recall", ON_U3OR, ALL_SIX))),
        ("C-40", "On U3M, most methods do best with ISS and LFSH.",
         most(best_with(["C5"], levels("f_score", ON_U3M, ALL_SIX)))),
        ("C-41", "On U3M, GTM is best overall, followed by GC, RANSAC and ST; SI, 3DHV and NNSR swap places.",
         in_top({"gtm": 1, "gc": 4, "ransac": 4, "st": 4}, mean_of(levels("f_score", ON_U3M, ALL_SIX)))
         & orders_differ(["si", "3dhv", "nnsr"], levels("f_score", ON_U3M, ALL_SIX))
         & listed(mean_of(levels("f_score", ON_U3M, ALL_SIX)), "Order"))),
    *_section("5.1, summary",
        ("C-42", "SI and CV find the majority of the correct matches under all conditions.",
         cells(everywhere("recall", ["si", "cv"], ON_B3R, ON_U3OR, ON_U3M, without="epsilon"), ">", 0.5,
               ["si", "cv"]))),
    *_section("5.2 item 1, noise and density",
        ("C-43", "All methods register all pairs of B3R under noise.",
         cells(levels("registered", NOISE), ">=", 1)),
        ("C-44", "Under noise, every method's average precision is above 0.4.",
         cells(levels("precision", NOISE), ">", 0.4)),
        ("C-45", ("All methods register all pairs while more than 30 % of the points are kept; below, SI and "
                  "SS start to fail."),
         cells(levels("registered", DENSITY, above(0.3)), ">=", 1)
         & over_levels("lowest", levels("registered", DENSITY, up_to(0.3)), "<", 1, ["si", "ss"]))),
    *_section("5.2 item 2, clutter and occlusion",
        ("C-46", "In clutter and occlusion, GC registers the most pairs, GTM the second most.",
         in_top({"gc": 1, "gtm": 2}, overall("registered", CLUTTER))
         & listed(overall("registered", CLUTTER), "Rates")),
        ("C-47", "RANSAC is mostly more precise than GC, and yet registers fewer pairs.",
         share(">", 0.5, higher("ransac", ["gc"], levels("precision", CLUTTER, OCCLUSION)))
         & higher("gc", ["ransac"], overall("registered", CLUTTER))),
        ("C-48", ("Pair by pair on U3OR, GC is rarely above 0.5 in precision and always above 0.1; RANSAC is "
                  "usually above 0.5 where it succeeds, and near 0 where it fails."),
         pairs_with("gc", (">", 0.5), "<=", 0.1, CLUTTER) & pairs_with("gc", (">", 0.1), ">=", 1, CLUTTER)
         & pairs_with("ransac", (">", 0.5), ">", 0.5, CLUTTER, registered=True)
         & pairs_with("ransac", ("<=", 0.05), ">", 0.5, CLUTTER, registered=False))),
    *_section("5.2 item 3, overlap",
        ("C-49", "GTM registers most at every overlap, followed by RANSAC and GC.",
         in_top({"gtm": 1, "ransac": 3, "gc": 3}, levels("registered", OVERLAP))),
        ("C-50", "With less than 60 % overlap, all methods fail on most pairs.",
         cells(levels("registered", OVERLAP, below(0.6)), "<", 0.5))),
    *_section("5.2 item 4, threshold and number of matches",
        ("C-51", "The threshold hardly changes the ranking by registration; GC and GTM are the two best.",
         stable(levels("registered", EPSILON), 0.8)
         & in_top({"gc": 2, "gtm": 2}, levels("registered", EPSILON))),
        ("C-52", ("More matches raise the registration rate of most methods a little; GTM is best near 500, "
                  "GC passes it for denser sets."),
         share(">", 0.5, changes(levels("registered", MATCHES), ">", TIE))
         & in_top({"gtm": 1}, levels("registered", MATCHES, nearest(500, 250, 999, optional=True)))
         & higher("gc", ["gtm"], levels("registered", MATCHES, from_(1000))))),
    *_section("5.2 item 5, detector and descriptor",
        ("C-53", "On B3R, all methods register reliably with every combination.",
         cells(levels("registered", ON_B3R, ALL_SIX), ">=", 0.9)
         & over_levels("range of the", levels("registered", ON_B3R, ALL_SIX), "<=", LARGE)),
        ("C-54", ("On U3OR, GC and GTM generally register most; SS is far behind with all combinations; NNSR "
                  "is sometimes competitive."),
         share(">", 0.5, in_top({"gc": 2, "gtm": 2}, levels("registered", ON_U3OR, ALL_SIX)))
         & trails("ss", CLEAR, levels("registered", ON_U3OR, ALL_SIX))
         & share(">", 0, in_top({"nnsr": 3}, levels("registered", ON_U3OR, ALL_SIX)))
         & listed(mean_of(levels("registered", ON_U3OR, ALL_SIX)), "Rates")),
        ("C-55", "On U3M, GTM registers most with every combination, and most of all with ISS and LFSH.",
         in_top({"gtm": 1}, levels("registered", ON_U3M, ALL_SIX))
         & best_with(["C5"], levels("registered", ON_U3M, ALL_SIX), ["gtm"])
         & listed(across("gtm", levels("registered", ON_U3M, ALL_SIX)), "GTM"))),
    *_section("5.3, efficiency",
        ("C-56", "ST and RANSAC take longest, above all for large sets (this depends on the implementation).",
         in_top({"st": 2, "ransac": 2}, times("longest")) & with_exponents("st", "ransac")),
        ("C-57", "NNSR and 3DHV are the two fastest.",
         in_top({"nnsr": 2, "3dhv": 2}, times("shortest")) & with_exponents("nnsr", "3dhv")),
        ("C-58", "SS is slower than NNSR, since it looks for its threshold.",
         higher("ss", ["nnsr"], times("longest")) & with_exponents("ss", "nnsr")),
        ("C-59", "GTM and SI are slower than most others.",
         in_top({"gtm": 4, "si": 4}, times("longest")) & with_exponents("gtm", "si")),
        ("C-60", "CV needs far less time than SI.",
         higher("si", ["cv"], times("longest"), twice=True) & with_exponents("si", "cv")),
        ("C-61", "3DHV stays fast for thousands of matches, since its cost is linear.",
         linear("3dhv", 1.2, 0.1))),
    *_section("5.4, visualization",
        ("C-62", "What SS and NNSR select contains many outliers, except on B3R.",
         cells(overall("precision", NOISE), ">=", 0.5, ["ss", "nnsr"])
         & cells(overall("precision", CLUTTER, OVERLAP), "<", 0.5, ["ss", "nnsr"]))),
    *_section("6, summary",
        ("C-63", "ST takes the longest of all for large sets.",
         in_top({"st": 1}, times("longest", largest=3000))),
        ("C-64", ("GC is inferior to most methods where many initial matches are correct, and good where few "
                  "are."),
         ranks("gc", 6, 9, overall("precision", NOISE))
         & in_top({"gc": 3}, overall("registered", CLUTTER, OVERLAP))),
        ("C-65", "Group-based methods are more precise; SI and CV recall more.",
         higher_mean(GROUP_BASED, INDIVIDUAL, overall("precision", *PLACES))
         & higher_mean(["si", "cv"], GROUP_BASED, overall("recall", *PLACES))),
        ("C-66", "CV is more precise than SI, and faster.",
         higher("cv", ["si"], overall("precision", *PLACES)) & higher("si", ["cv"], times("longest"))),
        ("C-67", ("Grouping by GC or GTM before the pose is estimated registers far more pairs than RANSAC "
                  "on the raw matches."),
         higher("gc+ransac", ["ransac"], same_cases("registered", (*CHAINED, "ransac"), "U3OR", "U3M"))
         & higher("gtm+ransac", ["ransac"], same_cases("registered", (*CHAINED, "ransac"), "U3OR", "U3M")))),
)
# fmt: on
"""All claims of the paper, in its order."""


def check_claims(
    frame: pd.DataFrame, timing: pd.DataFrame, *, resamples: int = 0, seed: int = 0
) -> list[Verdict]:
    """Check all claims of the paper on the records.

    Parameters
    ----------
    frame : DataFrame
        Records, one row per case, method and threshold.
    timing : DataFrame
        Times of the timing experiment; may have no rows.
    resamples : int
        Draws of the pairs on which claims are checked again, which gives verdicts their `stability`; none by
        default.
    seed : int
        Of the draws.

    Returns
    -------
    list of Verdict
        One per claim, in the paper's order; `CRITERIA` says how they come about.

    Raises
    ------
    InputError
        If the number of resamples or the seed isn't a whole number from 0.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.benchmark.paper.claims import check_claims
    >>> verdicts = check_claims(pd.DataFrame(), pd.DataFrame())  # no records
    >>> {verdict.verdict for verdict in verdicts}
    {'not testable'}
    """
    return check_evidence(Evidence(frame, timing), resamples=resamples, seed=seed)


def check_evidence(evidence: Evidence, *, resamples: int = 0, seed: int = 0) -> list[Verdict]:
    """Check all claims of the paper on evidence that is at hand."""
    resamples, seed = as_count("resamples", resamples, 0), as_count("seed", seed, 0)
    why = read_explanations()
    verdicts = [decide(claim, evidence, why.get(claim.id, "")) for claim in CLAIMS]
    if not resamples:
        return verdicts
    outcomes: dict[Claim, Outcome] = {
        claim: each.verdict for claim, each in zip(CLAIMS, verdicts, strict=True)
    }
    known = resample_outcomes(evidence, outcomes, resamples, seed)
    return [replace(each, stability=known.get(each.id)) for each in verdicts]


def bootstrap_verdicts(
    frame: pd.DataFrame,
    timing: pd.DataFrame,
    *,
    resamples: int = RESAMPLES,
    seed: int = 0,
    claims: Iterable[Claim] = CLAIMS,
) -> dict[str, Stability]:
    """Find out how often verdicts are the same on other draws of the same pairs.

    A resample draws as many pairs of each data set as it has, with replacement, and all records of a pair
    together; of the times it draws the repeats of each method on each set. It says how much verdicts hang on
    which pairs of these data sets there are, and nothing of other data sets.

    Parameters
    ----------
    frame : DataFrame
        Records, one row per case, method and threshold.
    timing : DataFrame
        Times of the timing experiment; may have no rows.
    resamples : int
        How many; 1 or more.
    seed : int
        Of the draws. The draws of a data set depend on it and on the names of the pairs only, so that
        records of other methods on the same pairs can be compared draw by draw.
    claims : iterable of Claim
        Which; all by default.

    Returns
    -------
    dict of str to Stability
        By the claim's id; only of claims that are testable on all pairs.

    Raises
    ------
    InputError
        If the number of resamples isn't a whole number above 0, or the seed isn't one from 0.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.benchmark.paper.claims import bootstrap_verdicts
    >>> bootstrap_verdicts(pd.DataFrame(), pd.DataFrame())  # no records
    {}
    """
    resamples, seed = as_count("resamples", resamples, 1), as_count("seed", seed, 0)
    evidence = Evidence(frame, timing)
    outcomes: dict[Claim, Outcome] = {claim: decide(claim, evidence).verdict for claim in claims}
    return resample_outcomes(evidence, outcomes, resamples, seed)


def decide(claim: Claim, evidence: Evidence, explanation: str = "") -> Verdict:
    """Check one claim, also where it isn't testable."""
    named = (claim.id, claim.section, claim.statement, claim.criterion)
    return Verdict(*named, **judge(claim.check, evidence), explanation=explanation)


def resample_outcomes(
    evidence: Evidence, found: dict[Claim, Outcome], resamples: int, seed: int = 0
) -> dict[str, Stability]:
    """Find out how often claims that are testable on all pairs come out as there."""
    counts: dict[Claim, Counter[Outcome]] = {
        claim: Counter() for claim, outcome in found.items() if outcome != "not testable"
    }
    for resample in resample_evidence(evidence, resamples, seed=seed) if counts else ():
        for claim, count in counts.items():
            count[_find_outcome(claim.check, resample)] += 1
    return {claim.id: Stability.of(found[claim], count) for claim, count in counts.items()}


def _find_outcome(check: Check, evidence: Evidence) -> Outcome:
    try:
        return count_tests(check.find(Witness(evidence)), check.need).outcome
    except NotTestableError:
        return "not testable"
