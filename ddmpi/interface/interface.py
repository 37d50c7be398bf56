"""The interface of two bodies: contact nodes, directions, gaps, and how each side's nodes move them.

Serial work on plain arrays. Every rank that holds the interface computes the same one from the same sides.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sparse

from ddmpi.interface.law import Law


@dataclass(frozen=True)
class FixedPairs:
    """Node pairs that clamps hold on both sides. They carry no unknown, but may be made to overlap.

    Attributes
    ----------
    nodes : of each side (k,), numbers in its body's mesh; none of a rigid partner
    normal : (k, d) outer normals of the first body
    gap : (k,) initial gap (m); with a rigid partner, after its displacement
    """

    nodes: tuple[np.ndarray, np.ndarray] = (np.empty(0, int), np.empty(0, int))
    normal: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    gap: np.ndarray = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True)
class Interface:
    """Where two bodies meet. The first of its two sides defines the directions.

    A vector of the interface has `size` entries: m along the normals, then d − 1 along the tangents of each of the
    mt nodes that slide.

    Attributes
    ----------
    name : of the contact
    bodies : names of the first and the second body; the second one may be a rigid partner, which has no nodes
    xy : (m, d) positions of the contact nodes on the first side (m)
    frame : (m, d, d) unit vectors of the first body: outer normal, then tangents; the second body's are opposite
    area : (m,) nodal lengths, in three dimensions areas, of what faces the other side (m)
    gap : (m,) initial gap along the normal (m); negative for an initial overlap
    nodes : of each side (k,), numbers in its body's mesh; none of a rigid partner
    transfer : of each side (m, k), sparse: a contact node moves as the rows say that the side's nodes move
    law : of contact and friction at these nodes
    modulus : E* (Pa), 1/E* being the sum of both bodies' (1 − ν²)/E, of which a rigid partner's is zero
    fixed : node pairs without unknowns, because clamps hold both bodies
    joined : (m − 1,) bool, whether a node and the next one are neighbours
    edges : (ns, 3) quadratic edges whose nodes all carry unknowns, by ends and middle, in the order of the middles
    held : (m,) inverse distances to the dropped neighbours, summed (1/m); zero where there are none
    one_sided : (size,) bool, unknowns along which only one of the bodies can move
    prescribed : (size,) contact displacement of a rigid partner (m), with the sign of the second side; zero for bodies
    """

    name: str
    bodies: tuple[str, str]
    xy: np.ndarray
    frame: np.ndarray
    area: np.ndarray
    gap: np.ndarray
    nodes: tuple[np.ndarray, np.ndarray]
    transfer: tuple[sparse.csr_matrix, sparse.csr_matrix]
    law: Law
    modulus: float
    joined: np.ndarray
    edges: np.ndarray
    held: np.ndarray
    one_sided: np.ndarray
    prescribed: np.ndarray
    fixed: FixedPairs = field(default_factory=FixedPairs)

    @property
    def m(self) -> int:
        return len(self.area)

    @property
    def on_rigid(self) -> bool:
        """Whether the partner is rigid."""
        return len(self.nodes[1]) == 0

    @property
    def dimension(self) -> int:
        return self.xy.shape[1]

    @property
    def dropped(self) -> int:
        """How many node pairs of the boundary carry no unknown."""
        return len(self.fixed.gap)

    @property
    def size(self) -> int:
        """Length of λ and s."""
        return self.law.size

    @property
    def sliding(self) -> np.ndarray:
        """(mt,) the nodes that carry tangential unknowns: none without friction, else all that no clamp holds."""
        return self.law.sliding

    @property
    def normal(self) -> np.ndarray:
        """(m, d) outer normals of the first body."""
        return self.frame[:, 0]

    @property
    def directions(self) -> np.ndarray:
        """(size, d) unit vectors of the first body along which the unknowns count."""
        return np.concatenate([self.normal, self.frame[self.sliding, 1:].reshape(-1, self.dimension)])

    def side(self, body: str) -> int:
        """0 where `body` is the first body, 1 where it is the second."""
        return self.bodies.index(body)
