"""An outline on a map seen from above, cell by cell: Olson, Real-time correlative scan matching, ICRA 2009."""

import numpy as np


def score(
    grid: np.ndarray,
    walls: np.ndarray,
    floor: np.ndarray,
    turn: np.ndarray,
    at: np.ndarray,
    floor_weight: float,
) -> float:
    """Return the mean of the map at walls less the weighted mean at open floor; 2 in the map counts 1."""
    means = []
    for points in (walls, floor):
        turned = np.array([[turn[0], -turn[1]], [turn[1], turn[0]]]) @ points.T
        cells = {tuple(cell) for cell in np.floor(turned.T + 0.5).astype(int)}
        values = [
            grid[tuple(cell + at)] if (cell + at >= 0).all() and (cell + at < grid.shape).all() else 0
            for cell in map(np.array, cells)
        ]
        means.append(sum(map(float, values)) / (2 * max(len(cells), 1)))
    return means[0] - floor_weight * means[1]
