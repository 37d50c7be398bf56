"""A law of friction that the program does not have yet works by its class alone, in the plane and in space."""

from dataclasses import dataclass

import numpy as np
import pytest

import ddmpi
import ddmpi.coupling.assembly
import ddmpi.interface.rows
from ddmpi.interface.law import CoulombLaw, law_of

COHESION = 1e6


@dataclass(frozen=True)
class CohesiveLaw(CoulombLaw):
    """Its bound grows with the pressure, and holds open nodes as well."""

    name = "cohesive"

    cohesion: np.ndarray

    def slip_bound(self, pressure: np.ndarray) -> np.ndarray:
        return self.cohesion + super().slip_bound(pressure)


def above_a_floor(dimension: int) -> dict:
    """A block that only friction holds along x, over a gap. It is pulled to the right."""
    up = np.eye(dimension)[-1].tolist()
    shape, on = ("rectangle", ["top", "right"]) if dimension == 2 else ("box", ["top", "right"])
    clamp = {"on": on[0], "xyz"[dimension - 1]: 0.0} | ({"y": 0.0} if dimension == 3 else {})
    return {
        "body": [
            {
                "name": "block",
                "clamp": [clamp],
                "material": {"young": 1e9, "poisson": 0.3},
                "mesh": {
                    "shape": shape,
                    "size": [2.0] + (dimension - 1) * [1.0],
                    "origin": [0.01 * each for each in up],
                    "divisions": [8] + (dimension - 1) * [3],
                },
                "traction": [{"on": on[1], "value": [1e5] + (dimension - 1) * [0.0]}],
            }
        ],
        "rigid": [{"name": "floor", "shape": "plane", "point": dimension * [0.0], "normal": up}],
        "contact": [
            {
                "bodies": ["block", "floor"],
                "on": ["bottom"],
                "friction": {"law": "coulomb", "coefficient": 0.3},
            }
        ],
    }


@pytest.mark.parametrize("dimension", [2, 3])
def test_open_nodes_that_a_law_holds_resist(dimension, monkeypatch):
    """What only the friction of open nodes holds is not said to slide without any force; a warning names the law."""

    def cohesive(friction, xy, arc, area, sliding, *more):
        law = law_of(friction, xy, arc, area, sliding, *more)
        return CohesiveLaw(
            law.m,
            law.sliding,
            law.components,
            law.coefficient,
            COHESION * area[sliding],
            live=law.live,
        )

    monkeypatch.setattr(ddmpi.interface.rows, "law_of", cohesive)
    monkeypatch.setattr(ddmpi.coupling.assembly, "law_of", cohesive)
    answer = ddmpi.solve(above_a_floor(dimension))
    assert answer.certified and answer.summary["undetermined"] == []
    assert (answer.contacts["block-floor"].status == "open").all()
    assert answer.contacts["block-floor"].force[0] == pytest.approx(-1e5)
    assert any(
        'law = "cohesive" asks for no pressure' in each for each in answer.summary["warnings"]
    )
