"""Slow, readable NumPy versions of all grouping methods: the oracle of the tests.

One file per method, written from the equations; those of the nine are of the paper (J. Yang, K. Xian, P. Wang,
Y. Zhang, "A Performance Evaluation of Correspondence Grouping Methods for 3D Rigid Data
Matching", TPAMI 2019). Nothing here uses the compiled package.
Equation numbers count the paper's displayed equations: (1) is SS, (21) is recall.
"""
