"""Derivatives of what rigid partners do, by motions and forces."""

from types import SimpleNamespace

import numpy as np
import pytest

from ddmpi.derive.results import _of_partner
from ddmpi.scene.results import named


def of(result: str) -> SimpleNamespace:
    """The functional of a result of the partner "jaw", which two motions drive, with two contacts of two entries."""
    driven = [
        SimpleNamespace(name=name, push=np.zeros(2), shift=lambda one, by=by: by * one[::-1])
        for name, by in (("jaw", 3.0), ("ram", 7.0))
    ]
    slices = {"jaw": slice(0, 2), "ram": slice(2, 4)}
    contacts = [
        (
            SimpleNamespace(bodies=("block", name), directions=np.array([[1.0, 2.0], [3.0, 4.0]])),
            part,
        )
        for name, part in (("jaw", slice(0, 2)), ("ram", slice(2, 4)))
    ]
    assembly = SimpleNamespace(
        space=SimpleNamespace(with_slices=lambda: iter(contacts)),
        joint=SimpleNamespace(driven=driven, slices=slices),
    )
    found = SimpleNamespace(partner="", motions=np.zeros(4), forces=np.zeros(4))
    _of_partner(assembly, found, named(result))
    return found


@pytest.mark.parametrize(("axis", "motions"), [("x", [0.0, 3.0]), ("y", [3.0, 0.0])])
def test_a_displacement_follows_the_motions_of_its_partner_alone(axis, motions):
    found = of(f"rigid.jaw.displacement.{axis}")
    assert found.partner == "jaw" and not found.forces.any()
    assert found.motions.tolist() == [*motions, 0.0, 0.0]


@pytest.mark.parametrize(("axis", "forces"), [("x", [1.0, 3.0]), ("y", [2.0, 4.0])])
def test_a_force_is_that_of_the_contacts_of_its_partner(axis, forces):
    found = of(f"rigid.jaw.force.{axis}")
    assert not found.partner and not found.motions.any()
    assert found.forces.tolist() == [*forces, 0.0, 0.0]
