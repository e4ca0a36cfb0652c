"""Clouds that commands read, and their descriptions in documents."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cgroup import io
from cgroup.cli.show.terminal import show_stages
from cgroup.io.attributes import unkept_attributes
from cgroup.types import PointCloud, RealArray


def read_cloud(file: Path, begin: Callable[[str], object]) -> PointCloud:
    """Read a cloud, and show that stage."""
    begin(f"reading {file.name}")
    return io.read_cloud(file)


def read_both(source: Path, target: Path) -> tuple[PointCloud, PointCloud]:
    """Read two clouds."""
    with show_stages() as begin:
        return read_cloud(source, begin), read_cloud(target, begin)


def describe_cloud(role: str, file: Path, cloud: PointCloud) -> dict[str, Any]:
    """Return the description of a cloud for a document."""
    return {
        "role": role,
        "file": file,
        "points": len(cloud),
        "dropped": cloud.dropped,
        "centroid": cloud.points.mean(axis=0),
        "extent": extent_of(cloud.points),
        "not_kept": unkept_attributes(file),
    }


def extent_of(points: RealArray) -> float:
    """Return the diagonal of the box around points."""
    return float(np.linalg.norm(np.ptp(points.astype(np.float64, copy=False), axis=0)))


def describe_pair(files: tuple[Path, Path], clouds: tuple[PointCloud, PointCloud]) -> list[dict[str, Any]]:
    """Return the descriptions of source and target for a document."""
    return [describe_cloud(*one) for one in zip(("source", "target"), files, clouds, strict=True)]
