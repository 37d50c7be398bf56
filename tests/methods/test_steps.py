"""Newton's step and state on dense compliances: a step is as long as helps, and a restored state is the whole one."""

import contextlib
import itertools

import numpy as np
import pytest
import scipy.sparse as sparse

from ddmpi.coupling.coarse import Motions
from ddmpi.coupling.space import Space
from ddmpi.interface.interface import Interface
from ddmpi.interface.law import CoulombLaw
from ddmpi.methods.newton import GAIN, LENGTHS, Newton
from ddmpi.methods.outer import Step
from ddmpi.methods.paths import Point


class Dense:
    """A joint operator of two bodies that clamps hold, with the matrix C and the free gaps d."""

    members, bodies, e = (), 2, np.empty(0)

    def __init__(self, C: np.ndarray, d: np.ndarray, coefficient: float) -> None:
        m = len(d) // 2
        nodes, alone = np.arange(m), sparse.identity(m, format="csr")
        interface = Interface(
            name="seam", bodies=("upper", "lower"), xy=np.column_stack([np.arange(m), np.zeros(m)]),
            frame=np.tile([[0.0, -1.0], [1.0, 0.0]], (m, 1, 1)), area=np.ones(m), gap=np.zeros(m),
            nodes=(nodes, nodes), transfer=(alone, alone), law=CoulombLaw(m, nodes, 1, np.full(m, coefficient)),
            modulus=1.0, joined=np.ones(m - 1, bool), edges=np.empty((0, 3), int), held=np.zeros(m),
            one_sided=np.zeros(2 * m, bool), prescribed=np.zeros(2 * m))
        self.C, self.d, self.size, self.space, self.neglected = C, d, 2 * m, Space([interface]), 0.0
        self.rigid, self.shared = Motions(self.space, 0, ()), np.zeros(2 * m, bool)

    def product(self, x, purpose, relative=None):
        return self.C @ x

    def multiplications(self) -> int:
        return 0

    def rigid_moduli(self) -> np.ndarray:
        return np.empty(0)

    def imbalance(self, s) -> np.ndarray:
        return np.empty(0)

    def first_closed(self) -> np.ndarray:
        return np.ones(self.size // 2, bool)

    deferred = contextlib.nullcontext


def random_joint(seed: int, m: int = 6, coefficient: float = 1.0) -> Dense:
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((2 * m, 2 * m))
    return Dense(root @ root.T / m + 0.05 * np.eye(2 * m), rng.standard_normal(2 * m), coefficient)


def residuals(newton: Newton) -> list[float]:
    """Norms of the residual (N) before every step, for the forces' present size does not count here."""
    found: list[float] = []
    newton.checkpoint = lambda: found.extend(newton._distances([newton._at]))
    assert newton.run(1e-8) == "converged"
    return found


@pytest.mark.parametrize(("m", "seed"), [(6, 9), (6, 10), (10, 4), (10, 5), (10, 9)])
def test_no_step_makes_the_residual_larger(m, seed):
    """Full steps would, in these problems: up to sixfold."""
    _, *others = residuals(Newton(random_joint(seed, m), 60))
    assert len(others) >= 4
    assert all(after <= before for before, after in itertools.pairwise(others))


def test_the_full_step_is_taken_where_it_gains_and_the_best_one_elsewhere():
    joint, norms, rng = random_joint(10), {}, np.random.default_rng(0)
    newton = Newton(joint, 60)
    assert newton.run(1e-10) == "converged"
    exact = newton.forces
    s = exact + rng.standard_normal(len(exact))
    newton._at = at = Point(s, joint.C @ s - joint.d, joint.e, joint.e)

    def length(change: np.ndarray) -> float:
        step, ways = Point(change, newton.joint.C @ change, joint.e, joint.e), (*LENGTHS, 0.0)
        norms.update(zip(ways, newton._distances(at.along(step, t) for t in ways), strict=True))
        norm, way = newton._length(norms[0.0], step)
        assert norm == norms[way]
        return way

    taken = [(length(far * (exact - s) + 0.1 * rng.standard_normal(len(s))), min(LENGTHS, key=norms.get),
              norms[1.0] <= GAIN * norms[0.0]) for far in np.linspace(0.2, 8.0, 40)]
    assert len({best for _, best, gains in taken if not gains}) >= 4
    assert 0 < sum(gains for _, _, gains in taken) < 40
    assert all(chosen == (1.0 if gains else best) for chosen, best, gains in taken)


def test_newton_goes_on_from_its_whole_state():
    """What is restored is what the state held, entry by entry; no entry is as in a new iteration."""
    state = {"s": np.arange(12.0), "r": np.arange(12.0) - 5.0, "alpha": np.arange(3.0), "left": -np.arange(3.0),
             "start": False, "warm": True, "least": 2.5, "settled": True, "error": 0.25, "far": 0.5, "norm": 3.0,
             "stalled": 4, "smallest": 0.125, "inner_steps": {"gmres": 7},
             "history": [Step(1, 0.5, 0.25, 1e-3, 12)[:5]]}
    new, fresh = Newton(random_joint(0), 60), Newton(random_joint(0), 60)
    new.restore(state)
    assert flat(new.state()) == flat(state)
    assert new._stalled == 4
    other = flat(fresh.state())
    assert not [name for name, value in flat(state).items() if value == other[name]]
    assert not set(flat(state)) ^ set(other)


def flat(state: dict, name: str = "") -> dict:
    """Values by dotted names, arrays as lists."""
    found = {}
    for key, value in state.items():
        if isinstance(value, dict):
            found |= flat(value, f"{name}{key}.")
        else:
            found[name + key] = value.tolist() if isinstance(value, np.ndarray) else value
    return found
