"""Solves with a body's stiffness by a KSP; options prefix ``body_``."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sparse
from petsc4py import PETSc
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.blas import dsymv

from ddmpi.errors import SolverError
from ddmpi.petsc.messages import petsc_message, reason_name
from ddmpi.petsc.schur import hold_schur, invert_on_first, inverted_schur, request_schur

REFINEMENTS = 3
"""An iterative solve with too large a true residual is refined this often; then it is an error."""

TRUE_RESIDUAL = ("cg", "fcg", "pipecg", "gmres", "fgmres", "bcgs", "cr")
"""KSP types that can test the unpreconditioned residual; for the others the check after the solve decides."""

MUMPS_ORDERING = 2
"""Approximate minimum fill. MUMPS's own choice without METIS, PORD, took 1.3 to 2 times as long with linear
triangles and four times as long with quadratic ones. With a Schur complement MUMPS uses its own ordering."""

DIRECT_RESIDUAL = 1e-6
"""A direct solve whose relative residual exceeds this has failed (a pivot was lost)."""

BACKWARD_ERROR = 2 * np.finfo(float).eps
"""Backward error of a solve in double precision. An iterative solve whose residual is below this times ‖A‖ ‖u‖ is
accepted even if it misses its tolerance, because a direct solve would do no better."""

USUAL, LEAST = 1e-10, 1e-13
"""Relative residuals of an iterative solve: the usual one, and the smallest that is ever asked for."""


class StiffnessSolver:
    """Solves with the stiffness A of one body; a factorization is made once, at construction.

    The default is MUMPS Cholesky; without MUMPS, CHOLMOD; without that, PETSc's own.

    Parameters
    ----------
    A : the stiffness matrix, symmetric positive definite
    name : the body's name, for messages
    schur : dofs on which the inverse of the Schur complement is wanted; only MUMPS gives it
    iterative : conjugate gradients with algebraic multigrid instead of a factorization

    Attributes
    ----------
    direct : whether solves are by a factorization alone
    given : relative residual at which -body_ksp_rtol stops an iterative solver; zero without that option
    inverse : (k, k) A⁻¹ on the dofs `schur` (m/N), which is the inverse of the Schur complement: symmetric,
        Fortran order; or None. Read only, and valid only as long as the solver exists

    Raises
    ------
    SolverError
        when the factorization fails. Collective on A's communicator.
    """

    def __init__(self, A: PETSc.Mat, name: str, schur: np.ndarray | None = None, iterative: bool = False) -> None:
        self.A, self.name = A, name
        self.ksp = PETSc.KSP().create(A.comm)
        self.ksp.setOptionsPrefix("body_")
        self.ksp.setOperators(A)
        self.inverse: np.ndarray | None = None
        try:
            self._configure(iterative)
            self._set_up(schur)
        except PETSc.Error as error:
            given = ", ".join(f"-{k} {v}" for k, v in PETSc.Options().getAll().items() if k.startswith("body_"))
            raise SolverError(f"body {name!r}: PETSc cannot set up its solver ({self.description}"
                              f"{'; options ' + given if given else ''}): {petsc_message(error)}") from None
        self._residual, self._correction = A.createVecs()
        self._first = True

    def _configure(self, iterative: bool) -> None:
        """Set defaults, then the user's options, then what follows from both."""
        options = PETSc.Options("body_")
        self.ksp.setType(PETSc.KSP.Type.CG if iterative else PETSc.KSP.Type.PREONLY)
        pc = self.ksp.getPC()
        pc.setType(PETSc.PC.Type.GAMG if iterative else PETSc.PC.Type.CHOLESKY)
        if options.getString("pc_type", pc.getType()) == "cholesky":
            pc.setFactorSolverType(options.getString("pc_factor_mat_solver_type", best_cholesky(self.A)))
        self.ksp.setTolerances(rtol=USUAL, atol=0.0, max_it=2000)
        self.ksp.setErrorIfNotConverged(False)
        self.ksp.setFromOptions()
        self.direct = self.ksp.getType() == PETSc.KSP.Type.PREONLY
        self._adapts = not self.direct and not options.hasName("ksp_rtol")
        self._tolerances = self.ksp.getTolerances()
        self.given = 0.0 if self.direct or self._adapts else self._tolerances[0]
        if not options.hasName("ksp_norm_type") and self.ksp.getType() in TRUE_RESIDUAL:
            self.ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
            if self.ksp.getType() == "gmres":
                self.ksp.setPCSide(PETSc.PC.Side.RIGHT)

    def _set_up(self, schur: np.ndarray | None) -> None:
        """Factor, and keep the inverse of the Schur complement if MUMPS gives it."""
        pc = self.ksp.getPC()
        if not (self.direct and pc.getType() == PETSc.PC.Type.CHOLESKY and pc.getFactorSolverType() == "mumps"):
            schur = None
        if schur is not None and self.A.size[0] <= 2 * len(schur):  # little to eliminate, where MUMPS may fail
            self.inverse, schur = _dense_inverse(self.A, schur, self.name), None
        if schur is not None:
            request_schur(pc, schur)
        self._factor()
        if schur is not None:
            self.inverse = inverted_schur(pc, len(schur))

    def _factor(self) -> None:
        """Set up the KSP, with our ordering of MUMPS unless the user names one."""
        options, name = PETSc.Options(), "body_mat_mumps_icntl_7"  # for an option that not all versions have a call for
        default = not options.hasName(name)
        if default:
            options.setValue(name, MUMPS_ORDERING)
        try:
            self.ksp.setUp()
        finally:
            if default:
                options.delValue(name)

    @property
    def description(self) -> str:
        """Type of KSP, PC and factorization, for logs and results."""
        pc = self.ksp.getPC()
        kind = f"{self.ksp.getType()} + {pc.getType()}"
        return f"{kind} ({pc.getFactorSolverType()})" if pc.getType() in ("cholesky", "lu") else kind

    def solve(self, f: PETSc.Vec, u: PETSc.Vec, relative: float = 0.0) -> None:
        """u ← A⁻¹ f. Collective. Raises SolverError when the true residual is too large.

        A direct solver is checked at its first solve (the certificate checks the last one). An iterative
        solver is checked at every solve, and refined if its own norm stopped it too early.

        Parameters
        ----------
        relative : ‖f − A u‖ / ‖f‖ at which an iterative solver stops; zero stands for USUAL. The option
            -body_ksp_rtol takes precedence
        """
        usual, *others = self._tolerances
        precision = usual
        if self._adapts:
            precision = max(relative or usual, LEAST)
            self.ksp.setTolerances(precision, *others)
        self._solve(f, u)
        if self.direct and not self._first:
            return
        self._first = False
        size = f.norm()
        target = DIRECT_RESIDUAL if self.direct else 2 * max(precision, usual)  # with room for rounding
        for attempt in range(REFINEMENTS + 1):
            self.A.mult(u, self._residual)
            self._residual.aypx(-1.0, f)
            residual = self._residual.norm()
            if residual <= target * size or residual <= min(BACKWARD_ERROR * self._norm * u.norm(),
                                                            DIRECT_RESIDUAL * size):
                return
            if not np.isfinite(residual) or attempt == REFINEMENTS:
                break
            self._solve(self._residual, self._correction)
            u.axpy(1.0, self._correction)
        hint = "" if self.direct else "; -body_ksp_rtol sets another precision"
        raise SolverError(f"body {self.name!r}: {self.description} left a true residual of "
                          f"{residual / size:.1e} relative to the load, {target:.0e} is needed{hint}")

    @cached_property
    def _norm(self) -> float:
        """‖A‖, the largest sum of a row (N/m)."""
        return self.A.norm(PETSc.NormType.NORM_INFINITY)

    def solve_block(self, F: np.ndarray) -> np.ndarray:
        """A⁻¹ F for the columns of F (n, k); with a factorization the residuals are not checked. Collective."""
        if self.direct and self.ksp.getPC().getType() in ("cholesky", "lu"):
            right = PETSc.Mat().createDense(F.shape, array=np.asfortranarray(F), comm=self.A.comm)
            found = PETSc.Mat().createDense(F.shape, comm=self.A.comm)
            found.setUp()
            self.ksp.getPC().getFactorMatrix().matSolve(right, found)
            return found.getDenseArray().copy()
        U, (f, u) = np.empty(F.shape), self.A.createVecs()
        for k in range(F.shape[1]):
            f.array[:] = F[:, k]
            self.solve(f, u)
            U[:, k] = u.array_r
        return U

    def _solve(self, f: PETSc.Vec, u: PETSc.Vec) -> None:
        self.ksp.solve(f, u)
        reason = self.ksp.getConvergedReason()
        if reason < 0:
            raise SolverError(f"body {self.name!r}: {self.description} failed with "
                              f"{reason_name(PETSc.KSP.ConvergedReason, reason)} after "
                              f"{self.ksp.getIterationNumber()} iterations")


