"""Place one scan on another: files in, pose and aligned cloud out, or an honest no.

Run it on two scans of your own, or without arguments on a generated pair:

    python examples/register_two_scans.py [SOURCE TARGET]
"""

import sys
from pathlib import Path

from cgroup import NoConsensusError
from cgroup.datasets import standin_pair
from cgroup.io import read_cloud, write_cloud, write_transform
from cgroup.registration import register

if len(sys.argv) == 3:
    source, target = (read_cloud(path) for path in sys.argv[1:])
else:
    pair = standin_pair()
    source, target = pair.source, pair.target

try:
    done = register(source, target)
except NoConsensusError as error:
    sys.exit(str(error))
print(f"Right with a probability of {done.probability:.3f}, overlap {100 * done.fitness:.0f} %:")
print(done.T_target_source)

out = Path("out")
out.mkdir(exist_ok=True)
write_transform(out / "transform.txt", done.T_target_source)
write_cloud(out / "aligned.ply", source.transformed(done.T_target_source))
