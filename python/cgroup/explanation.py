"""Explanation of the decision on one match."""

from dataclasses import dataclass, field

from cgroup._show.words import length, one_of


@dataclass(frozen=True)
class Explanation:
    """The reason why one match was kept or dropped; `str` returns it in sentences.

    Attributes
    ----------
    index : int
        Row of the match.
    kept : bool
        Whether it is in the group.
    method : str or None
        Public name; "register" for the verified group of a registration, None for a method of one's own.
    matches, selected : int
        How many matches there are, and how many the group has.
    score : float or None
        The method's score of it, for methods that score.
    rank : int or None
        Its rank by score, 1 for the greatest; equal scores have equal ranks.
    threshold : float or None
        The cut on the scores, where scores decide.
    residual : float or None
        Distance between its target point and its source point under the group's pose, in the data's unit: the
        pose is `Grouping.model`, or else the least-squares pose of the group. None without points or pose.
    tolerance : float or None
        The bound on the residual, in the data's unit, where residuals decide; for TEASER++ the bound along
        each axis.
    resolution : float or None
        The unit pr, if known.
    agreeing, agreeing_in_group : int or None
        How many of the other matches, and how many of the group's others, keep their distance to it. None
        without points.
    agreement : str
        The rule of keeping the distance: the method's own, or a general one, which the text states.
    reason : str
        Why, in words.
    remedy : str
        The single change that would have kept it; empty if it was kept, or if the change is unknown.
    """

    index: int
    kept: bool
    method: str | None
    matches: int
    selected: int
    score: float | None
    rank: int | None
    threshold: float | None
    residual: float | None
    tolerance: float | None
    resolution: float | None
    agreeing: int | None
    agreeing_in_group: int | None
    agreement: str
    reason: str
    remedy: str
    _tells_residual: bool = field(default=False, repr=False)

    @property
    def residual_in_resolutions(self) -> float | None:
        """The residual in pr; None if the residual or pr is unknown."""
        if self.residual is None or self.resolution is None:
            return None
        return self.residual / self.resolution

    def __str__(self) -> str:
        done = "kept" if self.kept else "dropped"
        sentences = [f"Match {self.index} was {done}: {self.reason}.", self._agreement(), self._residual()]
        if self.remedy:
            sentences.append(f"It would have been kept {self.remedy}.")
        return " ".join(sentence for sentence in sentences if sentence)

    def _agreement(self) -> str:
        if self.agreeing is None or self.agreeing_in_group is None:
            return ""
        text = f"It keeps its distance to {one_of(self.agreeing, 'the {} other matches', self.matches - 1)}"
        group = self.selected - self.kept
        if group:
            whole = "the group's {} others" if self.kept else "the group's {}"
            text += f" and {one_of(self.agreeing_in_group, whole, group)}"
        return f"{text}, {self.agreement}."

    def _residual(self) -> str:
        if self.residual is None or self._tells_residual:
            return ""
        return f"The group's pose leaves it {length(self.residual, self.resolution)} from its partner."
