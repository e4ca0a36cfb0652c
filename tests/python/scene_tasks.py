"""What tests have workers call with scans; log and gate are files in a folder."""

import os
import threading
from pathlib import Path

import numpy as np

from cgroup.errors import InputError
from cgroup.registration import PreparedScan
from cgroup.scenes.links import Link, link


def count_calls(folder: Path) -> int:
    return len((folder / "log").read_text().splitlines()) if (folder / "log").exists() else 0


def log(folder: str) -> None:
    with Path(folder, "log").open("a") as file:
        file.write(f"{os.getpid()}\n")


def gated(source: PreparedScan, target: PreparedScan, folder: str) -> Link | None:
    """Link two scans once a file called "open" is there."""
    log(folder)
    while not Path(folder, "open").exists():
        threading.Event().wait(0.01)
    return link(source, target, None, "normal")


def without_link(_source: PreparedScan, _target: PreparedScan, folder: str, *_: object) -> None:
    log(folder)


def odd_link(_source: PreparedScan, _target: PreparedScan, folder: str) -> Link:
    """Numbers that text may lose."""
    log(folder)
    odd = np.array([0.1, -0.0, 5e-324, np.inf, -np.inf, np.nan])
    return Link(np.tile(odd[:4], (2, 4, 1)), odd, np.tile(odd, (6, 1)), 1 / 3, float("nan"))


def count_voxels(*scans_and_folder: PreparedScan | str) -> int:
    *scans, folder = scans_and_folder
    log(str(folder))
    return sum(len(scan) for scan in scans)


def deadly(_source: PreparedScan, _target: PreparedScan) -> None:
    os._exit(9)


def refuse(_source: PreparedScan, _target: PreparedScan) -> None:
    raise InputError("voxel", 3, "give 4")
