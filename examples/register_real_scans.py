"""
Register two scans, and compare with their alignment
====================================================

Register two range scans from 45 degrees apart, plot their agreement, and compare the pose with the published
alignment. The object is the Stanford bunny, or a generated stone if the download fails.

The scans are from the Stanford Computer Graphics Laboratory, with thanks: the
`Stanford 3D Scanning Repository <http://graphics.stanford.edu/data/3Dscanrep/>`_ allows research, but no
commercial use. They are downloaded once, into the folder ``out``. If ``CGROUP_DATA`` is a folder with
``stanford_views/bunny``, it is used instead.
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
# The download is checked by SHA-256. Without a network a generated stone replaces the bunny.

ARCHIVE = "https://graphics.stanford.edu/pub/3Dscanrep/bunny.tar.gz"  # 5 MB
FILES = {
    "bun000.ply": "7d48f9fdf917311de680d074edce8aff25a4b9bfd87be9301822dace811209fb",
    "bun045.ply": "150f17a7c1043312a611bfff156c5933723bea903df4b4b3c2194854d1e9f155",
    "bun.conf": "4e205d6675e6284e5b185ed87cb8390884e103fd1bb9f9b54e340be7708aebeb",
}


def download(folder: Path) -> None:
    """Download two scans and the file with their alignment into a folder."""
    with urllib.request.urlopen(ARCHIVE, timeout=60) as answer:
        content = answer.read()
    found = {}
    with tarfile.open(fileobj=io.BytesIO(content)) as archive:
        for name, expected in FILES.items():
            found[name] = archive.extractfile(f"bunny/data/{name}").read().replace(b"\r\n", b"\n")
            if hashlib.sha256(found[name]).hexdigest() != expected:
                message = f"{name} has changed"
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
    print(f"{ARCHIVE} can't be read: {error}. A generated stone replaces the bunny.")
    pair = standin_pair()
    names = "Two scans of a stone"

# %%
# Find the pose
# -------------
# The scanner looked along -z of each scan, from far away. Given its ``viewpoint``, or
# ``view_direction=(0, 0, -1)``, poses that put a surface into observed free space are rejected.

done = register(pair.source, pair.target, viewpoint=pair.source_viewpoint)
print(f"Probability of a correct pose: {done.probability:.3f}")
print(f"Overlap {100 * done.fitness:.0f} %, residual there {done.inlier_rmse:.2g}, in the scans' unit")

# %%
# Plot the agreement
# ------------------
# Both scans are coloured by their distance to the other one. Grey points are seen by one scan only.

figure = registration_figure(
    pair.source.points,
    pair.target.points,
    done.correspondences,
    mask=done.grouping.mask,
    T_target_source=done.T_target_source,
    title=names,
)

# %%
# Compare with the published alignment
# ------------------------------------
# Stanford aligned all ten views together. The two poses differ by about the noise of the scans.

turn = rotation_error(done.T_target_source, pair.T_target_source)
shift = translation_error(done.T_target_source, pair.T_target_source)
print(f"Difference {turn:.2f} degrees and {shift:.2g}; a voxel is {done.voxel:.2g}")

# %%
# Interactive page
# ----------------
# The page is one file. Open it in a browser.

Path("out").mkdir(exist_ok=True)
write_page("out/registration.html", registration_page(pair.source, pair.target, done, title=names))
