"""A body at its interfaces: held or loose, touching something or nothing."""

from collections.abc import Sequence
from types import SimpleNamespace

import boundaries
import numpy as np
import pytest
import scipy.sparse as sparse
from by_skfem import to_scipy

import ddmpi.coupling.factored
from ddmpi.body.elasticity import Elasticity, assemble
from ddmpi.coupling.factored import Factored
from ddmpi.coupling.member import Member
from ddmpi.coupling.sides import Sides
from ddmpi.interface.interface import Places
from ddmpi.kept.kept import Kept
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import BodySpec, Clamp, Material, MeshSpec, Traction

YOUNG, POISSON = 2e11, 0.3
LOADS = {"right": (3e6, -1e6), "left": (1e6, 2e6), "bottom": (-5e5, 4e6)}

CLAMPS = {
    "loose": [],
    "slides along x": [Clamp(on="bottom", y=0.0)],
    "slides along y": [Clamp(on="left", x=1e-5)],
    "slides and turns": [Clamp(on="bottom", x=0.0)],
    "turns about a corner": [Clamp(on="bottom", x=0.0), Clamp(on="left", y=0.0)],
}
"""3, 1, 1, 2 and 1 motions are left."""

FACES = {"a side": ["top"], "two sides": ["top", "right"], "nothing": []}


def displaced(body: Member, *arguments) -> tuple[np.ndarray, float]:
    """The displacement, and what it leaves of the equilibrium relative to what acts."""
    u, left, acting, _ = body.displacement(*arguments)
    return u, left / acting if acting else 0.0


def rectangle(divisions=(9, 3), order=1) -> Mesh:
    return boundaries.rectangle(divisions, (3.0, 1.0), order=order)


def elastic(mesh: Mesh, clamp: Sequence = (), loads=LOADS) -> Elasticity:
    traction = [Traction(on=on, value=value) for on, value in loads.items()]
    return assemble(
        mesh,
        BodySpec(
            name="block",
            mesh=MeshSpec(file="unused.msh"),
            clamp=list(clamp),
            material=Material(young=YOUNG, poisson=POISSON),
            traction=traction,
        ),
    )


def touch(
    mesh: Mesh, group: str, number: int | None = None, friction: bool = True
) -> SimpleNamespace:
    """A stand-in for an interface at a side of the rectangle, or at some of its nodes."""
    ends = mesh.points[mesh.groups[group][0, :2]]
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    nodes = np.unique(mesh.groups[group])
    nodes = nodes[np.argsort(mesh.points[nodes] @ along)][:number]
    normal = np.array([along[1], -along[0]])
    normal *= np.sign(normal @ (ends[0] - mesh.points.mean(axis=0)))
    m = len(nodes)
    sliding = np.arange(m if friction else 0)
    directions = np.vstack(
        [np.tile(normal, (m, 1)), np.tile([-normal[1], normal[0]], (len(sliding), 1))]
    )
    identity = sparse.identity(m, format="csr")
    return SimpleNamespace(
        name=group,
        dimension=2,
        size=m + len(sliding),
        m=m,
        rows=Places((nodes, nodes), directions[:m], np.zeros(m), (identity, identity)),
        directions=directions,
        sliding=sliding,
        sides=lambda body: (0,),
        image=None,
        normal=directions[:m],
        law=SimpleNamespace(node=np.append(np.arange(m), sliding)),
        fixed=SimpleNamespace(
            nodes=(np.empty(0, int),) * 2, normal=np.empty((0, 2)), gap=np.empty(0)
        ),
    )


def member(
    mesh: Mesh, problem: Elasticity, faces: Sequence[str], kind: str | None = None, **rest
) -> Member:
    interfaces = [touch(mesh, group, **rest) for group in faces]
    body = Factored("block", problem, Sides("block", interfaces).rows(problem), kind)
    body.factor(Kept())
    return Member(body, interfaces)


def multiplied(body: Member) -> np.ndarray:
    """C column by column, by `mult`."""
    C = np.empty((body.C.size, body.C.size))
    for column, unit in zip(C.T, np.eye(body.C.size), strict=True):
        y = np.empty(body.C.size)
        body.mult(unit, y, "newton")
        column[:] = y
    return C


def balancing(body: Member, seed: int = 0) -> np.ndarray:
    """Contact forces with G s = e, as large as the load, otherwise arbitrary."""
    s = np.random.default_rng(seed).standard_normal(body.C.size) * np.linalg.norm(
        body.elasticity.b.array_r
    )
    return s - np.linalg.pinv(body.G) @ (body.G @ s - body.e)


def large(x: np.ndarray) -> float:
    return float(np.abs(x).max(initial=0.0))


