"""Types of one contact: its name, the two sides, what holds between them; and of rigid partners, which are surfaces
without mesh, material and rank."""

from __future__ import annotations

from typing import Annotated, Literal, get_args, get_type_hints

import msgspec

from ddmpi.scene.values import (
    Group,
    Name,
    NonNegative,
    Number,
    Point,
    Positive,
    Profile,
    SignedProfile,
    Table,
    settle,
)


class Coulomb(Table, frozen=True, kw_only=True, tag_field="law", tag="coulomb"):
    """Friction with the slip bound coefficient × contact pressure.

    Attributes
    ----------
    coefficient : of friction, a number or a profile
    """

    coefficient: NonNegative | Profile


class Tresca(Table, frozen=True, kw_only=True, tag_field="law", tag="tresca"):
    """Friction with a given slip bound, which holds at every contact node, open or not (as in the slides).

    Attributes
    ----------
    slip_bound : a stress (Pa), a number or a profile
    """

    slip_bound: NonNegative | Profile


class NoFriction(Table, frozen=True, kw_only=True, tag_field="law", tag="none"):
    """No friction: there are no tangential forces."""


class ContactSpec(Table, frozen=True, kw_only=True):
    """Two bodies that may touch, or a body and a rigid partner. Their meshes need not match; a side may overhang.

    Attributes
    ----------
    name : unique among contacts; left out, the names in bodies with a dash between
    bodies : two bodies, or a body and then a rigid partner; normals and forces of the results are the first one's
    on : a boundary group of each body, so only one if the partner is rigid
    kind : "bonded" neither parts nor slides
    friction : law of friction; left out, none
    gap : initial gap along the normal (m), positive open, negative an interference; left out, it is measured, on curved
        sides between the arcs over their chords
    pairing : "nodes" with nodes, or "mortar"; left out, by nodes where those of both sides match, else by (dual) mortar
    slave : with mortar, the body whose nodes carry the forces; left out, the one with the larger spacing of nodes over
        E/(1 − ν²)
    """

    name: Name | None = None
    bodies: tuple[Name, Name]
    on: Annotated[tuple[Group, ...], msgspec.Meta(min_length=1, max_length=2)]
    kind: Literal["unilateral", "bonded"] = "unilateral"
    friction: Coulomb | Tresca | NoFriction = NoFriction()
    gap: Number | SignedProfile | None = None
    pairing: Literal["nodes", "mortar"] | None = None
    slave: Name | None = None

    def __post_init__(self) -> None:
        if self.kind == "bonded" and not isinstance(self.friction, NoFriction):
            raise ValueError('friction does not go with kind = "bonded", which lets nothing slide; leave one of them '
                             "out")
        if self.slave is not None and self.pairing == "nodes":
            raise ValueError('slave does not go with pairing = "nodes", which has none; leave one of them out')

    def settled(self) -> SettledContact:
        """This contact under its name, which is by default the bodies' names with a dash."""
        return settle(self, SettledContact, name=self.name or default_name(self.bodies))


class SettledContact(ContactSpec, frozen=True, kw_only=True):
    """A contact without optional keys, but for a ``gap``, ``pairing`` or ``slave`` that is not given."""

    name: Name


LAWS = {str(law.__struct_config__.tag): {"law", *law.__struct_fields__}
        for law in get_args(get_type_hints(ContactSpec)["friction"])}
"""The keys of each law of friction."""


def default_name(bodies: tuple[str, ...] | list[str]) -> str:
    """The name of a contact between `bodies` that is given none."""
    return "-".join(bodies)


class Plane(Table, frozen=True, kw_only=True, tag_field="shape", tag="plane"):
    """A straight rigid surface.

    Attributes
    ----------
    name : unique among bodies and rigid partners
    point : any of its points (m)
    normal : points towards the bodies and has any length
    displacement : how it is moved (m); left out, not at all
    history : [history.NAME] whose factor multiplies the displacement
    """

    name: Name
    point: Point
    normal: Point
    displacement: Point | None = None
    history: Name | None = None

    def __post_init__(self) -> None:
        if not any(self.normal):
            raise ValueError("normal must not be zero; it points towards the bodies")


class Circle(Table, frozen=True, kw_only=True, tag_field="shape", tag="circle"):
    """A rigid disc that bodies touch from outside, or a bore that they touch from inside.

    Attributes
    ----------
    name : unique among bodies and rigid partners
    center : its centre (m)
    radius : its radius (m)
    inside : whether it is a bore
    displacement : how it is moved (m); left out, not at all
    history : [history.NAME] whose factor multiplies the displacement
    """

    name: Name
    center: Point
    radius: Positive
    inside: bool = False
    displacement: Point | None = None
    history: Name | None = None


class Sphere(Table, frozen=True, kw_only=True, tag_field="shape", tag="sphere"):
    """A rigid ball that bodies touch from outside, or a hollow that they touch from inside; in space.

    Attributes
    ----------
    name : unique among bodies and rigid partners
    center : its centre (m)
    radius : its radius (m)
    inside : whether it is a hollow
    displacement : how it is moved (m); left out, not at all
    history : [history.NAME] whose factor multiplies the displacement
    """

    name: Name
    center: Point
    radius: Positive
    inside: bool = False
    displacement: Point | None = None
    history: Name | None = None


class Cylinder(Table, frozen=True, kw_only=True, tag_field="shape", tag="cylinder"):
    """A rigid shaft that bodies touch from outside, or a bore that they touch from inside; in space, without ends.

    Attributes
    ----------
    name : unique among bodies and rigid partners
    point : any point of its axis (m)
    axis : along it, of any length
    radius : its radius (m)
    inside : whether it is a bore
    displacement : how it is moved (m); left out, not at all
    history : [history.NAME] whose factor multiplies the displacement
    """

    name: Name
    point: Point
    axis: Point
    radius: Positive
    inside: bool = False
    displacement: Point | None = None
    history: Name | None = None

    def __post_init__(self) -> None:
        if not any(self.axis):
            raise ValueError("axis must not be zero")


Rigid = Plane | Circle | Sphere | Cylinder
