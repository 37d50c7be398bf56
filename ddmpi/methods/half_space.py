"""An approximate inverse of the joint contact compliance: the stiffness of half-spaces on the interfaces.

Two elastic half-spaces pressed by the stresses σ give way by u = (2/E*) |∂|⁻¹ σ, with 1/E* the sum of (1−ν²)/E of both
(Johnson, Contact Mechanics, 1985, ch. 2 and 3) and |∂| the square root of −Δ along the interface. Normal and tangential
parts decouple when the materials are alike, and nearly so otherwise. Under loads that vary over a few elements every
body gives way like a half-space, and these loads make the compliance ill-conditioned. The few smooth modes that depend
on the body's shape are left to GMRES. So the preconditioner needs no second factorization of bodies, and has their
contrast of stiffness.

−Δ is the Laplacian K of the interface's facets over its nodal areas W, so that M = (E*/2) W^½ A^½ W^½ with
A = W^−½ K W^−½ + (q/L)²: the longest wave is about the interface itself, whose length is L. The root is a sum over
few shifts, A^½ = Σ w (1 − t²(A + t²)⁻¹) (method 3 of Hale, Higham, Trefethen, SIAM J. Numer. Anal. 46, 2008).
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy.linalg as dense
import scipy.sparse as sparse
from scipy.sparse.linalg import splu
from scipy.special import ellipj, ellipkm1

from ddmpi.coupling.joint import STEERING, Joint, Point
from ddmpi.coupling.member import Member
from ddmpi.coupling.space import Space
from ddmpi.interface.interface import Interface
from ddmpi.system.numbers import SAME

LONGEST = {1: 1.5, 2: 3.0}
"""Wave number of the longest wave times the length of the interface, q above, by the number of tangential components.
Under loads on a whole contact bodies give way less than half-spaces do, in space still less."""

FIRM, UNEVEN = 0.55, 1.5
"""On interfaces with `waves`, C M would have eigenvalues of 1.1 to 2.8 for short waves, and of 0.02 to 0.05 for rows at
clamps, whose functions have no such waves. There M has the factor FIRM, and rows of little local compliance J the
factor (c J)^½ to the power UNEVEN. Two boxes then take 182 products instead of 256, by multigrid 126 instead of 292."""

SHIFTS = 6
"""Terms of the root: its relative error is about exp(−2π² SHIFTS/(ln κ + 3)), 1e-3 at a condition κ of A of 1e6."""

SMALL = 40
"""Up to so many nodes dense inverses are made in less time than one sparse matrix: of the contacts of a small body."""

MODE_STEPS, MODE_PRECISION = 60, 0.05
"""Most Lanczos steps for a body's smooth modes, and the relative error of the modes; they only precondition."""

LIMIT = 2.5
"""The model of a compliance has the modes in which bodies give way by more than this times what half-spaces do."""

BENDING = 1e-4
"""Products in GMRES are more precise where half-spaces give way by less than this fraction of what the body does, as
unbalanced forces bend it far: 1e-5 in needles of 1 : 30. Bolted plates, with 7e-4, would only cost three times as
much."""

LEARNT, DEPENDENT = 60, 1e-8
"""Most products that a model knows; their directions below DEPENDENT of the largest are rounding."""

MODEL_STEPS, FORESEEN, SOLVED = 40, 0.1, 0.03
"""Most steps to the answer of a model, and the fraction SOLVED of the residual that they leave. They begin with the
present status of nodes if the residual is below FORESEEN, else with all nodes under pressure sticking."""

CORRECTED, COARSEST, FINER = 0.03, 3e-3, 0.1
"""Error of the product after a step, over the change of the forces; its limit over the forces; and the factor on the
first each time that rough gaps are computed anew, as on slender bodies small errors of forces move bodies far."""


