"""``cgroup evaluate``: score and compare results of any tool by the recalls of papers."""

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cgroup._checks.quoting import escape
from cgroup._show.words import counted
from cgroup.cli import options
from cgroup.cli.command import command
from cgroup.cli.documents import Document
from cgroup.cli.files import unique_names
from cgroup.cli.options import TRUTH, option
from cgroup.cli.terminal import UNKNOWN, print_facts, print_prose, print_table, print_text, show_value
from cgroup.errors import InputError
from cgroup.evaluation import recall_protocols as protocols
from cgroup.evaluation.recall_protocols import Recall, RecallProtocol, compare_results
from cgroup.evaluation.recalls import registration_recall
from cgroup.evaluation.result_files import PairErrors, read_results, read_truth, show_pair
from cgroup.types import BoolArray

# Bounds of levels: 3DLoMatch has pairs of 0.1 to 0.3, 3DMatch those above.
_OVERLAPS = (0.0, 0.1, 0.3, 0.5, 0.7, 1.0)
_FACTORS = tuple(k / 10 for k in range(1, 21))  # multiples of the limits, for the curve
_COUNTS = ("right", "wrong", "refused", "missing")
_WORST = 20  # poses of a result that a document lists
_WORDS = ("result", "one", "other", "scene", "overlap", "limits x")  # others are columns of numbers
_LATEX = str.maketrans(
    {letter: f"\\{letter}" for letter in "&%$#_{}"}
    | {letter: f"{{{letter}}}" for letter in "[*"}  # which the end of a row before would take
    | {"\\": r"\textbackslash{}", "^": r"\textasciicircum{}", "~": r"\textasciitilde{}"}
    | {"<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}"}
)
_MARKDOWN = str.maketrans({letter: f"\\{letter}" for letter in r"\`*_[]<>|~&$"})


def print_evaluation(
    document: Document, *, wide: bool, curve: bool = False, latex: bool = False, markdown: bool = False
) -> None:
    """Print results by all recalls of a protocol from their document, or as a table for a paper."""
    done = document["results"]
    if latex or markdown:
        rows = [["result", *(one["name"] for one in done["recalls"]), "RRE", "RTE"]]
        rows += [[one["name"], *_show_recalls(one, done)] for one in done["methods"]]
        print_text(_as_latex(rows) if latex else _as_markdown(rows))
        return
    for heading, columns, rows in _tables(done, curve=curve):
        print_prose(f"{heading}:")
        words = [at for at, name in enumerate(columns) if name in _WORDS]
        print_table(columns, rows, words=words, drop=range(len(columns) - 1, 1, -1), wide=wide)
        print_text("")
    print_facts(*_facts(done))


def _tables(done: Document, *, curve: bool) -> Iterator[tuple[str, list[str], list[list[str]]]]:
    methods: list[Document] = done["methods"]
    names, titles = ([one["name"] for one in done[key]] for key in ("methods", "recalls"))
    main, scenes = titles[done["main"]], [*dict.fromkeys(scene for one in methods for scene in one["scenes"])]
    of_what = f"{done['pairs']} pairs of {counted(len(scenes), 'scene')}"
    heading = f"{done['protocol']}: {of_what}; recalls in % with Wilson's intervals of 95 %"
    shown = [[one["name"], *_show_recalls(one, done, intervals=True)] for one in methods]
    yield heading, ["result", *titles], [row[:-2] for row in shown]
    counts = [[one["name"], *(str(one[count]) for count in _COUNTS)] for one in methods]
    rows = [[*row, *errors[-2:]] for row, errors in zip(counts, shown, strict=True)]
    yield f"By {main}", ["result", *_COUNTS, "RRE deg", "RTE"], rows
    levels = [f"{low:g} to {high:g}" for low, high in itertools.pairwise(_OVERLAPS)]
    of_scenes = [[*map(one["scenes"].get, scenes)] for one in methods]
    parts = [("scene", scenes, of_scenes), ("overlap", levels, [one["overlaps"] for one in methods])]
    parts += [("limits x", [*map(str, _FACTORS)], [one["curve"] for one in methods])] if curve else []
    for title, labels, shares in parts:
        if any(share is not None for each in shares for share in each):
            rows = [[label, *map(_percent, each)] for label, *each in zip(labels, *shares, strict=True)]
            yield f"{main} by {title}", [title, *names], rows
    if done["tests"]:
        rows = [[show_value(cell, ".2g") for cell in test.values()] for test in done["tests"]]
        heading = "Pairs registered by one result only; p of McNemar's exact test, adjusted by Holm"
        yield heading, ["one", "other", "only one", "only other", "p"], rows


