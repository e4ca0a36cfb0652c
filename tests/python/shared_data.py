"""Where the real data is that some tests use; it isn't part of the repository."""

import os
from pathlib import Path

import pytest

SHARED = Path(os.environ.get("CGROUP_SHARED", Path(__file__).parents[2] / ".." / "shared"))
DATA = Path(os.environ.get("CGROUP_DATA", SHARED / "data"))


def shared_file(name: str) -> Path:
    """Path of a shared file; the test is skipped where it isn't there."""
    path = SHARED / name
    if not path.exists():
        pytest.skip(f"{name} isn't in {SHARED}; set CGROUP_SHARED to the folder with the data")
    return path


def data_folder(dataset: str) -> Path:
    """Data root that holds the folder of a data set; the test is skipped where it isn't there."""
    root = Path(os.environ.get("CGROUP_DATA", SHARED / "data"))
    if not (root / dataset).is_dir():
        pytest.skip(
            f"no folder {dataset!r} in {root}; set CGROUP_DATA to the folder that holds the data sets"
        )
    return root
