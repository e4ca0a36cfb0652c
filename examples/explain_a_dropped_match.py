"""
Explain a dropped match
=======================

Ask a group why it left a match out, and look at the match from all sides.
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
# GTM finds nearly all of the right matches. Which one did it miss, and why?

found = group(matches, "gtm")
for row in np.flatnonzero(correct & ~found.mask):
    print(found.explain(int(row)))

# %%
# The same in numbers, and by another method:

why = group(matches, "gc").explain(0)
print(f"kept: {why.kept}, rank {why.rank} of {why.matches}")
print(f"{why.residual_in_resolutions:.1f} pr off under the group's pose")
print(f"keeps its distance to {why.agreeing} others, {why.agreeing_in_group} of them in the group")

# %%
# All matches of the group, right ones in one colour and wrong ones in another:

figure = found.plot(pair.source, pair.target, T_target_source=pair.T_target_source, correct=correct)
figure.savefig("gtm.png")

# %%
# A page to turn around: open it in a browser, and point at a line.

registration = register(pair.source, pair.target)
write_page("registration.html", registration_page(pair.source, pair.target, registration))