def _facts(done: Document) -> list[tuple[str, str]]:
    recalls = [f"{one['name']}: {one['criterion']}" for one in done["recalls"]]
    facts = {"recall": recalls, "note": done["notes"], "left open": done["left_open"]}
    return [(name, sentence) for name, sentences in facts.items() for sentence in sentences]


def _percent(share: float | None, digits: int = 1) -> str:
    return UNKNOWN if share is None else f"{100 * share:.{digits}f}"


def _show_recalls(method: Document, done: Document, *, intervals: bool = False) -> list[str]:
    """Return the recalls of a result as text, and its errors by the main recall."""
    cells: list[str] = []
    for one in method["recalls"]:
        ends = f" [{_percent(one['low'])}, {_percent(one['high'])}]" if intervals and one else ""
        cells.append(_percent(one and one["recall"], 2) + ends)
    main = method["recalls"][done["main"]]
    return [*cells, *(show_value(main[key], ".4f") for key in ("rotation_deg", "translation"))]


def _as_markdown(rows: list[list[str]]) -> str:
    lines = [f"| {' | '.join(escape(cell).translate(_MARKDOWN) for cell in row)} |" for row in rows]
    return "\n".join([lines[0], f"| --- |{' ---: |' * (len(rows[0]) - 1)}", *lines[1:]])


def _as_latex(rows: list[list[str]]) -> str:
    head, *body = (" & ".join(escape(cell).translate(_LATEX) for cell in row) + r" \\" for row in rows)
    begin = rf"\begin{{tabular}}{{l{'r' * (len(rows[0]) - 1)}}}"
    return "\n".join([begin, r"\toprule", head, r"\midrule", *body, r"\bottomrule", r"\end{tabular}"])


@command(
    "evaluate",
    "cgroup evaluate est_traj --protocol 3dmatch --truth benchmarks/3DMatch",
    "cgroup evaluate ours.csv theirs.npz --protocol kitti --truth poses.csv",
    "cgroup evaluate poses.tum --protocol own.toml --truth truth.tum --latex",
    show=print_evaluation,
)
def evaluate_command(
    results: list[Path] = options.argument(
        "RESULT", "Folders of est.log, CSV, NPZ, TUM, KITTI, g2o, JSON of register and merge, DGR's arrays."
    ),
    *,
    protocol: str = option(
        "NAME", f"{', '.join(protocols.protocol_names())}, or a .toml file.", TRUTH, default=...
    ),
    truth: Path | None = option(
        "PATH", "True poses: folders SCENE/gt.log, or a file like a result.", TRUTH, "none"
    ),
    inverse: bool = options.flag("--inverse", "Poses map the target into the source's frame.", TRUTH),
    curve: bool = options.flag("--curve", "Print the recall at 0.1 to 2 times the limits too."),  # noqa: ARG001
    latex: bool = options.flag("--latex", "Print the table of recalls as LaTeX."),  # noqa: ARG001 - for `show`
    markdown: bool = options.flag("--markdown", "Print the table of recalls as Markdown."),  # noqa: ARG001
) -> Document:
    """Score and compare registration results of any tool by all recalls of a protocol.

    Several results are tested against each other on the same pairs. A pair is identified by scene, target and
    source; the order is free. A missing pair counts as not registered.
    """
    by, known = protocols.read_protocol(protocol), None if truth is None else read_truth(truth)
    found: dict[str, PairErrors] = {}
    short = [path.parent.name if path.stem == "est" else path.stem for path in results]
    for name, path in zip(unique_names(results, short), results, strict=True):
        for one in read_results(path, known):
            if isinstance(one, PairErrors):
                found[f"{name}: {one.name}" if one.name in found else one.name] = one
            elif known is None:
                message = f"--truth: is needed for the poses in {path}; give the true poses"
                raise InputError(message)
            else:
                called = str(path) if name in found else name
                found[called] = protocols.score_poses(known, one, inverse=inverse)
                if not inverse:
                    protocols.refuse_inverses(known, one, found[called], _main_recall(by, found[called]))
    inputs = [{"role": f"result {number}", "file": path} for number, path in enumerate(results, 1)]
    return {"inputs": inputs, "results": _evaluate(by, found), "files": []}


