"""Place one scan on another: files in, pose and aligned cloud out.

Run it on two scans of your own, or without arguments on a generated pair:

    python examples/register_two_scans.py [SOURCE TARGET]
"""

import sys
from pathlib import Path

from cgroup.datasets import standin_pair
from cgroup.io import read_cloud, write_cloud, write_transform
from cgroup.registration import register

if len(sys.argv) == 3:
    source, target = (read_cloud(path) for path in sys.argv[1:])
else:
    pair = standin_pair()
    source, target = pair.source, pair.target

done = register(source, target, method="gtm")
print(f"{done.grouping.size} of {len(done.correspondences)} matches agree on this pose:")
print(done.T_target_source)

out = Path("out")
out.mkdir(exist_ok=True)
write_transform(out / "transform.txt", done.T_target_source)
write_cloud(out / "aligned.ply", source.transformed(done.T_target_source))
