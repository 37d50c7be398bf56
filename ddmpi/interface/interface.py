"""The interface of two bodies: paired contact nodes, normals, nodal lengths, initial gap, traces.

Serial work on the two sides' boundary nodes; who sends which side to whom is `exchange`'s business.
Both sides compute the same pairing from the same data, so nothing more has to be agreed on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Interface:
    """Contact node pairs in role order; index 0 is role 1's side, index 1 role 2's.

    Attributes
    ----------
    nodes : pair of (m,) mesh node numbers
    xy : (m, 2) positions on role 1's side (m)
    normal, tangent : (m, 2) of role 1's body; ν² = −ν¹, t² = −t¹
    length : (m,) nodal lengths (m)
    gap : (m,) initial gap along the normal (m); negative for an initial overlap
    sliding : (mt,) the nodes that carry a tangential unknown; all m unless some are held by a clamp,
        none in a frictionless scene
    dropped : how many node pairs of the boundary carry no unknown because both bodies clamp them
    joined : (m − 1,) bool, whether a node and the next one are neighbours
    middle : (m,) bool, whether a node is the middle of an edge; none in order 1
    one_sided : (size,) bool, unknowns along which only one of the bodies can move
    held : (m,) inverse distances to the dropped neighbours, summed (1/m); zero where there are none
    """

    nodes: tuple[np.ndarray, np.ndarray]
    xy: np.ndarray
    normal: np.ndarray
    tangent: np.ndarray
    length: np.ndarray
    gap: np.ndarray
    sliding: np.ndarray
    dropped: int
    joined: np.ndarray
    middle: np.ndarray
    held: np.ndarray
    one_sided: np.ndarray

    @property
    def m(self) -> int:
        return len(self.length)

    @property
    def size(self) -> int:
        """Length of λ and s: m normal unknowns, then the tangential ones."""
        return self.m + len(self.sliding)

    @property
    def middles(self) -> np.ndarray:
        """(ns,) the middles of quadratic edges whose ends carry unknowns, too: k − 1 and k + 1 of k."""
        return 1 + np.flatnonzero(self.middle[1:-1] & self.joined[:-1] & self.joined[1:])
