"""The interface of two bodies: contact nodes, directions, gaps, and the transfers from the nodes of both sides.

`check_overlap` finds mistakes of a scene, and `contradictions` those of clamps. Each rank with one of the two bodies
computes the same interface from the sides.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
import scipy.sparse as sparse

from ddmpi.errors import InputError
from ddmpi.interface.law import Law
from ddmpi.mesh.elements import circumference
from ddmpi.surface.outline import Outline
from ddmpi.surface.side import Side
from ddmpi.system.numbers import ALIKE, RigidMotion

LARGE_OVERLAP = 0.02
"""Warn of an initial overlap above this fraction of the thinner body's depth."""

MANY_ELEMENTS = 5.0
"""Warn of an initial overlap above this multiple of the distance between neighbouring nodes."""


@dataclass(frozen=True)
class Places:
    """Places on an interface at which the gap is evaluated; they carry no unknowns.

    Attributes
    ----------
    nodes : of both sides (j,), numbers in the meshes; empty for a rigid partner
    normal : (k, d) outer normals of the first body
    gap : (k,) initial gap (m), at the factor 1 of its history
    transfer : of both sides (k, j), sparse: displacements of the places from those of the side's nodes
    stays : (k,) the fraction of an initial overlap that clamps preserve, which is no error of the answer
    """

    nodes: tuple[np.ndarray, np.ndarray] = (np.empty(0, int), np.empty(0, int))
    normal: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    gap: np.ndarray = field(default_factory=lambda: np.empty(0))
    transfer: tuple[sparse.csr_matrix, sparse.csr_matrix] = (
        sparse.csr_matrix((0, 0)),
        sparse.csr_matrix((0, 0)),
    )
    stays: np.ndarray | float = 0.0

    def opening(self, scale: float) -> np.ndarray:
        """(k,) the gap times `scale` (m), without the overlap that clamps preserve."""
        return scale * self.gap - self.stays * np.minimum(scale * self.gap, 0.0)

    def moved(self, side: int, u: np.ndarray) -> np.ndarray:
        """Displacement (k, d) of the places with a side, from that of all its body's nodes (nv, d)."""
        return self.transfer[side] @ u[self.nodes[side]]


@dataclass(frozen=True)
class Lines:
    """All nodes that carry the forces of the rows. Nodes that share a row have a common pressure.

    Attributes
    ----------
    row, xy : (l,) the row of each node, and (l, d) its position (m)
    area : (l,) nodal lengths, in space areas, over the part that faces the other side; their sum is that of the rows
    facets : (f, 2) neighbours in the order of nodes, of a closed chain also (last, first); in space (f, 3) triangles
    at : (l, d) points of application of the forces (m), away from the nodes where facets are partly covered; None if
        they are the nodes
    """

    row: np.ndarray
    xy: np.ndarray
    area: np.ndarray
    facets: np.ndarray
    at: np.ndarray | None = None

    @property
    def acting(self) -> np.ndarray:
        """(l, d) points of application of the forces (m)."""
        return self.xy if self.at is None else self.at

    def only(self, some: np.ndarray) -> Lines:
        """The nodes marked by `some` (l,) bool, and the facets between them."""
        place = np.cumsum(some) - 1
        return Lines(
            self.row[some],
            self.xy[some],
            self.area[some],
            place[self.facets[some[self.facets].all(axis=1)]],
            None if self.at is None else self.at[some],
        )


