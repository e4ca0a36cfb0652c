"""Core numbers, colourings and maximum cliques of a graph, given as (n,n) bool.

Decisions where the sources are open
------------------------------------
* Vertices are taken out in rounds: all whose degree is at most the level at once, in the order of their indices; the
  level rises to the least degree left once a round is empty.
* A greedy clique goes from the last vertex taken out to the first.
* Of several maximum cliques: the greedy one; else the first found, see `maximum_clique`.
* A graph without vertices has an empty clique, which is as large as any.
"""

import numpy as np

from .result import BoolArray, IntArray


def cores(joined: BoolArray) -> tuple[IntArray, list[int]]:
    """(n,) core numbers, and the order in which the vertices were taken out."""
    n = len(joined)
    numbers, left, level = np.zeros(n, dtype=np.int64), np.ones(n, dtype=bool), 0
    order: list[int] = []
    while left.any():
        degrees = np.where(left, joined @ left.astype(np.int64), n)
        level = max(level, int(degrees.min()))
        leaving = np.flatnonzero(degrees <= level)
        numbers[leaving] = level
        order += leaving.tolist()
        left[leaving] = False
    return numbers, order


def greedy_clique(joined: BoolArray, order: list[int]) -> list[int]:
    """Of `order`, each vertex that is joined with all taken before it."""
    clique: list[int] = []
    for vertex in order:
        if joined[vertex, clique].all():
            clique.append(vertex)
    return clique


def color_classes(joined: BoolArray, vertices: list[int]) -> list[list[int]]:
    """Classes without an edge: the first vertex left, the first after it that is joined with none of its class, ..."""
    rows = np.array(vertices, dtype=np.int64)
    among = joined[np.ix_(rows, rows)]
    left = np.ones(len(vertices), dtype=bool)
    classes: list[list[int]] = []
    while left.any():
        members: list[int] = []
        free = left.copy()
        while free.any():
            first = int(free.argmax())
            members.append(vertices[first])
            left[first] = free[first] = False
            free &= ~among[first]
        classes.append(members)
    return classes


class Search:
    """Branch and bound that colours `most_steps` vertices, and then those of one set more."""

    def __init__(self, joined: BoolArray, most_steps: int) -> None:
        self.joined = joined
        self.steps_left = most_steps
        self.best: list[int] = []

    def keep(self, clique: list[int]) -> None:
        if len(clique) > len(self.best):
            self.best = clique

    def extend(self, members: list[int], candidates: list[int]) -> None:
        """Search cliques of `members` and some of the `candidates`.

        Branches go from the last vertex of the last colour back; those before it are left as candidates of each.
        """
        if len(members) + len(candidates) <= len(self.best):
            return
        classes = color_classes(self.joined, candidates)
        self.steps_left -= len(candidates)
        if len(classes) == len(candidates):
            self.keep([*members, *candidates])
            return
        left = list(candidates)
        for colors in range(len(classes), 0, -1):
            for vertex in classes[colors - 1][::-1]:
                if self.steps_left < 0 or len(members) + colors <= len(self.best):
                    return
                left.remove(vertex)
                self.extend([*members, vertex], [k for k in left if self.joined[vertex, k]])


def maximum_clique(joined: BoolArray, most_steps: int) -> list[int]:
    if len(joined) == 0:
        return []
    numbers, order = cores(joined)
    search = Search(joined, most_steps)
    search.keep(greedy_clique(joined, order[::-1]))
    if len(search.best) == numbers.max() + 1:
        return sorted(search.best)
    kept = [vertex for vertex in order[::-1] if numbers[vertex] >= len(search.best)]
    earlier = [[j for j in kept[:k] if joined[i, j]] for k, i in enumerate(kept)]
    for vertex, candidates in zip(kept, earlier, strict=True):
        search.keep([vertex, *greedy_clique(joined, candidates)])
    for vertex, candidates in zip(kept, earlier, strict=True):
        if search.steps_left >= 0:
            search.extend([vertex], candidates)
    return sorted(search.best)
