"""U3OR with clouds of the paper's size: surfaces resampled at less than half the spacing."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from cgroup import features
from cgroup.datasets.cache import cached
from cgroup.datasets.generated.scanner import Mesh
from cgroup.datasets.subdivision import Surface, longest_edges, subdivide
from cgroup.datasets.u3or import U3OR
from cgroup.io import read_cloud
from cgroup.types import PointCloud

if TYPE_CHECKING:
    from pathlib import Path

    from cgroup.datasets.base import MatchingPair, Origin
    from cgroup.types import FloatArray

SCANNER_SPACING = 0.33
"""Mean distance of neighbouring points in the real scan of scene rs1 (289,541 points), in mm."""

SPACING = 0.6
"""Mean distance of neighbouring points in models and scenes, in mm."""

VOXEL = 0.87
"""Edge length in mm of the cells whose means, on these surfaces, lie `SPACING` from each other."""

PIXEL = 0.9e-3
"""Angle between two rays of the simulated scanner in radians: points `SPACING` apart where the toys are."""

NOISE = 0.013
"""Standard deviation in mm of what models and simulated scenes have of the scanner's noise.

As much as the real scan scatters where it is smoothest: in a tenth of its places, points lie less than this
off the quadric through their surroundings of 1.6 mm. Without it flat parts are flat to the last digit, the
response of H3D ties there, and all of their points are keypoints: 7,600 of chef's 10,800.
"""

_FROM_PCL = 1000 * np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""From the frame of the scan in PCD, in metres, into the scanner's in mm."""

_FINEST = 0.75  # spacings, of the triangles whose corners are averaged in cells
_FACET = 3.0  # spacings, of the triangles that the scanner sees; .002 to .008 mm off the patch (medians)
_MOST_TRIANGLES = 99  # percent of the triangles that keep these limits; few are larger
_MAKING = 1  # to be raised when models or scenes change, so that the cache is made anew
_SETTINGS = [str(value) for value in (_MAKING, SPACING, VOXEL, PIXEL, NOISE)]


class U3ORDense(U3OR):
    """The pairs of `U3OR`, with models and scenes of some hundred thousand points, `SPACING` apart.

    The models of U3OR in circulation are simplified, to points 0.8 to 1.7 mm apart, which leaves a pair some
    560 matches where the paper's have thousands. Here a model is the smooth surface through its vertices and
    across their normals (curved PN triangles, `cgroup.datasets.subdivision`), sampled evenly and given
    `NOISE`: 68,000 to 176,000 points, where the owners' have 135,000 to 185,000. A simulated scene is these
    surfaces as posed, seen by the scanner in software with narrower pixels and the same noise. Scene rs1 is
    the real scan in full resolution, thinned, where ``pcl/rs1.pcd`` is there. A pair gets some 3,400 matches;
    it would get more than 10,000 at `SCANNER_SPACING`.

    What a model shows below the length of its edges, 3 mm for chef and T-rex and 1.5 mm for the others, is
    interpolated and not measured. So all pairs are *semi-synthetic*, those of scene rs1 too. True poses and
    the facts ``clutter`` and ``occlusion`` are those of `U3OR`: levels hold the same pairs. Whoever has the
    owners' models and scans needs `U3OR` only. Models and simulated scenes are kept in the cache.
    """

    name, title = "u3or-dense", "U3OR sampled densely"

    def origin_of(self, name: str) -> Origin:
        """Return "semi-synthetic": every model is interpolated."""
        self.check_name(name)
        return self.origin

    def load(self, name: str) -> MatchingPair:
        """Load the pair of `U3OR`, and put the dense clouds in the place of its own."""
        pair = super().load(name)
        scene, model = self._entry(name)
        source, target = self.dense_model(model), self.dense_scene(scene)
        return replace(pair, source=source, target=target, normals="given")

    def dense_model(self, name: str) -> PointCloud:
        """Sample the smooth surface of a model, with its normals."""
        if name not in self._dense_models:
            key = [*_SETTINGS, self._locate(self._model_places(name)).read_bytes()]
            arrays = cached("u3or-dense", key, lambda: self._sample(name))
            self._dense_models[name] = PointCloud(arrays["points"], arrays["normals"])
        return self._dense_models[name]

    def dense_scene(self, number: int) -> PointCloud:
        """Read the scan of a scene in full resolution and thin it; or look at the posed surfaces."""
        path = self._full_scans.get(number)
        if path is not None:
            scan = read_cloud(path).points @ _FROM_PCL.T
            return PointCloud(features.voxel_downsample(scan, VOXEL).points)
        key = [*_SETTINGS, str(number), *self._content(number)]
        return PointCloud(cached("u3or-dense", key, lambda: self._look_closely(number))["points"])

    @cached_property
    def _dense_models(self) -> dict[str, PointCloud]:
        return {}  # read once: each is in many pairs

    @cached_property
    def _full_scans(self) -> dict[int, Path]:
        """Scans in full resolution, by the number of the scene."""
        found = {path.stem.removeprefix("rs"): path for path in sorted(self._folder.rglob("rs*.pcd"))}
        return {int(number): path for number, path in found.items() if number.isdecimal()}

    def _has_scan(self, number: int) -> bool:
        # The facts are computed on the scene of U3OR, which needs no model only where it is a scan as well.
        return super()._has_scan(number) and number in self._full_scans

    def _look_closely(self, number: int) -> dict[str, FloatArray]:
        image = self._look(number, self._facets, PIXEL)
        noise = np.random.default_rng(number).normal(0, NOISE, len(image.ranges()))
        return {"points": image.points(noise)}

    def _facets(self, model: str) -> Mesh:
        """Triangles of a few pixels on the smooth surface of a model."""
        fine = self._refine(model, _FACET * SPACING)
        return Mesh(fine.points, fine.faces)

    def _sample(self, model: str) -> dict[str, FloatArray]:
        """Points in even distances on the smooth surface of a model, and its normals there."""
        fine = self._refine(model, _FINEST * SPACING)
        cells = features.voxel_downsample(fine.points, VOXEL, normals=fine.normals)
        assert cells.normals is not None  # noqa: S101 - they are given
        noise = np.random.default_rng(0).normal(0, NOISE, (len(cells), 1))
        return {"points": cells.points + noise * np.nan_to_num(cells.normals), "normals": cells.normals}

    def _refine(self, model: str, edge: float) -> Surface:
        """Subdivide a model until nearly all edges are that short."""
        mesh = self._mesh(model)
        normals = features.mesh_normals(mesh.vertices, mesh.faces)
        surface = Surface(mesh.vertices, mesh.faces, normals)
        longest = np.percentile(longest_edges(surface), _MOST_TRIANGLES)
        return subdivide(surface, max(1, int(np.ceil(longest / edge))))
