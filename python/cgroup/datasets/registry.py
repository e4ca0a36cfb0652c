"""Data sets by name."""

from collections.abc import Callable
from pathlib import Path

from cgroup._checks.calls import load_plugin
from cgroup._checks.values import guess_word, refuse_word
from cgroup.datasets.b3r import B3R, B3RClean
from cgroup.datasets.base import Dataset
from cgroup.datasets.demos import FGR, CorrespondenceFiles, FGRClouds, LidarScans, OneToThreeFiles
from cgroup.datasets.generated.stones import StandinClutter, StandinFull, StandinViews
from cgroup.datasets.generated.worlds import RepeatingWorlds, Worlds
from cgroup.datasets.generated_matches import GeneratedMatches
from cgroup.datasets.kitti import KITTI
from cgroup.datasets.threedmatch import ThreeDLoMatchTest, ThreeDMatch, ThreeDMatchTest
from cgroup.datasets.u3or import U3OR
from cgroup.datasets.views import U3M, StanfordViews
from cgroup.errors import InputError

DATASETS: dict[str, Callable[[Path | None], Dataset]] = {
    kind.name: kind
    for kind in (
        B3R, B3RClean, U3OR, U3M, StanfordViews, ThreeDMatch, ThreeDMatchTest, ThreeDLoMatchTest,
        LidarScans, KITTI, FGR, FGRClouds, CorrespondenceFiles, OneToThreeFiles, GeneratedMatches,
        StandinFull, StandinClutter, StandinViews, Worlds, RepeatingWorlds,
    )
}  # fmt: skip
"""Built-in data sets; each is opened with the data root."""


def open_dataset(name: str, root: Path | None = None) -> Dataset:
    """Open a data set.

    Parameters
    ----------
    name : str
        One of `DATASETS`; or "module:attribute" for one from outside the package: a class, or any callable,
        that takes the data root and returns a `Dataset`.
    root : Path, optional
        Folder that holds the data sets' folders; by default that in the environment variable ``CGROUP_DATA``.
        The data sets named standin-... and generated-matches need none.

    Returns
    -------
    Dataset
        Ready to load pairs from.

    Examples
    --------
    >>> from cgroup.datasets import open_dataset
    >>> stones = open_dataset("standin-full")
    >>> stones.title, len(stones.pair_names())
    ('Stones, full to full', 6)
    """
    factory = load_plugin("dataset", name) if ":" in name else DATASETS.get(name)
    if factory is None:
        refuse_word("dataset", name, DATASETS, guess_word(name, DATASETS), ", or give module:attribute")
    dataset = factory(root)
    if not isinstance(dataset, Dataset):
        message = f"dataset: {name!r} made a {type(dataset).__name__}; it has to be a cgroup.datasets.Dataset"
        raise InputError(message)
    return dataset
