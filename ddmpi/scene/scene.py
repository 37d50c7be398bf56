"""The scene: bodies, materials, loads, contact and method, as frozen data read from TOML.

Validation is msgspec's; what is added here is that a message names the file, the key as a user
would write it after ``--set``, and what would have been right.
"""

from __future__ import annotations

import msgspec

from ddmpi.scene.bodies import BodySpec
from ddmpi.scene.contacts import ContactSpec
from ddmpi.scene.method import PRESETS, Checkpoint, Method, Output
from ddmpi.scene.mistakes import nearest
from ddmpi.scene.values import Table


class Scene(Table, kw_only=True):
    """A whole scene; `resolved` gives it back as plain data with all defaults filled in."""

    title: str = ""
    body: list[BodySpec]
    contact: list[ContactSpec]
    method: Method = Method()
    output: Output = Output()
    checkpoint: Checkpoint = Checkpoint()
    petsc: dict[str, str | int | float | bool] = {}

    def __post_init__(self) -> None:
        names = [b.name for b in self.body]
        if len(names) != 2:
            raise ValueError(f"a scene has two [[body]] tables; got {len(names)}")
        if names[0] == names[1]:
            raise ValueError(f"the two bodies are both called {names[0]!r}; give them different names")
        if len(self.contact) != 1:
            raise ValueError(f"a scene has one [[contact]] table; got {len(self.contact)}")
        for name in self.contact[0].bodies:
            if name not in names:
                raise ValueError(f"contact.0.bodies names {name!r}, but the bodies are {', '.join(names)}"
                                 f"{nearest(name, names)}")
        if self.contact[0].bodies[0] == self.contact[0].bodies[1]:
            raise ValueError("contact.0.bodies names one body twice; contact is between two bodies")
        planes = {b.material.plane for b in self.body}
        if len(planes) > 1:
            raise ValueError("one body is in plane strain and the other in plane stress; they cannot touch")
        if len({b.mesh.order for b in self.body} - {None}) > 1:
            raise ValueError("the two bodies have mesh.order 1 and 2; forces at their common nodes would mean "
                             "different pressures, so give both the same")

    def settled(self) -> Scene:
        """With all that was left out filled in: what a preset says, and what follows from other keys.

        Raises ValueError where an accuracy is asked for that the elements named cannot be trusted with.
        """
        preset, method = PRESETS.get(self.method.preset, {}), self.method
        changes = {key: value for key, value in preset.items() if key != "order" and getattr(method, key) is None}
        if not all(b.mesh.refinable for b in self.body):
            changes.pop("target_error", None)  # a preset asks for what the meshes allow
        target = changes.get("target_error", method.target_error)
        if target and "tolerance" in changes:  # at least as tight as the target takes
            by_target = msgspec.structs.replace(method, target_error=target).resolved().tolerance
            changes["tolerance"] = min(changes["tolerance"], by_target)
        locking = [b for b in self.body if target and b.material.locks]
        named = next((b.mesh.order for b in self.body if b.mesh.order), None)
        if locking and named == 1:
            raise ValueError(f"body.{locking[0].name}: linear triangles lock at nu = {locking[0].material.poisson:g}; "
                             "estimates of their error cannot be trusted, and no method.target_error can be met; leave "
                             "mesh.order out or set it to 2")
        order = named or (2 if locking else preset.get("order", 1))
        body = [msgspec.structs.replace(b, mesh=msgspec.structs.replace(b.mesh, order=order)) for b in self.body]
        return msgspec.structs.replace(self, body=body, method=msgspec.structs.replace(method, **changes).resolved())

    def resolved(self) -> dict:
        return msgspec.to_builtins(self)