class SharedSolver(StiffnessSolver):
    """A `StiffnessSolver` of a stiffness whose rows are on several ranks; all its methods are collective on them.

    PETSc does not solve with MUMPS's factors beside a Schur complement on several ranks, except for the interior with
    the dofs of the Schur complement held. So a solve is one of the interior, which leaves a residual g on these dofs,
    their displacement `inverse` g on the first rank, and another solve of the interior.

    Parameters
    ----------
    A, name, iterative : as for `StiffnessSolver`
    schur : the same on all ranks, in the numbers of A, in any order

    Attributes
    ----------
    inverse : in the order of `schur`, on the first rank only
    little : whether a Schur complement was not asked of MUMPS since there is little to eliminate
    """

    def _set_up(self, schur: np.ndarray | None) -> None:
        pc, self.little = self.ksp.getPC(), False
        self._held: np.ndarray | None = None
        if not (self.direct and pc.getType() == PETSc.PC.Type.CHOLESKY and pc.getFactorSolverType() == "mumps"):
            schur = None
        if schur is not None and self.A.size[0] <= 2 * len(schur):
            schur, self.little = None, True
        if schur is not None:
            request_schur(pc, schur if self.A.comm.rank == 0 else schur[:0])
        self._factor()
        if schur is not None:
            self._condense(pc, schur)

    def _condense(self, pc: PETSc.PC, schur: np.ndarray) -> None:
        """Invert the Schur complement, and have MUMPS solve with these dofs held from now on."""
        self._factors, comm = pc.getFactorMatrix(), self.A.comm.tompi4py()
        code, definite = self._factors.getMumpsInfog(1), True
        if code >= 0 and comm.rank == 0:
            self.inverse = invert_on_first(pc, len(schur))
            definite = self.inverse is not None
        if code < 0 or not comm.bcast(definite):
            raise SolverError(f"body {self.name!r}: the stiffness cannot be factored (MUMPS: INFOG(1) = {code})")
        hold_schur(self._factors)
        start, stop = self.A.getOwnershipRange()
        self._held, self._comm = np.flatnonzero((schur >= start) & (schur < stop)), comm
        self._own = schur[self._held] - start
        self._spread, self._work = self.A.createVecs()
        self._spread.set(0.0)
        self._right, self._found = (PETSc.Mat().createDense((self._work.sizes, 1), comm=self.A.comm,
                                                            array=np.zeros((stop - start, 1))) for _ in range(2))
        self._moved = np.zeros(len(schur))

    def _solve(self, f: PETSc.Vec, u: PETSc.Vec) -> None:
        if self._held is None:
            super()._solve(f, u)
            return
        try:
            self._interior(f, u)
            self.A.mult(u, self._work)
            self._work.aypx(-1.0, f)
            self._move(self._work)
            self._spread.array[self._own] = self._moved[self._held]  # zero elsewhere
            self.A.mult(self._spread, self._work)
            self._work.aypx(-1.0, f)
            self._interior(self._work, u)
            u.array[self._own] = self._moved[self._held]
        except PETSc.Error as error:
            raise SolverError(f"body {self.name!r}: {self.description} failed: {petsc_message(error)}") from None

    def _interior(self, f: PETSc.Vec, u: PETSc.Vec) -> None:
        """u ← the displacement under f with the dofs of the Schur complement held."""
        self._right.getDenseArray()[:, 0] = f.array_r
        self._factors.matSolve(self._right, self._found)
        u.array[:] = self._found.getDenseArray()[:, 0]
        u.array[self._own] = 0.0

    def _move(self, residual: PETSc.Vec) -> None:
        """Displacement of the dofs of the Schur complement, from what the held ones leave there; on all ranks."""
        self._moved[:] = 0.0
        self._moved[self._held] = residual.array_r[self._own]
        total = np.empty_like(self._moved)
        self._comm.Reduce(self._moved, total)  # each is one rank's, so that the sums are exact
        if self.inverse is not None:
            self._moved[:] = dsymv(1.0, self.inverse, total)
        self._comm.Bcast(self._moved)

    def destroy(self) -> None:
        """Free what PETSc holds of it."""
        work = () if self._held is None else (self._spread, self._work, self._right, self._found)
        for each in (self.ksp, self._residual, self._correction, *work):
            each.destroy()


