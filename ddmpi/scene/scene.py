"""The scene: bodies, contacts and method, as the user asks for them and with everything filled in.

`Scene` is the frozen data of a TOML file, and checks what does not fit together. `Settled` is what all other rooms
work with.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Annotated, Literal

import msgspec

from ddmpi.scene.bodies import BodySpec, SettledBody
from ddmpi.scene.contacts import ContactSpec, SettledContact
from ddmpi.scene.method import PRESETS, Checkpoint, Method, Output, SettledMethod
from ddmpi.scene.mistakes import nearest
from ddmpi.scene.values import Number, Table, settle

FileOrder = Callable[[BodySpec], Literal[1, 2]]
"""Gives the order of the elements in the mesh file of a body; raises InputError."""

PETScOptions = dict[str, str | int | Number | bool]


class Scene(Table, frozen=True, kw_only=True):
    """A whole scene as a user writes it."""

    title: str = ""
    body: Annotated[list[BodySpec], msgspec.Meta(min_length=1)]
    contact: list[ContactSpec]
    method: Method = Method()
    output: Output = Output()
    checkpoint: Checkpoint = Checkpoint()
    petsc: PETScOptions = {}

    def __post_init__(self) -> None:
        bodies = {body.name: body for body in self.body}
        contacts = [contact.settled() for contact in self.contact]
        for key, entries in ("body", self.body), ("contact", contacts):
            for name, number in Counter(entry.name for entry in entries).items():
                if number > 1:
                    raise ValueError(f'{key}.{name}: {number} [[{key}]] tables have this name; give each name = "…" of '
                                     "its own")
        for contact in contacts:
            key = f"contact.{contact.name}.bodies"
            for name in contact.bodies:
                if name not in bodies:
                    raise ValueError(f"{key}: there is no body {name!r}{nearest(name, list(bodies))} "
                                     f"(bodies: {', '.join(bodies)})")
            first, second = (bodies[name] for name in contact.bodies)
            if first is second:
                raise ValueError(f"{key}: names {first.name!r} twice; a contact is between two bodies")
            planes = first.material.plane, second.material.plane
            if planes[0] != planes[1]:
                raise ValueError(f"{key}: {first.name!r} is in plane {planes[0]} and {second.name!r} in plane "
                                 f"{planes[1]}; they cannot touch, so give both the same material.plane")
        if len({body.mesh.order for body in self.body} - {None}) > 1:
            raise ValueError("bodies have mesh.order 1 and 2; forces at their common nodes would mean different "
                             "pressures, so give all bodies the same")
        if (len(self.body), len(self.contact)) != (2, 1):  # no rule of scenes, but what the other rooms can do yet
            raise ValueError(f"this version solves two bodies with one contact; got {len(self.body)} [[body]] and "
                             f"{len(self.contact)} [[contact]]")

    def settled(self, file_order: FileOrder | None = None) -> Settled:
        """The scene with everything filled in that was left out.

        The order of the elements is that of a body that names one, else 2 for a ``target_error`` where linear triangles
        lock, else the preset's, else what `file_order` says of the mesh files, else 1.

        Raises ValueError if ``method.target_error`` is asked of elements whose error estimate cannot be trusted, and
        if mesh files differ in order; and what `file_order` raises.
        """
        method = self.method.settled(refinable=all(body.mesh.refinable for body in self.body))
        locking = [body for body in self.body if method.target_error and body.material.locks]
        named = next((body.mesh.order for body in self.body if body.mesh.order), None)
        if locking and named == 1:
            raise ValueError(f"body.{locking[0].name}: linear triangles lock at nu = {locking[0].material.poisson:g}; "
                             "estimates of their error cannot be trusted, and no method.target_error can be met; leave "
                             "mesh.order out or set it to 2")
        order = named or (2 if locking else PRESETS.get(method.preset or "", {}).get("order"))
        if not order:
            order = self._order_of_files(file_order) if file_order else 1
        return settle(self, Settled, method=method, body=[body.settled(order) for body in self.body],
                      contact=[contact.settled() for contact in self.contact])

    def _order_of_files(self, file_order: FileOrder) -> Literal[1, 2]:
        """The order that all mesh files have; 1 if there are none. Raises ValueError if they differ."""
        found = {f"body.{body.name}.mesh.file = {body.mesh.file}": file_order(body)
                 for body in self.body if body.mesh.file is not None}
        if len(set(found.values())) > 1:
            each = ", ".join(f"{key} is of order {order}" for key, order in found.items())
            raise ValueError(f"{each}; say which one to use by mesh.order = 1 or 2")
        return next(iter(found.values()), 1)


class Settled(Table, frozen=True, kw_only=True):
    """A whole scene without optional keys: everything that was left out is filled in."""

    title: str
    body: list[SettledBody]
    contact: list[SettledContact]
    method: SettledMethod
    output: Output
    checkpoint: Checkpoint
    petsc: PETScOptions

    def resolved(self) -> dict:
        """The scene as plain data. Written as TOML without the keys that are None, it is read as this scene again."""
        return msgspec.to_builtins(self)
