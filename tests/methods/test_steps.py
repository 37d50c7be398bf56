"""Newton's step and state on dense compliances: a step is as long as helps, and a restored state is the whole one."""

import contextlib
import itertools
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import scipy.sparse as sparse
from mpi4py import MPI

import ddmpi.methods.newton
import ddmpi.methods.paths
from ddmpi.coupling.coarse import CoarseSystem, CrossPoints, Motions
from ddmpi.coupling.exchange import Exchange
from ddmpi.coupling.joint import Joint, Point
from ddmpi.coupling.space import Space
from ddmpi.interface.interface import Geometry, Interface, Places
from ddmpi.interface.law import BondedLaw, CoulombLaw
from ddmpi.judge.diagnosis import StatusLog
from ddmpi.methods.half_space import _inverse
from ddmpi.methods.newton import GAIN, LENGTHS, Newton
from ddmpi.methods.paths import InteriorPoints, Softening


class Dense:
    """A joint operator of two bodies that clamps hold, with the matrix C and the free gaps d."""

    members, bodies, e, dear, kept, still = (
        (),
        2,
        np.empty(0),
        False,
        np.empty(0, bool),
        np.empty(0),
    )
    load, D, offset, stiffens = 0.0, 0.0, 0.0, False
    closed, take, soften = Joint.closed, Joint.take, Joint.soften

    def __init__(
        self, C: np.ndarray, d: np.ndarray, coefficient: float, components: int = 1
    ) -> None:
        dimension, size = 1 + components, len(d)
        m = size // dimension
        nodes, alone = np.arange(m), sparse.identity(m, format="csr")
        xy = np.eye(1, dimension) * nodes[:, None]
        normal, *tangents = np.roll(np.eye(dimension), 1, axis=0)
        interface = Interface(
            name="seam",
            bodies=("upper", "lower"),
            geometry=Geometry(
                xy=xy,
                tangents=np.tile(tangents, (m, 1, 1)),
                area=np.ones(m),
                at=(xy, xy),
                facets=np.empty((0, dimension), int),
                laplacian=sparse.csr_matrix((m, m)),
            ),
            rows=Places((nodes, nodes), np.tile(normal, (m, 1)), np.zeros(m), (alone, alone)),
            law=CoulombLaw(m, nodes, components, np.full(m, coefficient)),
            modulus=1.0,
        )
        self.C, self.d, self.size, self.space, self.neglected = C, d, size, Space([interface]), 0.0
        self.steering, self.far = 1.0, False
        self.rigid = Motions(self.space, 0, ())
        self._m, self.exchange = m, SimpleNamespace(deferred=contextlib.nullcontext)

    def product(self, x, purpose, relative=None):
        return self.C @ x

    def multiplications(self) -> int:
        return 0

    def cross_points(self) -> CrossPoints:
        exchange = SimpleNamespace(
            total=lambda parts, about: np.zeros(self.size), world=MPI.COMM_SELF
        )
        return CrossPoints((), cast(Exchange, exchange), self.space)

    def shared(self) -> np.ndarray:
        return np.zeros(self.size, bool)

    def local(self) -> np.ndarray:
        return np.zeros(self.size)

    @property
    def rigid_moduli(self) -> np.ndarray:
        return np.empty(0)

    def at_rest(self) -> Point:
        return Point(np.zeros(self.size), -self.d, np.empty(0), np.empty(0))

    def imbalance(self, s, alpha) -> np.ndarray:
        return np.empty(0)

    def balances(self, left, size) -> bool:
        return True

    def first_closed(self) -> tuple[np.ndarray, np.ndarray]:
        return np.ones(self._m, bool), np.zeros(self._m, bool)


def random_joint(seed: int, m: int = 6, coefficient: float = 1.0, components: int = 1) -> Dense:
    rng, size = np.random.default_rng(seed), m * (1 + components)
    root = rng.standard_normal((size, size))
    return Dense(
        root @ root.T / m + 0.05 * np.eye(size), rng.standard_normal(size), coefficient, components
    )


def turned(joint: Dense, turns: np.ndarray) -> np.ndarray:
    """The matrix (size, size) that turns the tangents of each node by `turns` (m,), of a joint in space."""
    m, (cos, sin) = len(turns), (np.cos(turns), np.sin(turns))
    blocks = np.moveaxis(np.array([[cos, -sin], [sin, cos]]), 2, 0)
    return sparse.block_diag([sparse.identity(m), *blocks]).toarray()


