"""Records made up so that they agree with the paper: for tests of claims, figures and the report only."""

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pandas as pd

from cgroup.benchmark.problem import COMBINATIONS
from cgroup.evaluation.protocols import CLUTTER, OCCLUSION, OVERLAP
from cgroup.registry import PAPER_METHODS as METHODS


class Skill(NamedTuple):
    """How a method does on a data set: share of pairs it succeeds on, and P and R where it does."""

    success: float
    precision: float
    recall: float


# Success, precision and recall of each method on full models, in scenes, and on views.
_SKILLS = """\
ss      1     0.62  0.6     0.3   0.13  0.3     0.4   0.15  0.3
nnsr    1     0.93  0.6     0.8   0.2   0.42    0.5   0.25  0.4
si      1     0.9   0.95    0.8   0.28  0.78    0.6   0.25  0.82
cv      1     0.93  0.98    0.85  0.36  0.92    0.7   0.35  0.92
ransac  1     0.985 0.99    0.55  0.8   0.35    0.9   0.66  0.6
st      1     0.98  0.99    0.4   0.3   0.25    0.7   0.4   0.5
gc      1     0.84  0.98    1     0.3   0.55    0.9   0.55  0.5
3dhv    1     0.82  0.65    0.7   0.25  0.38    0.6   0.3   0.35
gtm     1     0.98  0.93    0.9   0.88  0.4     1     0.95  0.62
"""


def _read_skills(first: int) -> dict[str, Skill]:
    lines = [line.split() for line in _SKILLS.splitlines()]
    return {method: Skill(*map(float, numbers[first : first + 3])) for method, *numbers in lines}


FULL, SCENE, VIEWS = (_read_skills(first) for first in (0, 3, 6))


def _records(
    dataset: str, origin: str, pair: str, skill: dict[str, Skill], position: float, **facts
) -> list[dict]:
    """Nine rows of one case; `position` in [0,1) tells the pairs on which a method succeeds."""
    n, ratio = facts.pop("n", 1200), facts.pop("ratio", 0.5)
    shared = {
        "dataset": dataset,
        "origin": origin,
        "pair": pair,
        "nuisance": "",
        "combination": "C1",
        "front": "",
        **dict.fromkeys(("level", "nms_radius", "clutter", "occlusion", "overlap"), np.nan),
        "epsilon": 5.0,
        "pr": 0.5,
        "n": n,
        "correct": round(ratio * n),
        "inlier_ratio": ratio,
        "error": "",
        "seconds": 0.01,
        **facts,
    }
    shared["case"] = "/".join(
        str(shared[name]) for name in ("dataset", "pair", "nuisance", "level", "nms_radius", "combination")
    )
    shared["detector"], shared["descriptor"] = COMBINATIONS[shared["combination"]]
    rows = []
    for method, each in skill.items():
        done = position < each.success
        precision = each.precision if done else 0.0
        recall = each.recall if done or method in {"si", "cv"} else 0.02
        hits = round(recall * shared["correct"])
        rows.append(
            {
                **shared,
                "method": method,
                "precision": precision,
                "recall": recall,
                "f_score": 2 * precision * recall / max(precision + recall, 1e-9),
                "selected": round(hits / precision) if precision else 40,
                "selected_correct": hits if precision else 0,
                "registered": precision > 0.1,
                "ok:rmse<=5pr": precision > 0.3,
            }
        )
    return rows


def _changed(skill: dict[str, Skill], changes: dict[str, tuple[float, float]]) -> dict[str, Skill]:
    """Precision and recall of some methods, moved."""
    return {
        name: Skill(
            each.success,
            float(np.clip(each.precision + changes.get(name, (0, 0))[0], 0, 1)),
            float(np.clip(each.recall + changes.get(name, (0, 0))[1], 0, 1)),
        )
        for name, each in skill.items()
    }


def _noise(pairs: int) -> Iterator[dict]:
    for level in np.arange(1, 10) * 0.05:
        loss = dict.fromkeys(METHODS, (-0.1 * level, -0.03 * level))
        loss |= {"si": (-0.8 * level, -0.1 * level), "ransac": (0, 0), "st": (0, 0), "ss": (-0.3 * level, 0)}
        skill = _changed(FULL, loss)
        for k in range(pairs):
            facts = {
                "nuisance": "noise",
                "level": level,
                "ratio": 0.6 - 0.5 * level,
                "experiments": ("noise",),
            }
            yield from _records("b3r-clean", "real", f"scene{k}", skill, k / pairs, **facts)


