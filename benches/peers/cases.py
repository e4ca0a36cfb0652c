"""Seeded synthetic correspondence sets, written once for Python (.npz) and once for C++ (.bin).

Lengths are in pr: the mean nearest-neighbour distance of the surface is 1. A case holds

- ``src``, ``tgt`` (n,3) float32: matched points;
- ``lrf_src``, ``lrf_tgt`` (n,3,3) float32: local reference frames, rows are the axes;
- ``sim``, ``ratio`` (n,) float32: descriptor similarity (higher is better) and d1/d2 (lower is better);
- ``gt`` (n,) uint8: 1 where ``|R p + t - p'|`` is at most `INLIER_RESIDUAL`;
- ``R``, ``t``, ``pr`` float64: the true pose, source to target, and the unit.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

Array: TypeAlias = "NDArray[np.float64]"
Case: TypeAlias = "dict[str, NDArray]"

SEED = 20240711
INLIER_RESIDUAL = 5.0
INLIER_NOISE = 0.5  # per axis
FRAME_NOISE = np.deg2rad(5.0)
LEAST_INLIERS = 3

SURFACE_POINTS = 60_000
POINTS_AT_UNIT = 12_000
"""A scan of so many points resolves the object at 1 pr; matches are drawn from a finer sampling of it."""

BUMPS = ((12, 4.0, 0.22), (60, 30.0, 0.07), (300, 200.0, 0.025))
"""Number, sharpness and height of the bumps, from coarse to fine."""

MAGIC = b"CGC1"
FLOAT_FIELDS = ("src", "tgt", "lrf_src", "lrf_tgt", "sim", "ratio")
POSE_FIELDS = ("R", "t", "pr")


def case_name(n: int, share: float) -> str:
    """File name of a case, without its ending."""
    return f"n{n:06d}_inliers{round(share * 1000):03d}"


def ensure_case(folder: Path, n: int, share: float) -> Path:
    """Write a case unless it is there; the path of its .npz file, beside which the .bin file lies."""
    path = folder / f"{case_name(n, share)}.npz"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        case = make_case(n, share)
        write_bin(path.with_suffix(".bin"), case)
        partial = path.with_suffix(".partial")
        with partial.open("wb") as file:  # savez appends .npz to names
            np.savez(file, **case)
        partial.replace(path)
    return path


def load_case(path: Path) -> Case:
    """Read a case from its .npz file."""
    with np.load(path) as file:
        return dict(file)


def write_bin(path: Path, case: Case) -> None:
    """Write the layout that `pcl_peers.cpp` reads.

    Little-endian: magic, uint32 n, the float32 fields in the order of `FLOAT_FIELDS`, uint8 gt, then R (by
    rows), t and pr in float64.
    """
    with path.open("wb") as file:
        file.write(MAGIC + np.array(len(case["src"]), "<u4").tobytes())
        for key in FLOAT_FIELDS:
            file.write(np.ascontiguousarray(case[key], "<f4").tobytes())
        file.write(case["gt"].tobytes())
        for key in POSE_FIELDS:
            file.write(np.ascontiguousarray(case[key], "<f8").tobytes())


def read_bin(path: Path) -> Case:
    """Read what `write_bin` wrote."""
    data = path.read_bytes()
    if data[:4] != MAGIC:
        message = f"{path}: not a case"
        raise ValueError(message)
    n = int(np.frombuffer(data, "<u4", 1, 4)[0])
    shapes = {"src": (n, 3), "tgt": (n, 3), "lrf_src": (n, 3, 3), "lrf_tgt": (n, 3, 3), "sim": (n,)}
    shapes |= {"ratio": (n,), "gt": (n,), "R": (3, 3), "t": (3,), "pr": ()}
    case, offset = {}, 8
    for key, shape in shapes.items():
        kind = np.dtype("u1" if key == "gt" else "<f8" if key in POSE_FIELDS else "<f4")
        count = int(np.prod(shape))
        case[key] = np.frombuffer(data, kind, count, offset).reshape(shape)
        offset += count * kind.itemsize
    return case


def make_case(n: int, share: float) -> Case:
    """Draw n matches of which a share is right; the same arrays for the same arguments."""
    surface, normals = surface_for(n)
    rng = np.random.default_rng([SEED, n, round(share * 1e4)])
    rotation = random_rotation(rng)
    translation = rng.uniform(-100, 100, size=3)
    right = max(LEAST_INLIERS, round(n * share))

    chosen = rng.choice(len(surface), size=n, replace=False)
    moved = surface[chosen] @ rotation.T + translation
    partners = chosen.copy()
    target = moved + rng.normal(scale=INLIER_NOISE, size=(n, 3))
    wrong = np.arange(right, n)
    while len(wrong):  # again where a random partner happens to be right
        partners[wrong] = rng.integers(0, len(surface), size=len(wrong))
        noise = rng.normal(scale=INLIER_NOISE, size=(len(wrong), 3))
        target[wrong] = surface[partners[wrong]] @ rotation.T + translation + noise
        wrong = wrong[np.linalg.norm(target[wrong] - moved[wrong], axis=1) <= INLIER_RESIDUAL]
    correct = np.linalg.norm(target - moved, axis=1) <= INLIER_RESIDUAL

    source_frames = frames(normals[chosen], rng)
    target_frames = frames(normals[partners] @ rotation.T, rng)
    target_frames[:right] = wobbled(source_frames[:right] @ rotation.T, rng)
    similarity = np.where(correct, rng.beta(6, 3, n), rng.beta(4, 4, n))
    ratio = np.where(correct, rng.beta(6, 2.5, n), rng.beta(18, 1.8, n))

    order = rng.permutation(n)
    case = {
        "src": surface[chosen],
        "tgt": target,
        "lrf_src": source_frames,
        "lrf_tgt": target_frames,
        "sim": similarity,
        "ratio": ratio,
    }
    return {
        **{key: value[order].astype("<f4") for key, value in case.items()},
        "gt": correct[order].astype("u1"),
        "R": rotation,
        "t": translation,
        "pr": np.array(1.0),
    }


def surface_for(n: int) -> tuple[Array, Array]:
    """Points and normals of a sampling with at least n points."""
    return _surface(SURFACE_POINTS * max(1, -(-n // SURFACE_POINTS)))


@functools.lru_cache(maxsize=2)
def _surface(count: int) -> tuple[Array, Array]:
    points = bumpy_surface(count)
    return points, pca_normals(points)


def bumpy_surface(count: int) -> Array:
    """Sample a star-shaped closed surface whose normals, curvature and point spacing all vary.

    Directions are a golden-angle lattice with jitter; the radius is a sum of smooth bumps at three scales,
    which do not depend on the count: more points are a finer sampling of one shape.
    """
    from scipy.spatial import cKDTree  # noqa: PLC0415 - only where cases are made

    rng = np.random.default_rng([SEED, count])
    i = np.arange(count) + 0.5
    z = 1 - 2 * i / count
    phi = i * np.pi * (1 + 5**0.5)
    ring = np.sqrt(1 - z * z)
    directions = np.stack([ring * np.cos(phi), ring * np.sin(phi), z], axis=1)
    directions += rng.normal(scale=0.15 * np.sqrt(4 * np.pi / count), size=directions.shape)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)

    radius = np.ones(count)
    bump_rng = np.random.default_rng([SEED, 0])
    for number, sharpness, height in BUMPS:
        centers = bump_rng.normal(size=(number, 3))
        centers /= np.linalg.norm(centers, axis=1, keepdims=True)
        heights = height * bump_rng.uniform(-1, 1, size=number)
        for center, amplitude in zip(centers, heights, strict=True):
            radius += amplitude * np.exp(sharpness * (directions @ center - 1))
    points = directions * radius[:, None] * np.array([1.0, 0.85, 0.7])
    spacing = cKDTree(points).query(points, k=2)[0][:, 1].mean()
    return points / (spacing * np.sqrt(count / POINTS_AT_UNIT))


def pca_normals(points: Array, neighbors: int = 16) -> Array:
    """Fit a plane to the neighbours of each point; its normal, outwards."""
    from scipy.spatial import cKDTree  # noqa: PLC0415 - only where cases are made

    patches = points[cKDTree(points).query(points, k=neighbors)[1]]
    patches = patches - patches.mean(axis=1, keepdims=True)
    normals = np.linalg.eigh(np.einsum("nki,nkj->nij", patches, patches))[1][:, :, 0]
    outwards = np.einsum("ni,ni->n", normals, points - points.mean(axis=0))
    return normals * np.where(outwards < 0, -1.0, 1.0)[:, None]


def frames(normals: Array, rng: np.random.Generator) -> Array:
    """Frames whose z axis is the normal and whose x axis is random."""
    x = np.cross(normals, rng.normal(size=normals.shape))
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(normals, x), normals], axis=1)


def wobbled(axes: Array, rng: np.random.Generator) -> Array:
    """Turn each frame a little, about an axis of its own."""
    about = rng.normal(size=(len(axes), 3))
    about /= np.linalg.norm(about, axis=1, keepdims=True)
    turns = axis_angle(about, np.abs(rng.normal(scale=FRAME_NOISE, size=len(axes))))
    return np.einsum("nai,nji->naj", axes, turns)


def axis_angle(axes: Array, angles: Array) -> Array:
    """Rotation matrices by Rodrigues' formula."""
    cross = np.zeros((len(axes), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2] = -axes[:, 2], axes[:, 1]
    cross[:, 1, 0], cross[:, 1, 2] = axes[:, 2], -axes[:, 0]
    cross[:, 2, 0], cross[:, 2, 1] = -axes[:, 1], axes[:, 0]
    sine, cosine = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return np.eye(3) + sine * cross + (1 - cosine) * (cross @ cross)


def random_rotation(rng: np.random.Generator) -> Array:
    """Uniform rotation, from a random unit quaternion."""
    quaternion = rng.normal(size=4)
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
