"""LC, likelihood consensus."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup._checks.calls import explain_wrong_calls
from cgroup.methods._call import call

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.methods.types import Progress
    from cgroup.types import AnyCloud, Grouping


@explain_wrong_calls
def lc(
    source: AnyCloud,
    target: AnyCloud,
    *,
    ratio: ArrayLike | None = None,
    source_lrf: ArrayLike | None = None,
    target_lrf: ArrayLike | None = None,
    resolution: float | None = None,
    tolerance: float | None = None,
    modes: int = 40,
    instances: int = 1,
    scale: bool | tuple[float, float] = False,
    threads: int | None = None,
    max_memory: int | None = None,
    progress: Progress | None = None,
) -> Grouping:
    """Likelihood consensus (LC): the pose that makes matches likelier than chance.

    For few right matches among many; a method of this library. Cliques of matches that keep their distances
    (``|ds - dt| < tolerance``) give poses. The support of a pose is the sum of
    ``max(0, L_i - r_i^2 / (2 sigma^2))`` over residuals r_i below ``2 * tolerance``, with
    ``sigma = 0.9 * tolerance`` and the chance level
    ``L_i = ln(s n / D_i) + clip(8 (0.87 - ratio_i), -0.8, 3)``: D_i counts the matches that start or end
    within ``5/3 * tolerance`` of match i, and ``s = max(1/100, 10/n)`` is the share that is right where
    nothing is known. The best pose is refined, its supporters are taken out, and so on; the score of each is
    its support times the share of source points that it lays near a target. Of more than 2,500
    correspondences, cliques are sought among the 2,500 that keep their distance to the most others (the
    diagnostics say how many under ``vertices``). Cost O(n^2) tests of pairs, memory O(n).

    Frames make further poses and count in the support, where they are good: where most of the supporters of
    poses that are no chance have frames that agree, or where position alone finds no such pose
    (``by_frames`` in the diagnostics). Every step, and what each is worth:
    https://cgroup-project.github.io/cgroup/methods/lc.html.

    Parameters
    ----------
    source, target : (n,3) array_like of float
        Matched points.
    ratio : (n,) array_like of float, optional
        Nearest / second-nearest descriptor distance; without it, all matches are alike beforehand.
    source_lrf, target_lrf : (n,3,3) array_like of float, optional
        Local reference frames, rows are axes; NaN for none. A match without them is judged by its position.
    resolution : float, optional
        Mean nearest-neighbour distance of the clouds; one that is wrong by a factor of 4 finds the same pose.
    tolerance : float, optional
        Greatest distance difference of two that agree, a length; default ``3 * resolution``, without a
        resolution 0.8 times the distance of neighbouring points, and where that leaves no sure answer, other
        powers of 2 times that: the pose is then refined by the noise under it, `Grouping.noise`. For dense
        matches of clouds thinned to voxels of side v, ``1.2 * v``.
    modes : int
        Most poses in `Grouping.alternatives`, the best among them.
    instances : int
        Most groups in `Grouping.instances`, which is None for 1: groups of different rigid motions, each of
        them sure by the matches that better ones leave, any two with less than 0.3 in common (intersection
        over union). Row 0 is the mask; there is no row where the best is not `Grouping.ok`.
    scale : bool or (float, float)
        Whether the two sides are in different units: then the length in the target is sought that the
        source's unit has, between the two bounds if they are given. True allows any unit: the scale is sought
        where both sides are of about the same size, to a factor of 3, and bounds only narrow that. All
        lengths (`resolution`, `tolerance`, `Grouping.noise`) are the target's.
    threads : int, optional
        Threads to compute on, None for all cores. The result does not depend on it.
    max_memory : int, optional
        Bytes that the graph of agreeing pairs may take; by default a quarter of the memory that is free, at
        most 1.5 GiB. A larger graph is refused.
    progress : callable, optional
        Called now and then with the share of the work done, in [0,1]; an error that it raises ends the work.

    Returns
    -------
    Grouping
        The correspondences with a residual of at most ``5/3 * tolerance`` under `Grouping.model`, the best
        pose. Its scores are probabilities to be right, given that pose; `Grouping.alternatives` has the
        other poses too. `Grouping.false_alarms` is ``n^3/6 P(Poisson(lambda) >= k - 3)`` for k supporters
        that lie ``7/3 * tolerance`` apart, of which chance gives lambda where the targets lie as they do;
        times the number of tolerances there are to try; infinite where a mirror image fits as well. Where a
        smaller radius makes few exact correspondences less likely by chance, it is that number. The
        diagnostics say under ``dimensions`` whether the group's points span a body (3), a plane (2) or a line
        (1), and under ``resolution`` a third of the tolerance that was taken. Without a pose that three
        correspondences support, the group is empty. Where a scale s is sought, the model and the
        alternatives are similarities, ``s R`` in their upper left, all of the same s, which is in
        `diagnostics` under ``scale``; `Grouping.transform` stays a rigid motion, which does not know of it.

    Raises
    ------
    InputError
        If points aren't (n,3), finite and as many on both sides, or a ratio or a frame isn't what it should
        be, or frames are given on one side only; for an option out of its range; where the graph exceeds
        `max_memory`.
    OutOfMemoryError
        Where the system gives no memory for the computation.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import lc
    >>> rng = np.random.default_rng(0)
    >>> source = rng.uniform(0, 100, size=(500, 3))
    >>> target = source[:, [1, 2, 0]] + 5.0
    >>> target[25:] = rng.uniform(0, 100, size=(475, 3))
    >>> result = lc(source, target)
    >>> bool(result.mask[:25].all()), result.model[:3, 3].round(1)
    (True, array([5., 5., 5.]))
    >>> result.ok, result.false_alarms < 1e-6
    (True, True)
    """
    return call("lc", locals())
