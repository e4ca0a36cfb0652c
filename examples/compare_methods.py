"""Run all methods on the same matches and judge each against the true pose."""

from cgroup.comparison import compare
from cgroup.datasets import standin_pair
from cgroup.registration import correspond

pair = standin_pair()
matches = correspond(pair.source, pair.target)
for result in compare(matches, pair.T_target_source):
    score = result.score
    print(
        f"{result.method:7} {score.selected:4} selected, precision {score.precision:.2f}, "
        f"recall {score.recall:.2f}, rotation error {result.rotation_error:6.2f} degrees"
    )
