"""Types of one contact: its name, the two sides, what holds between them."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from ddmpi.scene.values import Group, Name, NonNegative, Number, Profile, SignedProfile, Table, settle


class Coulomb(Table, frozen=True, kw_only=True, tag_field="law", tag="coulomb"):
    """Slip bound = coefficient × contact pressure."""

    coefficient: NonNegative | Profile


class Tresca(Table, frozen=True, kw_only=True, tag_field="law", tag="tresca"):
    """Given slip bound (Pa), which holds at every contact node, open or not (as in the slides)."""

    slip_bound: NonNegative | Profile


class NoFriction(Table, frozen=True, kw_only=True, tag_field="law", tag="none"):
    """Tangential unknowns do not exist."""


class ContactSpec(Table, frozen=True, kw_only=True):
    """Two bodies that may touch, or a body and a rigid partner, which then comes second.

    Normals and forces of the results are the first body's. ``on`` has a boundary group of each body, so only one if
    the partner is rigid. ``gap`` (m) is the initial one along the normal: positive is open, negative an interference.
    It is measured where it is None.

    ``pairing`` is by nodes where those of both sides match, else by mortar, whose rows stand at the nodes of the
    ``slave``: by default of the side with the larger spacing over plane modulus.
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


def default_name(bodies: tuple[str, ...] | list[str]) -> str:
    """The name of a contact between `bodies` that is given none."""
    return "-".join(bodies)
