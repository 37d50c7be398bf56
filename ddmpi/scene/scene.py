"""The scene: bodies, rigid partners, contacts and method, as a user writes them, and with all defaults.

`Scene` is the frozen data of a TOML file, and checks that its parts fit together. Other rooms work with `Settled`.
"""

from __future__ import annotations

import unicodedata
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Annotated, Any, get_args

import msgspec
from msgspec.structs import replace

from ddmpi.errors import nearest
from ddmpi.scene.bodies import BodySpec, Material, SettledBody, Traction
from ddmpi.scene.checks import check_heat, check_thickness
from ddmpi.scene.contacts import ContactSpec, Rigid, SettledContact
from ddmpi.scene.derivable import refuse_underivable
from ddmpi.scene.formulas import check_formulas, varies
from ddmpi.scene.meshes import MeshSpec
from ddmpi.scene.method import (
    PRESETS,
    Checkpoint,
    Method,
    Output,
    SettledMethod,
    Time,
    units,
)
from ddmpi.scene.motions import Motion, check_motions
from ddmpi.scene.values import WHERE, History, Name, Number, Table, histories, settle, tables
from ddmpi.system.files import LONGEST, contact_files

FileKind = Callable[[BodySpec], tuple[int, int]]
"""Gives dimension and order of the elements in the mesh file, or in the drawing, of a body; raises InputError."""

EXTENTS = (
    "size",
    "divisions",
    "radii",
    "angles",
    "bodies",
    "on",
    "young",
    "poisson",
    "shear",
    "expansion",
    "view",
)
"""Keys of lists that are neither places nor vectors."""

FORMULAS = ("x", "y", "z", "normal", "value", "pressure", "volume_force", "gap", "temperature")
"""Keys whose values may be formulas."""

SURFACES = [shape for shape in get_args(Rigid) if shape.surface]
"""Shapes of rigid partners that bodies can touch."""

PETScOptions = dict[str, str | int | Number | bool]


