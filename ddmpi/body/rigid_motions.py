"""The rigid motions that clamps leave a body free, and a generalised inverse of its stiffness.

The stiffness of an unsupported body is singular. Springs at a few dofs make it positive definite, and its inverse a
generalised inverse: a balanced load gets its displacement, up to a rigid motion. `Centring` then removes what depends
on the place of the springs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sparse
from scipy.linalg import qr

from ddmpi.body.hinges import refuse_hinges
from ddmpi.body.stiffness import Stiffness
from ddmpi.errors import InputError
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.motions import Motion
from ddmpi.system.numbers import Frame, crossed, is_touched, norm

if TYPE_CHECKING:
    from petsc4py import PETSc  # reports use rigid motions without it

LOOSE = 1e-16
"""A motion is free if its squared size at the clamps, per component, is below this fraction of the largest."""

PURE = 1e-10
"""A translation is free by itself if its distance from the span of the free motions is below this."""

SEEN, FACETED = 1e-8, 3e-2
"""A motion does not act on the contact if it moves it by less than the fraction SEEN of its size. Below the fraction
FACETED only normals that are off act on it, as on the turn of a round part, by facets or where a clearance of up to
half the radius parts the sides: contact forces that balance a load along it would be far larger than the load."""


def rigid_motions(points: np.ndarray, centre: np.ndarray, size: float = 1.0) -> np.ndarray:
    """Translations, then rotations about `centre`, of `points` (k, d) as displacements (k, d, j).

    In the plane j = 3: along x, along y, counterclockwise; in space j = 6, rotations by the right-hand rule about x, y,
    z. Distances are divided by `size`.
    """
    x, d = (points - centre) / size, points.shape[1]
    return np.stack(
        [
            *(np.broadcast_to(axis, x.shape) for axis in np.eye(d)),
            *(crossed(turn[None], x) for turn in np.eye(1 if d == 2 else 3)),
        ],
        axis=-1,
    )


def free_motions(
    motions: np.ndarray, free: np.ndarray, springs: Sequence[np.ndarray] = ()
) -> np.ndarray:
    """Combinations (j, ·) of `motions` (k, d, j), orthonormal columns, that move the nodes only in the directions onto
    which `free` (k, d, d) projects, and strain no springs, given as rows (r, j) on the motions."""
    across = np.eye(free.shape[1]) - free
    fixed = np.concatenate([(across @ motions)[across.diagonal(axis1=1, axis2=2) > 0.0], *springs])
    # The null space of the clamped components; a QR first leaves the SVD a matrix of at most six rows.
    _, values, vectors = np.linalg.svd(
        np.linalg.qr(fixed, mode="r") if len(fixed) else np.zeros((1, motions.shape[2]))
    )
    squares = np.zeros(motions.shape[2])
    squares[: len(values)] = values**2
    return vectors[squares <= LOOSE * max(squares[0], 1.0) * max(len(fixed), 1)].T


def recognisable(left: np.ndarray, dimension: int) -> np.ndarray:
    """A basis (j, ·) of the span of `left` (j, ·), orthonormal columns, with translations separated.

    Translations along axes that are in the span come first. The rest, if it is one motion, has the coefficient one for
    its rotation, about a point in the bounding box, as clamps are at nodes.
    """
    axes = np.eye(len(left))[:, :dimension]
    pure = axes[:, np.linalg.norm(axes - left @ left[:dimension].T, axis=0) < PURE]
    vectors, _, _ = np.linalg.svd(left - pure @ (pure.T @ left))
    rest = vectors[:, : left.shape[1] - pure.shape[1]]
    if rest.shape[1] == 1:
        size = np.abs(rest)
        rest = rest / rest[np.flatnonzero(size > 0.5 * size.max())[-1]]
    return np.hstack([pure, rest])


def body_motions(
    mesh: Mesh, K: Stiffness, free: np.ndarray, name: str, springs: sparse.csr_matrix | None = None
) -> np.ndarray:
    """The rigid motions that clamps and springs of a body leave free, as displacements (nv, d, j) of all nodes.

    The rows of the springs (r, d nv) are without units. Translations move by one, rotations by the distance from their
    centre over that of the farthest node from the centroid, so that coefficients are lengths. Without supports the
    motions are the translations along the axes and the rotations about the centroid; around an axis the axial one only.

    Not collective. Raises InputError if a loose part of the body is not connected to the rest.
    """
    # cells that are connected by facets are one piece
    pieces, piece = K.connected() if mesh.parts.any() else (1, np.zeros(len(mesh.points), int))
    for k in range(pieces if pieces > 1 else 0):
        _refuse_loose(mesh, piece == k, pieces, free, name, springs)
    centre, left = _centroid(mesh), np.empty((0, 0))
    size = float(np.linalg.norm(mesh.points - centre, axis=1).max())
    if pieces == 1:
        left = _left_free(mesh, piece == 0, centre, size, free, springs)
    refuse_hinges(mesh, name, free, left.shape[1] if left.size else 0, rigid_motions, springs)
    if not left.size:
        return np.empty((*mesh.points.shape, 0))
    return free @ (rigid_motions(mesh.points, centre, size) @ recognisable(left, mesh.dimension))


def _left_free(
    mesh: Mesh,
    members: np.ndarray,
    centre: np.ndarray,
    size: float,
    free: np.ndarray,
    springs: sparse.csr_matrix | None,
) -> np.ndarray:
    """`free_motions` (j, ·) of the nodes `members` (nv,) bool, with springs as for `body_motions`.

    Around an axis all motions but the axial one strain the body; they are excluded as if they strained springs.
    """
    touched, seen = members & is_touched(free), [np.eye(3)[[0, 2]]] if mesh.axisymmetric else []
    if springs is not None:
        motions = rigid_motions(mesh.points, centre, size) * members[:, None, None]
        seen.append(springs @ motions.reshape(springs.shape[1], -1))
    return free_motions(rigid_motions(mesh.points[touched], centre, size), free[touched], seen)


def _refuse_loose(
    mesh: Mesh,
    members: np.ndarray,
    pieces: int,
    free: np.ndarray,
    name: str,
    springs: sparse.csr_matrix | None,
) -> None:
    """Raise InputError if the piece of the nodes `members` (nv,), one of several, can move as a rigid body."""
    left = _left_free(mesh, members, mesh.points[members].mean(axis=0), mesh.extent, free, springs)
    if left.size:
        translations, rotations = np.split(np.abs(left[:, 0]), [free.shape[1]])
        motion = "rotate" if rotations.max() > 0.5 else f"move along {'xyz'[translations.argmax()]}"
        groups = [group for group, edges in mesh.groups.items() if members[edges].any()]
        fix = f", or clamp it on its own boundary groups ({', '.join(groups)})" if groups else ""
        raise InputError(
            f"body.{name}.clamp: a piece of the body (it has {pieces} that are not connected) is not "
            f"supported: it can still {motion} as a rigid body; make each piece a body of its own "
            f"(mesh.part){fix}"
        )


def _centroid(mesh: Mesh) -> np.ndarray:
    """(d,) centre of the area or volume."""
    measures, middle = mesh.measures(), mesh.points.mean(axis=0)
    middles = np.take(mesh.points.T, mesh.corners.T, axis=1).mean(axis=1).T
    moments = np.ascontiguousarray(measures[:, None] * (middles - middle))
    points, weights = mesh.cell.quadrature
    for cells in mesh.summed_blocks():
        mapped = mesh.map(cells, points)
        moments[cells] = np.einsum("q,qt,qtd->td", weights, mapped.measures, mapped.places - middle)
    return middle + moments.sum(axis=0) / measures.sum()


def near_null_space(points: np.ndarray, free: np.ndarray) -> PETSc.NullSpace:
    """The rigid motions of `points` (k, d), projected onto the free directions by `free` (k, d, d) and orthonormal, for
    algebraic multigrid."""
    from petsc4py import PETSc

    motions = free @ rigid_motions(points, points.sum(axis=0) / max(len(points), 1))
    Q, _ = np.linalg.qr(motions.reshape(-1, motions.shape[2]))
    vectors = [
        PETSc.Vec().createWithArray(
            np.ascontiguousarray(q), bsize=points.shape[1], comm=PETSc.COMM_SELF
        )
        for q in Q.T
    ]
    return PETSc.NullSpace().create(vectors=vectors, comm=PETSc.COMM_SELF)


def support(motions: np.ndarray) -> np.ndarray:
    """As many dofs (j,) as `motions` (k, d, j), far apart, whose supports leave none of the motions free.

    QR with column pivoting: the next dof is the one that the remaining motions move most.
    """
    rows = motions.reshape(-1, motions.shape[2])
    return qr(rows.T, mode="r", pivoting=True)[1][: rows.shape[1]]


def add_springs(A: PETSc.Mat, dofs: np.ndarray) -> PETSc.Mat:
    """A with springs on a few `dofs`, as a new matrix: positive definite, its inverse a generalised inverse of A.

    It is A + ρ M Mᵀ, with the free motions M at these dofs, orthonormal. At as many dofs as motions, see `support`,
    M Mᵀ is the identity: springs enter the diagonal only. A balanced load does not strain them. Springs between nodes
    cost multigrid more iterations (41 with four nodes, instead of 27). ρ is the largest entry of the diagonal; the
    condition number is then at most about that of a body clamped on its short side.
    """
    fixed = A.copy()
    stiffen(fixed, dofs)
    fixed.setNearNullSpace(A.getNearNullSpace())
    for name in ("coarse", "causes"):
        fixed.setAttr(name, A.getAttr(name))
    return fixed


def stiffen(A: PETSc.Mat, dofs: np.ndarray) -> float:
    """Add the springs of `add_springs` to A itself, on `dofs` of a rank's own rows; return their stiffness (N/m)."""
    diagonal = A.getDiagonal()
    stiffness = diagonal.max()[1]
    diagonal.array[dofs] += stiffness
    A.setDiagonal(diagonal)
    A.setOption(A.Option.SPD, True)
    return stiffness


