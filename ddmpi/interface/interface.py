"""The interface of two bodies, or of two sides of one: contact nodes, directions, gaps, and the transfers from the nodes
of both sides.

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
from ddmpi.scene.contacts import PAIR, Closure
from ddmpi.surface.outline import Outline
from ddmpi.surface.side import Side, dot
from ddmpi.system.numbers import ALIKE, Frame, RigidMotion

LARGE_OVERLAP = 0.02
"""Warn of an initial overlap above this fraction of the thinner body's depth."""

MANY_ELEMENTS = 5.0
"""Warn of an initial overlap above this multiple of the distance between neighbouring nodes."""


@dataclass(frozen=True)
class Places:
    """Places on an interface: its rows, or others at which the gap is evaluated and which carry no unknowns.

    Attributes
    ----------
    nodes : of both sides (j,), numbers in the meshes; empty for a rigid partner
    normal : (k, d) outer normals of the first body
    gap : (k,) initial gap along the normal (m), at the factor 1 of its history; negative for an initial overlap
    transfer : of both sides (k, j), sparse: displacements of the places from those of the side's nodes
    stays : (k,) the fraction of an initial overlap that clamps preserve, which is no error of the answer
    beyond : how many of the last places are rows that were left out as open
    turned : (d, d) of an image, by which displacements of the second side are turned; None if there is none
    """

    nodes: tuple[np.ndarray, np.ndarray] = (np.empty(0, int), np.empty(0, int))
    normal: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    gap: np.ndarray = field(default_factory=lambda: np.empty(0))
    transfer: tuple[sparse.csr_matrix, sparse.csr_matrix] = (
        sparse.csr_matrix((0, 0)),
        sparse.csr_matrix((0, 0)),
    )
    stays: np.ndarray | float = 0.0
    beyond: int = 0
    turned: np.ndarray | None = None

    def opening(self, scale: float) -> np.ndarray:
        """(k,) the gap times `scale` (m), without the overlap that clamps preserve."""
        return scale * self.gap - self.stays * np.minimum(scale * self.gap, 0.0)

    def moved(self, side: int, u: np.ndarray) -> np.ndarray:
        """Displacement (k, d) of the places with a side, from that of all its body's nodes (nv, d); or several, (k, d,
        j) from (nv, d, j)."""
        own = u[self.nodes[side]]
        if side and self.turned is not None:
            own = np.einsum("ij,kj...->ki...", self.turned, own)
        moved = self.transfer[side] @ own.reshape(len(own), int(np.prod(own.shape[1:])))
        return moved.reshape(len(moved), *own.shape[1:])

    def on_rigid(self) -> Places:
        """The same places with a second side that belongs to no body."""
        none = sparse.csr_matrix((len(self.gap), 0))
        return replace(
            self, nodes=(self.nodes[0], np.empty(0, int)), transfer=(self.transfer[0], none)
        )


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
class Geometry:
    """Where the rows of an interface are. The first of its two sides defines the directions.

    Attributes
    ----------
    xy : (m, d) positions of the contact nodes on the first side, or on the slave (m)
    tangents : (m, d − 1, d) unit vectors of the first body, beside its outer normals; the second body's are opposite
    area : (m,) nodal lengths, in space areas, over the part that faces the other side (m or m²)
    at : of both sides (m, d), points of application of the rows' forces (m)
    facets : (f, l) rows at the nodes of facets, outward, in space triangles. Only facets that wholly face the other
        side and whose nodes share no rows; at an axis in order 2 the row of a middle is listed twice
    laplacian : (m, m) sparse, of hat functions on all facets between the rows, m^(d − 3); zero at nodes without a row
        that clamps or other contacts constrain. Rows with a common entry are neighbours
    arc : (m,) arc lengths along the first body's boundary, by which profiles count (m); empty where there are none
    stands : (m,) the node of the slave, or of the first body, at which each row stands, by its number in the mesh
    axisymmetric : whether nodal lengths are areas of revolution around x = 0
    pointwise : whether the sides meet along edges or at vertices only, with forces but no stresses; `area` then comes
        from the distance between nodes and only steers the iteration
    waves : whether elements can follow the rows' functions within a facet, as those of order 2 in space
    tilt : (2, m, d − 1) tangents of the angles by which the normals of both sides lean along the `tangents`
    covered : length or area of the part that faces the other side, with what clamps hold (m or m²)
    """

    xy: np.ndarray
    tangents: np.ndarray
    area: np.ndarray
    at: tuple[np.ndarray, np.ndarray]
    facets: np.ndarray
    laplacian: sparse.csr_matrix
    arc: np.ndarray = field(default_factory=lambda: np.empty(0))
    stands: np.ndarray = field(default_factory=lambda: np.empty(0, int))
    axisymmetric: bool = False
    pointwise: bool = False
    waves: bool = False
    tilt: np.ndarray = field(default_factory=lambda: np.zeros((2, 0, 1)))
    covered: float = 0.0

    @cached_property
    def neighbours(self) -> np.ndarray:
        """(p, 2) the pairs of rows with a common entry in the laplacian, the lower one first."""
        entries = self.laplacian.tocoo()
        pairs = np.column_stack([entries.row, entries.col])
        return pairs[(entries.row < entries.col) & (entries.data != 0.0)]


