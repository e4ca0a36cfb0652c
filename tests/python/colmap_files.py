"""Models of COLMAP, written from the description of their files."""

import struct
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

FOCAL, MIDDLE = 500.0, (320.0, 240.0)


class Views(NamedTuple):
    """Points, and the poses of cameras that see them; two per frame, as of a rig."""

    points: np.ndarray
    frames: list[np.ndarray]
    second_from_first: np.ndarray

    @property
    def poses(self) -> list[np.ndarray]:
        return [pose for frame in self.frames for pose in (frame, self.second_from_first @ frame)]

    def seen(self, pose: np.ndarray) -> np.ndarray:
        inside = self.points @ pose[:3, :3].T + pose[:3, 3]
        return FOCAL * inside[:, :2] / inside[:, 2:] + MIDDLE


def pose_of(turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_rotvec(turn).as_matrix(), shift
    return pose


def make_views(seed: int = 0, points: int = 12, frames: int = 3) -> Views:
    rng = np.random.default_rng(seed)
    poses = [pose_of(rng.normal(size=3), np.array([0, 0, 9.0])) for _ in range(frames)]
    return Views(rng.normal(size=(points, 3)), poses, pose_of(np.array([0, 0.1, 0]), np.array([0.3, 0, 0])))


def numbers_of(pose: np.ndarray) -> list[float]:
    return [*Rotation.from_matrix(pose[:3, :3]).as_quat()[[3, 0, 1, 2]].tolist(), *pose[:3, 3].tolist()]


def write_model(folder: Path, views: Views, kind: str, *, rigs: bool = True) -> Path:
    """Write a model in text or binary, with colours i, i + 1, i + 2 and an error of i / 8."""
    folder.mkdir(parents=True)
    contents = (_texts if kind == "txt" else _binaries)(views)
    for name, content in contents.items():
        if rigs or name not in ("rigs", "frames"):
            (folder / f"{name}.{kind}").write_bytes(content)
    return folder


def _binaries(views: Views) -> dict[str, bytes]:
    count = len(views.points)
    cameras = struct.pack("<Q", 2)
    cameras += b"".join(struct.pack("<IiQQ4d", i, 1, 640, 480, FOCAL, FOCAL, *MIDDLE) for i in (1, 2))
    images = struct.pack("<Q", len(views.poses))
    for row, pose in enumerate(views.poses):
        images += (
            struct.pack("<I7dI", row + 1, *numbers_of(pose), row % 2 + 1) + f"{row}.png".encode() + b"\0"
        )
        images += struct.pack("<Q", count)
        images += b"".join(struct.pack("<2dq", *seen, i) for i, seen in enumerate(views.seen(pose).tolist()))
    points = struct.pack("<Q", count)
    for i, point in enumerate(views.points.tolist()):
        points += struct.pack(
            "<Q3d3BdQ", i, *point, i % 250, i % 250 + 1, i % 250 + 2, i / 8, len(views.poses)
        )
        points += b"".join(struct.pack("<II", row + 1, i) for row in range(len(views.poses)))
    rigs = struct.pack("<QIIiIiIB7d", 1, 1, 2, 0, 1, 0, 2, 1, *numbers_of(views.second_from_first))
    frames = struct.pack("<Q", len(views.frames))
    for row, pose in enumerate(views.frames):
        frames += struct.pack("<II7dI", row + 1, 1, *numbers_of(pose), 2)
        frames += struct.pack("<iIQiIQ", 0, 1, 2 * row + 1, 0, 2, 2 * row + 2)
    return {"cameras": cameras, "images": images, "points3D": points, "rigs": rigs, "frames": frames}


def _texts(views: Views) -> dict[str, bytes]:
    def line(*words: object) -> str:
        return " ".join(repr(word) if isinstance(word, float) else str(word) for word in words) + "\n"

    images, frames, points = "# images\n", "# frames\n", "# points\n\n"
    for row, pose in enumerate(views.poses):
        images += line(row + 1, *numbers_of(pose), row % 2 + 1, f"{row}.png")
        seen = [(*place, i) for i, place in enumerate(views.seen(pose).tolist())] if row else []
        images += line(*(word for one in seen for word in one))
    for row, pose in enumerate(views.frames):
        camera = ("CAMERA", 1, 2 * row + 1, "CAMERA", 2, 2 * row + 2)
        frames += line(row + 1, 1, *numbers_of(pose), 2, *camera)
    for i, point in enumerate(views.points.tolist()):
        track = [word for row in range(1, len(views.poses)) for word in (row + 1, i)]
        points += line(i, *point, i % 250, i % 250 + 1, i % 250 + 2, i / 8, *track)
    rig = line(1, 2, "CAMERA", 1, "CAMERA", 2, 1, *numbers_of(views.second_from_first))
    rig += line(2, 2, "CAMERA", 3, "IMU", 1, 0)
    cameras = "".join(line(i, "PINHOLE", 640, 480, FOCAL, FOCAL, *MIDDLE) for i in (1, 2))
    texts = {"cameras": cameras, "images": images, "points3D": points, "rigs": rig, "frames": frames}
    return {name: text.encode() for name, text in texts.items()}