def best_cholesky(A: PETSc.Mat) -> str:
    """Name of the best package for a Cholesky factorization of A that this PETSc has."""
    return next((package for package in ("mumps", "cholmod") if offers_cholesky(A, package)), "petsc")


def offers_cholesky(A: PETSc.Mat, package: str) -> bool:
    """Whether this PETSc has a Cholesky factorization of A by `package`."""
    pc = PETSc.PC().create(A.comm)
    try:
        pc.setOperators(A)
        pc.setType(PETSc.PC.Type.CHOLESKY)
        pc.setFactorSolverType(package)
        pc.setFactorSetUpSolverType()
    except PETSc.Error:
        return False
    finally:
        pc.destroy()
    return True


def _dense_inverse(A: PETSc.Mat, dofs: np.ndarray, name: str) -> np.ndarray:
    """A⁻¹ on `dofs` by dense algebra."""
    indptr, columns, values = A.getValuesCSR()
    dense = sparse.csr_matrix((values, columns, indptr), A.size).toarray()
    try:
        return np.asfortranarray(cho_solve(cho_factor(dense), np.eye(len(dense))[:, dofs])[dofs])
    except (np.linalg.LinAlgError, ValueError) as error:  # not positive definite, not finite
        raise SolverError(f"body {name!r}: the stiffness cannot be factored: {error}") from None