@dataclass(frozen=True)
class Interface:
    """Where two bodies meet. The first of its two sides defines the directions.

    A vector of the interface has `size` entries: m along the normals, then d − 1 tangential ones of each sliding node.

        >>> interface = ddmpi.solve("configs/punch.toml").contacts["punch-base"].interface
        >>> interface.m, interface.size, interface.normal[0].tolist(), interface.law.name
        (41, 82, [0.0, -1.0], 'coulomb')

    Attributes
    ----------
    name, bodies : of the contact, and of its two bodies; the second may be a rigid partner, which has no nodes
    xy : (m, d) positions of the contact nodes on the first side, or on the slave (m)
    frame : (m, d, d) unit vectors of the first body: outer normal, then tangents; the second body's are opposite
    area : (m,) nodal lengths, in space areas, over the part that faces the other side (m or m²)
    gap : (m,) initial gap along the normal (m), at the factor 1 of its history; negative for an initial overlap
    nodes : of both sides (k,), numbers in the meshes; empty for a rigid partner
    transfer : of both sides (m, k), sparse: displacements of the contact nodes from those of the side's nodes
    law : of contact and friction at these nodes
    modulus : E* (Pa), 1/E* = (1 − ν²)/E of the first body + that of the second; a rigid partner adds nothing
    fixed : nodes without unknowns, because clamps constrain both bodies there; the certificate ignores their gap
    facets : (f, l) rows at the nodes of facets, outward, in space triangles. Only facets that wholly face the other
        side and whose nodes share no rows; at an axis in order 2 the row of a middle is listed twice
    laplacian : (m, m) sparse, of hat functions on all facets between the rows, m^(d − 3); zero at nodes without a row
        that clamps or other contacts constrain. Rows with a common entry are neighbours
    one_sided : (size,) bool, unknowns along which only one of the bodies can move
    displacement : (d,) of a rigid partner, or of its pivot (m); zero for bodies
    pull, offset : (d,) direction of a pretension, empty if there is none; how far the first side is pulled along it
        (m): the bond is closed when the sides are apart by this
    turn, pivot : of a rigid partner that turns: (t,) about (d,) the pivot (rad, m); empty for all others
    at : of both sides (m, d), points of application of the rows' forces (m); None where unknown
    slave : name of the body whose nodes carry the rows where the nodes do not match, else None
    lines : the nodes of the rows
    stands : (m,) the node of the slave, or of the first body, at which each row stands, by its number in the mesh
    draw : makes the `outline` of the covered part when it is asked for
    probes : places between the nodes of non-matching sides; of matching ones, fixed nodes that can still move a little
    beyond : number of rows that were left out as open; they are the last probes
    history, gap_history : the histories of the rigid partner's displacement and of the gap, or None
    scale : factor of the gap at present
    arc : (m,) arc lengths along the first body's boundary, by which profiles count (m); empty where there are none
    axisymmetric : whether nodal lengths are areas of revolution around x = 0
    pointwise : whether the sides meet along edges or at vertices only, with forces but no stresses; `area` then comes
        from the distance between nodes and only steers the iteration
    waves : whether elements can follow the rows' functions within a facet, as those of order 2 in space
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
    facets: np.ndarray
    laplacian: sparse.csr_matrix
    one_sided: np.ndarray
    displacement: np.ndarray
    fixed: Places = field(default_factory=Places)
    at: tuple[np.ndarray, np.ndarray] | None = None
    slave: str | None = None
    lines: Lines = Lines(np.empty(0, int), np.empty((0, 2)), np.empty(0), np.empty((0, 2), int))
    stands: np.ndarray = field(default_factory=lambda: np.empty(0, int))
    draw: Callable[[], Outline | None] | None = None
    probes: Places = field(default_factory=Places)
    beyond: int = 0
    history: str | None = None
    gap_history: str | None = None
    scale: float = 1.0
    arc: np.ndarray = field(default_factory=lambda: np.empty(0))
    pull: np.ndarray = field(default_factory=lambda: np.empty(0))
    offset: float = 0.0
    turn: np.ndarray = field(default_factory=lambda: np.empty(0))
    pivot: np.ndarray = field(default_factory=lambda: np.empty(0))
    axisymmetric: bool = False
    pointwise: bool = False
    waves: bool = False

    def under(self, factors: Mapping[str | None, float]) -> Interface:
        """The same interface with these `factors` of its gap and rigid partner, by history."""
        return replace(
            self,
            displacement=factors[self.history] * self.displacement,
            scale=factors[self.gap_history],
        )

    @property
    def prescribed(self) -> np.ndarray:
        """(size,) contact displacement of the rigid partner (m), with the sign of the second side."""
        # B² u with the second side's signs: its normal is −ν, its tangents −t.
        return -np.einsum("id,id->i", self.directions, self.carried(self.places)[self.law.node])

    def carried(self, places: np.ndarray) -> np.ndarray:
        """Displacement (k, d) of the rigid partner, or by the offset, at places (k, d) (m); zero for bodies."""
        offset = self.offset * self.pull if self.offset else 0.0
        return RigidMotion(self.displacement + offset, self.turn, self.pivot).at(places)

    @property
    def places(self) -> np.ndarray:
        """(m, d) where forces act on the first body (m)."""
        return self.xy if self.at is None else self.at[0]

    @cached_property
    def outline(self) -> Outline | None:
        """The outline of the covered part, for files and pictures; None where `draw` is missing."""
        return self.draw and self.draw()

    def __getstate__(self) -> dict[str, object]:
        return vars(self) | {"draw": partial(copy, self.outline)}  # without what it is made of

    @property
    def shares(self) -> np.ndarray:
        """(l,) the fraction of its row's force that acts on each of the `lines`."""
        return (
            np.ones(len(self.lines.row))
            if self.pointwise
            else self.lines.area / self.area[self.lines.row]
        )

    @property
    def opening(self) -> np.ndarray:
        """(m,) the gap at present (m)."""
        return self.scale * self.gap

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
    def spacing(self) -> np.ndarray:
        """(m,) distance between neighbouring nodes, from nodal lengths or areas (m)."""
        return (self.area / self.around) ** (1.0 / self.law.components)

    @property
    def around(self) -> np.ndarray | float:
        """`circumference` (m,) at the rows (m); at the axis, that of a circle within the row's area."""
        # The hat function at the axis has the area A = π h²/3. The circumference at h/3, √(4πA/3), makes its length
        # A/around = h/2, as that of any other end node.
        least = np.sqrt(4.0 / 3.0 * np.pi * self.area) if self.axisymmetric else 0.0
        return np.maximum(circumference(self.xy, self.axisymmetric), least)

    @property
    def length(self) -> float:
        """Length of the contact, in space the root of its area (m)."""
        return float((self.area / self.around).sum() ** (1.0 / self.law.components))

    @property
    def stiffness(self) -> np.ndarray:
        """c (size,) of s − c r: the stiffness of half-spaces against waves of the nodes' spacing (N/m)."""
        # Half-spaces resist a wave of displacement with the wave number k by E* k/2 per area; with k = 1/spacing, times
        # the area of a node, this is E*/2 in the plane. Any c > 0 has the same answers; c steers the active sets.
        width = self.around * (self.area / self.around) ** (
            1.0 - 1.0 / self.law.components
        )  # 1 in the plane
        return 0.5 * self.modulus * width[self.law.node]

    @property
    def size(self) -> int:
        """Length of λ and s."""
        return self.law.size

    @property
    def sliding(self) -> np.ndarray:
        """(mt,) the nodes with tangential unknowns: none without friction, else all that clamps leave free."""
        return self.law.sliding

    @property
    def normal(self) -> np.ndarray:
        """(m, d) outer normals of the first body."""
        return self.frame[:, 0]

    @property
    def directions(self) -> np.ndarray:
        """(size, d) the unit vectors of all unknowns, on the first body; zero where neither body can move."""
        directions = np.concatenate(
            [self.normal, self.frame[self.sliding, 1:].reshape(-1, self.dimension)]
        )
        return directions if self.law.live.all() else directions * self.law.live[:, None]

    def side(self, body: str) -> int:
        """0 where `body` is the first body, 1 where it is the second."""
        return self.bodies.index(body)


