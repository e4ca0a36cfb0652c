"""What a parser finds in a file of a cloud."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cgroup.types import FloatArray, IndexArray


class CloudContent(NamedTuple):
    """What a file holds, before points that aren't finite are left out."""

    points: FloatArray
    normals: FloatArray | None = None
    faces: IndexArray | None = None
    colors: NDArray[np.uint8] | None = None
    viewpoint: FloatArray | None = None


def join(parts: Sequence[CloudContent]) -> CloudContent:
    """Join parts of a file: normals and colours if all have them, the viewpoint if it is the same."""
    if not parts:
        return CloudContent(np.empty((0, 3)))
    starts = np.cumsum([0, *(len(part.points) for part in parts)])
    meshes = [
        part.faces + start for part, start in zip(parts, starts[:-1], strict=True) if part.faces is not None
    ]
    normals = [part.normals for part in parts if part.normals is not None]
    colors = [part.colors for part in parts if part.colors is not None]
    places = [part.viewpoint for part in parts if part.viewpoint is not None]
    is_one = len(places) == len(parts) and (np.array(places) == places[0]).all()
    return CloudContent(
        np.concatenate([part.points for part in parts]),
        np.concatenate(normals) if len(normals) == len(parts) else None,
        np.concatenate(meshes) if meshes else None,
        np.concatenate(colors) if len(colors) == len(parts) else None,
        places[0] if is_one else None,
    )
