"""
Compare all methods
===================

Run all methods on the same matches, and score each with the true pose.
"""

from cgroup.comparison import compare, find_correct
from cgroup.datasets import standin_pair
from cgroup.plots import comparison_figure
from cgroup.registration import correspond

pair = standin_pair()
matches = correspond(pair.source, pair.target)
results = list(compare(matches, pair.T_target_source))
for result in results:
    score = result.score
    print(
        f"{result.method:7} {score.selected:4} selected, precision {score.precision:.2f}, "
        f"recall {score.recall:.2f}, rotation error {result.rotation_error:6.2f} degrees"
    )

# %%
# The selection of each method, with correct and wrong matches in two colours:

figure = comparison_figure(
    pair.source.points,
    pair.target.points,
    matches,
    correct=find_correct(matches, pair.T_target_source),
    masks={result.method: result.grouping.mask for result in results},
    T_target_source=pair.T_target_source,
    title="Two views of a stone, matched by SHOT at Harris keypoints",
)
figure.savefig("comparison.png")