class Scene(Table, frozen=True, kw_only=True):
    """A whole scene as a user writes it.

    Attributes
    ----------
    title : of pictures and summary
    axisymmetric : whether bodies are solids of revolution around x = 0: x is the radius, y the axis, forces are of the
        whole circumference
    body : elastic bodies
    rigid : partners of contacts without mesh, material and rank
    contact : contacts of bodies with each other or with a rigid partner; left out, each body is solved alone
    history : factors over time by name, [history.NAME]
    time : load steps; left out, all loads act at once
    method : method and accuracy
    output : files that are written
    checkpoint : intervals at which the state is written
    petsc : PETSc options of solvers by name without the dash, such as body_ksp_type = "cg"; the command line wins, and
        it alone may set options that name files or start programs, see docs/reference/security.md
    """

    title: str = ""
    axisymmetric: bool = False
    body: Annotated[list[BodySpec], msgspec.Meta(min_length=1)]
    rigid: list[Rigid] = []
    contact: list[ContactSpec] = []
    history: dict[Name, History] = {}
    time: Time | None = None
    method: Method = Method()
    output: Output = Output()
    checkpoint: Checkpoint = Checkpoint()
    petsc: PETScOptions = {}

    def __post_init__(self) -> None:
        self._check_names()
        self._check_files()
        for key, table in tables(self):
            for name in FORMULAS:
                check_formulas(f"{key}.{name}", getattr(table, name, None))
        for contact in self.contact:
            self._check_partners(contact)
            self._check_nodes(contact)
        check_thickness(self.body, {name for contact in self.contact for name in contact.bodies})
        orders = sorted({body.mesh.order for body in self.body if body.mesh.order})
        if len(orders) > 1:
            raise ValueError(
                f"bodies have mesh.order {' and '.join(map(str, orders))}; forces at their common nodes "
                "would mean different pressures, so give all bodies the same"
            )
        for contact in self.contact:
            if self.axisymmetric and contact.pretension and contact.pretension.along[0]:
                raise ValueError(
                    f"contact.{contact.called}.pretension.along: an axisymmetric bond is pulled along y "
                    "only; write along = [0, 1] or [0, -1]"
                )
        for rigid in self.rigid if self.axisymmetric else ():
            if 0 in rigid.pushed or rigid.turning:
                key = (
                    "pivot"
                    if rigid.turning
                    else "force"
                    if rigid.force and rigid.force[0]
                    else "free"
                )
                raise ValueError(
                    f"rigid.{rigid.name}.{key}: an axisymmetric partner is pushed along y only and does "
                    "not turn, because radial forces cancel around the axis"
                )
        if self.output.mirrored and not self.axisymmetric:
            raise ValueError(
                "output.mirrored: shows the other half of axisymmetric bodies; write axisymmetric = true "
                "at the top, or leave it out"
            )
        self._check_histories()
        check_motions(self)
        check_heat(self.body)
        two = (len(self.body), len(self.rigid), len(self.contact)) == (2, 0, 1)
        if self.method.for_two and not (two and self.contact[0].kind == "unilateral"):
            raise ValueError(
                f"method.{self.method.for_two} is for two supported bodies with one unilateral contact; "
                "beyond that the published iteration diverges for theta >= 0.02, accelerated or not; use "
                'outer = "newton", the default'
            )

    def _check_names(self) -> None:
        """Bodies and rigid partners share one list of names, contacts have another."""
        pairs: set[frozenset[str]] = set()
        sides: dict[frozenset[tuple[str, str]], str] = {}
        for number, contact in enumerate(self.contact):
            first, second = contact.bodies
            if contact.name is None and frozenset(contact.bodies) in pairs:
                raise ValueError(
                    f"contact.{number}: a second contact between {first!r} and {second!r} must be named; "
                    f'add name = "…"'
                )
            pairs.add(frozenset(contact.bodies))
            name, both = (
                contact.called,
                frozenset(zip(contact.bodies, (*contact.on, ""), strict=False)),
            )
            if both in sides:
                raise ValueError(
                    f"contact.{name}: is between the same sides as contact.{sides[both]}; forces and slip "
                    "bounds of both would add up, so leave one of them out"
                )
            sides[both] = name
        named = {
            "body": [body.name for body in self.body],
            "rigid": [rigid.name for rigid in self.rigid],
            "contact": [contact.called for contact in self.contact],
        }
        for key, names in named.items():
            for name, number in Counter(names).items():
                if number > 1:
                    raise ValueError(
                        f'{key}.{name}: {number} [[{key}]] tables have this name; give each name = "…" of '
                        "its own"
                    )
        for rigid in self.rigid:
            if rigid.name in named["body"]:
                raise ValueError(
                    f"rigid.{rigid.name}: a [[body]] has this name, too; rename one of them, because "
                    "contacts name both in the same way"
                )

    def _check_files(self) -> None:
        """The files of contacts differ, also on file systems that do not distinguish capitals and small letters."""
        files: dict[str, tuple[str, str]] = {}
        for name, file in (
            (contact.called, file)
            for contact in self.contact
            for file in contact_files(contact.called)
        ):
            if (size := len(file.encode())) > LONGEST:
                raise ValueError(
                    f"contact.{name}: is too long for the name of a file; {file} has {size} bytes, and "
                    f'{LONGEST} are allowed; give the contact a shorter name = "…"'
                )
            other, same = files.setdefault(
                unicodedata.normalize("NFC", file).casefold(), (name, file)
            )
            if other != name:
                alike = f" and {same}, which are the same on some file systems" * (same != file)
                raise ValueError(
                    f"contact.{name}: this contact and contact.{other} would both write {file}{alike}; "
                    'rename one of them by name = "…"'
                )

    def _check_histories(self) -> None:
        """Histories exist, and the method supports load steps."""
        for key, table in tables(self):
            name = getattr(table, "history", None)
            if name is not None and name not in self.history:
                raise ValueError(
                    f"{key}.history: there is no [history.{name}]{nearest(name, list(self.history))} "
                    f"(histories: {', '.join(self.history) or 'none'})"
                )
        if self.history and self.time is None:
            raise ValueError(
                f"history.{next(iter(self.history))}: a history needs [time], as in [time], points = "
                "[1.0, 2.0]; without it all loads act at once"
            )
        if self.output.animation and self.time is None:
            raise ValueError(
                "output.animation: plays load steps, and without [time] there is only one; leave it out"
            )
        for contact in self.contact:
            name, cycle = (
                contact.pretension.history if contact.pretension else None,
                self.time and self.time.cycle,
            )
            end = self.history[name].times[-1] if name else 1.0
            ends = f"contact.{contact.called}.pretension.history: [history.{name}] ends"
            if end <= 0.0:
                raise ValueError(
                    f"{ends} at time {end:g}, before the first load step, so that the force would never "
                    "act; let it end at a later time, or leave it out"
                )
            # each cycle would give the force anew, and let the offset go that the one before has kept
            if name and cycle and cycle.repeat > 1 and cycle.begin < end <= cycle.to:
                raise ValueError(
                    f"{ends} within the cycle from {cycle.begin:g} to {cycle.to:g}; let it end before or "
                    "later"
                )
        if self.time is None:
            return
        if self.method.for_one:
            raise ValueError(
                f"time: method.{self.method.for_one} solves a single load step; several need "
                'outer = "newton", the default'
            )
        self.time.check_cycle(self.history)
        if self.method.target_error:
            raise ValueError(
                "time: method.target_error is for one load step; refine the meshes by mesh.divisions or "
                "mesh.refine"
            )

    def _check_nodes(self, contact: ContactSpec) -> None:
        """What has no surface has bonds alone."""
        nodes = [one.name for one in self.rigid if not one.surface]
        if contact.bodies[1] in nodes and contact.kind != "bonded":
            raise ValueError(
                f"contact.{contact.called}.kind: {contact.bodies[1]!r} is a node, which has no surface "
                'that could be touched; write kind = "bonded", or give it another shape'
            )

    def _check_partners(self, contact: ContactSpec) -> None:
        """A contact is between two bodies, or a body and then a rigid partner, with a group for each body."""
        key, bodies = f"contact.{contact.called}", {body.name: body for body in self.body}
        rigid = [partner.name for partner in self.rigid]
        for name in contact.bodies:
            if name not in bodies and name not in rigid:
                lists = f"bodies: {', '.join(bodies)}" + f"; rigid: {', '.join(rigid)}" * bool(
                    rigid
                )
                raise ValueError(
                    f"{key}.bodies: there is no body {'or rigid partner ' * bool(rigid)}{name!r}"
                    f"{nearest(name, [*bodies, *rigid])} ({lists})"
                )
        first, second = contact.bodies
        if first == second:
            raise ValueError(
                f"{key}.bodies: names {first!r} twice; a contact is between two bodies, or a body and a "
                "rigid partner"
            )
        if first in rigid and second in rigid:
            raise ValueError(
                f"{key}.bodies: {first!r} and {second!r} are both rigid; one of them must be a [[body]]"
            )
        if first in rigid:
            raise ValueError(
                f"{key}.bodies: {first!r} is rigid and comes second; write bodies = "
                f'["{second}", "{first}"], on = ["{contact.on[-1]}"]'
            )
        if second in rigid and len(contact.on) > 1:
            raise ValueError(
                f"{key}.on: {second!r} is rigid and has no boundary groups; write on = "
                f'["{contact.on[0]}"], the one of {first!r}'
                + (f", or on = [[{', '.join(contact.on)}]], both" * "".join(contact.on).isdigit())
            )
        if second in bodies and len(contact.on) < 2:
            raise ValueError(
                f"{key}.on: names a boundary group of {first!r}, and must name one of {second!r}, too; "
                f'write on = ["{contact.on[0]}", "…"]'
            )
        if contact.slave is not None and contact.slave not in contact.bodies:
            raise ValueError(
                f"{key}.slave: {contact.slave!r} is not a body of this contact"
                f"{nearest(contact.slave, list(contact.bodies))} (bodies: {first}, {second})"
            )
        if second in rigid and (contact.slave or contact.pairing):
            raise ValueError(
                f"{key}.{'slave' if contact.slave else 'pairing'}: {second!r} is rigid and has no nodes; "
                f"rows stand at the nodes of {first!r}, so leave this key out"
            )

    def settled(self, file_kind: FileKind | None = None) -> Settled:
        """The scene with all defaults.

        The order of the elements is that of a body that names one, else 2 for a ``target_error`` if linear triangles
        lock, else the preset's, else 2 for a ``target_error``, else that of the mesh files by `file_kind`, else 1.
        Where the target has made it 2, shapes have half their divisions if they can, see `_halved`. The dimension is
        that of shapes, else of places and vectors, else of the files.

        Raises ValueError for a ``method.target_error`` with elements that lock, for mesh files of different orders, and
        for different dimensions in one scene; and the errors of `file_kind`.
        """
        dimension = self._dimension(file_kind)
        method = self.method.settled(
            refinable=self.time is None and all(body.mesh.refinable for body in self.body)
        )
        locking = [body for body in self.body if method.target_error and body.locking_ratio]
        named = next((body.mesh.order for body in self.body if body.mesh.order), None)
        if locking and named == 1:
            raise ValueError(
                f"body.{locking[0].name}: linear elements lock at nu = {locking[0].locking_ratio:g}; "
                "estimates of their error cannot be trusted, and no method.target_error can be met; leave "
                "mesh.order out or set it to 2"
            )
        preset = PRESETS.get(method.preset or "", {}).get("order")
        order, bodies, aimed = self._order(named or preset, method.target_error, file_kind)
        order = 2 if locking else order
        bonded = {contact.bodies[1] for contact in self.contact if contact.kind == "bonded"}
        scene = settle(
            self,
            Settled,
            method=method,
            dimension=dimension,
            aimed=aimed,
            body=[body.settled(order, dimension, self.axisymmetric) for body in bodies],
            rigid=[rigid.settled(dimension, rigid.name in bonded) for rigid in self.rigid],
            time=self.time.settled() if self.time else None,
            contact=[
                settle(contact, SettledContact, name=contact.called) for contact in self.contact
            ],
        )
        if self.output.derivatives:
            refuse_underivable(scene.resolved())
        return scene

    def _dimension(self, file_kind: FileKind | None) -> int:
        """Number of coordinates of all places and vectors. Raises ValueError if it differs within the scene."""
        given: list[tuple[str, Any, int]] = [
            (f"body.{body.name}.mesh.shape", body.mesh.shape, body.mesh.dimension)
            for body in self.body
            if body.mesh.dimension
        ]
        given += [(key, list(value), len(value)) for key, value in _vectors(self)]
        if not given and file_kind:
            given = [
                (
                    f"body.{body.name}.mesh.{'file' if body.mesh.file else 'geometry'}",
                    body.mesh.file or body.mesh.geometry,
                    file_kind(body)[0],
                )
                for body in self.body
            ]
        first, value, dimension = given[0] if given else ("", "", 2)
        where = {
            d: f"{words}{f', as {first} = {value}' * bool(first)}" for d, words in WHERE.items()
        } | ({2: "around an axis, as axisymmetric = true"} if self.axisymmetric else {})
        for number, key, what in self._misplaced():
            if number != dimension:
                raise ValueError(f"{key}: {what}; this scene is {where[dimension]}")
        for key, other, number in given:
            if number != dimension:
                raise ValueError(
                    f"{key}: {other} is {WHERE[number]}, and {first} = {value} is {WHERE[dimension]}; a "
                    "scene has plane shapes and lists [x, y], or solid ones and lists [x, y, z]"
                )
        return dimension

    def _misplaced(self) -> Iterator[tuple[int, str, str]]:
        """Keys of one dimension only: the dimension, the key, and the reason."""
        for rigid in self.rigid:
            if rigid.only_in:
                others = [
                    shape.__struct_config__.tag
                    for shape in SURFACES
                    if shape.only_in != rigid.only_in
                ]
                yield (
                    rigid.only_in,
                    f"rigid.{rigid.name}.shape",
                    (
                        f"a {rigid.__struct_config__.tag} is a shape {WHERE[rigid.only_in]}; {WHERE[5 - rigid.only_in]} "
                        f"there are {', '.join(others)}"
                    ),
                )
            if "z" in (rigid.free or ()):
                yield 3, f"rigid.{rigid.name}.free", "there is no z in the plane"
            if isinstance(rigid.moment, float | int):
                yield (
                    2,
                    f"rigid.{rigid.name}.moment",
                    "a moment in space has three components, [x, y, z]",
                )
        for name in ("view", "cut"):
            if getattr(self.output, name) not in (None, True, False):
                yield (
                    3,
                    f"output.{name}",
                    "only pictures of solids have a view and a cut; leave it out",
                )
        if self.axisymmetric:
            yield 2, "axisymmetric", "axisymmetric bodies are drawn in the half-plane x >= 0"
        what = (
            "nothing is twisted around the axis"
            if self.axisymmetric
            else "there is no z in the plane"
        )
        for key, table in tables(self):
            along = getattr(table, "along", "")  # of a profile
            if along == "arc":
                yield (
                    2,
                    f"{key}.along",
                    'surfaces have no arc length; take a coordinate, such as along = "x"',
                )
            if isinstance(table, Traction) and table.moment is not None and self.axisymmetric:
                yield 3, f"{key}.moment", what
            elif isinstance(table, Traction) and isinstance(table.moment, float):
                yield 2, f"{key}.moment", "in space a moment is [Mx, My, Mz]"
            if isinstance(table, Motion):
                yield from ((3, f"{key}.free", what) for axis in table.free or () if axis == "z")
                if table.axis or isinstance(table.moment, tuple):
                    yield (
                        3,
                        f"{key}.{'axis' if table.axis else 'moment'}",
                        "in the plane turns are in it",
                    )
                elif table.turn or table.moment:
                    yield (
                        2,
                        f"{key}.turn",
                        "a turn in space has an axis, as in axis = [0.0, 0.0, 1.0]",
                    )
            if isinstance(table, Material):
                yield from (
                    (number, f"{key}.{name}", words)
                    for number, name, words in table.of_one_dimension(self.axisymmetric)
                )
            uses_z = {name: varies(getattr(table, name, None), "z") for name in FORMULAS} | {
                "z": getattr(table, "z", None) is not None,
                "z_slope": bool(getattr(table, "z_slope", None)),
                "along": along == "z",
            }
            yield from ((3, f"{key}.{name}", what) for name, used in uses_z.items() if used)
        bodies = {body.name: body for body in self.body}
        for contact in self.contact:
            planes = [(name, bodies[name].plane) for name in contact.bodies if name in bodies]
            if len({plane for _, plane in planes}) > 1:
                (one, its), (other, theirs) = planes
                yield (
                    3,
                    f"contact.{contact.called}.bodies",
                    (
                        f"{one!r} is in plane {its} and {other!r} in plane {theirs}; they cannot touch, so give both the "
                        "same material.plane"
                    ),
                )

    def _order(
        self, chosen: int | None, target: float | None, file_kind: FileKind | None
    ) -> tuple[int, list[BodySpec], str]:
        """The order that is `chosen`, else 2 for a `target`, else that of the files; and the bodies, with what the target
        has changed in words."""
        if chosen or not target:
            return chosen or self._order_of_files(file_kind), self.body, ""
        return 2, *_halved(self.body)

    def _order_of_files(self, file_kind: FileKind | None) -> int:
        """The order that all mesh files have; 1 if there are none, or none can be read. Raises ValueError if they differ."""
        if not file_kind:
            return 1
        orders = {
            f"body.{body.name}.mesh.file = {body.mesh.file}": file_kind(body)[1]
            for body in self.body
            if body.mesh.file is not None
        }
        if len(set(orders.values())) > 1:
            listed = ", ".join(f"{key} is of order {order}" for key, order in orders.items())
            one = " or ".join(map(str, sorted({*orders.values()})))
            raise ValueError(f"{listed}; say which one to use by mesh.order = {one}")
        return next(iter(orders.values()), 1)