def _density(pairs: int) -> Iterator[dict]:
    for level in np.arange(1, 10) / 10:
        away = 1 - level
        loss = dict.fromkeys(METHODS, (-0.1 * away, -0.02 * away))
        loss |= {"nnsr": (0, -0.55 * away), "si": (-0.5 * away, -0.4 * away), "ss": (0.0, 0)}
        loss |= {"ransac": (0, 0), "st": (0, 0)}
        skill = _changed(FULL, loss)
        if level <= 0.3:
            skill |= {name: skill[name]._replace(success=0.7) for name in ("si", "ss")}
        if level <= 0.3:
            skill["si"] = skill["si"]._replace(precision=0.5)
        for k in range(pairs):
            facts = {"nuisance": "density", "level": level, "ratio": 0.5 * level, "experiments": ("density",)}
            yield from _records("b3r-clean", "real", f"scene{k}", skill, k / pairs, **facts)


def _scenes(pairs: int) -> Iterator[dict]:
    for k in range(pairs):
        experiments = ("clutter", "occlusion", "epsilon")
        level = k % 7
        for epsilon in np.arange(1.0, 11.0):
            more = (epsilon - 5) / 5
            gain = dict.fromkeys(METHODS, (0.02 * more, 0.01 * more))
            gain |= {"ransac": (0.1 * more, 0), "gtm": (0.09 * more, 0)}
            gain |= {"si": (0.02 * more, 0.05 * more), "cv": (0.02 * more, 0.05 * more)}
            gain |= {"ss": (0.02 * more, 0.15 * more)}
            facts = {
                "epsilon": epsilon,
                "clutter": CLUTTER.levels[level],
                "occlusion": OCCLUSION.levels[level],
                "ratio": 0.022,
                "experiments": experiments,
            }
            origin = "real" if k == 0 else "semi-synthetic"
            yield from _records(
                "u3or", origin, f"rs{k}", _changed(SCENE, gain), (k // 7) / (pairs / 7), **facts
            )


def _occluded_scenes(pairs: int) -> Iterator[dict]:
    """Pairs without clutter, on which CV is less far ahead in recall."""
    skill = _changed(SCENE, {"cv": (0, -0.12)})
    for k in range(pairs):
        facts = {"occlusion": OCCLUSION.levels[k % 7], "ratio": 0.022, "experiments": ("occlusion",)}
        yield from _records("u3or", "semi-synthetic", f"occluded{k}", skill, k / pairs, **facts)


def _views(per_level: int) -> Iterator[dict]:
    for i, overlap in enumerate(OVERLAP.levels):
        less = 0.9 - overlap
        loss = dict.fromkeys(METHODS, (-0.3 * less, -0.2 * less))
        loss |= {
            "gtm": (-1.3 * less if overlap >= 0.7 else -0.35, -0.2 * less),
            "ransac": (-0.15 * less, -0.2 * less),
        }
        skill = _changed(VIEWS, loss)
        if overlap < 0.6:
            skill = {name: each._replace(success=0.45 * each.success) for name, each in skill.items()}
        for k in range(per_level):
            facts = {"overlap": overlap + 0.05, "ratio": 0.2 * overlap, "experiments": ("overlap",)}
            yield from _records("stanford", "real", f"view{i}-{k}", skill, k / per_level, **facts)


def _matches(pairs: int) -> Iterator[dict]:
    for step, n in enumerate((300, 500, 950, 2000, 3100, 5000)):
        swing = 0.05 * (-1) ** step
        gain = {"gc": (swing, 0), "ransac": (swing, swing), "3dhv": (swing, 0)}
        dense = max(0.0, (n - 950) / 4000)
        few = (-0.2, 0.0) if n < 1000 else (0.5 * dense, 0.0)
        gain |= {"si": few, "cv": (few[0] + (0.25 if n > 1000 else 0), 0)}
        skill = _changed(SCENE, gain)
        skill = {
            name: each._replace(success=min(1.0, each.success + 0.03 * step)) for name, each in skill.items()
        }
        if n < 1000:
            skill["gc"], skill["gtm"] = (
                skill["gc"]._replace(success=0.85),
                skill["gtm"]._replace(success=0.97),
            )
        else:
            skill["gtm"] = skill["gtm"]._replace(success=0.93)
        for k in range(pairs):
            facts = {"nms_radius": 6.0 - step, "n": n + k, "ratio": 0.03, "experiments": ("matches",)}
            yield from _records("u3or", "semi-synthetic", f"rs{k}", skill, k / pairs, **facts)


def _combinations(pairs: int) -> Iterator[dict]:
    for name in COMBINATIONS:
        few = name in {"C2", "C5"}
        best = {"u3or": name in {"C3", "C6"}, "stanford": name == "C5", "b3r": False}
        for dataset, origin, skill in (
            ("b3r", "real", FULL),
            ("u3or", "semi-synthetic", SCENE),
            ("stanford", "real", VIEWS),
        ):
            used = _changed(skill, dict.fromkeys(METHODS, (0.04, 0.04)) if best[dataset] else {})
            if dataset == "stanford":
                used = _changed(used, {"gc": (0.25, 0.15), "ransac": (0.05, -0.05), "st": (0.2, 0)})
                used = _changed(used, {"nnsr": (0.3, 0.1) if few else (-0.1, 0)})
            if dataset == "u3or" and name == "C4":
                used["nnsr"] = used["nnsr"]._replace(success=0.87)
            if dataset == "b3r":
                used = _changed(used, {"gtm": (0.015, 0)})
            ratio = {"b3r": 0.1 if few else 0.5, "u3or": 0.02, "stanford": 0.1}[dataset]
            for k in range(pairs):
                facts = {"combination": name, "ratio": ratio, "experiments": ("combinations",)}
                yield from _records(dataset, origin, f"{dataset}{k}", used, k / pairs, **facts)


def _variants(pairs: int, per_level: int) -> Iterator[dict]:
    """On the cases of `_scenes` and `_views`."""
    chained = {"gc+ransac": Skill(0.9, 0.8, 0.4), "gtm+ransac": Skill(0.85, 0.9, 0.4)}
    for k in range(pairs):
        position = (k // 7) / (pairs / 7)
        yield from _records("u3or", "semi-synthetic", f"rs{k}", chained, position, experiments=("variants",))
    for i in range(7):
        for k in range(per_level):
            name = f"view{i}-{k}"
            yield from _records("stanford", "real", name, chained, k / per_level, experiments=("variants",))


@lru_cache(maxsize=1)
def _paper() -> pd.DataFrame:
    experiments = _noise(3), _density(4), _scenes(70), _views(20), _matches(35), _combinations(20)
    further = _occluded_scenes(14), _variants(70, 20)
    return pd.DataFrame(row for rows in (*experiments, *further) for row in rows)


def paper_frame(*experiments: str) -> pd.DataFrame:
    """Records that agree with the paper; all experiments, or those named."""
    frame = _paper()
    if experiments:
        wanted = frame["experiments"].map(lambda ids: any(each in experiments for each in ids))
        frame = frame[wanted]
    return frame.copy()


def paper_timing() -> pd.DataFrame:
    """Times that agree with the paper."""
    cost = {
        "ss": lambda n: 2e-8 * n * np.log(n),
        "nnsr": lambda n: 1e-8 * n,
        "si": lambda n: 8e-6 * n * np.log(n),
        "cv": lambda n: 1e-6 * n * np.log(n),
        "ransac": lambda n: 8e-11 * n**3 + 0.03,
        "st": lambda n: 9e-11 * n**3 + 0.05,
        "gc": lambda n: 5e-9 * n**2,
        "3dhv": lambda n: 2e-8 * n,
        "gtm": lambda n: 1e-6 * n**1.5,
    }
    return pd.DataFrame(
        [
            {
                "method": method,
                "n": n,
                "threads": 1,
                "repeat": repeat,
                "seconds": float(seconds(n)) * (1 + 0.01 * (repeat % 3)),
                "dataset": "b3r-clean",
                "pair": "scene0",
            }
            for method, seconds in cost.items()
            for n in (500, 1000, 2000, 5000, 10000)
            for repeat in range(3)
        ]
    )
