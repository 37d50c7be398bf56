"""The scene: bodies, rigid partners, contacts and method, as a user writes them, and with all defaults.

`Scene` is the frozen data of a TOML file, which `checks` has looked at. Other rooms work with `Settled`.
"""

from __future__ import annotations

from functools import cached_property
from typing import Annotated

import msgspec
from msgspec.structs import replace

from ddmpi.errors import InputError
from ddmpi.scene.bodies import BodySpec, SettledBody
from ddmpi.scene.checks import mistakes
from ddmpi.scene.contacts import ContactSpec, Rigid, SettledContact
from ddmpi.scene.copies import TAKEN
from ddmpi.scene.derivable import refuse_underivable
from ddmpi.scene.dimension import FileKind, dimension_of
from ddmpi.scene.method import PRESETS, Method, SettledMethod
from ddmpi.scene.motions import Image
from ddmpi.scene.output import Checkpoint, Output, units
from ddmpi.scene.petsc import PETScOptions
from ddmpi.scene.results import refuse_unknown
from ddmpi.scene.time import History, Time
from ddmpi.scene.values import Name, Table, histories, settle


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
        for mistake in mistakes(self):
            raise ValueError(mistake)

    def settled(self, file_kind: FileKind | None = None) -> Settled:
        """The scene with all defaults.

        The order of the elements is that of a body that names one, else 2 for an accuracy target if linear triangles
        lock, else the preset's, else 2 for such a target, else that of the mesh files by `file_kind`, else 1. Where a
        target has made it 2, shapes have half their divisions if they can, see `_halved`. The dimension is that of
        shapes, else of places and vectors, else of the files.

        Raises ValueError for an accuracy target with elements that lock, for mesh files of different orders, and for
        different dimensions in one scene; and the errors of `file_kind`.
        """
        dimension = dimension_of(self, file_kind)
        method = self.method.settled(
            refinable=self.time is None
            and all(
                body.mesh.refinable and not (body.copy and body.mesh.drawn) for body in self.body
            )
        )
        order, bodies, aimed = self._order(method, file_kind)
        bonded = {contact.bodies[1] for contact in self.contact if contact.kind == "bonded"}
        scene = settle(
            self,
            Settled,
            method=method,
            dimension=dimension,
            aimed=aimed,
            body=[
                body.settled(order, dimension, self.axisymmetric, bool(method.target))
                for body in bodies
            ],
            rigid=[rigid.settled(dimension, rigid.name in bonded) for rigid in self.rigid],
            time=self.time.settled() if self.time else None,
            contact=[
                settle(contact, SettledContact, name=contact.called) for contact in self.contact
            ],
        )
        if self.output.derivatives:
            refuse_underivable(scene.resolved())
        refuse_unknown(scene)
        return scene

    def _order(
        self, method: SettledMethod, file_kind: FileKind | None
    ) -> tuple[int, list[BodySpec], str]:
        """The order of the elements; and the bodies, with what a target has changed in words."""
        named = next((body.mesh.order for body in self.body if body.mesh.order), None)
        chosen = named or PRESETS.get(method.preset or "", {}).get("order")
        target = method.aimed
        locking = next((body for body in self.body if target and body.locking_ratio), None)
        if locking and named == 1:
            raise ValueError(
                f"body.{locking.name}: linear elements lock at nu = {locking.locking_ratio:g}; "
                f"estimates of their error cannot be trusted, and no method.{target} can be met; leave "
                "mesh.order out or set it to 2"
            )
        if target and not chosen:
            return 2, *_halved(self.body, target)
        return 2 if locking else chosen or self._order_of_files(file_kind), self.body, ""

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


def _halved(bodies: list[BodySpec], target: str) -> tuple[list[BodySpec], str]:
    """The bodies whose elements a `target`, a key of the method, makes quadratic, and what that changes, in words.

    Shapes have half their divisions, and nearly the nodes of linear elements, where all divisions of all shapes are
    even and leave two cells, and no mesh is from a file: matching meshes stay matching.
    """
    shapes = [body.mesh for body in bodies if body.mesh.divisions]
    files = any(body.mesh.file for body in bodies)
    words = f"quadratic elements, as no mesh.order is named beside method.{target}"
    if files:
        words += "; new middles of sides of mesh files are on straight lines"
    if not shapes or files or any(k % 2 or k < 4 for mesh in shapes for k in mesh.divisions or ()):
        return bodies, words

    halved = list[BodySpec]()
    for body in bodies:
        divisions = body.mesh.divisions and tuple(k // 2 for k in body.mesh.divisions)
        halved.append(replace(body, mesh=replace(body.mesh, divisions=divisions)))
    return halved, f"{words}; shapes begin with half their divisions"


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

    def refuse_forceless(self) -> None:
        """Raise InputError for pretensions without a force, as `import` writes them: a check does without."""
        lacking = [
            f"contact.{bolt.name}.pretension"
            for bolt in self.bolts
            if bolt.pretension and bolt.pretension.force is None
        ]
        if lacking:
            raise InputError(
                f"{', '.join(lacking)}: force is missing, the tension of the bolt (N); write it into the line, as in "
                "pretension = { force = 10e3, along = … }"
            )

    @property
    def wheel(self) -> Image | None:
        """The turned image that makes the scene one sector of a wheel; None if there is none."""
        return next((one.image for one in self.contact if one.image and one.image.turn), None)

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
        data = msgspec.to_builtins(self)
        for body in data["body"]:
            for key in TAKEN if body["copy"] else ():
                del body[key]
        return {key: value for key, value in data.items() if key not in ("dimension", "aimed")}

    @property
    def units(self) -> dict[str, str]:
        """`units` of the scene's quantities."""
        materials = [{"material": msgspec.to_builtins([*body.materials])} for body in self.body]
        return units(
            {
                "output": msgspec.to_builtins(self.output),
                "axisymmetric": self.axisymmetric,
                "body": materials,
            },
            self.dimension,
        )