class HalfSpace:
    """M ≈ C⁻¹ (N/m): a block for each interface, without coupling between them or between the normal and tangential
    components. `local` (size,) are the compliances `Joint.local`, for interfaces with waves. Not collective.

        >>> joint = ddmpi.solve("configs/punch.toml", MPI.COMM_WORLD).solved.assembly.joint
        >>> M, x = HalfSpace(joint.space), np.cos(3.0 * np.arange(joint.size))  # forces that vary from node to node
        >>> like = M.mult(joint.product(x, "example"))
        >>> 0.5 < joint.space.norm(like) / joint.space.norm(x) < 2.0  # M C is about the identity
        True
    """

    def __init__(self, space: Space, local: np.ndarray | None = None) -> None:
        self._met = np.array([interface.m > 0 for interface in space.interfaces], bool)
        parts = [
            pair for pair in space.with_slices() if pair[0].m
        ]  # not bodies that left each other
        self._at, self._even = np.empty(0, int), np.ones((space.size, 1))
        if not parts:
            return
        interfaces = [interface for interface, _ in parts]
        self._columns = max(_columns(interface) for interface in interfaces)
        self._of = np.repeat(np.arange(len(parts)), [interface.m for interface in interfaces])
        first = np.searchsorted(self._of, np.arange(len(parts)))  # node of each interface
        self._at = np.concatenate(
            [
                self._columns * (start + interface.law.node) + _component(interface)
                for start, interface in zip(first, interfaces, strict=True)
            ]
        )
        self._scale = np.array([0.5 * interface.modulus for interface in interfaces])
        for k, (interface, entries) in enumerate(parts):
            if interface.geometry.waves:
                self._even[entries, 0] = _evenness(
                    interface, np.zeros(interface.size) if local is None else local[entries]
                )
                self._scale[k] *= FIRM
        self._factor(interfaces, first)

    def _factor(self, interfaces: Sequence[Interface], first: np.ndarray) -> None:
        """A and its root for these interfaces, whose first nodes have the numbers `first`."""
        area = np.concatenate([interface.area for interface in interfaces])
        stiffness = np.concatenate([interface.stiffness[: interface.m] for interface in interfaces])
        spacing = self._scale[self._of] * area / stiffness
        self._spacing = np.bincount(self._of, spacing) / np.bincount(self._of)
        length = np.array([interface.length for interface in interfaces])
        longest = np.array([LONGEST[interface.law.components] for interface in interfaces])
        self._lowest = (longest / length) ** 2
        self._root = np.sqrt(area)[:, None]
        laplacians = [interface.geometry.laplacian for interface in interfaces]
        small = len(area) <= SMALL
        if small:
            A = dense.block_diag(*(each.toarray() for each in laplacians)) / self._root
            A = A / self._root.T + np.diag(self._lowest[self._of])
        else:
            over = sparse.diags(1.0 / self._root[:, 0])
            A = over @ sparse.block_diag(laplacians, "csr") @ over
            A = (A + sparse.diags(self._lowest[self._of])).tocsr()
        # Hale, Higham, Trefethen 2008, method 3: A^½ = (2/π) ∫ A (A + t²)⁻¹ dt over t > 0 with t = √lowest sn/cn(u), by
        # the midpoint rule in u up to the complete elliptic integral K of m = 1 − lowest/highest. Twice the largest
        # diagonal entry stands for the highest eigenvalue
        modulus = self._lowest / (2.0 * np.maximum.reduceat(A.diagonal(), first))
        quarter = ellipkm1(modulus)
        middles = (np.arange(SHIFTS) + 0.5)[:, None] / SHIFTS
        sn, cn, dn, _ = ellipj(middles * quarter, 1.0 - modulus)
        self._weights = 2.0 * quarter * np.sqrt(self._lowest) / (np.pi * SHIFTS) * dn / cn**2
        self._shifts, self._sum = self._lowest * (sn / cn) ** 2, self._weights.sum(axis=0)
        squares = self._shifts[:, self._of]
        if small:
            inverses = np.linalg.inv(A + squares[:, :, None] * np.eye(len(area)))
            self._solve = lambda x: inverses @ x
            return
        # all A + t² in one block-diagonal matrix: one factorization and one solve
        shifted = sparse.block_diag(SHIFTS * [A], format="csc")
        shifted.setdiag(shifted.diagonal() + squares.ravel())
        factors = splu(shifted)
        self._solve = lambda x: factors.solve(np.tile(x, (SHIFTS, 1))).reshape(SHIFTS, *x.shape)

    def softened(self, deltas: np.ndarray | Sequence[float]) -> HalfSpace:
        """(1 + δ) (M⁻¹ + δ/c)⁻¹: half-spaces behind a layer, δ of each interface, c as `Interface.stiffness`.

        By R/(1 + bR) = 2/π ∫ (1 − t²(A + t²)⁻¹) / (1 + b²t²) dt for R = A^½; b is δ times the spacing of nodes.
        """
        softer = copy.copy(self)
        if self._met.any():
            delta = np.asarray(deltas, float)[self._met]
            b = delta * self._spacing
            softer._scale = self._scale * (1.0 + delta)
            softer._weights = self._weights / (1.0 + b**2 * self._shifts)
            thick = b**2 * self._lowest > 1.0  # the shifts leave out small t
            softer._sum = np.where(
                thick, 1.0 / np.where(thick, b, 1.0), softer._weights.sum(axis=0)
            )
        return softer

    def mult(self, x: np.ndarray, inverse: bool = False) -> np.ndarray:
        """M x in newtons, of x (size,) or columns (size, c) in metres; or M⁻¹ x in metres, of x in newtons."""
        if not x.size:
            return x
        columns = x.reshape(len(x), -1)
        even = self._even ** (1 if inverse else -1)
        nodes = np.zeros((len(self._root) * self._columns, columns.shape[1]))
        nodes[self._at] = even * columns
        y = self._apply(nodes.reshape(len(self._root), -1), inverse).reshape(nodes.shape)
        return (even * y[self._at]).reshape(x.shape)

    def _apply(self, x: np.ndarray, inverse: bool) -> np.ndarray:
        """The root of the operator, or its inverse A^−½ = Σ w (A + t²)⁻¹, on columns x (m, c)."""
        # M = scale W^½ A^½ W^½ with A^½ = Σ w (1 − t² (A + t²)⁻¹), and M⁻¹ = W^−½ A^−½ W^−½ / scale
        scale = self._scale[self._of, None]
        x = x / self._root if inverse else self._root * x
        shifted = self._solve(x)  # (A + t²)⁻¹ x (SHIFTS, m, c)
        weights = self._weights if inverse else self._weights * self._shifts
        summed = np.einsum("tm,tmc->mc", weights[:, self._of], shifted)
        if inverse:
            return summed / (scale * self._root)
        return scale * self._root * (self._sum[self._of, None] * x - summed)