def _halved(bodies: list[BodySpec]) -> tuple[list[BodySpec], str]:
    """The bodies whose elements an accuracy target makes quadratic, and what that changes, in words.

    Shapes have half their divisions, and nearly the nodes of linear elements, where all divisions of all shapes are
    even and leave two cells, and no mesh is from a file: matching meshes stay matching.
    """
    shapes = [body.mesh for body in bodies if body.mesh.divisions]
    files = any(body.mesh.file for body in bodies)
    words = "quadratic elements, as no mesh.order is named beside method.target_error"
    if files:
        words += "; new middles of sides of mesh files are on straight lines"
    if not shapes or files or any(k % 2 or k < 4 for mesh in shapes for k in mesh.divisions or ()):
        return bodies, words

    def half(mesh: MeshSpec) -> MeshSpec:
        return (
            replace(mesh, divisions=tuple(k // 2 for k in mesh.divisions))
            if mesh.divisions
            else mesh
        )

    return [replace(body, mesh=half(body.mesh)) for body in bodies], (
        f"{words}; shapes begin with half their divisions"
    )


def _vectors(scene: Scene) -> Iterator[tuple[str, tuple]]:
    """All places and vectors within a scene, each with its key."""
    for key, table in tables(scene):
        for name in table.__struct_fields__:
            value = getattr(table, name)
            if isinstance(value, tuple) and name not in EXTENTS:
                yield from (
                    (f"{key}.{name}", part)
                    for part in (value if isinstance(value[0], tuple) else [value])
                )


class Settled(Table, frozen=True, kw_only=True, dict=True):
    """A whole scene without optional keys, with all defaults, in the plane or in space."""

    title: str
    axisymmetric: bool
    body: list[SettledBody]
    rigid: list[Rigid]
    contact: list[SettledContact]
    history: dict[str, History]
    time: Time | None
    method: SettledMethod
    output: Output
    checkpoint: Checkpoint
    petsc: PETScOptions
    dimension: int
    aimed: str  # what a target has changed in the meshes, in words

    @cached_property
    def followed(self) -> list[str]:
        """Names of the histories that are used, in the order of the scene."""
        used = histories(self) if self.history else []
        return [name for name in self.history if name in used]

    @property
    def pushed(self) -> list[Rigid]:
        """The rigid partners with a contact that move as the forces on them want."""
        named = {contact.bodies[1] for contact in self.contact}
        return [rigid for rigid in self.rigid if rigid.yields and rigid.name in named]

    @property
    def bolts(self) -> list[SettledContact]:
        """The contacts with a pretension."""
        return [contact for contact in self.contact if contact.pretension]

    @property
    def tightened(self) -> dict[str, float]:
        """When the histories of pretensions end, by contact: from then on these keep their offsets."""
        return {
            contact.name: self.history[bolt.history].times[-1]
            for contact in self.contact
            if (bolt := contact.pretension) and bolt.history
        }

    @property
    def legs(self) -> list[float]:
        """The ends of legs in ascending order: the points, and between them kinks of used histories, the ends of those
        of pretensions, and those of cycles."""
        if self.time is None:
            return [1.0]
        kinks = {time for name in self.followed for time in self.history[name].kinks}
        kinks.update(self.tightened.values(), self.time.cycle_ends)
        return sorted(
            {*self.time.points, *(time for time in kinks if 0.0 < time < self.time.points[-1])}
        )

    def drawn(self, time: float, run: int) -> float:
        """The time in the histories of a `time` of a run with `run` cycles."""
        return float(self.time.cycle.drawn(time, run)) if self.time and self.time.cycle else time

    def factors(self, time: float) -> dict[str | None, float]:
        """The factors at `time` by history; 1 under None, for what has no history."""
        return {None: 1.0} | {name: self.history[name].at(time) for name in self.followed}

    @property
    def far(self) -> bool:
        """Whether bodies and rigid partners may move far."""
        return self.time is not None and self.time.motions == "far"

    def resolved(self) -> dict:
        """The scene as plain data. Written as TOML without the keys that are None, it is read as this scene again."""
        return {
            key: value
            for key, value in msgspec.to_builtins(self).items()
            if key not in ("dimension", "aimed")
        }

    @property
    def units(self) -> dict[str, str]:
        """`units` of the scene's quantities."""
        return units(
            {"output": msgspec.to_builtins(self.output), "axisymmetric": self.axisymmetric},
            self.dimension,
        )
