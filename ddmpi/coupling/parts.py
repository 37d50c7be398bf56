"""The bodies of a rank by themselves: their meshes, their discrete problems, and their sides on contacts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import msgspec
import numpy as np
from mpi4py import MPI

from ddmpi.body.elasticity import Elasticity, assemble
from ddmpi.body.loads import values_at
from ddmpi.body.stress import material_of, modulus_beside
from ddmpi.coupling.exchange import Ends, Exchange
from ddmpi.coupling.ranks import homes_of
from ddmpi.errors import InputError, naming
from ddmpi.interface.rows import holds_along
from ddmpi.kept.kept import Kept
from ddmpi.mesh.build import build_mesh, content
from ddmpi.mesh.cache import opened
from ddmpi.mesh.mesh import MEASURE, Mesh, signed_measures
from ddmpi.mesh.refine import Sizes
from ddmpi.scene.bodies import SettledBody
from ddmpi.scene.contacts import SettledContact
from ddmpi.scene.motions import Image
from ddmpi.scene.scene import Settled
from ddmpi.surface.boundary import contact_side
from ddmpi.surface.seams import find_seam
from ddmpi.surface.side import Located, Side
from ddmpi.system import interrupt
from ddmpi.system.numbers import SAME, in_words


@dataclass
class Part:
    """A body of this rank before it is factored: its number in the scene, its specification, and its contacts, each with
    the body's side, 0 or 1; then its mesh, with the shift from its home (m), its discrete problem, and its sides in the
    order of the contacts."""

    number: int
    spec: SettledBody
    touching: list[tuple[SettledContact, int]]
    mesh: Mesh = field(init=False)
    shift: tuple[float, ...] = ()
    problem: Elasticity = field(init=False)
    sides: list[Located] = field(default_factory=list)


@dataclass(frozen=True)
class Share:
    """What of a scene a rank has: its bodies, and their contacts in the order of the scene."""

    scene: Settled
    exchange: Exchange
    parts: Sequence[Part]
    contacts: Sequence[SettledContact]
    kept: Kept

    @classmethod
    def of(cls, world: MPI.Comm, scene: Settled, kept: Kept) -> Share:
        """That of this rank, before any work. Not collective."""
        homes = homes_of([body.name for body in scene.body], world)
        parts = {
            body.name: Part(number, body, [])
            for number, body in enumerate(scene.body)
            if homes[body.name] == world.rank
        }
        contacts, ends = [], []
        for contact in scene.contact:
            for side, name in enumerate(contact.bodies):
                if name in parts:
                    parts[name].touching.append((contact, side))
            if not parts.keys().isdisjoint(contact.bodies):
                first, second = contact.bodies
                contacts.append(contact)
                ends.append(Ends(contact.name, homes[first], homes.get(second, homes[first])))
        return cls(scene, Exchange(world, ends), [*parts.values()], contacts, kept)


def mesh_bodies(share: Share, folder: Path, sizes: Mapping[str, Sizes]) -> None:
    """Mesh this rank's bodies, so that they have the groups of their contacts. Not collective. Raises InputError and
    InterruptionError."""
    touched = _touched(share.scene)
    images = [(contact.name, contact.image) for contact in share.scene.contact if contact.image]
    for part in share.parts:
        groups = touched.get(part.spec.original, [])
        with opened(share.scene.output.cache):
            part.mesh = _mesh(share, part, folder, sizes.get(part.spec.name), groups)
        for contact, side in part.touching:
            with naming(f"contact.{contact.name}.on"):
                part.mesh.facets(contact.on[side])
                if contact.itself and side:
                    _refuse_common(part.mesh, contact.on)
        for name, image in images:
            _refuse_unlike(part, name, image)
        interrupt.check()


def _refuse_unlike(part: Part, contact: str, image: Image) -> None:
    """Raise InputError for a volume force that an image would not have. Not collective."""
    mesh, key = part.mesh, f"body.{part.spec.name}.volume_force"
    frame = image.frame(1.0, mesh.dimension)

    def force(points: np.ndarray) -> np.ndarray:
        values = values_at(part.spec.weight[0], points, key)
        return np.column_stack([np.broadcast_to(value, len(points)) for value in values])

    here = force(mesh.points)
    off = np.linalg.norm(force(frame.at(mesh.points)) - frame.along(here), axis=1)
    if off.max() > SAME * np.abs(here).max():
        raise InputError(
            f"{key}: is not alike in the image of contact.{contact}, {image.words}, as at "
            f"{in_words(mesh.points[off.argmax()])}; draw the whole, or give a force that turns or repeats with it, as "
            "the centrifugal one does"
        )


def _refuse_common(mesh: Mesh, on: Sequence[str]) -> None:
    """Raise InputError for two groups of a body that have facets in common. Not collective."""
    one, other = (mesh.facets(group).numbers for group in on)
    common = np.intersect1d(one, other)
    if len(common):
        place = in_words(mesh.points[mesh.boundary[0][common[0], : mesh.dimension]].mean(axis=0))
        raise InputError(
            f"{on[0]!r} and {on[1]!r} have {len(common)} {mesh.cell.facet.names} in common, as at {place}; a surface "
            "is one side of a contact, and another one faces it"
        )


def assemble_bodies(share: Share) -> dict[tuple[str, int], Located]:
    """Find stiffness, loads and sides of this rank's bodies; the sides by contact and number. Not collective. Raises
    InputError and InterruptionError."""
    sides = {}
    for part in share.parts:
        part.problem = _assemble(part, share.kept)
        for contact, side in part.touching:
            sides[contact.name, side] = _side(part, contact, side, share.kept)
            part.sides.append(sides[contact.name, side])
        interrupt.check()
    return sides


def _mesh(share: Share, part: Part, folder: Path, sizes: Sizes | None, contacts: list[str]) -> Mesh:
    """The mesh of a body, which depends on what the scene says of it and on the content of its file, and resolves the
    groups on which something acts; `contacts` are those of its contacts and of its copies'. Shapes that differ by their
    place alone, and copies, are shifts of one mesh, which is turned first for copies that are. Not collective. Raises
    InputError."""
    scene, spec, kept = share.scene, part.spec, share.kept
    file = content(spec, folder)
    home, part.shift = spec.mesh.at_home(scene.axisymmetric)
    placement = spec.placement(scene.dimension)
    if spec.copy:
        there = placement.at(np.array(part.shift or np.zeros(scene.dimension)))
        part.shift = tuple(there.tolist()) if there.any() else ()
    depends = (
        repr(msgspec.structs.asdict(spec.mesh) | home),
        kept.key("file", spec.name) if file is None else file,
        contacts,
        sizes,
        scene.dimension,
        scene.axisymmetric,
        [(name, acting.on) for name, acting in spec.acting],
    )

    def build(place: Mapping[str, tuple]) -> Mesh:
        body = msgspec.structs.replace(spec, mesh=msgspec.structs.replace(spec.mesh, **place))
        return build_mesh(body, folder, contacts, sizes, scene.dimension, scene.axisymmetric)

    try:
        drawn = kept.get("drawn", spec.name, depends, lambda: build(home))
    except InputError:
        if home:
            build({})  # which says where
        raise
    whole = kept.key("drawn", spec.name), placement.turned
    mesh = kept.get("shape", spec.name, whole, lambda: drawn.turned(placement.turned))
    shift, where = part.shift, (kept.key("shape", spec.name), part.shift)

    def place() -> Mesh:
        placed = mesh.shifted(shift) if shift else mesh
        if shift and not signed_measures(placed.points, placed.triangles).min() > 0.0:
            build({})  # which says that so far away its cells have no area
            raise InputError(
                f"body.{spec.name}.copy: so far away its cells have no {MEASURE[scene.dimension]} in double precision"
            )
        return placed

    return kept.get("mesh", spec.name, where, place)


def _touched(scene: Settled) -> dict[str, list[str]]:
    """The groups of the contacts of each body and its copies, by the original, in the order of the scene."""
    original = {body.name: body.original for body in scene.body}
    touched = dict[str, list[str]]()
    for contact in scene.contact:
        for side, name in enumerate(contact.bodies):
            if name in original:
                touched.setdefault(original[name], []).append(contact.on[side])
    return touched


def _assemble(part: Part, kept: Kept) -> Elasticity:
    """The discrete problem of a body, which warns of a mesh, of a file or a drawing, whose cells are not connected as
    they look. Not collective. Raises InputError."""
    seam, mesh, spec = None, part.mesh, part.spec
    if not spec.mesh.shape:
        groups = {contact.on[side] for contact, side in part.touching}
        groups |= {acting.on for name, acting in spec.acting if name != "clamp"}
        depends = kept.key("mesh", spec.name), sorted(groups)
        seam = kept.get("seam", spec.name, depends, lambda: find_seam(mesh, groups, spec.name))
    warnings = [seam.words(spec.name)] if seam else []
    try:
        elasticity = assemble(mesh, spec, kept)
    except InputError as error:  # a piece may be loose because of the seam
        raise InputError("; ".join([str(error), *warnings])) from None
    return replace(elasticity, warnings=[*warnings, *elasticity.warnings])


def _side(part: Part, contact: SettledContact, side: int, kept: Kept) -> Located:
    """The side of a body on a contact. Not collective. Raises InputError."""
    spec, group = part.spec, contact.on[side]
    mesh, supports = part.mesh.home, part.problem.supports
    others = [(other, which) for other, which in part.touching if other is not contact]
    boundary = mesh.facets(group)
    nodes = np.unique(boundary.nodes)
    depends = (
        kept.key("shape", spec.name),
        [supports.clamps[nodes], supports.free[nodes]],
        {history: u[nodes] for history, u in supports.moved.items()},
        spec.material,
        group,
        [(other.on[which], holds_along(other)) for other, which in others],
        contact.itself and contact.on,
    )

    # a node of both sides, as at the tip of a crack, is held by the body itself
    shared = np.zeros(len(mesh.points), bool)
    if contact.itself and not contact.image:
        one, other = (mesh.facets(on).nodes for on in contact.on)
        shared[np.intersect1d(one, other)] = True

    def make() -> Side:
        return contact_side(
            mesh,
            boundary,
            supports,
            "",
            modulus_beside(mesh, material_of(mesh, spec), boundary),
            _tied(mesh, others, supports.free, group) | shared,
            any(group == other.on[which] for other, which in others),
        )

    owner, shift = f"{contact.name}.{side}", np.array(part.shift or np.zeros(mesh.dimension))
    found = kept.get("side", owner, depends, make)
    return Located(found, kept.key("side", owner), spec.name, shift)


def _tied(
    mesh: Mesh, others: Sequence[tuple[SettledContact, int]], free: np.ndarray, group: str
) -> np.ndarray:
    """Nodes (nv,) bool of a body that are clamped in all components or lie on one of its `others` contacts, given with
    the side, that carries tangential forces; in space only if that has another `group`."""
    tied = ~free.any(axis=(1, 2))
    for contact, side in others:
        if holds_along(contact) and (free.shape[1] == 2 or contact.on[side] != group):
            tied[mesh.facets(contact.on[side]).nodes] = True
    return tied
