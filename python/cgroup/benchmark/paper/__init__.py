"""The design of the paper's evaluation: experiments, data sets, complexities."""

from dataclasses import dataclass

from cgroup.evaluation.bins import CLUTTER, OCCLUSION, OVERLAP, Bins

PAPER_EPSILON = 5.0  # a match is correct within this many pr, wherever the threshold isn't what is varied
PLACES = {
    "B3R": ("b3r-clean", "b3r", "standin-full"),
    "U3OR": ("u3or", "standin-clutter"),
    "U3M": ("u3m", "stanford", "standin-views"),
}
"""Data sets that can stand for a data set of the paper; the first one with records does."""

OF_THE_PAPER = frozenset({"b3r-clean", "b3r", "u3or", "u3m"})  # data sets that the paper used
GENERATED = "standin-"  # names of generated data sets begin so


@dataclass(frozen=True)
class Experiment:
    """An experiment of the paper, section 4.3.

    `column` of the records is varied, and sorted into `bins`; `label` is that of the axis, with the unit.
    `places` are data sets of the paper. `sections` of the paper interpret the outcome, as claims name them.
    """

    id: str
    title: str
    column: str
    label: str
    places: tuple[str, ...]
    bins: Bins | None = None
    sections: tuple[str, ...] = ()


# fmt: off
EXPERIMENTS = {each.id: each for each in (
    Experiment("noise", "Gaussian noise", "level", "standard deviation of the noise (pr)",
               ("B3R",), None, ("5.1 item 1", "5.2 item 1")),
    Experiment("density", "Point density", "level", "share of the points kept",
               ("B3R",), None, ("5.1 item 2", "5.2 item 1")),
    Experiment("clutter", "Clutter", "clutter", "clutter (share of the scene)",
               ("U3OR",), CLUTTER, ("5.1 item 3", "5.2 item 2")),
    Experiment("occlusion", "Occlusion", "occlusion", "occlusion (share of the model)",
               ("U3OR",), OCCLUSION, ("5.1 item 3", "5.2 item 2")),
    Experiment("overlap", "Partial overlap", "overlap", "overlap (share)",
               ("U3M",), OVERLAP, ("5.1 item 4", "5.2 item 3")),
    Experiment("epsilon", "Inlier threshold", "epsilon", "inlier threshold (pr)",
               ("U3OR",), None, ("5.1 item 5", "5.2 item 4")),
    Experiment("matches", "Number of matches", "nms_radius", "initial matches (mean number)",
               ("U3OR", "U3M"), None, ("5.1 item 6", "5.2 item 4")),
    Experiment("combinations", "Detector and descriptor", "combination", "detector and descriptor",
               ("B3R", "U3OR", "U3M"), None, ("5.1 item 7", "5.2 item 5")),
)}
# fmt: on
"""In the paper's order."""

# Methods in sequence, as the paper's summary recommends them
VARIANTS = Experiment("variants", "Grouping before RANSAC", "", "", ("U3OR", "U3M"))
PAPER_COMPLEXITY = {
    "ss": "n log n",
    "nnsr": "n",
    "si": "n log n",
    "cv": "n log n",
    "ransac": "n³",
    "st": "n³",
    "gc": "n²",
    "3dhv": "n",
    "gtm": "n²",
}
"""The paper's table of complexities, section 5.3."""

# Methods of `VARIANTS` that a claim compares, on the cases that all of them were run on
CHAINED = ("gc+ransac", "gtm+ransac", "ransac")
