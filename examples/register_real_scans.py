"""
Register two scans, and compare with their alignment
====================================================

Two range scans of one side of an object, from 45 degrees apart: find the pose, see where the scans agree,
and compare it with the alignment that came with them. The object is the Stanford bunny, or a generated stone
where the bunny can't be downloaded.

The bunny's scans are those of the Stanford Computer Graphics Laboratory, with thanks: the
`Stanford 3D Scanning Repository <http://graphics.stanford.edu/data/3Dscanrep/>`_ gives them for research, and
not for commercial use. They are downloaded once, into the folder ``out``; ``CGROUP_DATA`` names a folder that
has them already, in ``stanford_views/bunny``.
"""

import hashlib
import io
import os
import tarfile
import urllib.request
from pathlib import Path

from cgroup.datasets import open_dataset, standin_pair
from cgroup.evaluation import rotation_error, translation_error
from cgroup.pages import registration_page, write_page
from cgroup.plots import registration_figure
from cgroup.registration import register

# %%
# Get the scans
# -------------
# What arrives is compared with what this example was written with, by SHA-256. Without a network a generated
# stone takes the bunny's place.

ARCHIVE = "https://graphics.stanford.edu/pub/3Dscanrep/bunny.tar.gz"  # 5 MB
FILES = {
    "bun000.ply": "7d48f9fdf917311de680d074edce8aff25a4b9bfd87be9301822dace811209fb",
    "bun045.ply": "150f17a7c1043312a611bfff156c5933723bea903df4b4b3c2194854d1e9f155",
    "bun.conf": "4e205d6675e6284e5b185ed87cb8390884e103fd1bb9f9b54e340be7708aebeb",
}


def download(folder: Path) -> None:
    """Write two scans, and the file with their alignment, into a folder."""
    with urllib.request.urlopen(ARCHIVE, timeout=60) as answer:
        content = answer.read()
    found = {}
    with tarfile.open(fileobj=io.BytesIO(content)) as archive:
        for name, expected in FILES.items():
            found[name] = archive.extractfile(f"bunny/data/{name}").read().replace(b"\r\n", b"\n")
            if hashlib.sha256(found[name]).hexdigest() != expected:
                message = f"{name} isn't what it was"
                raise OSError(message)
    folder.mkdir(parents=True)
    for name, text in found.items():
        (folder / name).write_bytes(text)


root, bunny = Path(os.environ.get("CGROUP_DATA", "out")), Path("stanford_views", "bunny")
if not (root / bunny).is_dir():
    root = Path("out")
try:
    if not (root / bunny).is_dir():
        download(root / bunny)
    pair = open_dataset("stanford", root).load("bunny/bun000-bun045")
    names = "Two scans of the Stanford bunny"
except (OSError, EOFError, KeyError, tarfile.TarError) as error:
    print(f"{ARCHIVE} can't be read: {error}. A generated stone takes the bunny's place.")
    pair = standin_pair()
    names = "Two scans of a stone"

# %%
# Find the pose
# -------------
# The scanner looked along -z of each scan, from far away. It is told by ``viewpoint``, or by
# ``view_direction=(0, 0, -1)``: what it saw through then speaks against a pose.

done = register(pair.source, pair.target, viewpoint=pair.source_viewpoint)
print(f"Right with a probability of {done.probability:.3f}")
print(f"Overlap {100 * done.fitness:.0f} %, residual there {done.inlier_rmse:.2g}, in the scans' unit")

# %%
# See where the scans agree
# -------------------------
# Both scans are coloured by their distance to the other one. Grey is what only one of them saw.

figure = registration_figure(
    pair.source.points,
    pair.target.points,
    done.correspondences,
    mask=done.grouping.mask,
    T_target_source=done.T_target_source,
    title=names,
)

# %%
# Compare it with the alignment that came with the scans
# ------------------------------------------------------
# Stanford aligned all ten views at once; the two poses differ by about the noise of the scans.

turn = rotation_error(done.T_target_source, pair.T_target_source)
shift = translation_error(done.T_target_source, pair.T_target_source)
print(f"Apart by {turn:.2f} degrees and {shift:.2g}; a voxel is {done.voxel:.2g}")

# %%
# Turn them around
# ----------------
# The page is one file to open in a browser; its colours can be switched too.

Path("out").mkdir(exist_ok=True)
write_page("out/registration.html", registration_page(pair.source, pair.target, done, title=names))