@dataclass(frozen=True)
class Partner:
    """The prescribed motion of the second side: of a rigid partner, or of a bond with a pretension.

    Attributes
    ----------
    motion : of a rigid partner; none for bodies
    history : of the motion, or None
    pull, offset : (d,) direction of a pretension, empty if there is none; how far the first side is pulled along it
        (m): the bond is closed when the sides are apart by this
    """

    motion: RigidMotion = field(default_factory=lambda: RigidMotion(np.zeros(())))
    history: str | None = None
    pull: np.ndarray = field(default_factory=lambda: np.empty(0))
    offset: float = 0.0

    def carried(self, places: np.ndarray) -> np.ndarray:
        """Displacement (k, d) of the rigid partner, or by the offset, at places (k, d) (m); zero for bodies."""
        carried = self.motion.at(places)
        return carried + self.offset * self.pull if self.offset else carried


@dataclass(frozen=True)
class Drawing:
    """What files and pictures show of an interface.

    Attributes
    ----------
    lines : the nodes of the rows
    draw : makes the `outline` when it is asked for; None where nobody asks
    """

    lines: Lines = Lines(np.empty(0, int), np.empty((0, 2)), np.empty(0), np.empty((0, 2), int))
    draw: Callable[[], Outline] | None = None

    @cached_property
    def outline(self) -> Outline:
        """The outline of the covered part."""
        assert self.draw
        return self.draw()

    def __getstate__(self) -> dict[str, object]:
        drawn = (
            {"draw": partial(copy, self.outline)} if self.draw else {}
        )  # without what it is made of
        return vars(self) | drawn


