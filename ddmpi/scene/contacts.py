"""Types of one contact: the two sides and the friction law."""

from __future__ import annotations

from ddmpi.scene.values import Name, NonNegative, Profile, Table


class Coulomb(Table, kw_only=True, tag_field="law", tag="coulomb"):
    """Slip bound = coefficient × contact pressure."""

    coefficient: NonNegative | Profile


class Tresca(Table, kw_only=True, tag_field="law", tag="tresca"):
    """Given slip bound (Pa), which holds at every contact node, open or not (as in the slides)."""

    slip_bound: NonNegative | Profile


class NoFriction(Table, kw_only=True, tag_field="law", tag="none"):
    """Tangential unknowns do not exist."""


class ContactSpec(Table, kw_only=True):
    """Two boundary groups that may touch; the first body takes role 1."""

    bodies: tuple[Name, Name]
    on: tuple[Name, Name]
    friction: Coulomb | Tresca | NoFriction = NoFriction()