@pytest.mark.every(3)
@pytest.mark.parametrize("path", [None, Softening])
@pytest.mark.parametrize("seed", range(5))
def test_friction_in_space_finds_its_direction(seed, path, monkeypatch):
    """Vectors of friction: few steps, by Newton's method or through a layer, and the same whatever the tangents are."""
    joint = random_joint(seed, m=10, coefficient=0.4, components=2)
    joint.C, joint.d[:10] = (
        joint.C + 2.0 * np.eye(30),
        np.abs(joint.d[:10]),
    )  # held well, so that the answer is one
    Q = turned(joint, np.random.default_rng(1).uniform(0.0, 6.0, 10))
    found = []
    if path:
        monkeypatch.setattr(ddmpi.methods.newton, "PATIENCE", 0)
        monkeypatch.setattr(ddmpi.methods.newton, "PATHS", (path,))
    for each in (joint, Dense(Q.T @ joint.C @ Q, Q.T @ joint.d, 0.4, components=2)):
        newton = Newton(each, 40)
        assert newton.run(1e-10) == "converged" and len(newton.history) <= (30 if path else 12)
        assert bool(newton.history[0].stage) == bool(path)
        found.append(newton.forces)
    s, r = found[0], joint.C @ found[0] - joint.d
    law = joint.space.interfaces[0].law
    assert s == pytest.approx(law.project(s - 3.0 * r), abs=1e-8)
    assert (np.linalg.norm(law.split(s)[1], axis=1) > 0.0).sum() > 3 and law.active_set(
        s - r
    ).excess.any()
    assert Q @ found[1] == pytest.approx(s, abs=1e-8)


@pytest.mark.parametrize("components", [1, 2])
def test_a_step_of_interior_points_is_newtons(components, monkeypatch):
    """Whatever the forces change by, a short step along t takes away the part t of what is left of s w = μ and of
    g y + s_t·v = 2μ, with the slip bound g that follows the pressure."""
    joint = random_joint(3, coefficient=0.4, components=components)
    path, rng = InteriorPoints(joint, np.full(joint.size, 0.5)), np.random.default_rng(2)
    m, law = joint.size // (1 + components), joint.space.interfaces[0].law
    path.point = path.point._replace(
        s=np.append(rng.uniform(1.0, 2.0, m), 0.1 * rng.standard_normal(m * components))
    )
    path._slip, path._steps = 0.1 * rng.standard_normal(path._slip.shape) * path._most, 1
    monkeypatch.setattr(ddmpi.methods.paths, "TO_BOUND", 1e-6)

    def products() -> np.ndarray:
        s = path.point.s
        rubs = (s[path._rows] * path._slip).sum(axis=1)
        return np.append(s[:m] * path._w[:m], (law.bound_at(s) * path._most[:, 0] + rubs) / 2.0)

    before, ds = products(), rng.standard_normal(joint.size)
    path.step(lambda *_: Point(ds, ds, joint.e, joint.e))
    assert not path.failed and path._last < 1e-4
    assert (products() - before) / path._last == pytest.approx(
        path._barrier - before, abs=1e-3 * before.max()
    )
    path._steps = ddmpi.methods.paths.MOST_POINTS - 1
    path.step(lambda *_: Point(ds, ds, joint.e, joint.e))
    assert path.failed  # however far there is left to go


@pytest.mark.parametrize("length", [1e-3, 1.0, 1e3])
def test_interior_points_begin_inside_their_cones_in_any_unit(length):
    """Slips are less than their bounds, also with friction so large that 2μ/g adds next to nothing to these."""
    joint = random_joint(3, coefficient=50.0, components=2)
    joint.d = length * joint.d
    path = InteriorPoints(joint, np.full(joint.size, 0.5))
    assert (np.linalg.norm(path._slip, axis=1) < path._most[:, 0]).all()


