"""Types of one contact: its name, the two sides and the friction law."""

from __future__ import annotations

from ddmpi.scene.values import Group, Name, NonNegative, Profile, Table, settle


class Coulomb(Table, frozen=True, kw_only=True, tag_field="law", tag="coulomb"):
    """Slip bound = coefficient × contact pressure."""

    coefficient: NonNegative | Profile


class Tresca(Table, frozen=True, kw_only=True, tag_field="law", tag="tresca"):
    """Given slip bound (Pa), which holds at every contact node, open or not (as in the slides)."""

    slip_bound: NonNegative | Profile


class NoFriction(Table, frozen=True, kw_only=True, tag_field="law", tag="none"):
    """Tangential unknowns do not exist."""


class ContactSpec(Table, frozen=True, kw_only=True):
    """Two boundary groups that may touch; normals and forces of the results are the first body's."""

    name: Name | None = None
    bodies: tuple[Name, Name]
    on: tuple[Group, Group]
    friction: Coulomb | Tresca | NoFriction = NoFriction()

    def settled(self) -> SettledContact:
        """This contact under its name, which is by default the bodies' names with a dash."""
        return settle(self, SettledContact, name=self.name or default_name(self.bodies))


class SettledContact(ContactSpec, frozen=True, kw_only=True):
    """A contact without optional keys."""

    name: Name


def default_name(bodies: tuple[str, ...] | list[str]) -> str:
    """The name of a contact between `bodies` that is given none."""
    return "-".join(bodies)
