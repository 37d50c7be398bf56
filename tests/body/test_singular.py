"""Why a body's stiffness is too singular for double precision: the cause that is named is the one that is there."""

import pytest
from scenes import COULOMB, rectangle

import ddmpi
from ddmpi.errors import SolverError


def block(size=(1.0, 1.0), divisions=(3, 3), **more) -> dict:
    """A block under a rigid plane; its other keys."""
    body = {"clamp": ["bottom"], "traction": [{"on": "top", "value": [0.0, -1e5]}]} | more
    return {
        "body": [rectangle("block", (0.0, 0.0), size, divisions, **body)],
        "rigid": [
            {"name": "lid", "shape": "plane", "point": [0.0, size[1]], "normal": [0.0, -1.0]}
        ],
        "contact": [{"bodies": ["block", "lid"], "on": ["top"], "friction": COULOMB}],
    }


WEAK = {"on": "bottom", "normal": 0.3, "tangential": 0.3}
CAUSES = {
    "a solver that does not solve": (
        block() | {"petsc": {"body_pc_type": "none"}},
        "without -body_pc_type none it leaves",
    ),
    "weak foundations": (
        block(clamp=[], foundation=[WEAK]),
        "its foundations alone resist a rigid motion",
    ),
    "no volume change": (
        block(poisson=0.49999999999),
        "with Poisson's ratio 0.49999999999 it resists changes of volume",
    ),
    "slender": (block((1.0, 2e-4), (400, 1), clamp=["left"]), "as long as it is thick"),
}


@pytest.mark.parametrize("name", CAUSES)
def test_the_true_cause_is_named(name):
    """Options, foundations, Poisson's ratio and shape are told apart, each by what it does to the stiffness."""
    scene, words = CAUSES[name]
    with pytest.raises(SolverError, match=words) as caught:
        ddmpi.solve(scene)
    others = {other for _, other in CAUSES.values()} - {words}
    assert not [other for other in others if other in str(caught.value)]