@dataclass(frozen=True)
class Interface:
    """Where two bodies meet.

    A vector of the interface has `size` entries: m along the normals, then d − 1 tangential ones of each sliding node.

        >>> interface = ddmpi.solve("configs/punch.toml").contacts["punch-base"].interface
        >>> interface.m, interface.size, interface.normal[0].tolist(), interface.law.name
        (41, 82, [0.0, -1.0], 'coulomb')

    Attributes
    ----------
    name, bodies : of the contact, and of its two bodies; the second may be a rigid partner, which has no nodes
    geometry, rows : where the rows are; how they follow the nodes of both sides, with their gaps
    law : of contact and friction at the rows
    modulus : E* (Pa), 1/E* = (1 − ν²)/E of the first body + that of the second; a rigid partner adds nothing
    one_sided : (size,) bool, unknowns along which only one of the bodies can move; empty if there are none
    slave : name of the body whose nodes carry the rows where the nodes do not match, "first" or "second" where both
        sides are of one, else None
    partner : the prescribed motion of the second side
    fixed : nodes without unknowns, because clamps constrain both bodies there; the certificate ignores their gap
    probes : places between the nodes of non-matching sides; of matching ones, fixed nodes that can still move a little
    layer : the law of a soft joint; None of a hard one
    image : where it is seen if the second side is an image, which all places of the second side are of
    gap_history, scale : the history of the gap, or None; the gap's factor at present
    rub_history, former : the history of the friction, or None; its law at the beginning of the load step, if another
    drawing : what files and pictures show
    """

    name: str
    bodies: tuple[str, str]
    geometry: Geometry
    rows: Places
    law: Law
    modulus: float
    one_sided: np.ndarray = field(default_factory=lambda: np.empty(0, bool))
    slave: str | None = None
    partner: Partner = Partner()
    fixed: Places = field(default_factory=Places)
    probes: Places = field(default_factory=Places)
    layer: Closure | None = None
    image: Frame | None = None
    gap_history: str | None = None
    scale: float = 1.0
    rub_history: str | None = None
    former: Law | None = None
    drawing: Drawing = field(default_factory=Drawing)

    def under(self, factors: Mapping[str | None, float]) -> Interface:
        """The same interface with these `factors` of its gap, friction and rigid partner, by history."""
        motion = self.partner.motion
        moved = motion._replace(displacement=factors[self.partner.history] * motion.displacement)
        return replace(
            self,
            partner=replace(self.partner, motion=moved),
            scale=factors[self.gap_history],
            law=self.law.under(factors[self.rub_history]) if self.rub_history else self.law,
        )

    def imaged(self, frame: Frame) -> Interface:
        """The same interface if a `frame` has taken the second side where it is."""
        places = (
            replace(each, turned=frame.turned) for each in (self.rows, self.fixed, self.probes)
        )
        rows, fixed, probes = places
        return replace(self, rows=rows, fixed=fixed, probes=probes, image=frame)

    @property
    def prescribed(self) -> np.ndarray:
        """(size,) contact displacement of the rigid partner (m), with the sign of the second side."""
        # B² u with the second side's signs: its normal is −ν, its tangents −t.
        carried = self.partner.carried(self.places)[self.law.node]
        return -dot(self.directions, carried)

    def softness(self, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """D (m,) in m/N and b (m,) in metres of the closure D s + b near normal forces s (m,); zero of hard contacts."""
        if not self.layer:
            return np.zeros(self.m), np.zeros(self.m)
        slope, offset = self.layer.tangent(normal / self.area)
        return slope / self.area, offset

    @property
    def xy(self) -> np.ndarray:
        """(m, d) positions of the contact nodes (m)."""
        return self.geometry.xy

    @property
    def area(self) -> np.ndarray:
        """(m,) nodal lengths, in space areas (m or m²)."""
        return self.geometry.area

    @property
    def gap(self) -> np.ndarray:
        """(m,) initial gap (m), at the factor 1 of its history."""
        return self.rows.gap

    @property
    def normal(self) -> np.ndarray:
        """(m, d) outer normals of the first body."""
        return self.rows.normal

    @property
    def tangents(self) -> np.ndarray:
        """(m, d − 1, d) unit tangents of the first body."""
        return self.geometry.tangents

    @property
    def frame(self) -> np.ndarray:
        """(m, d, d) unit vectors of the first body: outer normal, then tangents."""
        return np.column_stack([self.normal[:, None], self.tangents])

    @property
    def lines(self) -> Lines:
        """The nodes of the rows."""
        return self.drawing.lines

    @property
    def axisymmetric(self) -> bool:
        """Whether nodal lengths are areas of revolution around x = 0."""
        return self.geometry.axisymmetric

    @property
    def places(self) -> np.ndarray:
        """(m, d) where forces act on the first body (m)."""
        return self.geometry.at[0]

    @property
    def shares(self) -> np.ndarray:
        """(l,) the fraction of its row's force that acts on each of the `lines`."""
        lines = self.lines
        if self.geometry.pointwise:
            return np.ones(len(lines.row))
        return lines.area / self.area[lines.row]

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
        return len(self.rows.nodes[1]) == 0

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
        # The width is 1 in the plane.
        width = self.around * (self.area / self.around) ** (1.0 - 1.0 / self.law.components)
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
    def directions(self) -> np.ndarray:
        """(size, d) the unit vectors of all unknowns, on the first body; zero where neither body can move."""
        directions = np.concatenate(
            [self.normal, self.tangents[self.sliding].reshape(-1, self.dimension)]
        )
        return directions if self.law.live.all() else directions * self.law.live[:, None]

    @property
    def alone(self) -> bool:
        """Whether one body alone moves its rows: the partner is rigid, or both sides are of this body."""
        return self.on_rigid or self.itself

    def sides(self, body: str) -> tuple[int, ...]:
        """The sides of a `body`: 0 where it is the first, 1 where it is the second, of a contact with itself both."""
        return tuple(k for k, name in enumerate(self.bodies) if name == body)

    @property
    def itself(self) -> bool:
        """Whether both sides are of one body."""
        return self.bodies[0] == self.bodies[1]

    @property
    def idle(self) -> bool:
        """Whether no rigid motion of bodies moves its rows: both sides are of one body, and none is an image."""
        return self.itself and self.image is None

    @property
    def roles(self) -> tuple[str, str]:
        """What `slave` calls both sides, as of a `ContactSpec`."""
        return PAIR if self.itself else self.bodies

    def touched(self, body: str) -> np.ndarray:
        """The nodes of a `body` at the rows, by their numbers in its mesh."""
        return np.concatenate([self.rows.nodes[side] for side in self.sides(body)])


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
    deep = overlap
    if (
        interface.law.two_sided and len(sides) == 2
    ):  # bonds bridge gaps, but their sides face each other
        one, other = interface.geometry.at
        deep = max(deep, float(dot(interface.normal, one - other).max()))
    if deep > (1.0 - ALIKE) * min(depths):
        order = "Are the two names of `on` in the order of `bodies`?"
        ends = "Ends of a sector or of a periodic cell have an image"
        raise InputError(
            f"contact.{interface.name}: the sides overlap by {deep:.3g} {unit}, and the depth of {thin!r} is "
            f"{min(depths):.3g} {unit}: they face away from each other. {ends if interface.itself else order}"
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
