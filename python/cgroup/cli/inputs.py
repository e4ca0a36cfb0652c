"""Clouds as commands read them, and what is said of them."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cgroup import io
from cgroup.cli.terminal import print_facts, show_stages

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from cgroup.types import PointCloud

Facts = dict[str, Any]


def read_both(source: Path, target: Path) -> tuple[PointCloud, PointCloud]:
    """Read two clouds."""
    with show_stages() as begin:
        begin(f"reading {source.name}")
        first = io.read_cloud(source)
        begin(f"reading {target.name}")
        return first, io.read_cloud(target)


def describe_cloud(role: str, file: Path, cloud: PointCloud) -> Facts:
    """List what a document says of a cloud."""
    return {
        "role": role,
        "file": str(file),
        "points": len(cloud),
        "dropped": cloud.dropped,
        "centroid": cloud.points.mean(axis=0),
    }


def describe_pair(files: tuple[Path, Path], clouds: tuple[PointCloud, PointCloud]) -> list[Facts]:
    """List what a document says of source and target."""
    roles = ("source", "target")
    return [describe_cloud(*one) for one in zip(roles, files, clouds, strict=True)]


def print_clouds(inputs: Iterable[Mapping[str, Any]]) -> None:
    """Print how many points each cloud of a document has."""
    for cloud in inputs:
        dropped = cloud["dropped"]
        left_out = f", {dropped} more without finite coordinates left out" if dropped else ""
        print_facts((cloud["role"], f"{cloud['file']}: {cloud['points']} points{left_out}"))


def digest(file: str) -> str | None:
    """Return the SHA-256 of a file, None where it isn't there any more."""
    try:
        return hashlib.sha256(Path(file).read_bytes()).hexdigest()
    except (OSError, ValueError):
        return None
