"""Assemblies by brute force: what the package's answers are measured against.

Reads a scene as a plain dict with the keys of the TOML file, and solves the coupled discrete problem in its primal
form, displacements and contact forces together, by dense factorisations in one process. Nothing of the package is
used. Structured linear triangles, pairing by position, rigid planes; loads and clamps that are constant; one load step.

    solution = solve(scene)
    distance(solution, answer)          # answer = ddmpi.solve(text)

Signs: a contact's row counts B u = u¹·ν¹ + u²·ν² (and the same with t), r = gap − B u is the opening, and bodies obey
A u + Bᵀ s = b. A force obeys its law when s_ν = max(0, s_ν − c r_ν) and s_t = P(s_t − c r_t), P the projection on
|s_t| ≤ g. Tresca's g holds at open nodes as well.
"""

from __future__ import annotations

import itertools
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sparse
from scipy.optimize import linprog
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

SIDES = ("bottom", "right", "top", "left")

MATCHING = 1e-9
"""Largest distance of paired nodes, and largest gap that counts as zero, as a fraction of the spacing."""

LOOSE = 1e-6
"""Springs that hold loose bodies, over E' of the body. They stand in the matrix of a Newton step only and leave the
equations as they are; without them a step is singular where motions are undetermined."""

REDUNDANT = 5e-4
"""Compliance of rows whose nodes belong to several contacts, over 1/c; it too stands in the matrix only."""

PRECISE = 1e-10
"""Residual over the largest force at which a problem is solved."""

ROUNDING = 1e-13
"""Residual over c times the largest displacement that is rounding."""

INFEASIBLE = 1e-7
"""Share of the loads on loose bodies that must stay without balance for a scene to have no equilibrium."""


# One body


@dataclass
class Body:
    """One body on its structured mesh.

    Attributes
    ----------
    points : (nv, 2) nodes (m)
    groups : nodes of each side, in the order of the corners
    A : (2 nv, 2 nv) stiffness, no dof clamped; x of node i is 2i
    b : (2 nv,) loads (N)
    prescribed : (2 nv,) displacement of clamped dofs (m), nan where a dof is free
    modulus : E' (Pa), that of plane strain or stress
    """

    name: str
    points: np.ndarray
    groups: dict[str, np.ndarray]
    A: sparse.csc_matrix
    b: np.ndarray
    prescribed: np.ndarray
    modulus: float

    @property
    def free(self) -> np.ndarray:
        return np.isnan(self.prescribed)

    def rigid_motions(self) -> np.ndarray:
        """(2 nv, k) rigid motions that the clamps leave, orthonormal."""
        x = self.points - self.points.mean(axis=0)
        R = np.zeros((self.b.size, 3))
        R[::2, 0] = R[1::2, 1] = 1.0
        R[::2, 2], R[1::2, 2] = -x[:, 1], x[:, 0]
        R /= np.linalg.norm(R, axis=0)
        _, values, V = np.linalg.svd(np.vstack([R[~self.free], np.zeros((3, 3))]))  # full: V is (3, 3)
        return np.linalg.qr(R @ V[values < 1e-10].T)[0]


def build(spec: dict[str, Any]) -> Body:
    """The body of a [[body]] table."""
    points, triangles, groups = _mesh(spec["mesh"])
    young, poisson = spec["material"]["young"], spec["material"]["poisson"]
    stress = spec["material"].get("plane", "strain") == "stress"
    mu = young / (2 * (1 + poisson))
    lam = young * poisson / (1 - poisson**2) if stress else young * poisson / ((1 + poisson) * (1 - 2 * poisson))
    a, b, c = (points[triangles[:, i]] for i in range(3))
    twice = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    assert (twice > 0).all(), "corners must run counterclockwise"
    opposite = np.stack([c - b, a - c, b - a], axis=1)
    gradient = np.stack([-opposite[:, :, 1], opposite[:, :, 0]], axis=2) / twice[:, None, None]  # (nt, corner, 2)
    strain = np.zeros((len(triangles), 3, 6))
    strain[:, 0, ::2] = strain[:, 2, 1::2] = gradient[:, :, 0]
    strain[:, 1, 1::2] = strain[:, 2, ::2] = gradient[:, :, 1]
    hooke = np.array([[lam + 2 * mu, lam, 0], [lam, lam + 2 * mu, 0], [0, 0, mu]])
    local = np.einsum("tki,kl,tlj,t->tij", strain, hooke, strain, twice / 2)
    dofs = (2 * triangles[:, :, None] + np.arange(2)).reshape(-1, 6)
    size = 2 * len(points)
    A = sparse.csc_matrix((local.ravel(), (np.repeat(dofs, 6, axis=1).ravel(), np.tile(dofs, 6).ravel())), (size, size))

    load, prescribed = np.zeros((len(points), 2)), np.full((len(points), 2), np.nan)
    force = np.array(spec.get("volume_force", [0.0, 0.0]), float)
    np.add.at(load, triangles.ravel(), np.repeat(twice / 6, 3)[:, None] * force)
    for traction in spec.get("traction", []):
        nodes = groups[traction["on"]]
        along = np.diff(points[nodes], axis=0)
        if "pressure" in traction:  # along the inner normal; the body lies to the left
            value = traction["pressure"] * np.column_stack([-along[:, 1], along[:, 0]])
        else:
            value = np.linalg.norm(along, axis=1)[:, None] * np.array(traction["value"], float)
        for end in nodes[:-1], nodes[1:]:
            np.add.at(load, end, value / 2)
    for clamp in spec.get("clamp", []):
        clamp = {"on": clamp, "x": 0.0, "y": 0.0} if isinstance(clamp, str) else clamp
        for i, component in enumerate("xy"):
            if component in clamp:
                prescribed[groups[clamp["on"]], i] = clamp[component]
    modulus = young if stress else young / (1 - poisson**2)
    return Body(spec["name"], points, groups, A, load.ravel(), prescribed.ravel(), modulus)


