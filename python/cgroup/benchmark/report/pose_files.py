"""Poses of a run in files for `cgroup evaluate` and the scripts of others: ``SET/METHOD/SCENE/est.log``.

The true poses are beside them in ``SET/truth/SCENE/gt.log``. The pose of a line ``i j`` maps cloud j into i.
"""

from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pandas as pd

from cgroup.io import write_file
from cgroup.io.result_folders import make_folder
from cgroup.io.transforms import format_log
from cgroup.types import FloatArray

TRUTH = "truth"  # folder of the true poses, beside those of the methods
# Data sets whose pairs are named by a scene and the numbers of two clouds, and the order of the clouds
_SOURCE_FIRST = {"3dmatch-test": False, "3dlomatch-test": False, "kitti": True}


def write_poses(out: Path, frames: Iterable[pd.DataFrame]) -> None:
    """Write the poses of pairs whose clouds have numbers."""
    logs: dict[Path, dict[tuple[int, int], FloatArray]] = defaultdict(dict)
    for frame in frames:
        if frame.empty:
            continue
        chosen = (
            frame["dataset"].isin(_SOURCE_FIRST) & (frame["error"] == "") & (frame.get("skipped", "") == "")
        )
        columns = ("set", "method", "dataset", "pair", "pose", "truth")
        for of_set, method, dataset, pair, found, true in zip(
            *(frame.loc[chosen, name] for name in columns), strict=True
        ):
            *_, scene, numbers = pair.split("/")
            first, second = (int(number) for number in numbers.split("-"))
            clouds = (second, first) if _SOURCE_FIRST[dataset] else (first, second)
            folder = out / _name_folder(of_set)
            if found is not None:
                logs[folder / _name_folder(method) / scene / "est.log"][clouds] = found
            if true is not None:
                logs[folder / TRUTH / scene / "gt.log"][clouds] = true
    for path, log in logs.items():
        make_folder(path.parent)
        write_file(path, format_log(np.array(list(log)), np.array(list(log.values()))).encode())


def _name_folder(label: str) -> str:
    return "".join(letter if letter.isalnum() or letter in "-_.+ " else "_" for letter in label)
