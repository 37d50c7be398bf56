"""Equations between nodes of a deck that are supports."""

from __future__ import annotations

import numpy as np

from ddmpi.decks.acting import Acts
from ddmpi.decks.cards import Acting


class Equations:
    """What equations are in a scene; supports are written into those of the model."""

    def __init__(self, acts: Acts) -> None:
        self.acts, self.supports = acts, acts.kinds["supports"]
        equations = acts.model.equations
        self.left = equations.copy()
        while any([self._known(key) for key in [*self.left]]):
            pass
        for key, (card, terms) in equations.items():
            acts.rigid_nodes |= {node for node, *_ in terms} - acts.home.keys()
            if key in self.left:
                acts.notes.add("lost", card, "an equation of several free displacements")

    def _known(self, key: tuple[int, int]) -> bool:
        """Whether an equation has one node alone that its supports leave free; then it is a support of that one."""
        card, terms = self.left[key]
        free = [term for term in terms if term[:2] not in self.supports]
        given = [(self.supports[term[:2]], term[2]) for term in terms if term not in free]
        moved = [one for one in given if one[0].moves]
        if len({node for node, *_ in free}) > 1 or len(moved) > bool(free):
            return False
        if free:
            (node, k, size), *others = free
            if others:
                way = np.sum([c * self.acts.way(node, k) for _, k, c in free], axis=0)
                if not (size := float(np.linalg.norm(way))):  # on the axis of its directions
                    return False
                self.acts.ways.append(way / size)
                k = 6 + len(self.acts.ways)
            nothing = Acting(card, ((self.acts.model.ends[-1], 0.0),))
            acting, c = moved[0] if moved else (nothing, 0.0)
            course = tuple((time, 0.0 - c / size * value) for time, value in acting.course)
            self.supports[node, k] = Acting(card, course)
        self.acts.notes.add("taken", card, "clamps")
        del self.left[key]
        return True