def test_the_coarse_problem_holds_motions_however_forces_follow_each_other():
    """Ẑ y + D a = h, with friction that follows pressure, so that S is not symmetric."""
    space, rng = random_joint(3).space, np.random.default_rng(4)
    size, number = space.size, 3
    motions = Motions(
        space, number, [(slice(0, size), np.arange(number), rng.standard_normal((size, number)))]
    )
    E, D, root = (
        np.eye(size) + 0.3 * rng.standard_normal((size, size)),
        rng.random(number),
        rng.random((size, size)),
    )
    coarse = CoarseSystem(
        motions,
        sparse.identity(size, format="csr"),
        sparse.csr_matrix(E),
        np.ones(size),
        lambda columns: root @ root.T @ columns,
        sparse.diags(D),
        np.zeros(number, bool),
        np.zeros((number, 0)),
    )
    h = rng.standard_normal(number)
    y, a = coarse.correct(rng.standard_normal(size), h)
    assert motions.sums(E @ y) + D * a == pytest.approx(h, rel=1e-8)


def test_softening_leaves_bonds_as_they_are():
    """The layer is between nodes that may open; one step closes a bond, C s = d."""
    joint = random_joint(3)
    (interface,) = joint.space.interfaces
    joint.space = Space([replace(interface, law=BondedLaw(6, np.arange(6), 1))])
    newton = Newton(joint, 40)
    path = Softening(joint, newton.preconditioner.c)
    station = next(path.points(partial(newton.direction, by=path.by)))
    assert station.point.s == pytest.approx(np.linalg.solve(joint.C, joint.d), rel=1e-2)


@pytest.mark.parametrize(("m", "seed"), [(6, 9), (6, 10), (10, 4), (10, 5), (10, 9)])
def test_no_step_makes_the_residual_larger(m, seed):
    """Full steps would, in these problems: up to sixfold."""
    misfits: list[float] = []  # (N), as the forces' present size does not count here
    newton = Newton(random_joint(seed, m), 60, lambda _: misfits.append(newton._at.misfit))
    assert newton.run(1e-8) == "converged"
    assert len(misfits) >= 5
    assert all(after <= before for before, after in itertools.pairwise(misfits))


def test_the_full_step_is_taken_where_it_gains_and_the_best_one_elsewhere():
    joint, norms, rng = random_joint(10), {}, np.random.default_rng(0)
    newton = Newton(joint, 60)
    assert newton.run(1e-10) == "converged"
    exact = newton.forces
    s = exact + rng.standard_normal(len(exact))
    at = newton._measured(Point(s, joint.C @ s - joint.d, joint.e, joint.e))

    def length(change: np.ndarray) -> float:
        step, ways = Point(change, newton.joint.C @ change, joint.e, joint.e), (*LENGTHS, 0.0)
        norms.update(zip(ways, newton._misfits(at.point.along(step, t) for t in ways), strict=True))
        norm, way = newton._length(at, step, GAIN)
        assert norm == norms[way]
        return way

    taken = [
        (
            length(far * (exact - s) + 0.1 * rng.standard_normal(len(s))),
            min(LENGTHS, key=norms.get),
            norms[1.0] <= GAIN * norms[0.0],
        )
        for far in np.linspace(0.2, 8.0, 40)
    ]
    assert len({best for _, best, gains in taken if not gains}) >= 4
    assert 0 < sum(gains for _, _, gains in taken) < 40
    assert all(chosen == (1.0 if gains else best) for chosen, best, gains in taken)


def test_the_inverse_of_products_leaves_out_what_depends_on_others():
    """Whatever the sizes of the directions; of two that are the same it takes both by halves."""
    sizes = np.diag([1e-6, 3.0, 1e5])
    gram = np.array([[2.0, 0.3, -0.4], [0.3, 1.5, 0.2], [-0.4, 0.2, 1.1]])
    found = sizes @ _inverse(sizes @ gram @ sizes) @ sizes
    assert found @ gram == pytest.approx(np.eye(3), abs=1e-9)
    assert _inverse(np.ones((2, 2))) == pytest.approx(np.full((2, 2), 0.25))


@pytest.mark.parametrize(
    ("laws", "smooth"),
    [
        ([(True, False)], True),
        ([(False, True)], True),
        ([(True, False), (False, True)], True),
        ([(False, False)], False),
        ([(True, False), (False, False)], False),
    ],
)
def test_no_node_slides_with_friction_where_each_contact_is_smooth_or_two_sided(laws, smooth):
    interfaces = [
        SimpleNamespace(law=SimpleNamespace(frictionless=one, two_sided=other), xy=np.empty((0, 2)))
        for one, other in laws
    ]
    space = SimpleNamespace(interfaces=interfaces, laws=SimpleNamespace(largest_slope=0.0))
    assert StatusLog(space).frictionless == smooth
