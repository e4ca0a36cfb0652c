"""
Explain a dropped match
=======================

Print why a group rejected a match, and inspect the match in an interactive page.
"""

import numpy as np

from cgroup import group
from cgroup.comparison import find_correct
from cgroup.datasets import standin_pair
from cgroup.pages import registration_page, write_page
from cgroup.registration import correspond, register

pair = standin_pair()
matches = correspond(pair.source, pair.target)
correct = find_correct(matches, pair.T_target_source)

# %%
# GTM finds nearly all correct matches. Explain the ones that it missed:

found = group(matches, "gtm")
for row in np.flatnonzero(correct & ~found.mask):
    print(found.explain(int(row)))

# %%
# The same as numbers, for another method:

why = group(matches, "gc").explain(0)
print(f"kept: {why.kept}, rank {why.rank} of {why.matches}")
print(f"residual {why.residual_in_resolutions:.1f} pr under the group's pose")
print(f"preserves its distance to {why.agreeing} others, {why.agreeing_in_group} of them in the group")

# %%
# All matches of the group, with correct and wrong ones in two colours:

figure = found.plot(pair.source, pair.target, T_target_source=pair.T_target_source, correct=correct)
figure.savefig("gtm.png")

# %%
# An interactive page: open it in a browser, and point at a line.

registration = register(pair.source, pair.target)
write_page("registration.html", registration_page(pair.source, pair.target, registration))