class Centring:
    """Makes a generalised inverse A⁺ of a loose body independent of the place of the springs.

    The centred inverse is Π A⁺ Πᵀ. Its displacements have no rigid motion in the least-squares sense at the contact,
    and on average none of those motions that hardly act on the contact: loads K = R (RᵀR)⁻¹ U balance these, the U of
    the least singular values of G. R (n, j) has the free motions as columns in A's dofs, B (size, n) is the trace on
    the contact nodes. Not collective.

    Attributes
    ----------
    K : (n, q) loads along the motions R U that hardly act on the contact, and along no others
    faint : (q, size) their contact displacements, zero where they do not act on it at all
    """

    def __init__(self, R: np.ndarray, B: sparse.csr_matrix) -> None:
        self._R, self._B = R, B
        Q, T = np.linalg.qr(B @ R)
        # G = (B R)ᵀ = Tᵀ Qᵀ = U Σ (Q Vᵀ)ᵀ. Its rank is below j where motions hardly act on the contact, as those along
        # a frictionless floor; P = I − Gᵀ(GGᵀ)⁺G is then made of the first `rank` vectors.
        U, values, V = np.linalg.svd(T.T)
        size = np.linalg.norm(B.data) * np.abs(R).max() if len(values) else 0.0
        rank, seen = (int((values > least * size).sum()) for least in (FACETED, SEEN))
        self._V = Q @ V[:rank].T
        self._inverse = self._V / values[:rank] @ U[:, :rank].T  # Gᵀ(GGᵀ)⁺, (size, j)
        self._faint = R @ U[:, rank:]
        self.K = R @ np.linalg.solve(R.T @ R, U[:, rank:])
        self.faint = (B @ self._faint).T
        self.faint[seen - rank :] = 0.0

    def project(self, x: np.ndarray) -> np.ndarray:
        """P x with P = I − Gᵀ(GGᵀ)⁺G: the part of contact forces or displacements (size,) without rigid motion."""
        # As many rigid motions as contact unknowns: P is zero, and subtraction would leave rounding.
        if self._V.shape[0] == self._V.shape[1]:
            return np.zeros_like(x)
        return x - self._V @ (self._V.T @ x)

    def balance(self, f: np.ndarray) -> np.ndarray:
        """Πᵀ f: the load (n,) with contact forces that balance it, as far as they can; the rest is left out."""
        # Πᵀ f = f − K k − Bᵀ s with the least contact forces s of G s = Rᵀ f along the motions that are seen
        return f - self.K @ (self._faint.T @ f) - self._B.T @ (self._inverse @ (self._R.T @ f))

    def centre(self, u: np.ndarray) -> np.ndarray:
        """Π u: the displacement (n,) without its rigid motion."""
        return u - self._R @ (self._inverse.T @ (self._B @ u)) - self._faint @ (self.K.T @ u)