@pytest.mark.every(7)
@pytest.mark.parametrize(
    "order, kind", [(1, "explicit"), (2, "explicit"), (1, "direct"), (1, "iterative")]
)
@pytest.mark.parametrize("faces", FACES.values(), ids=FACES)
@pytest.mark.parametrize("clamp", CLAMPS.values(), ids=CLAMPS)
def test_loose_body_against_dense_algebra(clamp, faces, order, kind):
    """C, h and the displacement are those of the pseudo-inverse of A, centred: P C P, P(h − C Gᵀ(GGᵀ)⁺e)."""
    mesh = rectangle(order=order)
    problem = elastic(mesh, clamp)
    body = member(mesh, problem, faces, kind)
    inverse = np.linalg.pinv(to_scipy(problem.A).toarray(), rcond=1e-11)
    B, b = body.C.B.toarray(), problem.b.array_r
    R = problem.motions[problem.nodes].reshape(len(b), -1)
    G = R.T @ B.T
    C, to_e = B @ inverse @ B.T, np.linalg.pinv(G, rcond=1e-10)
    P = np.eye(len(B)) - to_e @ G
    h = P @ (B @ inverse @ b - C @ to_e @ (R.T @ b)) + body.trace(problem.acting.prescribed)
    precision = 1e-8 if kind == "iterative" else 1e-10

    assert large(body.G - G) <= 1e-13
    assert body.e == pytest.approx(R.T @ b, abs=1e-12 * large(b))
    assert large(multiplied(body) - P @ C @ P) <= precision * large(C)
    assert large(body.h - h) <= precision * large(inverse @ b)


@pytest.mark.parametrize("kind", ["explicit", "direct", "iterative"])
@pytest.mark.parametrize("clamp", CLAMPS.values(), ids=CLAMPS)
def test_displacement_of_a_loose_body(clamp, kind):
    """B u = h − C s + Gᵀα wherever G s = e; clamped dofs stay where they are prescribed; α moves it rigidly."""
    mesh = rectangle()
    problem = elastic(mesh, clamp)
    body = member(mesh, problem, ["top", "right"], kind)
    s, alpha, Cs = (
        balancing(body),
        1e-3 * np.array([1.0, -2.0, 3.0])[: len(body.e)],
        np.empty(body.C.size),
    )
    body.mult(s, Cs, "newton")
    u, residual = displaced(body, s, alpha)
    assert residual <= 1e-11
    assert large(body.trace(u) - (body.h - Cs + body.G.T @ alpha)) <= 1e-9 * large(u)
    assert np.array_equal(u[~problem.free], problem.acting.prescribed[~problem.free])
    still, residual = displaced(body, s)
    assert residual <= 1e-11
    assert u - still == pytest.approx(body.motions @ alpha, abs=1e-15)


@pytest.mark.parametrize("share", [1e-6, 1e-3, 1.0])
def test_residual_sees_an_imbalance(share):
    """Contact forces that do not balance the load leave a residual, as large as what they miss."""
    mesh = rectangle()
    body = member(mesh, elastic(mesh), ["top"])
    s = balancing(body)
    for motion in body.G:
        off = share * np.linalg.norm(s) * motion / np.linalg.norm(motion)
        _, residual = displaced(body, s + off)
        assert 0.01 * share <= residual <= 2 * share


def other_supports(motions: np.ndarray) -> np.ndarray:
    """Dofs near each other, where `support` takes them far apart."""
    chosen: list[int] = []
    rows = motions.reshape(-1, motions.shape[2])
    for dof in range(len(rows) // 2, len(rows)):
        if np.linalg.matrix_rank(rows[[*chosen, dof]], 1e-6) > len(chosen):
            chosen.append(dof)
    return np.array(chosen[: motions.shape[2]])


@pytest.mark.every(5)
@pytest.mark.parametrize(
    "faces, rest",
    [
        (["top", "right"], {}),
        (["top"], {"friction": False}),
        (["top"], {"number": 1}),
        (["top"], {"number": 2}),
        (["top"], {"number": 1, "friction": False}),
        ([], {}),
    ],
    ids=["two sides", "no friction", "one node", "two nodes", "one node, no friction", "nothing"],
)
@pytest.mark.parametrize("clamp", CLAMPS.values(), ids=CLAMPS)
def test_nothing_depends_on_the_supports(clamp, faces, rest, monkeypatch):
    """Even where the contact does not see all motions, and the load cannot be balanced."""
    mesh = rectangle((27, 9))
    problem, found, chosen = elastic(mesh, clamp), [], []
    for choice in (ddmpi.coupling.factored.support, other_supports):
        chosen.append(choice(problem.motions[problem.nodes]))
        monkeypatch.setattr(ddmpi.coupling.factored, "support", choice)
        body = member(mesh, problem, faces, **rest)
        s = np.random.default_rng(1).standard_normal(body.C.size)
        found.append((multiplied(body), body.h, *displaced(body, s)))
    assert set(chosen[0]) != set(chosen[1])
    for one, other in zip(*found, strict=True):
        assert large(np.asarray(one) - other) <= 1e-10 * max(large(np.asarray(one)), 1e-11)
