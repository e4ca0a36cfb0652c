"""The table of a front end: how clouds become matches, where that differs from the default."""

from __future__ import annotations

import json
from typing import Literal

from cgroup.benchmark.config.table import Positive, Table


class FrontEntry(Table):
    """What an experiment changes of the paper's front end, which matches clouds.

    Attributes
    ----------
    matching : {"nearest", "mutual"}
        Every source keypoint with the target keypoint of nearest descriptor; or only the matches whose
        keypoints are each other's nearest.
    normals : {"mesh", "pca"}, optional
        Vertex normals of the mesh, or normals of fitted planes; what the data set says by default. A cloud
        without faces gets "pca".
    frames : {"shot", "toldi"}
        Local reference frames that the methods are given; descriptors stay as they are.
    harris_radius : float, optional
        Of Harris 3D in pr, for its normals, its response and its non-maximum suppression; 2.7 by default.
    iss_radii : (float, float), optional
        Of ISS in pr: of the scatter and of the non-maximum suppression; 2.7 and 1.8 by default.
    resolution : {"pair", "undisturbed", "source", "target"}
        The unit pr of all lengths: mean of both clouds' resolutions as they are matched, or before the
        nuisance; or that of one cloud.
    similarity : {"unit", "raw"}
        Whether the similarity of two descriptors is taken after scaling them to unit length.

    Raises
    ------
    pydantic.ValidationError
        For an unknown key, or a value of another type or out of range.

    Examples
    --------
    >>> from cgroup.benchmark.config import ExperimentEntry
    >>> entry = ExperimentEntry(
    ...     id="noise / mutual",
    ...     dataset="standin-full",
    ...     nuisance="noise",
    ...     levels=[0.1, 0.3],
    ...     front={"matching": "mutual"},
    ... )
    >>> entry.front.matching, entry.front.resolution
    ('mutual', 'pair')
    """

    matching: Literal["nearest", "mutual"] = "nearest"
    normals: Literal["mesh", "pca"] | None = None
    frames: Literal["shot", "toldi"] = "shot"
    harris_radius: Positive | None = None
    iss_radii: tuple[Positive, Positive] | None = None
    resolution: Literal["pair", "undisturbed", "source", "target"] = "pair"
    similarity: Literal["unit", "raw"] = "unit"

    def changes(self, detector: str, nuisance: str) -> str:
        """Return what differs from the default where a detector and a nuisance are used.

        Radii of another detector change nothing, nor does the resolution before a nuisance where there is
        none: such cases are those of the default.

        Parameters
        ----------
        detector : {"h3d", "iss"}
            Which is used.
        nuisance : str
            Which is used; empty for none.

        Returns
        -------
        str
            JSON object with sorted keys; empty where nothing differs.

        Examples
        --------
        >>> from cgroup.benchmark.config import FrontEntry
        >>> front = FrontEntry(harris_radius=3, matching="mutual")
        >>> front.changes("h3d", "noise")
        '{"harris_radius": 3.0, "matching": "mutual"}'
        >>> front.changes("iss", "noise")
        '{"matching": "mutual"}'
        """
        without = {"iss_radii" if detector == "h3d" else "harris_radius"}
        if not nuisance and self.resolution == "undisturbed":
            without.add("resolution")
        changed = self.model_dump(mode="json", exclude=without, exclude_defaults=True)
        return json.dumps(changed, sort_keys=True) if changed else ""