@dataclass(frozen=True)
class FreeFrame:
    """What forces decide of the frame of a body, or of a rigid partner, that moves far.

    Attributes
    ----------
    axes : (a,) of the world along which it is free to move
    turns : (t, 1 or 3) unit vectors about which it is free to turn, in the plane [1]
    pivot : (d,) of its turn, in the coordinates of the drawing (m)
    size : farthest distance of a node from the pivot (m), which turns are multiplied by
    part : of its `motion` that is free; None of a body without supports
    """

    axes: Sequence[int]
    turns: np.ndarray
    pivot: np.ndarray
    size: float
    part: Motion | None = None

    @classmethod
    def of(cls, part: Motion | None, points: np.ndarray, axisymmetric: bool = False) -> FreeFrame:
        """That of something with these nodes (k, d): as its `part` says, or of a body without supports."""
        d = points.shape[1]
        free = part.free if part and part.free else ["y"] if axisymmetric else [*"xyz"[:d], "turn"]
        pivot = points.mean(axis=0) if part is None else np.array(part.pivot or np.zeros(d))
        turns = part.about[None] if part and (d == 2 or part.axis) else np.eye(1 if d == 2 else 3)
        return cls(
            ["xyz".index(axis) for axis in free if axis != "turn"],
            turns[: ("turn" in free) * len(turns)],
            pivot,
            float(np.linalg.norm(points - pivot, axis=1).max()),
            part,
        )

    @property
    def history(self) -> str | None:
        """Of its force and moment."""
        return self.part.history if self.part else None

    def motions(self, points: np.ndarray, turned: np.ndarray) -> np.ndarray:
        """Displacements (k, d, j) of points (k, d) of the drawing by its motions, in the axes of the frame, which is
        `turned` (d, d): along axes of the world, then by turns that move the farthest node by one."""
        return np.stack(
            [
                *(np.zeros_like(points) + turned[axis] for axis in self.axes),
                *(
                    crossed(turn[None], points - self.pivot) / self.size
                    for turn in self._seen(turned)
                ),
            ],
            axis=2,
        )

    def _seen(self, turned: np.ndarray) -> np.ndarray:
        """The axes of its turns (t, 1 or 3), seen from the frame."""
        return self.turns @ turned if self.turns.shape[1] == len(turned) else self.turns

    @property
    def push(self) -> np.ndarray:
        """Its force and moment along its motions (j,), at the factor 1 of their history (N)."""
        force, moment = (self.part.force, self.part.moment) if self.part else (None, 0.0)
        # a number is the moment about the axis
        moments = (
            self.turns @ np.array(moment)
            if isinstance(moment, tuple)
            else np.full(len(self.turns), moment)
        )
        return np.array(
            [
                *((force[axis] for axis in self.axes) if force else [0.0] * len(self.axes)),
                *(moments / self.size),
            ]
        )

    def resists(
        self, points: np.ndarray, turned: np.ndarray, dead: np.ndarray, following: np.ndarray
    ) -> np.ndarray:
        """K (j, j) = −∂e/∂α (N/m), by which loads (k, d) at points resist the motions; some follow turns.

        The moment of a force about a place that stays is e = f·(ω × (x − p)): as x moves, it changes by f·(ω × δx); and
        as a following f turns by φ about ω, all e = f·M change by φ (ω × f)·M. All in the axes of the frame.
        """
        M, K = self.motions(points, turned), np.zeros((len(self.axes) + len(self.turns),) * 2)
        for k, turn in enumerate(self._seen(turned), len(self.axes)):
            K[k] -= [
                ((dead + following) * crossed(turn[None], moved)).sum() / self.size
                for moved in np.moveaxis(M, 2, 0)
            ]
            K[:, k] -= np.einsum("nij,ni->j", M, crossed(turn[None], following)) / self.size
        return K

    @property
    def levers(self) -> np.ndarray:
        """The part of `resists` by its force, which moves along with the pivot."""
        none, force = np.zeros((1, len(self.pivot))), np.zeros((1, len(self.pivot)))
        force[0, self.axes] = self.push[: len(self.axes)]
        return self.resists(self.pivot[None], np.eye(len(self.pivot)), force, none)

    def since(self, before: np.ndarray, gone: np.ndarray) -> np.ndarray:
        """The motions α (j,) (m) from how far it had gone `before`, see `Freed`, to how far it has `gone`."""
        d, about = len(self.pivot), self.part.pivot if self.part else None
        then, now = (
            Frame.of(far[:d]).after(Frame.of(0.0 * far[:d], far[d:], about))
            for far in (before, gone)
        )
        way, turn = now.at(self.pivot) - then.at(self.pivot), now.after(then.undone).turn
        return np.concatenate([way[self.axes], np.radians(self.turns @ turn) * self.size])

    def _turn(self, alpha: np.ndarray) -> np.ndarray:
        """The turn (1,), in space a vector (3,), of motions α (j,) (m), in degrees."""
        return np.degrees(alpha[len(self.axes) :] / self.size) @ self.turns

    def turn(self, alpha: np.ndarray) -> float:
        """By how much it turns in motions α (j,) (m), in degrees."""
        return norm(self._turn(alpha))

    def gone(self, gone: np.ndarray, frame: Frame, alpha: np.ndarray) -> np.ndarray:
        """How far it has gone, see `Freed`, after motions α (j,) (m) from a frame."""
        shift, by = np.zeros(len(frame.shift)), self._turn(alpha)
        shift[self.axes] = alpha[: len(self.axes)]
        before, turn = np.split(gone, [len(shift)])
        # without supports the turn that is remembered is one about the origin
        shift += before if self.part else Frame.of(0.0 * shift, by, frame.at(self.pivot)).at(before)
        after = turn + by
        if (
            len(turn) == 3
        ):  # of the vectors of a rotation, which differ by whole turns, the nearest one
            after = Frame.of(0.0 * shift, by).after(Frame.of(0.0 * shift, turn)).turn
            size = norm(after)
            after = (
                after * (1.0 + 360.0 / size * round((turn @ after / size - size) / 360.0))
                if size
                else after
            )
        return np.concatenate([shift, after])
