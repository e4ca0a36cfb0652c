"""Pages of the API reference: what every public module offers, grouped by what it does.

`GROUPS` names every public name once; a test compares it with each module's ``__all__``.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import itertools
import re
import typing
from pathlib import Path
from typing import TYPE_CHECKING

from cgroup.registry import METHOD_INFO

if TYPE_CHECKING:
    from types import ModuleType

_SHORT = 80
_PREFIXES = r"\b(numpy|typing)\.|<class '|'>"


def _methods(*, individual: bool, in_paper: bool) -> str:
    kind = (individual, in_paper)
    infos = [info for info in METHOD_INFO.values() if (info.individual, info.in_paper) == kind]
    return " ".join(info.function.__name__ for info in infos)


GROUPS: dict[str, dict[str, str]] = {
    "cgroup": {
        "One function for all methods": "group group_many",
        "Groups of any method": "match_probabilities certify",
        "Several motions": "group_motions",
        "What goes in, what comes out": "Correspondences Grouping Explanation",
        "Methods that judge matches one by one": _methods(individual=True, in_paper=True),
        "Methods that judge matches together": _methods(individual=False, in_paper=True),
        "Methods that came after the paper": _methods(individual=False, in_paper=False),
        "Errors": "CgroupError InputError NoConsensusError OutOfMemoryError",
        "Names": "METHODS PAPER_METHODS PRESETS",
    },
    "cgroup.types": {
        "Clouds": "PointCloud AnyCloud",
        "Matches and groups": "Correspondences Grouping Rule Agreement OPTIONAL_FIELDS",
        "Arrays": "BoolArray FloatArray IndexArray RealArray",
    },
    "cgroup.errors": {"Errors": "CgroupError InputError NoConsensusError OutOfMemoryError"},
    "cgroup.features": {
        "Clouds and lengths": "Cloud CloudLike resolution within",
        "Downsampling": "voxel_downsample choose_voxel Voxels",
        "Normals and meshes": "normals mesh_normals sample_mesh ORIGIN Viewpoint",
        "Keypoints": "harris3d iss drop_isolated SUPPORT_RADIUS",
        "Local reference frames": "shot_lrf toldi_lrf",
        "Descriptors": "shot lfsh rcs fpfh DescribedCloud",
        "Matching": "match Matches",
    },
    "cgroup.registration": {
        "Two clouds": "register refine assess Registration false_accepts FalseAccepts",
        "Many clouds": "prepare PreparedScan register_many",
        "Models in scenes": "recognize find_instances Recognized",
        "The dense front": "DenseFront",
        "The paper's front, step by step": "correspond PaperFront detect describe surface_normals "
        "match_described",
        "Choices": "DESCRIPTORS Descriptor DETECTORS Detector EFFORTS Effort NORMALS Normals",
        "From cgroup.features": "DescribedCloud ORIGIN Viewpoint",
    },
    "cgroup.scenes": {
        "Many scans": "register_all Scene Edge false_joins",
        "A scan in a map": "prepare_map PreparedMap locate assess_in_map",
        "Pose graphs": "PoseGraph",
    },
    "cgroup.verification": {
        "Poses on surfaces": "Surface verify Verification score_poses",
        "Positions of points": "places Place",
        "The last refinement": "FineSurface align Alignment",
    },
    "cgroup.io": {
        "Clouds": "read_cloud read_depth write_cloud PointCloud",
        "Models of COLMAP": "read_colmap write_colmap ColmapModel",
        "Poses": "read_transform read_transforms write_transform check_rigid RIGID_TOLERANCE",
        "Targets": "read_targets",
        "Matches and groups": "read_correspondences write_correspondences write_mask",
        "Descriptors and keypoints": "read_descriptors write_descriptors write_keypoints",
        "Any file": "merge_files transform_file write_file",
    },
    "cgroup.rigid": {
        "Transforms": "apply invert check_rigid RIGID_TOLERANCE",
        "Errors of a pose": "rotation_error translation_error",
    },
    "cgroup.evaluation": {
        "Which matches are right": "correct_matches match_errors",
        "How good a group is": "score_group GroupScore",
        "How good a pose is": "alignment_error rotation_error translation_error",
        "How good a scene is": "score_scene SceneScore ecdf",
        "Recalls of benchmarks": "redwood_error registration_recall feature_matching_recall inlier_ratio "
        "mean_average_accuracy",
        "Registered or not": "Protocol PROTOCOLS",
        "How hard a pair is": "overlap clutter_and_occlusion",
    },
    "cgroup.targets": {
        "Surveyed targets": "fit_targets TargetFit",
    },
    "cgroup.comparison": {
        "Methods side by side": "compare MethodResult find_correct",
        "As a table": "table write_table",
        "When a pair counts as registered": "MAX_ROTATION MAX_DISPLACEMENT",
    },
    "cgroup.datasets": {
        "Generated": "standin_pair make_problem make_scene MatchingProblem",
        "Data sets": "open_dataset DATASETS Dataset data_root",
        "What they hold": "MatchingPair CorrespondencePair",
        "Pairs with nothing in common": "mirror mix mixed_names UnrelatedPair",
    },
    "cgroup.nuisances": {
        "On clouds": "add_noise decimate",
        "On pairs, by level": "apply_nuisance NUISANCES LEAST_POINTS",
    },
    "cgroup.plots": {
        "Clouds and matches": "registration_figure comparison_figure keypoints_figure",
    },
    "cgroup.pages": {
        "Pages of a result": "registration_page location_page recognition_page scene_page comparison_page",
        "Any page": "write_page",
    },
    "cgroup.registry": {
        "What is known of each method": "METHOD_INFO MethodInfo MethodOption label_of",
        "Names": "METHODS MethodName PAPER_METHODS PRESETS",
    },
    "cgroup.benchmark.config": {
        "Reading": "read_config parse_config",
        "What a configuration holds": "Config",
    },
    "cgroup.benchmark.run": {"Running": "run"},
    "cgroup.benchmark.tables": {
        "Results": "load load_groups",
        "Means": "aggregate exponents",
    },
    "cgroup.benchmark.report": {"Report": "write_report"},
    "cgroup.benchmark.stats": {"Ranking": "rank_methods"},
    "cgroup.benchmark.pipelines": {
        "Ways to register two clouds": "PIPELINES Clouds Answer",
        "Ways to register many scans": "SCENE_SOLVERS Scans SceneAnswer",
    },
    "cgroup.benchmark.paper.claims": {
        "The paper's claims": "check_claims CLAIMS Outcome OUTCOMES CRITERIA",
    },
}


def write(folder: Path) -> list[str]:
    """Write one page per module, and the table of modules; return the pages."""
    modules = list(GROUPS)
    _write(folder / "modules.txt", _module_table(modules))
    homes: dict[int, str] = {}
    for name in modules:
        module = importlib.import_module(name)
        _write(folder / f"{name}.rst", _page(name, module, homes))
    _drop_pages_of_lost_names(folder, modules)
    return [f"reference/{name}.rst" for name in modules]


def types() -> dict[str, str]:
    """Return the full name of every public class by its short one."""
    found: dict[str, str] = {}
    for name, groups in GROUPS.items():
        module = importlib.import_module(name)
        for each in " ".join(groups.values()).split():
            if inspect.isclass(getattr(module, each)):
                found.setdefault(each, f"{name}.{each}")
    return found


def _drop_pages_of_lost_names(folder: Path, modules: list[str]) -> None:
    """Remove what autosummary wrote for names that are no more; it leaves that lying."""
    wanted = {
        f"{module}.{line.strip()}"
        for module in modules
        for line in (folder / f"{module}.rst").read_text(encoding="utf-8").splitlines()
        if line.startswith("   ")
    }
    lost = [path for path in (folder / "api").glob("*.rst") if path.stem not in wanted]
    for path in (*lost, *(path for path in folder.glob("cgroup*.rst") if path.stem not in modules)):
        path.unlink()


def _summary(module: ModuleType) -> str:
    return (inspect.getdoc(module) or "").split("\n\n")[0].replace("\n", " ")


def _module_table(modules: list[str]) -> str:
    rows = [(f":doc:`{name}`", _summary(importlib.import_module(name))) for name in modules]
    lines = [".. list-table::", "   :widths: 30 70", ""]
    for link, summary in rows:
        lines += [f"   * - {link}", f"     - {summary}"]
    return "\n".join([*lines, "", ".. toctree::", "   :hidden:", "", *(f"   {name}" for name in modules), ""])


def _page(name: str, module: ModuleType, homes: dict[int, str]) -> str:
    """Return a page with the module's docstring, and its names in tables."""
    lines = [name, "=" * len(name), "", f".. automodule:: {name}", "   :no-members:", "   :no-index:", ""]
    lines += [f".. currentmodule:: {name}", ""]
    for title, names in GROUPS[name].items():
        there = {each: getattr(module, each) for each in names.split()}
        home_of = {each: homes.setdefault(id(value), name) for each, value in there.items()}
        own = [each for each in there if home_of[each] == name]
        constants = [
            each for each in there if not inspect.isroutine(there[each]) | inspect.isclass(there[each])
        ]
        lines += [title, "-" * len(title), ""]
        lines += _table([each for each in own if each not in constants], "   :toctree: api")
        lines += _table([f"~{home_of[each]}.{each}" for each in there if each not in (*own, *constants)])
        for each in constants:
            lines += _constant(name, each, there[each], is_own=each in own)
    return "\n".join(lines)


