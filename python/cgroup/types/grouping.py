"""Groups of correspondences, and the rule that selected them."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cgroup import _core
from cgroup._checks.arrays import BoolArray, FloatArray, IndexArray, RealArray
from cgroup._checks.calls import call_hook
from cgroup._checks.values import run_options
from cgroup._show.drawing import plot
from cgroup._show.words import pose_html, result_table
from cgroup.errors import InputError, NoConsensusError
from cgroup.explanation import Explanation
from cgroup.types.fields import Correspondences, Fields
from cgroup.types.point_cloud import AnyCloud

_USE_GROUP = 'group correspondences that have them: cgroup.group(correspondences, "ss")'
_WITHOUT_POINTS = f"{{}}: this group was made without points; {_USE_GROUP}"


@dataclass(frozen=True)
class Agreement:
    """Criterion for two correspondences that preserve their distance.

    They are `ds` apart in the source and `dt` in the target.

    Attributes
    ----------
    bound : float
        ``|ds - dt|`` is less than this length, in the data's unit, or ``min(ds/dt, dt/ds)`` greater than this
        number.
    is_ratio : bool
        Which of the two.
    accepts_equality : bool
        Whether the bound itself is accepted.
    least_sum, least_each : float or None
        Length that ``ds + dt``, or each of the two, has to exceed, in the data's unit.
    scale : float
        Factor by which `ds` is multiplied first, if the method estimates a scale (TEASER++).
    """

    bound: float
    is_ratio: bool = False
    accepts_equality: bool = False
    least_sum: float | None = None
    least_each: float | None = None
    scale: float = 1.0


@dataclass(frozen=True, eq=False)
class Rule:
    """Criterion by which a method selected the correspondences of the group.

    ======================= =========================================================== ====================
    kind                    a correspondence is selected if                             bound
    ======================= =========================================================== ====================
    ``score``               its score is above `Grouping.threshold`
    ``ratio``               its nearest descriptor is so many times nearer              ratio
    ``residual``            the model leaves it less than that from its partner         length
    ``axes in clique``      it is in the maximum clique, and each axis of its residual  length
    ``axes in core``        it is in the densest core, and each axis of its residual    length
    ``conflict``            no match of a higher score conflicts with it                distance ratio
    ``recomputed conflict`` the same, with new scores after each acceptance             distance ratio
    ``star``                it keeps its distance to the seed                           length
    ``grown set``           it is in the largest set that all keep their distances      members
    ``greatest``            its score is among the greatest
    ``fullest bin``         it votes in the fullest bin, or in those around it          neighbouring bins
    ``maximum``             it votes for the largest maximum                            length: side of a bin
    ======================= =========================================================== ====================

    Attributes
    ----------
    method : str
        Public name; "register" for the verified group of a registration.
    kind : str
        Kind of the rule, as in the table.
    bound : float or None
        The bound that was used; lengths are in the data's unit.
    accepts_equality : bool
        Whether the bound, or the threshold, is itself accepted.
    agreement : Agreement or None
        Criterion for two correspondences that preserve their distance, for methods that use it.
    decided_by : (n,) array of int64 or None
        Row of the correspondence that decided on each, -1 for none: the nearest seed for "star", for a
        conflict the first accepted one that it conflicts with.
    conflicts : (n,) array of int64 or None
        How many selected correspondences each conflicts with.
    votes : (n,3) array of float64 or None
        Where each votes, NaN without a local frame: in bins from the fullest one for "fullest bin", for
        "maximum" the place in the data's unit, from the mean of the target points.
    resolution : float or None
        The unit pr in the data's unit, if known.
    """

    method: str
    kind: str
    bound: float | None = None
    accepts_equality: bool = False
    agreement: Agreement | None = None
    decided_by: IndexArray | None = None
    conflicts: IndexArray | None = None
    votes: FloatArray | None = None
    resolution: float | None = None


@dataclass(frozen=True, eq=False)
class Grouping:
    """The correspondences that a method selects as correct.

    Attributes
    ----------
    mask : (n,) array of bool
        True for selected correspondences; aligned with the input.
    scores : (n,) array of float64 or None
        The method's score of each correspondence, higher is better.
    threshold : float or None
        The cut on the scores that was really used.
    model : (4,4) array of float64 or None
        The transform of the selection, for methods that fit one (RANSAC, LC, MAC, SC2-PCR, TurboReg,
        TEASER++, CLIPPER); maps source into target.
    diagnostics : dict of str to float
        Facts about the run: iterations, seed of the cluster, eigenvalue, ...
    alternatives : (k,4,4) array of float64 or None
        Transforms that the correspondences support, `model` first, for methods that find several (LC).
    alternative_scores : (k,) array of float64 or None
        The method's score of each, descending.
    ok : bool or None
        Whether the group is significant: `false_alarms` below 0.01, for methods that estimate them (LC).
        If False, chance could explain the group, which may still be correct.
    false_alarms : float or None
        Expected number of groups as good as this one if no correspondence is correct; for methods that
        estimate it (LC).
    noise : float or None
        Standard deviation of correct correspondences, a length, for methods that estimate it (LC without a
        tolerance).
    instances : (m,n) array of bool or None
        Groups of different rigid motions, each of which is `ok`, the best first: row 0 is `mask`. None unless
        several were asked for; no row unless the group is `ok`.
    rule : Rule or None
        Criterion of the method with its bounds; None for a user's own method.
    """

    mask: BoolArray
    scores: FloatArray | None
    threshold: float | None
    model: FloatArray | None
    diagnostics: dict[str, float]
    alternatives: FloatArray | None = None
    alternative_scores: FloatArray | None = None
    ok: bool | None = None
    false_alarms: float | None = None
    noise: float | None = None
    instances: BoolArray | None = None
    rule: Rule | None = None
    _positions: tuple[RealArray, RealArray] | None = field(default=None, repr=False)

    @property
    def indices(self) -> IndexArray:
        """Rows of the selected correspondences, ascending: (m,) array of int64."""
        return np.flatnonzero(self.mask).astype(np.int64, copy=False)

    @property
    def size(self) -> int:
        """Number of selected correspondences."""
        return int(np.count_nonzero(self.mask))

    @property
    def complete(self) -> bool:
        """Whether the method finished its search.

        False if a bound on cliques, steps, time or memory ended it early: ``diagnostics["truncated"]`` is 1.
        Other entries of `diagnostics` give its progress, such as ``vertices`` or ``cliques`` (MAC).
        """
        return not self.diagnostics.get("truncated", 0.0)

    @cached_property
    def probabilities(self) -> FloatArray:
        """Probability that each match is correct, (n,): `cgroup.match_probabilities`."""
        if self._positions is None:
            raise InputError(_WITHOUT_POINTS.format("probabilities"))
        unit = None if self.rule is None else self.rule.resolution
        return find_probabilities(Fields(*self._positions, resolution=unit), self)

    def transform(self) -> FloatArray:
        """Least-squares rigid transform of the group.

        Returns
        -------
        (4,4) array of float64
            ``T_target_source``, column vectors: p' = R p + t (Kabsch).

        Raises
        ------
        NoConsensusError
            For fewer than three selected correspondences, or a group on one line.
        InputError
            If the method was given no points (`ss`, `nnsr`): use `cgroup.group`.
        """
        if self._positions is None:
            raise InputError(_WITHOUT_POINTS.format("transform"))
        source, target = self._positions
        return _core.rigid_fit(source[self.mask], target[self.mask])

    def explain(self, index: int) -> Explanation:
        """Explain why a match was kept or dropped.

        Parameters
        ----------
        index : int
            Row of the match.

        Returns
        -------
        Explanation
            Score and rank, the cut, how many others it agrees with, its residual under the group's pose, and
            what would have kept it; ``str()`` of it is a few sentences.

        Examples
        --------
        >>> from cgroup import ss
        >>> why = ss([0.2, 0.8, 0.9]).explain(0)
        >>> why.kept, why.rank, why.threshold
        (False, 3, 0.5)
        >>> print(why)  # doctest: +NORMALIZE_WHITESPACE
        Match 0 was dropped: its score of 0.2 (rank 3 of 3) is below the cut at
        0.5. It would have been kept with a score above 0.5.
        """
        return call_hook("explanation", self, index)

    def plot(
        self,
        source: AnyCloud | None = None,
        target: AnyCloud | None = None,
        *,
        T_target_source: ArrayLike | None = None,
        correct: ArrayLike | None = None,
        interactive: bool = False,
    ) -> Any:  # noqa: ANN401 - matplotlib's Figure or plotly's
        """Draw both sides and lines between the matches of the group.

        Parameters are as for `plot` of `Correspondences`; the pose is that of the group by default. An
        interactive figure explains on hover why each match was kept or dropped.

        Returns
        -------
        matplotlib.figure.Figure or plotly.graph_objects.Figure
            Not shown; notebooks show the return value of a cell.
        """
        if self._positions is None:
            raise InputError(_WITHOUT_POINTS.format("plot"))
        pose = T_target_source
        if pose is None:
            with suppress(NoConsensusError):
                pose = self.transform()
        given = {"source": source, "target": target, "pose": pose, "correct": correct}
        matches = Correspondences(*self._positions)
        title = f"{self.size} of {len(self.mask)} matches selected"
        return plot(given, matches, self.mask, interactive=interactive, title=title, grouping=self)

    def _repr_html_(self) -> str:
        share = self.size / max(len(self.mask), 1)
        return result_table(f"Grouping: {self.size} of {len(self.mask)} selected", share, self._rows())

    def _rows(self) -> list[tuple[str, str]]:
        scores = self.scores if self.scores is not None and len(self.scores) > 0 else None
        trust = "" if self.ok is None else ("reliable" if self.ok else "possible by chance")
        return [
            ("method", "" if self.rule is None else self.rule.method),
            ("scores", "" if scores is None else f"{scores.min():.3g} to {scores.max():.3g}"),
            ("cut", "" if self.threshold is None else f"{self.threshold:.3g}"),
            ("trust", trust),
            ("false alarms", "" if self.false_alarms is None else f"{self.false_alarms:.3g}"),
            ("instances", "" if self.instances is None else str(len(self.instances))),
            ("search", "" if self.complete else "cut short"),
            ("pose", "" if self.model is None else pose_html(self.model)),
        ]

    def __repr__(self) -> str:
        cut = "" if self.complete else ", search cut short"
        return f"Grouping({self.size} of {len(self.mask)} selected{cut})"


def find_probabilities(fields: Fields, grouping: Grouping, threads: int | None = None) -> FloatArray:
    """Return the probability of each match; without a resolution, that of the group is used."""
    unit = fields.resolution or grouping.diagnostics.get("resolution")
    return _core.match_probabilities(fields._replace(resolution=unit), grouping, run_options(threads, 0))
