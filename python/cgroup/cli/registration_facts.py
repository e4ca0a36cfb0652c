"""Registrations in documents and as printed facts."""

import math
from collections.abc import Sequence

import numpy as np

from cgroup._show.words import say_direction
from cgroup.cli.documents import Document, fields
from cgroup.cli.terminal import show_length
from cgroup.evaluation import PROTOCOLS, alignment_error, rotation_error, translation_error
from cgroup.evaluation.ground_truth import OVERLAP_WITHIN
from cgroup.registration import Registration
from cgroup.rigid import apply, invert
from cgroup.rigid.transforms import axis_of, split_scale
from cgroup.types import FloatArray, PointCloud

Clouds = tuple[PointCloud, PointCloud]

_RIGHT = PROTOCOLS["5deg+5pr"]  # limits of a right pose
_LEAST_TURN = 0.005  # degrees below which a rotation is not printed


def registration_results(
    done: Registration, clouds: Clouds | None = None, true_pose: FloatArray | None = None
) -> Document:
    """Return the part of a document about a registration; a true pose needs the clouds."""
    seconds: dict[str, float] = {}  # by stage, source and target together
    for name, value in done.seconds.items():
        stage = name.removeprefix("source ").removeprefix("target ")
        seconds[stage] = seconds.get(stage, 0.0) + value
    degrees, length = done.deviations
    results: Document = {
        **fields(done, "ok", "T_target_source", "scale", "scale_deviation", "probability"),
        **fields(done, "decoy_probability", "fitness", "target_fitness", "inlier_rmse"),
        "matches": len(done.correspondences),
        "selected": done.grouping.size,
        **fields(done, "voxel", "resolution", "covariance"),
        "deviation_deg": degrees,
        "deviation": length,
        **fields(done, "open_motion", "alternatives", "notes"),
        "seconds": seconds,
    }
    if clouds is not None and true_pose is not None:
        results["truth"] = _judge(done, clouds, true_pose)
    return results


def _judge(done: Registration, clouds: Clouds, true_pose: FloatArray) -> Document:
    pose, pr = done.T_target_source, done.resolution

    def measure(truth: FloatArray) -> tuple[float, float, float, bool | None]:
        turn, shift = rotation_error(pose, truth), translation_error(pose, truth)
        source, target = (cloud.points for cloud in clouds)
        displacement = alignment_error(source, target, pose, truth, tolerance=OVERLAP_WITHIN * pr)
        return turn, shift, displacement, _RIGHT.judge(math.nan, turn, shift, displacement / pr)

    turn, shift, displacement, right = measure(true_pose)
    assert _RIGHT.max_rmse is not None  # noqa: S101 - of this one
    return {
        "right": right,
        "rotation_error_deg": turn,
        "translation_error": shift,
        "displacement": displacement,
        "right_if_inverted": bool(not right and measure(invert(true_pose))[-1]),
        "limits": {"max_rotation_deg": _RIGHT.max_rotation, "max_displacement": _RIGHT.max_rmse * pr},
    }


def placement_facts(done: Document, middle: Sequence[float]) -> list[tuple[str, str]]:
    """Describe pose, probability, overlap and errors of a registration; `middle` is the source's."""
    scale, pose = done["scale"], np.array(done["T_target_source"])
    pose = pose if scale == 1.0 else split_scale(pose)[1]
    center = scale * np.array([middle])
    angle, way = rotation_error(pose, np.eye(4)), float(np.linalg.norm(apply(pose, center) - center))
    turned = f"rotated by {angle:.3g} degrees about the axis {say_direction(axis_of(pose))}"
    turned = turned if angle > _LEAST_TURN else "not rotated"
    moved = f"its middle moved by {show_length(way)} (in the files' unit, as all lengths)"
    facts = [("pose", f"{turned}, {moved}")]
    if scale != 1.0:
        known = done["scale_deviation"]
        deviation = "" if known is None else f", +- {100 * known:.1g} %"
        facts.append(("scale", f"{scale:.5g} (the source's unit in the target's){deviation}"))
    chance = "more than 0.999" if done["probability"] > 0.9995 else f"{done['probability']:.3f}"
    shares = [f"{100 * done[name]:.0f} %" for name in ("fitness", "target_fitness")]
    facts += [
        ("probability", f"{chance} that the pose is correct"),
        ("overlap", f"{shares[0]} of the source overlaps the target, {shares[1]} of the target the source"),
    ]
    if done["inlier_rmse"] is not None:
        residual = f"{show_length(done['inlier_rmse'])} in the overlap (root mean square)"
        facts.append(("residual", residual))
    if done["deviation"] is not None:
        deviations = f"{done['deviation_deg']:.2g} degrees, {show_length(done['deviation'], 2)} at the middle"
        deviations += " (standard deviation from noise and shape; other errors add to it)"
        facts.append(("deviation", deviations))
    if "truth" in done:
        facts.append(("truth", describe_truth(done)))
    return facts + [("note", note) for note in done["notes"]]


def describe_truth(done: Document) -> str:
    """Describe the errors of a pose against the true one, and the verdict."""
    truth, limits = done["truth"], done["truth"]["limits"]
    turn, shift = truth["rotation_error_deg"], truth["translation_error"]
    voxels = f"{show_length(shift / done['voxel'], 2)} voxels"
    off = f"{turn:.3g} degrees and {show_length(shift)} ({voxels}) from the true pose"
    inverse = "; right under the inverse of this truth" if truth["right_if_inverted"] else ""
    if truth["right"] is None:
        return f"{off}, under which no point of the source overlaps the target{inverse}"
    return (
        f"{'right' if truth['right'] else 'wrong'}: {off}, mean displacement in the overlap "
        f"{show_length(truth['displacement'])} (limits: {limits['max_rotation_deg']:g} degrees, "
        f"displacement {show_length(limits['max_displacement'])}){inverse}"
    )