def _constant(module: str, name: str, value: object, *, is_own: bool) -> list[str]:
    """Return a constant with the string below its assignment, which autosummary doesn't find."""
    text = repr(value)
    shown = [f"   :value: {text}"] if len(text) <= _SHORT and not text.startswith("<") else []
    lines = [f".. py:data:: {name}", *shown, *([] if is_own else ["   :no-index:"]), ""]
    if typing.get_origin(value) is not None:
        lines = [f".. py:data:: {name}", *([] if is_own else ["   :no-index:"]), ""]
        lines += [f"   A type: ``{re.sub(_PREFIXES, '', text)}``.", ""]
    return [*lines, *(f"   {line}" for line in _constant_doc(module, name).splitlines()), ""]


def _constant_doc(module: str, name: str) -> str:
    """Return the string below the assignment of a name, wherever in the package it stands."""
    folder = Path(inspect.getfile(importlib.import_module("cgroup"))).parent
    nearest = folder.joinpath(*module.split(".")[1:])
    files = [*sorted(nearest.rglob("*.py")), nearest.with_suffix(".py"), *sorted(folder.rglob("*.py"))]
    for path in filter(Path.is_file, files):
        body = ast.parse(path.read_text(encoding="utf-8")).body
        for statement, following in itertools.pairwise(body):
            targets = getattr(statement, "targets", [getattr(statement, "target", None)])
            is_it = any(isinstance(target, ast.Name) and target.id == name for target in targets)
            if is_it and isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant):
                return inspect.cleandoc(str(following.value.value))
    return ""


def hide_private_parameters(*event: object) -> tuple[str, str | None] | None:
    """Leave what a class keeps for itself out of its signature."""
    signature, returned = typing.cast("tuple[str, str | None]", event[-2:])
    return signature and (re.sub(r", _\w+=[^,)]+", "", signature), returned)


def _table(names: list[str], *options: str) -> list[str]:
    return [".. autosummary::", *options, "", *(f"   {name}" for name in names), ""] if names else []


def _write(path: Path, text: str) -> None:
    """Write a file unless it says the same already, so that Sphinx reads only what has changed."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")
