"""
Register two scans
==================

Place one scan on another: files in, pose and aligned cloud out, or an honest no.

Run it on two scans of your own, or without arguments on a generated pair::

    python examples/register_two_scans.py [SOURCE TARGET]
"""

import sys
from pathlib import Path

from cgroup import NoConsensusError
from cgroup.datasets import standin_pair
from cgroup.io import read_cloud, write_cloud, write_transform
from cgroup.plots import registration_figure
from cgroup.registration import register

# %%
# Read the clouds
# ---------------

if len(sys.argv) == 3:
    source, target = (read_cloud(path) for path in sys.argv[1:])
else:
    pair = standin_pair()
    source, target = pair.source, pair.target

# %%
# Find the pose
# -------------
# A pose that can't be trusted is an error, which says why.

try:
    done = register(source, target)
except NoConsensusError as error:
    sys.exit(str(error))
print(f"Right with a probability of {done.probability:.3f}, overlap {100 * done.fitness:.0f} %:")
print(done.T_target_source)

# %%
# Write what was found
# --------------------

out = Path("out")
out.mkdir(exist_ok=True)
write_transform(out / "transform.txt", done.T_target_source)
write_cloud(out / "aligned.ply", source.transformed(done.T_target_source))

# %%
# See it
# ------

figure = registration_figure(
    source.points,
    target.points,
    done.correspondences,
    mask=done.grouping.mask,
    T_target_source=done.T_target_source,
    title="Two scans of a stone",
)
figure.savefig(out / "registration.png")