def check_overlap(
    interface: Interface, *sides: Side, scales: Sequence[float] = (1.0,), unit: str = "m"
) -> list[str]:
    """Warnings of a large initial overlap; InputError where the sides face away from each other. Not collective.

    `sides` are those of the elastic bodies, `scales` all factors of the gap. The depth of a body is its extent along
    the normal of the contact.
    """
    given = np.concatenate([interface.gap, interface.fixed.gap])
    gap = np.min([scale * given for scale in scales], axis=0)
    normal = np.concatenate([interface.normal, interface.fixed.normal])
    k = int(np.argmin(gap))
    overlap, depths = -gap[k], [float(np.abs(normal[k]) @ side.extent) for side in sides]
    thin = sides[int(np.argmin(depths))].body
    if len(sides) == 1 and overlap > (1.0 - ALIKE) * depths[0]:
        raise InputError(
            f"contact.{interface.name}: {thin!r} lies {overlap:.3g} {unit} deep in "
            f"{interface.bodies[1]!r}, more than its depth of {depths[0]:.3g} {unit}: the surface or the "
            "boundary is turned the wrong way"
        )
    if overlap > min(depths):
        raise InputError(
            f"contact.{interface.name}: the sides overlap by {overlap:.3g} {unit}, more than the depth "
            f"of {thin!r} ({min(depths):.3g} {unit}): they face away from each other. Are the two names "
            "of `on` in the order of `bodies`?"
        )
    spacing = float(np.median(interface.spacing))
    if overlap > LARGE_OVERLAP * min(depths) or overlap > MANY_ELEMENTS * spacing:
        of = "of the thinner one's depth" if len(sides) == 2 else "of the body's depth"
        return [
            f"contact.{interface.name}: the bodies overlap by {overlap:.3g} {unit} at first, "
            f"{overlap / min(depths):.1%} {of} and {overlap / spacing:.3g} times the distance of contact nodes; "
            "small-strain theory requires small overlaps"
        ]
    return []