def _columns(interface: Interface) -> int:
    """Components of a node: the normal one, and the tangential ones."""
    return 1 + interface.law.components * (len(interface.sliding) > 0)


def _component(interface: Interface) -> np.ndarray:
    """(size,) the number of each entry's component, 0 for the normal one."""
    tangential = np.tile(np.arange(1, _columns(interface)), len(interface.sliding))
    return np.concatenate([np.zeros(interface.m, int), tangential])


def _evenness(interface: Interface, local: np.ndarray) -> np.ndarray:
    """(size,) the factor of rows whose functions have no waves within facets, see UNEVEN."""
    softness = np.sqrt(interface.stiffness * local)
    softness /= np.median(softness[softness > SAME * softness.max()])
    # at planes of symmetry there are rows along which no body moves
    return np.where(softness > SAME, np.minimum(softness, 1.0) ** UNEVEN, 1.0)


def smooth_modes(
    operator: Member | Joint, space: Space, limit: float
) -> tuple[np.ndarray, np.ndarray]:
    """Deformations in which a body, or all of them, give way much more than half-spaces do, by Lanczos steps.

    They are v = M⁻¹ x with C x = μ M⁻¹ x, where M are the half-spaces of the interfaces in `space` (coarse spaces by
    such eigenproblems: Spillane, Dolean, Hauret, Nataf, Pechstein, Scheichl, Numer. Math. 126, 2014).

    Parameters
    ----------
    operator : multiplies vectors of the `space` by C
    limit : modes with μ above it are returned

    Returns
    -------
    v : (j, space.size) contact displacements of unit energy vᵀ M v
    mu : (j,)

    Collective on the ranks of the operator. Raises SolverError.
    """
    half_space, size = HalfSpace(space, operator.local()), space.size
    most = min(MODE_STEPS, int(space.add(np.array([float(size)]))[0]))
    V, W, H = np.empty((0, size)), np.empty((0, size)), np.empty((0, 0))  # W = M V, H = Wᵀ C W
    v = 1.0 + 0.3 * np.random.default_rng(0).standard_normal(size)
    modes = (np.empty((0, size)), np.empty(0))
    while len(V) < most:
        # Lanczos steps with C M, symmetric in the product vᵀ M w. v is made orthogonal to all before, twice because of
        # rounding. H is full, not tridiagonal, as products with C are only as precise as MODE_PRECISION
        for _ in range(2):
            v = v - V.T @ space.add(W @ v)
        w = half_space.mult(v)
        length = np.sqrt(max(space.add(np.array([v @ w]))[0], 0.0))
        if not length > 0.0:
            break
        V, W, v = np.vstack([V, v / length]), np.vstack([W, w / length]), np.empty(size)
        operator.mult(W[-1], v, "modes", MODE_PRECISION)
        column = space.add(W @ v)
        H = np.block([[H, column[:-1, None]], [column[None, :]]])
        mu, Y = np.linalg.eigh(H)
        left = v - V.T @ column
        length = np.sqrt(max(space.add(np.array([left @ half_space.mult(left)]))[0], 0.0))
        error = length * np.abs(
            Y[-1]
        )  # the residual of each Ritz pair, a bound of the error of its μ
        above = mu > limit
        modes = Y[:, above].T @ V, mu[above]
        if (
            len(V) > 2
            and (error <= MODE_PRECISION * np.maximum(mu, limit))[mu > limit - error].all()
        ):
            break
    return modes