def _main_recall(by: RecallProtocol, *found: PairErrors) -> Recall:
    for recall in by.recalls:
        if all(map(recall.is_known, found)):
            return recall
    message = f"{by.title}: no recall is known for all results; RMSE needs gt.info beside gt.log"
    raise InputError(message)


def _evaluate(by: RecallProtocol, found: dict[str, PairErrors]) -> Document:
    main = _main_recall(by, *found.values())
    pairs = {len(one.keys) for one in found.values()}
    if len(pairs) > 1:
        message = f"RESULT: of {' and '.join(map(str, sorted(pairs)))} pairs; give results of one benchmark"
        raise InputError(message)
    is_whole = by.pairs in (None, *pairs)
    notes = [] if is_whole else [f"{by.title} has {by.pairs} pairs, the truth has {min(pairs)}"]
    notes += [f"{name}: {note}" for name, one in found.items() for note in one.notes]
    tests = compare_results(found, main)
    tested = {(test["one"], test["other"]) for test in tests}
    apart = [" and ".join(two) for two in itertools.combinations(found, 2) if two not in tested]
    notes += [f"not tested, because their pairs differ: {', '.join(apart)}"] if apart else []
    return {
        "protocol": by.title,
        "citation": by.citation,
        "pairs": min(pairs),
        "recalls": [{"name": one.name, "criterion": one.describe()} for one in by.recalls],
        "main": by.recalls.index(main),
        "methods": [_describe(name, one, by, main) for name, one in found.items()],
        "tests": tests,
        "factors": _FACTORS,
        "notes": notes,
        "left_open": by.left_open,
    }


def _describe(name: str, found: PairErrors, by: RecallProtocol, main: Recall) -> Document:
    counts, right = main.counted(found), main.registered(found)
    scenes, levels = np.array([key[0] for key in found.keys]), np.digitize(found.overlap, _OVERLAPS[1:-1])
    levels[np.isnan(found.overlap)] = -1
    kinds = (right, ~right & ~found.refused & ~found.missing, found.refused, found.missing)

    excess = main.excess(found)
    rows = np.flatnonzero(counts & ~right & np.isfinite(excess))
    values = {"overlap": found.overlap, "factor": excess, "rotation_deg": found.rotation}
    values |= {"translation": found.translation, "rmse": found.rmse}

    def share(chosen: BoolArray) -> float:
        return registration_recall(right[counts & chosen])

    return {
        "name": name,
        **{kind: int((counts & rows).sum()) for kind, rows in zip(_COUNTS, kinds, strict=True)},
        "recalls": [one.score(found) for one in by.recalls],
        "scenes": {scene: share(scenes == scene) for scene in np.unique(scenes).tolist()},
        "overlaps": [share(levels == level) for level in range(len(_OVERLAPS) - 1)],
        "worst": [
            {"pair": show_pair(found.keys[row]), **{key: float(each[row]) for key, each in values.items()}}
            for row in rows[np.argsort(-excess[rows])][:_WORST].tolist()
        ],
        "curve": [registration_recall(main.registered(found, factor)[counts]) for factor in _FACTORS],
    }
