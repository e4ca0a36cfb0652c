"""
Register two scans
==================

Estimate the pose between two scans, and write it and the aligned cloud.

Without arguments it uses a generated pair::

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
# If no pose is reliable, `register` raises an error with the reason.

try:
    done = register(source, target)
except NoConsensusError as error:
    sys.exit(str(error))
print(f"Probability of a correct pose {done.probability:.3f}, overlap {100 * done.fitness:.0f} %:")
print(done.T_target_source)

# %%
# Write the results
# -----------------

out = Path("out")
out.mkdir(exist_ok=True)
write_transform(out / "transform.txt", done.T_target_source)
write_cloud(out / "aligned.ply", source.transformed(done.T_target_source))

# %%
# Plot
# ----

figure = registration_figure(
    source.points,
    target.points,
    done.correspondences,
    mask=done.grouping.mask,
    T_target_source=done.T_target_source,
    title="Two scans of a stone",
)
figure.savefig(out / "registration.png")