def modes_of(
    members: Sequence[Member], limits: Mapping[int, float]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """The `smooth_modes` of bodies above the limit for their components of friction, found once for bodies that are
    alike; products count for each. Collective on the bodies' communicators. Raises SolverError."""
    modes, products = [], dict[int, int]()
    alike = dict[int, tuple[np.ndarray, np.ndarray]]()
    for member in members:
        key, count = id(member.body.B), member.C.count  # bodies have B in common if they are alike
        if not member.interfaces:
            alike[key] = np.empty((0, member.size)), np.empty(0)
        elif key not in alike or member.dear:
            components = max(interface.law.components for interface in member.interfaces)
            alike[key] = smooth_modes(member, Space(member.interfaces), limits[components])
            products[key] = count["modes"]
        else:
            count["modes"] += products[key]
        modes.append(alike[key])
    return modes


class Model(Joint):
    """An approximation C̃ of the joint compliance, where a product with C is expensive.

    C̃ = M⁻¹ + Σ (μ − 1) v vᵀ has the half-spaces and the smooth modes v of all bodies. Products y = C x that are known
    make it better: C̃ x = y for all of them, by the block form of the update of Broyden, Fletcher, Goldfarb and Shanno
    (Schnabel, Quasi-Newton methods using multiple secant equations, 1983), which leaves C̃ positive definite.

    Parameters
    ----------
    joint : the operator; all but C is taken from it. For slender bodies its products in GMRES become more precise
    """

    def __init__(self, joint: Joint) -> None:
        self.__dict__.update(joint.__dict__)
        self.dear = False
        self._half_space = HalfSpace(joint.space, joint.local())
        self._modes, mu = smooth_modes(joint, joint.space, LIMIT)
        self._more, least = mu - 1.0, 1.0 / mu.max(initial=1.0)
        joint.steering = STEERING * (least if least < BENDING else 1.0)
        self._x, self._y, self._bx = np.empty(
            (3, 0, joint.size)
        )  # known products y = C x; C̃ x without them
        self._within = self._known = np.empty((0, 0))  # inverses of xᵀ C̃ x and xᵀ y

    def mult(self, x: np.ndarray, y: np.ndarray, purpose: str, relative: float = 0.0) -> None:
        """y ← C̃ x; collective on all bodies, but without products of bodies."""
        y[:] = self._unlearnt(x)
        # block BFGS: C̃ ← C̃ − C̃X (Xᵀ C̃ X)⁻¹ (C̃X)ᵀ + Y (Xᵀ Y)⁻¹ Yᵀ, from the C̃ of `_unlearnt`
        if len(self._x):
            a, b = self.space.add(np.stack([self._bx @ x, self._y @ x]))
            y += self._y.T @ (self._known @ b) - self._bx.T @ (self._within @ a)

    def _unlearnt(self, x: np.ndarray) -> np.ndarray:
        """C̃ x of half-spaces and modes alone."""
        return self._half_space.mult(x, inverse=True) + self._modes.T @ (
            self._more * self.space.add(self._modes @ x)
        )

    def learn(self, x: np.ndarray, y: np.ndarray) -> None:
        """Learn the product y = C x (size,), with an error that is small beside y. Collective on all bodies."""
        size = self.space.norm(x)
        if not size:
            return
        products = (
            np.vstack([former, new])
            for former, new in zip(
                (self._x, self._y, self._bx),
                (x / size, y / size, self._unlearnt(x / size)),
                strict=True,
            )
        )
        self._x, self._y, self._bx = (rows[-LEARNT:] for rows in products)
        grams = self.space.add(np.stack([self._x @ self._bx.T, self._x @ self._y.T]))
        self._within, self._known = (
            _inverse(0.5 * (gram + gram.T)) for gram in grams
        )  # Xᵀ Y is not quite symmetric

    def pass_through(self, s: np.ndarray, r: np.ndarray, alpha: np.ndarray, e: np.ndarray) -> None:
        """Choose d̃ so that the model has the gaps r (size,) under forces s (size,) and motions α; take the loads e."""
        # C̃ s − d̃ − Gᵀα = r: the model is exact at the iterate, and errs in changes of the gaps alone
        self.d = self.product(s, "model", 0.0) + self.offset - r - self.rigid.spread(alpha)
        self.e = e


class Modelled:
    """Newton steps by a model of the compliance: each goes to the answer of the model, and one product with C corrects
    its gaps.

    Parameters
    ----------
    joint : the operator
    newton : a `Newton` of a `Model` of it

    Attributes
    ----------
    rough : whether the gaps of the iterate are only as precise as the last step needed
    """

    def __init__(self, joint: Joint, newton: Any) -> None:
        self._joint, self._newton, self._corrected, self.rough = joint, newton, CORRECTED, False

    def step(self, point: Point, residual: float, size: float, guess: str) -> Point | None:
        """The change from `point` to the answer of the model, or None if the model's iteration finds none.

        Parameters
        ----------
        residual, size : of the equations over the forces, and the size (N) with which forces are compared
        guess : as of `Iterate`

        Collective. Raises SolverError.
        """
        joint, newton, (s, r, alpha, left) = self._joint, self._newton, point
        newton.joint.D, newton.joint.offset = joint.D, joint.offset
        newton.joint.pass_through(s, r, alpha, joint.e)
        newton.begin((s, r, alpha) if guess != "rest" else None, foreseen=residual < FORESEEN)
        least = joint.neglected / size if size else 0.0
        if newton.run(max(SOLVED * min(residual, 1.0), least)) != "converged":
            return None
        forces, turned = newton.forces, joint.rigid.spread(newton.motions)
        whole, moved = joint.space.norms([forces, forces - s])
        relative = (
            min(max(self._corrected * moved, joint.neglected) / whole, COARSEST) if whole else 0.0
        )
        opened = joint.product(forces, "newton", relative) + joint.offset - joint.d - turned - r
        self.rough = True
        closed = opened + turned - joint.rigid.spread(alpha)
        newton.joint.learn(forces - s, closed - joint.D * (forces - s))
        return Point(
            forces - s,
            opened,
            newton.motions - alpha,
            joint.imbalance(forces, newton.motions) - left,
        )

    def refine(self) -> None:
        """Note that the gaps are precise now; if they were rough, later products will be more precise."""
        self._corrected *= FINER if self.rough else 1.0
        self.rough = False


def _inverse(gram: np.ndarray) -> np.ndarray:
    """The inverse of a positive definite matrix, without directions that are rounding or negative by errors of
    products."""
    scale = 1.0 / np.sqrt(np.maximum(gram.diagonal(), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(scale[:, None] * gram * scale)
    kept = values > DEPENDENT * values[-1]
    vectors = scale[:, None] * vectors[:, kept]
    return (vectors / values[kept]) @ vectors.T
