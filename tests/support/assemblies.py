"""What must hold of the answer to a plane assembly, by another program than the package.

Reads a scene as a plain dict with the keys of the TOML file: structured linear triangles, pairing by position, rigid
planes; loads and clamps that are constant; one load step. Nothing of the package is used.

    assembly = Assembly(scene)
    imbalance(assembly)          # above INFEASIBLE there is no equilibrium
    violation(assembly, answer)  # of answer = ddmpi.solve(text); zero for a solution

Signs: a contact's row counts B u = u¹·ν¹ + u²·ν² (and the same with t), r = gap − B u is the opening, and bodies obey
A u + Bᵀ s = b. Forces obey their laws when s_ν ≥ 0 and r_ν ≥ 0, one of them zero, and |s_t| ≤ g, with equality against
the slip where there is one. Tresca's g holds at open nodes as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse
from scipy.optimize import linprog
from scipy.spatial import cKDTree

SIDES = ("bottom", "right", "top", "left")

MATCHING = 1e-9
"""Largest distance of paired nodes, and largest gap that counts as zero, as a fraction of the spacing."""

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
    """All bodies and rows of a scene.

    Dofs are those of all bodies, one after the other. `follows` says for each tangential row which row is its node's
    normal one, and is −1 for a normal row.
    """

    def __init__(self, scene: dict[str, Any]) -> None:
        self.scene = scene
        self.bodies = {spec["name"]: build(spec) for spec in scene["body"]}
        rigid = {spec["name"]: spec for spec in scene.get("rigid", [])}
        self.pairs = [pair for number, contact in enumerate(scene.get("contact", []))
                      for pair in pairs_of(number, contact, self.bodies, rigid)]
        sizes = [body.b.size for body in self.bodies.values()]
        self.start = dict(zip(self.bodies, np.cumsum([0, *sizes]).tolist(), strict=False))
        self.A = sparse.block_diag([body.A for body in self.bodies.values()], format="csr")
        self.b, self.prescribed = (np.concatenate([getattr(body, name) for body in self.bodies.values()])
                                   for name in ("b", "prescribed"))
        self._rows()

    def _rows(self) -> None:
        entries, gap, bonded, follows, coefficient, bound = ([] for _ in range(6))
        for pair in self.pairs:
            contact = self.scene["contact"][pair.contact]
            friction = contact.get("friction", {"law": "none"})
            ties = contact.get("kind") == "bonded"
            normal = -1
            for direction in (0, 1):
                if pair.held[direction] or (direction == 1 and friction["law"] == "none" and not ties):
                    continue
                row = len(gap)
                for name, node, sign in zip(contact["bodies"], pair.nodes, (1.0, -1.0), strict=True):
                    if node >= 0:  # a rigid partner has no nodes
                        entries += [(row, self.start[name] + 2 * node + i, sign * pair.frame[direction, i])
                                    for i in (0, 1)]
                gap.append(pair.offset[direction])
                bonded.append(ties)
                follows.append(normal)
                coefficient.append(friction.get("coefficient", 0.0) if direction == 1 else 0.0)
                bound.append(friction.get("slip_bound", 0.0) * pair.length if direction == 1 else 0.0)
                normal = row if direction == 0 else normal
        rows, columns, values = np.array(entries).reshape(-1, 3).T
        self.B = sparse.csr_matrix((values, (rows.astype(int), columns.astype(int))), (len(gap), self.b.size))
        self.gap, self.bonded, self.follows = np.array(gap), np.array(bonded, bool), np.array(follows, int)
        self.coefficient, self.bound = np.array(coefficient), np.array(bound)
        self.normal = (self.follows < 0) & ~self.bonded
        self.tangential = (self.follows >= 0) & ~self.bonded

    def displacement(self, answer: Any) -> np.ndarray:
        """That of an answer (`ddmpi.solve`, or anything with `bodies[name].points` and `.displacement`) at all dofs."""
        parts = []
        for name, body in self.bodies.items():
            far, node = cKDTree(answer.bodies[name].points).query(body.points)
            assert len(answer.bodies[name].points) == len(body.points), name
            assert far.max() <= 1e-7 * np.ptp(body.points, axis=0).max(), name
            parts.append(np.asarray(answer.bodies[name].displacement)[node].ravel())
        return np.concatenate(parts)


def unbalanced(assembly: Assembly, G: sparse.spmatrix, e: np.ndarray, size: float,
               carries: np.ndarray | None = None, slips: np.ndarray | None = None) -> float:
    """min Σ |G s − e| / size over forces s that obey the laws of friction, by linear programming.

    Parameters
    ----------
    carries : (rows,) bool, normal rows that may carry a pressure; left out, all may
    slips : (rows,) sign of the slip of tangential rows, against which the force is on its bound; 0: within it
    """
    (k, rows), tangential = G.shape, np.flatnonzero(assembly.tangential)
    lines, shape = np.arange(len(tangential)), (len(tangential), rows)
    bound = assembly.bound[tangential] / size
    slope = sparse.csr_matrix((assembly.coefficient[tangential], (lines, assembly.follows[tangential])), shape)
    pick = sparse.csr_matrix((np.ones(len(tangential)), (lines, tangential)), shape)
    below = sparse.vstack([pick - slope, -pick - slope]).tocsr()
    sign = np.zeros(len(tangential)) if slips is None else slips[tangential]
    fixed = sparse.csr_matrix(-sparse.diags(sign) @ pick - slope)[sign != 0]
    balance = sparse.hstack([G, sparse.identity(k), -sparse.identity(k)])

    def beside(matrix: sparse.csr_matrix) -> sparse.csr_matrix:  # columns for what is left of the balance
        return sparse.hstack([matrix, sparse.csr_matrix((matrix.shape[0], 2 * k))])

    most = np.full(rows, None) if carries is None else np.where(carries, None, 0.0)
    found = linprog(np.r_[np.zeros(rows), np.ones(2 * k)], A_ub=beside(below), b_ub=np.r_[bound, bound],
                    A_eq=sparse.vstack([balance, beside(fixed)]), b_eq=np.r_[e / size, bound[sign != 0]],
                    bounds=[(0.0, limit) if normal else (None, None)
                            for normal, limit in zip(assembly.normal, most, strict=True)] + [(0.0, None)] * (2 * k),
                    method="highs")
    return float(found.fun) if found.status == 0 else np.inf


def imbalance(assembly: Assembly) -> float:
    """The smallest share of the loads on loose bodies that contact forces within their laws leave without balance.

    Above `INFEASIBLE` there is certainly no equilibrium. Below, there is one where bounds do not follow the normal
    forces; with Coulomb friction there need not be.
    """
    G, e = [], []
    for name, body in assembly.bodies.items():
        R, own = body.rigid_motions(), slice(assembly.start[name], assembly.start[name] + body.b.size)
        scale = np.abs(R).max(initial=0.0) or 1.0
        G.append(sparse.csr_matrix((assembly.B[:, own] @ (R / scale)).T))
        e.append((R / scale).T @ (body.b - body.A @ np.nan_to_num(body.prescribed)))
    loads = np.concatenate(e)
    size = np.abs(loads).sum()
    return unbalanced(assembly, sparse.vstack(G), loads, size) if size else 0.0


def violation(assembly: Assembly, answer: Any, tolerance: float = 1e-6) -> float:
    """How far displacements are from any solution: the largest of penetration, opening of bonds, motion of clamps and
    imbalance.

    The first three are over the largest displacement. Imbalance is the least share of all nodal forces that contact
    forces leave, which obey the laws at these displacements: none where it is open, on the bound where it slips,
    openings and slips below `tolerance` (over the largest displacement) being none. Coulomb friction may leave several
    solutions; each of them has none.
    """
    u = assembly.displacement(answer)
    size = np.abs(u).max() or 1.0
    opening, free = assembly.gap - assembly.B @ u, np.isnan(assembly.prescribed)
    wrong = np.where(assembly.normal, -opening, np.where(assembly.bonded, np.abs(opening), 0.0)).max(initial=0.0)
    moved = np.abs(u - assembly.prescribed)[~free].max(initial=0.0)
    left = assembly.b - assembly.A @ u
    total = (np.abs(assembly.b) + np.abs(assembly.A @ u))[free].sum() or 1.0
    touched = np.diff(assembly.B.tocsc().indptr) > 0
    inside = np.abs(left[free & ~touched]).sum() / total
    slips = np.where(np.abs(opening) > tolerance * size, np.sign(opening), 0.0)
    at_contacts = unbalanced(assembly, sparse.csr_matrix(assembly.B.T)[free & touched], left[free & touched], total,
                             opening <= tolerance * size, slips)
    return float(max(wrong / size, moved / size, inside + at_contacts))