def _mesh(spec: dict[str, Any]) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Points, triangles and groups: nodes at equal parameters, cells cut from the first to the third corner."""
    nx, ny = spec["divisions"]
    if spec["shape"] == "rectangle":
        (x, y), (w, h) = spec.get("origin", [0.0, 0.0]), spec["size"]
        corners = np.array([[x, y], [x + w, y], [x + w, y + h], [x, y + h]], float)
    else:
        assert spec["shape"] == "quadrilateral", spec["shape"]
        corners = np.array(spec["corners"], float)
    s, t = (each[..., None] for each in np.meshgrid(np.arange(nx + 1) / nx, np.arange(ny + 1) / ny, indexing="ij"))
    grid = (1 - s) * (1 - t) * corners[0] + s * (1 - t) * corners[1] + s * t * corners[2] + (1 - s) * t * corners[3]
    number = np.arange(grid.shape[0] * grid.shape[1]).reshape(grid.shape[:2])
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    triangles = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    groups = dict(zip(SIDES, (number[:, 0], number[-1], number[::-1, -1], number[0, ::-1]), strict=True))
    return grid.reshape(-1, 2), triangles, groups


# Contacts


@dataclass
class Pair:
    """A contact node: its rows, and what its law says.

    Attributes
    ----------
    nodes : of the first and the second body; the second one of a rigid partner is −1
    frame : (2, 2) outer normal and tangent of the first body
    offset : (2,) initial gap, and what a rigid partner's displacement takes from the rows (m)
    length : nodal length of the part that both sides have in common (m)
    held : (2,) bool, rows along which clamps hold both sides
    """

    contact: int
    nodes: tuple[int, int]
    frame: np.ndarray
    offset: np.ndarray
    length: float
    held: np.ndarray


def pairs_of(number: int, contact: dict[str, Any], bodies: dict[str, Body], rigid: dict[str, dict]) -> list[Pair]:
    """The pairs of a [[contact]] table; those that clamps hold altogether are left out."""
    first, nodes = bodies[contact["bodies"][0]], bodies[contact["bodies"][0]].groups[contact["on"][0]]
    xy = first.points[nodes]
    normal = _outward(xy)
    steps = np.linalg.norm(np.diff(xy, axis=0), axis=1)
    partner, displacement = contact["bodies"][1], np.zeros(2)
    free = [first.free.reshape(-1, 2)[nodes]]
    if partner in rigid:
        plane = rigid[partner]
        assert plane["shape"] == "plane", "rigid circles are not implemented"
        inner = np.array(plane["normal"], float) / np.linalg.norm(plane["normal"])
        normal, displacement = -inner, np.array(plane.get("displacement", [0.0, 0.0]), float)
        match, gap = np.full(len(nodes), -1), (xy - np.array(plane["point"], float)) @ inner
        found, common = np.ones(len(nodes), bool), np.ones(len(nodes) - 1, bool)
        free.append(np.zeros((len(nodes), 2), bool))
    else:
        second = bodies[partner]
        others = second.groups[contact["on"][1]]
        distance, place = cKDTree(second.points[others]).query(xy)
        found, match = distance <= MATCHING * steps.min(), others[place]
        common = found[:-1] & found[1:] & (np.abs(np.diff(place)) == 1)
        normal = normal - _outward(second.points[others])
        normal, gap = normal / np.linalg.norm(normal), np.zeros(len(nodes))
        free.append(second.free.reshape(-1, 2)[match])
    if "gap" in contact:
        gap = np.full(len(nodes), float(contact["gap"]))
    gap[np.abs(gap) <= MATCHING * steps.min()] = 0.0
    if contact.get("kind") == "bonded" and "gap" not in contact:
        gap[:] = 0.0
    length = (np.r_[0.0, steps * common] + np.r_[steps * common, 0.0]) / 2
    spacing = (np.r_[steps[0], steps] + np.r_[steps, steps[-1]]) / 2
    frame = np.array([normal, [-normal[1], normal[0]]])
    found_pairs = []
    for k in np.flatnonzero(found):
        held = np.array([all(_is_held(direction, each[k]) for each in free) for direction in frame])
        if not (held.all() or (held[0] and contact.get("kind") != "bonded")):
            offset = np.array([gap[k], 0.0]) + frame @ displacement  # r = gap − B u, and B counts −ν¹ on the partner
            found_pairs.append(Pair(number, (int(nodes[k]), int(match[k])), frame, offset,
                                    float(length[k] or spacing[k]), held))
    return found_pairs


def _outward(xy: np.ndarray) -> np.ndarray:
    """Outer unit normal of a straight side, walked with the body to the left."""
    along = xy[-1] - xy[0]
    return np.array([along[1], -along[0]]) / np.linalg.norm(along)


def _is_held(direction: np.ndarray, free: np.ndarray) -> bool:
    """Whether clamps take the motion along `direction`; of two, the one nearest to a free component stays."""
    return bool(not free.any() or (not free.all() and np.linalg.norm(direction * free) < np.sqrt(0.5) - 1e-9))


# All bodies together


class Assembly:
    """The coupled problem, condensed to the dofs that contacts and corners have.

    A row's force s, opening r and stiffness c are arrays over the rows; `normal` numbers the rows along normals, and
    `follows` says for each tangential row which row is its node's normal one.
    """

    def __init__(self, scene: dict[str, Any]) -> None:
        self.scene = scene
        self.bodies = {spec["name"]: build(spec) for spec in scene["body"]}
        rigid = {spec["name"]: spec for spec in scene.get("rigid", [])}
        self.pairs = [pair for number, contact in enumerate(scene.get("contact", []))
                      for pair in pairs_of(number, contact, self.bodies, rigid)]
        self._condense()
        self._rows()

    def _owners(self, pair: Pair) -> list[tuple[str, int, float]]:
        """Body, node and sign of both sides; a rigid partner has none."""
        names = self.scene["contact"][pair.contact]["bodies"]
        sides = zip(names, pair.nodes, (1.0, -1.0), strict=True)
        return [(name, node, sign) for name, node, sign in sides if node >= 0]

    def _condense(self) -> None:
        touched: dict[str, set[int]] = {name: set() for name in self.bodies}
        for pair in self.pairs:
            for name, node, _ in self._owners(pair):
                touched[name].add(node)
        self.number: dict[tuple[str, int], int] = {}  # of a body's dof in the condensed problem
        blocks, loads, springs, motions = [], [], [], []
        self._recovery = {}
        start = 0
        for name, body in self.bodies.items():
            corners = {int(group[0]) for group in body.groups.values()}
            kept = np.array([2 * node + i for node in sorted(touched[name] | corners) for i in (0, 1)], int)
            kept = kept[body.free[kept]]
            rest = np.setdiff1d(np.flatnonzero(body.free), kept)
            clamped = np.flatnonzero(~body.free)
            right = body.b - body.A[:, clamped] @ body.prescribed[clamped]
            inside = splu(body.A[np.ix_(rest, rest)].tocsc()) if len(rest) else None
            coupling = body.A[np.ix_(rest, kept)].toarray()
            back, alone = (inside.solve(coupling), inside.solve(right[rest])) if inside else (coupling, right[rest])
            S = body.A[np.ix_(kept, kept)].toarray() - coupling.T @ back
            blocks.append((S + S.T) / 2)
            loads.append(right[kept] - coupling.T @ alone)
            self._recovery[name] = start, kept, rest, back, alone
            R = body.rigid_motions()
            motions.append((name, R, R[kept]))
            Q = np.linalg.qr(R[kept])[0] if R.size else R[kept]
            springs.append(body.modulus * Q @ Q.T)
            self.number |= {(name, int(dof)): start + i for i, dof in enumerate(kept)}
            start += len(kept)
        self.S, self.f = scipy.linalg.block_diag(*blocks), np.concatenate(loads)
        self.springs = scipy.linalg.block_diag(*springs)
        self.motions = motions
        self.size = start

    def _rows(self) -> None:
        uses = Counter((name, node) for pair in self.pairs for name, node, _ in self._owners(pair))
        entries, gap, stiffness, shared, bonded, follows, coefficient, bound, owner = ([] for _ in range(9))
        self.B_bodies: dict[str, list] = {name: [] for name in self.bodies}  # (row, dof, value), all dofs
        for p, pair in enumerate(self.pairs):
            contact = self.scene["contact"][pair.contact]
            friction = contact.get("friction", {"law": "none"})
            ties = contact.get("kind") == "bonded"
            weakness = sum(1.0 / self.bodies[name].modulus for name, _, _ in self._owners(pair))
            many = any(uses[name, node] > 1 for name, node, _ in self._owners(pair))
            normal = -1
            for direction in (0, 1):
                if pair.held[direction] or (direction == 1 and friction["law"] == "none" and not ties):
                    continue
                row = len(gap)
                given = pair.offset[direction]
                for name, node, sign in self._owners(pair):
                    for i in (0, 1):
                        value = sign * pair.frame[direction, i]
                        self.B_bodies[name].append((row, 2 * node + i, value))
                        if (name, 2 * node + i) in self.number:
                            entries.append((row, self.number[name, 2 * node + i], value))
                        else:
                            given -= value * self.bodies[name].prescribed[2 * node + i]
                gap.append(given)
                stiffness.append(0.5 / weakness)
                shared.append(many)
                bonded.append(ties)
                follows.append(normal)
                coefficient.append(friction.get("coefficient", 0.0) if direction == 1 else 0.0)
                bound.append(friction.get("slip_bound", 0.0) * pair.length if direction == 1 else 0.0)
                owner.append(p)
                normal = row if direction == 0 else normal
        rows, columns, values = (np.array(each) for each in zip(*entries, strict=True)) if entries else ([], [], [])
        self.B = np.zeros((len(gap), self.size))
        self.B[rows, columns] = values
        self.gap, self.c = np.array(gap), np.array(stiffness)
        self.shared, self.bonded = np.array(shared, bool), np.array(bonded, bool)
        self.follows, self.coefficient, self.bound = np.array(follows, int), np.array(coefficient), np.array(bound)
        self.owner = np.array(owner, int)
        self.normal = (self.follows < 0) & ~self.bonded
        self.tangential = (self.follows >= 0) & ~self.bonded

    def limits(self, s: np.ndarray) -> np.ndarray:
        """Slip bounds of all rows under the forces `s`; zero where the row is no tangential one."""
        return self.bound + self.coefficient * np.maximum(s[self.follows], 0.0) * self.tangential

    def project(self, q: np.ndarray) -> np.ndarray:
        """The forces that the laws assign to q = s − c r; a bonded row takes all."""
        g = self.limits(q)
        return np.where(self.bonded, q, np.where(self.normal, np.maximum(q, 0.0), np.clip(q, -g, g)))

    def opening(self, u: np.ndarray) -> np.ndarray:
        return self.gap - self.B @ u

    def residuals(self, u: np.ndarray, s: np.ndarray) -> tuple[float, float]:
        """Imbalance, and how far forces are from their laws, both over the largest force."""
        size = max(np.abs(s).max(initial=0.0), np.abs(self.f).max(initial=0.0)) or 1.0
        law = s - self.project(s - self.c * self.opening(u))
        return (float(np.abs(self.f - self.S @ u - self.B.T @ s).max(initial=0.0) / size),
                float(np.abs(law).max(initial=0.0) / size))

    def solved(self, u: np.ndarray, s: np.ndarray, precision: float = PRECISE) -> bool:
        size = max(np.abs(s).max(initial=0.0), np.abs(self.f).max(initial=0.0)) or 1.0
        rounding = ROUNDING * max(np.abs(self.S).max(initial=0.0), self.c.max(initial=0.0)) * np.abs(u).max(initial=0.0)
        return max(self.residuals(u, s)) <= precision + rounding / size

    def displacement(self, u: np.ndarray) -> dict[str, np.ndarray]:
        """The displacement (nv, 2) of each body."""
        found = {}
        for name, (start, kept, rest, back, alone) in self._recovery.items():
            full = np.nan_to_num(self.bodies[name].prescribed)
            full[kept] = u[start:start + len(kept)]
            full[rest] = alone - back @ full[kept]
            found[name] = full.reshape(-1, 2)
        return found

    def condensed(self, displacement: dict[str, np.ndarray]) -> np.ndarray:
        """The dofs of the condensed problem in displacements (nv, 2) by body."""
        u = np.empty(self.size)
        for name, (start, kept, *_) in self._recovery.items():
            u[start:start + len(kept)] = displacement[name].ravel()[kept]
        return u


# Is there an equilibrium at all?


def imbalance(assembly: Assembly) -> float:
    """The smallest share of the loads on loose bodies that contact forces within their laws leave without balance.

    Above `INFEASIBLE` there is certainly no equilibrium. Below, there is one where bounds do not follow the normal
    forces; with Coulomb friction there need not be. By linear programming, min ‖G s − e‖₁.
    """
    rows = len(assembly.gap)
    G, e = [], []
    for name, R, _ in assembly.motions:
        if R.size:
            body = assembly.bodies[name]
            entries = np.array(assembly.B_bodies[name]).reshape(-1, 3)
            B = sparse.csr_matrix((entries[:, 2], (entries[:, 0].astype(int), entries[:, 1].astype(int))),
                                  (rows, body.b.size))
            scale = np.abs(R).max()
            G.append((B @ (R / scale)).T)
            clamped = np.where(body.free, 0.0, np.nan_to_num(body.prescribed))
            e.append((R / scale).T @ (body.b - body.A @ clamped))
    if not G:
        return 0.0
    G, e = np.vstack(G), np.concatenate(e)
    size = np.abs(e).sum()
    if size == 0.0:
        return 0.0
    e = e / size
    k, tangential = len(e), np.flatnonzero(assembly.tangential)
    t = len(tangential)
    lines, columns = np.arange(t), assembly.follows[tangential]
    slope = sparse.csr_matrix((assembly.coefficient[tangential], (lines, columns)), (t, rows))
    pick = sparse.csr_matrix((np.ones(t), (lines, tangential)), (t, rows))
    empty = sparse.csr_matrix((t, 2 * k))
    limits = sparse.vstack([sparse.hstack([pick - slope, empty]), sparse.hstack([-pick - slope, empty])]).tocsr()
    found = linprog(np.r_[np.zeros(rows), np.ones(2 * k)],
                    A_eq=sparse.hstack([sparse.csr_matrix(G), sparse.identity(k), -sparse.identity(k)]).tocsr(), b_eq=e,
                    A_ub=limits if t else None, b_ub=np.tile(assembly.bound[tangential], 2) / size if t else None,
                    bounds=[(0.0 if n else None, None) for n in assembly.normal] + [(0.0, None)] * (2 * k),
                    method="highs")
    return float(found.fun) if found.status == 0 else float("nan")


# Newton's method


@dataclass(frozen=True)
class ActiveSet:
    """Which rows are closed (under pressure, bonded) or stick, and the sign of the force where a row slips."""

    holds: np.ndarray
    slips: np.ndarray

    @property
    def key(self) -> bytes:
        return self.holds.tobytes() + self.slips.tobytes()


def active_set(assembly: Assembly, u: np.ndarray, s: np.ndarray) -> ActiveSet:
    q = s - assembly.c * assembly.opening(u)
    g = assembly.limits(q)
    slips = np.where(assembly.tangential & (np.abs(q) >= g), np.where(q >= 0, 1, -1), 0).astype(np.int8)
    return ActiveSet(assembly.bonded | np.where(assembly.normal, q > 0, assembly.tangential & (slips == 0)), slips)


def newton_step(assembly: Assembly, active: ActiveSet, u: np.ndarray, s: np.ndarray, loose: float, redundant: float,
                ) -> tuple[np.ndarray, np.ndarray]:
    """Displacements and forces of the linear problem that an active set leaves."""
    holds = np.flatnonzero(active.holds)
    slope = active.slips * assembly.coefficient
    follow = np.flatnonzero(slope)
    follow = follow[active.holds[assembly.follows[follow]]]

    def expand(y: np.ndarray) -> np.ndarray:  # rows × columns from the rows that hold
        x = np.zeros((len(assembly.gap), *y.shape[1:]))
        x[holds] = y
        x[follow] = (slope[follow] * x[assembly.follows[follow]].T).T
        return x

    given = active.slips * assembly.bound
    E_T_B = assembly.B[holds].copy()  # transpose of E applied to B
    place = np.full(len(assembly.gap), -1)
    place[holds] = np.arange(len(holds))
    np.add.at(E_T_B, place[assembly.follows[follow]], slope[follow, None] * assembly.B[follow])
    n, k = assembly.size, len(holds)
    matrix = np.zeros((n + k, n + k))
    matrix[:n, :n] = assembly.S + loose * assembly.springs
    matrix[:n, n:] = E_T_B.T
    matrix[n:, :n] = assembly.B[holds]
    c = assembly.c[holds]
    matrix[range(n, n + k), range(n, n + k)] = -np.where(assembly.shared[holds], redundant, 0.0) / c
    y = s[holds]
    unit = np.r_[np.ones(n), np.full(k, np.median(np.diag(assembly.S)))]  # rows of a force become like those of S
    factors = scipy.linalg.lu_factor(unit[:, None] * matrix * unit, check_finite=False, overwrite_a=True)
    for _ in range(2):  # the second solve refines
        right = np.concatenate([assembly.f - assembly.S @ u - assembly.B.T @ (expand(y) + given),
                                (assembly.opening(u))[holds]])
        change = unit * scipy.linalg.lu_solve(factors, unit * right, check_finite=False)
        u, y = u + change[:n], y + change[n:]
    return u, expand(y) + given


@dataclass
class Course:
    """Where an iteration has come to."""

    u: np.ndarray
    s: np.ndarray
    solved: bool
    steps: int
    drifts: bool = False


def _polished(assembly: Assembly, u: np.ndarray, s: np.ndarray, loose: float) -> tuple[np.ndarray, np.ndarray]:
    """A solution as precise as steps on its own active set make it."""
    for _ in range(3):
        finer = newton_step(assembly, active_set(assembly, u, s), u, s, loose, REDUNDANT)
        if not max(assembly.residuals(*finer)) < max(assembly.residuals(u, s)):
            break
        u, s = finer
    return u, s


def newton(assembly: Assembly, u: np.ndarray, s: np.ndarray, first: ActiveSet | None = None, loose: float = LOOSE,
           redundant: float = REDUNDANT, most: int = 40) -> Course:
    """Semi-smooth Newton; ends early where active sets repeat."""
    seen: Counter[bytes] = Counter()
    active = first or active_set(assembly, u, s)
    for step in range(1, most + 1):
        with np.errstate(all="ignore"):
            new_u, new_s = newton_step(assembly, active, u, s, loose, redundant)
        if not (np.isfinite(new_u).all() and np.isfinite(new_s).all()):
            return Course(u, s, False, step)
        if assembly.solved(new_u, new_s):
            return Course(*_polished(assembly, new_u, new_s, loose), True, step)
        u, s = new_u, new_s
        active = active_set(assembly, u, s)
        seen[active.key] += 1
        if seen[active.key] > 8:
            break
    return Course(u, s, False, step)


# Interior points: the other way, where Newton's active sets go in circles


def interior_point(assembly: Assembly, spring: np.ndarray, center: np.ndarray, most: int = 60,
                   ) -> tuple[np.ndarray, np.ndarray]:
    """Displacements and forces with springs about `center`, which hold loose bodies.

    The laws are written with products of numbers that are not negative, s_ν w = 0, p (g − s_t) = 0, q (g + s_t) = 0
    with the opening w and the slip p − q, and the products are led to zero (Mehrotra's predictor and corrector).
    Bounds follow the normal forces, so that the iteration may end anywhere. Rows whose bound is nil carry no force.
    Bonded rows are given a compliance, whose bias the last forces take out again.
    """
    force = np.abs(assembly.f).max(initial=0.0) or 1.0
    slope, bound = assembly.coefficient, assembly.bound
    N, L = np.flatnonzero(assembly.normal), np.flatnonzero(assembly.bonded)
    T = np.flatnonzero(assembly.tangential & ((bound > 1e-12 * max(bound.max(initial=0.0), force)) | (slope > 0)))
    BN, BT, BL = assembly.B[N], assembly.B[T], assembly.B[L]
    slope, bound, gap = slope[T], bound[T], assembly.gap
    place = np.full(len(gap), -1)
    place[N] = np.arange(len(N))
    of = place[assembly.follows[T]]  # the normal row of each tangential one
    stiff = np.median(assembly.c) if len(assembly.c) else 1.0
    K, f = assembly.S + spring, assembly.f + spring @ center
    force = max(force, stiff * np.abs(gap).max(initial=0.0), bound.max(initial=0.0))
    length = force / stiff
    u, sL, sT = center.copy(), np.zeros(len(L)), np.zeros(len(T))
    sN, w = np.full(len(N), force), np.maximum(gap[N] - BN @ u, length)
    slip = BT @ u - gap[T]
    p, q = np.maximum(slip, 0.0) + length, np.maximum(-slip, 0.0) + length
    weak = 1e-5 / assembly.c[L]
    count = max(len(N) + 2 * len(T), 1)
    for _ in range(most):
        G = bound + slope * sN[of]
        a, b = G - sT, G + sT
        r = f - K @ u - BN.T @ sN - BT.T @ sT - BL.T @ sL
        rN, rT, rL = gap[N] - BN @ u - w, BT @ u - gap[T] - p + q, BL @ u - gap[L]
        mu = (sN @ w + p @ a + q @ b) / count
        wrong = max(np.abs(r).max(initial=0.0) / force, *(np.abs(x).max(initial=0.0) / length for x in (rN, rT, rL)))
        if (mu <= 1e-13 * force * length and wrong <= 1e-7) or mu <= 1e-16 * force * length:
            break
        DN, DT, DF = sN / w, 1.0 / (p / a + q / b), slope * (p / a - q / b)
        matrix = K + BN.T @ (DN[:, None] * BN) + BL.T @ (BL / weak[:, None])
        matrix += BT.T @ (DT[:, None] * (BT + (DF * DN[of])[:, None] * BN[of]))
        scale = 1.0 / np.sqrt(np.abs(np.diag(matrix)))
        matrix = scale[:, None] * matrix * scale
        matrix[np.diag_indices(len(matrix))] += 1e-14
        if not np.isfinite(matrix).all():
            break
        factor = scipy.linalg.lu_factor(matrix, check_finite=False, overwrite_a=True)

        def step(cN, cP, cQ, at=(r, rN, rT, rL, a, b, DN, DT, DF, scale, factor)):  # towards these products
            r, rN, rT, rL, a, b, DN, DT, DF, scale, factor = at
            oN = (cN - sN * w - sN * rN) / w  # noqa: B023
            oT = DT * (rT - (cP - p * a) / a + (cQ - q * b) / b + DF * oN[of])  # noqa: B023
            right = r - BN.T @ oN - BT.T @ oT - BL.T @ (rL / weak)
            du = scale * scipy.linalg.lu_solve(factor, scale * right, check_finite=False)
            dN, dL = DN * (BN @ du) + oN, (BL @ du + rL) / weak
            dT = DT * (BT @ du + rT - (cP - p * a) / a + (cQ - q * b) / b + DF * dN[of])  # noqa: B023
            da, db = slope * dN[of] - dT, slope * dN[of] + dT
            return (du, dN, dT, dL, rN - BN @ du, (cP - p * a - p * da) / a, (cQ - q * b - q * db) / b,  # noqa: B023
                    da, db)

        def longest(dN, dw, dp, dq, da, db, at=(a, b)):
            parts = (sN, dN), (w, dw), (p, dp), (q, dq), (at[0], da), (at[1], db)  # noqa: B023
            return min([1.0, *(float((-x[d < 0] / d[d < 0]).min(initial=np.inf)) for x, d in parts)])

        _, dN, _, _, dw, dp, dq, da, db = step(0.0, 0.0, 0.0)
        t = longest(dN, dw, dp, dq, da, db)
        ahead = ((sN + t * dN) @ (w + t * dw) + (p + t * dp) @ (a + t * da) + (q + t * dq) @ (b + t * db)) / count
        target = mu * min(1.0, max(ahead / mu, 0.0)) ** 3
        du, dN, dT, dL, dw, dp, dq, da, db = step(target - dN * dw, target - dp * da, target - dq * db)
        t = min(1.0, 0.995 * longest(dN, dw, dp, dq, da, db))
        u, sN, sT, sL = u + t * du, sN + t * dN, sT + t * dT, sL + t * dL
        w, p, q = w + t * dw, p + t * dp, q + t * dq
    s = np.zeros(len(gap))
    s[N], s[T], s[L] = sN, sT, sL
    return u, s


def by_interior_points(assembly: Assembly, loose: tuple[float, ...] = (1e-6, 1e-8, 1e-4)) -> Course:
    """Interior points with bounds that follow the normal forces, each end polished by Newton.

    The springs follow the bodies. Where bodies drift, that goes on for ever: the springs carry the same imbalance at
    every step and whatever their stiffness, and a hundredth of the stiffness makes steps a hundred times longer.
    """
    zero = np.zeros(assembly.size)
    course = Course(zero, np.zeros(len(assembly.gap)), False, 0)
    ends: list[tuple[float, float, float]] = []  # stiffness, imbalance and step, where the laws hold
    for stiffness in loose:
        center = zero
        for _ in range(4):
            with np.errstate(all="ignore"):
                u, s = interior_point(assembly, stiffness * assembly.springs, center)
            if not np.isfinite(u).all():
                break
            course = newton(assembly, u, s, most=20)
            if course.solved:
                return course
            imbalance, wrong = assembly.residuals(u, s)
            if wrong < 1e-5:
                ends.append((stiffness, imbalance, float(np.abs(u - center).max())))
            center = u
        for (soft, a, far), (stiff, b, near) in itertools.product(ends, ends):
            if soft < 0.1 * stiff and abs(a - b) <= 0.05 * b and 0.5 < far * soft / (near * stiff) < 2.0:
                return Course(center, course.s, False, course.steps, drifts=True)
    return course


# A scene


@dataclass
class Solution:
    """What the reference found.

    Attributes
    ----------
    converged : whether equations and laws hold to rounding
    reason : how it ended; contains "no equilibrium" where the linear program says so, "undecided" where nothing is
        known, because Coulomb friction may leave a scene without equilibrium that the linear program accepts
    how : which attempt found it
    imbalance : see `imbalance`
    residuals : imbalance of the nodes and distance from the laws, over the largest force
    displacement : (nv, 2) by body
    forces : by contact, (k, 2) along normal and tangent of its first body; not unique at nodes of several contacts
    status : by contact, words for each of its nodes
    undetermined : rigid motions that nothing holds, as displacements (nv, 2) by body, one dictionary each
    """

    assembly: Assembly
    converged: bool
    reason: str
    how: str = ""
    steps: int = 0
    imbalance: float = 0.0
    residuals: tuple[float, float] = (np.inf, np.inf)
    displacement: dict[str, np.ndarray] = field(default_factory=dict)
    forces: dict[str, np.ndarray] = field(default_factory=dict)
    status: dict[str, list[str]] = field(default_factory=dict)
    undetermined: list[dict[str, np.ndarray]] = field(default_factory=list)

    @property
    def points(self) -> dict[str, np.ndarray]:
        return {name: body.points for name, body in self.assembly.bodies.items()}

    @property
    def displacement_max(self) -> float:
        return max(float(np.abs(each).max()) for each in self.displacement.values())


def solve(scene: dict[str, Any]) -> Solution:
    """Solve a scene, if it has an equilibrium."""
    assembly = Assembly(scene)
    zero = np.zeros(assembly.size), np.zeros(len(assembly.gap))
    share = imbalance(assembly)
    if share > INFEASIBLE:
        return Solution(assembly, False, f"no equilibrium: {share:.1e} of the loads stays without balance",
                        imbalance=share)
    shut = assembly.gap <= 0.0
    shut = np.where(assembly.follows >= 0, shut[assembly.follows], shut) if len(shut) else shut
    touching = ActiveSet(assembly.bonded | shut, np.zeros(len(shut), np.int8))
    course, how = newton(assembly, *zero, touching, most=25), "newton"
    if not course.solved:
        course, how = by_interior_points(assembly), "interior points"
    return _finished(assembly, course, how if course.solved or course.drifts else "nothing", share)


def _finished(assembly: Assembly, course: Course, how: str, share: float) -> Solution:
    u, s = course.u, course.s
    reason = "solved" if course.solved else "undecided: no attempt converged"
    if course.drifts:
        reason, how = "undecided: bodies drift, which the linear program does not see", "drift"
    found = Solution(assembly, course.solved, reason, how, course.steps, share, assembly.residuals(u, s),
                     assembly.displacement(u))
    names = [contact.get("name") or "-".join(contact["bodies"]) for contact in assembly.scene.get("contact", [])]
    forces, status = ({name: [] for name in names} for _ in range(2))
    opening, g = assembly.opening(u), assembly.limits(s)
    size = np.abs(s).max(initial=0.0) or 1.0
    for p, pair in enumerate(assembly.pairs):
        rows = np.flatnonzero(assembly.owner == p)
        along = [row for row in rows if assembly.follows[row] < 0 and not (assembly.bonded[row] and pair.held[0])]
        across = [row for row in rows if row not in along]
        name = names[pair.contact]
        forces[name].append([s[along[0]] if along else 0.0, s[across[0]] if across else 0.0])
        if assembly.bonded[rows[0]]:
            status[name].append("bonded")
        elif s[along[0]] <= PRECISE * size and opening[along[0]] >= 0.0:
            status[name].append("open")
        else:
            sticks = bool(across) and abs(s[across[0]]) < g[across[0]] * (1 - 1e-8)
            status[name].append("stick" if sticks else "slip")
    found.forces = {name: np.array(each).reshape(-1, 2) for name, each in forces.items()}
    found.status = status
    found.undetermined = _undetermined(assembly, s)
    return found


def _undetermined(assembly: Assembly, s: np.ndarray) -> list[dict[str, np.ndarray]]:
    """Rigid motions that no row holds whose force is clearly inside its bounds, orthonormal over all nodes."""
    size = np.abs(s).max(initial=0.0) or 1.0
    small = 1e-9 * size
    g = assembly.limits(s)
    pressed = assembly.normal & (s > small)
    sticks = assembly.tangential & (g > small) & (np.abs(s) < g - small)
    rows = np.flatnonzero(assembly.bonded | pressed | sticks)
    blocks, columns = [], []
    for name, R, kept in assembly.motions:
        start = assembly._recovery[name][0]
        scale = np.abs(R).max() if R.size else 1.0
        for k in range(R.shape[1]):
            blocks.append(assembly.B[np.ix_(rows, range(start, start + len(kept)))] @ kept[:, k] / scale)
            columns.append((name, R[:, k] / scale))
    if not columns:
        return []
    _, values, V = np.linalg.svd(np.vstack([np.column_stack(blocks), np.zeros((len(columns), len(columns)))]))
    full = {name: np.column_stack([R for other, R in columns if other == name] or [np.empty((body.b.size, 0))])
            for name, body in assembly.bodies.items()}
    modes = []
    for direction in V[values < 1e-9 * max(values.max(), 1.0)]:
        parts = {name: np.array([value for value, (other, _) in zip(direction, columns, strict=True) if other == name])
                 for name in full}
        modes.append(np.concatenate([full[name] @ parts[name] for name in full]))
    if not modes:
        return []
    modes = np.linalg.qr(np.column_stack(modes))[0].T
    ends = np.cumsum([0, *(body.b.size for body in assembly.bodies.values())])
    return [{name: mode[a:b].reshape(-1, 2) for name, (a, b) in zip(full, itertools.pairwise(ends), strict=True)}
            for mode in modes]


# Comparison


def distance(reference: Solution, answer: Any) -> float:
    """Largest difference of the displacements over the largest displacement, undetermined motions taken out.

    Parameters
    ----------
    answer : of `ddmpi.solve`, or anything with `bodies[name].points` and `.displacement`; nodes match by position
    """
    found = displacement_of(reference, answer)
    difference = np.concatenate([(found[name] - u).ravel() for name, u in reference.displacement.items()])
    size = np.concatenate([u.ravel() for u in reference.displacement.values()])
    for mode in reference.undetermined:
        direction = np.concatenate([mode[name].ravel() for name in reference.displacement])
        difference = difference - (direction @ difference) * direction
        size = size - (direction @ size) * direction
    return float(np.abs(difference).max() / (np.abs(size).max() or 1.0))


def violation(reference: Solution, answer: Any, tolerance: float = 1e-6) -> float:
    """How far displacements are from any solution: the larger of penetration and imbalance.

    Coulomb friction may leave several solutions; this tells another one from a wrong answer. Penetration is over the
    largest displacement. Imbalance is the least share of all nodal forces that contact forces leave, which obey the
    laws at these displacements: none where it is open, on the bound where it slips, openings and slips below
    `tolerance` (over the largest displacement) being none. By linear programming.
    """
    assembly = reference.assembly
    u = assembly.condensed(displacement_of(reference, answer))
    r, right = assembly.opening(u), assembly.f - assembly.S @ u
    size = np.abs(u).max(initial=0.0) or 1.0
    penetration = np.where(assembly.normal, np.maximum(-r, 0.0), np.where(assembly.bonded, np.abs(r), 0.0))
    total = np.abs(assembly.f).sum() + np.abs(assembly.S @ u).sum() or 1.0
    n, rows = assembly.size, len(r)
    T = np.flatnonzero(assembly.tangential)
    slipping = np.abs(r[T]) > tolerance * size
    pick = sparse.csr_matrix((np.ones(len(T)), (range(len(T)), T)), (len(T), rows))
    bound = sparse.csr_matrix((assembly.coefficient[T], (range(len(T)), assembly.follows[T])), (len(T), rows))
    given = assembly.bound[T] / total
    sign = sparse.diags(-np.sign(r[T]))
    beside = sparse.csr_matrix((len(T), 2 * n))
    equal = sparse.hstack([sign @ pick - bound, beside]).tocsr()[slipping]
    below = sparse.vstack([sparse.hstack([pick - bound, beside]), sparse.hstack([-pick - bound, beside])]).tocsr()
    balance = sparse.hstack([sparse.csr_matrix(assembly.B.T), sparse.identity(n), -sparse.identity(n)])
    shut = r <= tolerance * size
    found = linprog(np.r_[np.zeros(rows), np.ones(2 * n)],
                    A_eq=sparse.vstack([balance, equal]).tocsr(), b_eq=np.r_[right / total, given[slipping]],
                    A_ub=below if len(T) else None, b_ub=np.r_[given, given] if len(T) else None,
                    bounds=[(0.0, None if closed else 0.0) if normal else (None, None)
                            for normal, closed in zip(assembly.normal, shut, strict=True)] + [(0.0, None)] * (2 * n),
                    method="highs")
    return max(float(penetration.max(initial=0.0) / size), float(found.fun) if found.status == 0 else np.inf)


def displacement_of(reference: Solution, answer: Any) -> dict[str, np.ndarray]:
    """The displacement of `answer` at the reference's nodes."""
    found = {}
    for name, points in reference.points.items():
        body = answer.bodies[name]
        far, place = cKDTree(body.points).query(points)
        assert len(body.points) == len(points) and far.max() <= 1e-7 * np.ptp(points, axis=0).max(), name
        found[name] = np.asarray(body.displacement)[place]
    return found
