"""Write the goldens beside this file: what PCL computes on small generated shapes.

    apt-get install libpcl-dev cmake
    cmake -S tests/golden -B target/goldens && cmake --build target/goldens
    python tests/golden/make_goldens.py target/goldens/make_goldens

The inputs are stored with the outputs, so that the tests don't depend on how shapes are generated.
"""

import subprocess
import sys
from pathlib import Path

import numpy as np

from cgroup import features
from cgroup.datasets import make_problem, standin_pair
from cgroup.datasets.generated.stones import stone

HERE = Path(__file__).resolve().parent
SUPPORT = 8.0  # pr
KEYPOINTS = 50
GC_SIZE, HOUGH_BIN = 3.0, 5.0


def main(program: str) -> None:
    """Run PCL on a range view, on a closed shape and on matches."""
    version = subprocess.run([program, "version"], capture_output=True, text=True, check=True).stdout.strip()
    vertices = stone(np.random.default_rng(0), 13).vertices
    # The sides of the mesh share the vertices on their edges.
    _, first = np.unique(vertices.round(3), axis=0, return_index=True)
    clouds = {"view": standin_pair(pixels=36).source.points, "stone": vertices[np.sort(first)]}
    for name, points in clouds.items():
        np.savez_compressed(HERE / f"{name}.npz", **cloud_golden(program, points), pcl=version)
    np.savez_compressed(HERE / "matches.npz", **matches_golden(program), pcl=version)


def cloud_golden(program: str, points: np.ndarray) -> dict[str, np.ndarray]:
    """Inputs, and what PCL finds on them."""
    points = points.astype(np.float32)
    pr = features.resolution(points)
    keypoints = np.linspace(0, len(points) - 1, KEYPOINTS).astype(np.int32)
    rows = [[len(points)], points, [len(keypoints)], keypoints]
    found = run(program, "cloud", pr, SUPPORT * pr, rows)
    return {
        "points": points,
        "pr": np.array(pr),
        "radius": np.array(SUPPORT * pr),
        "keypoints": keypoints,
        "normals": found["normals"].reshape(-1, 3),
        "harris": np.sort(found["harris"].astype(np.int32)),
        "iss": np.sort(found["iss"].astype(np.int32)),
        "shot_lrf": found["shot_lrf"].reshape(-1, 3, 3),
        "shot352": found["shot352"].reshape(-1, 352),
        "fpfh": found["fpfh"].reshape(-1, 33),
    }


def matches_golden(program: str) -> dict[str, np.ndarray]:
    """Matches, and the largest groups that PCL finds among them."""
    problem = make_problem(np.random.default_rng(7), 200, inlier_ratio=0.4, noise=0.5, frame_error=2.0)
    given = {name: getattr(problem, name).astype(np.float32) for name in ("source", "target", "similarity")}
    given |= {name: getattr(problem, name).astype(np.float32) for name in ("source_lrf", "target_lrf")}
    n = len(problem)
    columns = [
        given["source"],
        given["target"],
        *(given[f"{side}_lrf"].reshape(n, 9) for side in ("source", "target")),
    ]
    rows = np.column_stack([*columns, 1 - given["similarity"]])
    found = run(program, "groups", GC_SIZE, HOUGH_BIN, [[n], rows])
    groups = {name: found[name].astype(np.int32) for name in ("gc", "hough")}
    return given | groups | {"gc_size": np.array(GC_SIZE), "hough_bin": np.array(HOUGH_BIN)}


def run(program: str, what: str, first: float, second: float, numbers: list) -> dict[str, np.ndarray]:
    """Give numbers to the program; what it prints, by name."""
    text = " ".join(f"{value:.9g}" for part in numbers for value in np.ravel(part))
    command = [program, what, repr(float(first)), repr(float(second))]
    lines = subprocess.run(
        command, input=text, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    words = (line.split() for line in lines)
    return {name: np.array(values, dtype=np.float32) for name, *values in words}


if __name__ == "__main__":
    main(sys.argv[1])
