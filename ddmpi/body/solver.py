"""Solves with a body's stiffness by a KSP; options prefix ``body_``."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sparse
from petsc4py import PETSc

from ddmpi.errors import SolverError
from ddmpi.petsc.mumps import Factors, MumpsError, RefusedError
from ddmpi.petsc.options import in_force
from ddmpi.petsc.versions import petsc_message, reason_name

REFINEMENTS = 3
"""An iterative solve with too large a true residual is refined this often; then it is an error."""

MUMPS_ORDERING = 2
"""Approximate minimum fill. MUMPS's own choice without METIS, PORD, took 1.3 to 2 times as long with linear triangles
and four times as long with quadratic ones. In space it takes 0.6 to 0.9 of the time, but ends the process (signal 11)
where few nodes are free."""

DIRECT_RESIDUAL = 1e-6
"""A direct solve whose relative residual exceeds this has failed (a pivot was lost)."""

BACKWARD_ERROR = 2 * np.finfo(float).eps
"""Backward error of a solve in double precision. An iterative solve whose residual is below this times ‖A‖ ‖u‖ is
accepted even if it misses its tolerance, because a direct solve would do no better."""

REMEMBERED = 40
"""An iterative solve starts from the best combination of this many earlier solutions (Fischer, Comput. Methods Appl.
Mech. Engng. 163, 1998), each of which takes the memory of two displacements."""

USUAL, LEAST = 1e-10, 1e-13
"""Relative residuals of an iterative solve: the usual one and the smallest one."""


class StiffnessSolver:
    """Solves with the stiffness A of one body; a factorization is made once, at construction.

    The default is MUMPS Cholesky; without MUMPS, CHOLMOD; without that, PETSc's own. All methods are collective on A's
    communicator. Raises SolverError when the factorization fails.

    Parameters
    ----------
    A : the stiffness matrix, symmetric positive definite
    name : the body's name, for messages
    trace : (k, columns of A) B on the first rank, if C = B A⁻¹ Bᵀ is wanted; without rows on the others. Only MUMPS
        computes C
    order : (columns of A,) the places of the rows of A in the order of elimination, on the first rank; None leaves it
        to MUMPS. Used with `trace` only
    iterative : conjugate gradients with algebraic multigrid instead of a factorization

    Attributes
    ----------
    direct : whether solves are by a factorization alone
    given : relative residual at which -body_ksp_rtol stops an iterative solver; zero without that option
    condensed : (k, k) C (m/N), in Fortran order, of which only the upper triangle is set; or None. On the first rank
        only
    refused : why MUMPS was not called directly for C, or empty
    """

    def __init__(
        self,
        A: PETSc.Mat,
        name: str,
        trace: sparse.csr_matrix | None = None,
        order: np.ndarray | None = None,
        iterative: bool = False,
    ) -> None:
        self.A, self.name = A, name
        self.ksp = PETSc.KSP().create(A.comm)
        self.ksp.setOptionsPrefix("body_")
        self.ksp.setOperators(A)
        self.condensed: np.ndarray | None = None
        self.refused = ""
        self._factors: Factors | None = None
        try:
            self._configure(iterative)
            self._set_up(trace, order)
        except PETSc.Error as error:
            given = ", ".join(f"-{k} {v}" for k, v in in_force().items() if k.startswith("body_"))
            raise SolverError(
                f"body {name!r}: PETSc cannot set up its solver ({self.description}"
                f"{'; options ' + given if given else ''}): {petsc_message(error)}"
            ) from None
        self._residual, self._correction = A.createVecs()
        self._first = True

    def _configure(self, iterative: bool) -> None:
        """Set defaults, then the user's options, then settings that depend on both."""
        options = PETSc.Options("body_")
        self.ksp.setType(PETSc.KSP.Type.CG if iterative else PETSc.KSP.Type.PREONLY)
        pc, coarse = self.ksp.getPC(), self.A.getAttr("coarse") if iterative else None
        multigrid = PETSc.PC.Type.MG if coarse else PETSc.PC.Type.GAMG
        pc.setType(multigrid if iterative else PETSc.PC.Type.CHOLESKY)
        if coarse and options.getString("pc_type", pc.getType()) == "mg":
            self._use_linear_elements(pc, *coarse())
        if options.getString("pc_type", pc.getType()) == "cholesky":
            pc.setFactorSolverType(
                options.getString("pc_factor_mat_solver_type", best_cholesky(self.A))
            )
        self.ksp.setTolerances(rtol=USUAL, atol=0.0, max_it=2000)
        self.ksp.setErrorIfNotConverged(False)
        if iterative:
            self.ksp.setUseFischerGuess(2, REMEMBERED)
        self.ksp.setFromOptions()
        self.direct = self.ksp.getType() == PETSc.KSP.Type.PREONLY
        self._adapts = not self.direct and not options.hasName("ksp_rtol")
        self._tolerances = self.ksp.getTolerances()
        self.given = 0.0 if self.direct or self._adapts else self._tolerances[0]
        if not options.hasName("ksp_norm_type") and self.ksp.getType() == PETSc.KSP.Type.CG:
            self.ksp.setNormType(
                PETSc.KSP.NormType.UNPRECONDITIONED
            )  # other types are checked after the solve alone

    def _use_linear_elements(
        self, pc: PETSc.PC, interpolation: PETSc.Mat, motions: PETSc.NullSpace
    ) -> None:
        """Multigrid in two levels: Chebyshev's iteration with the blocks of nodes on quadratic elements, and linear
        elements, Pᵀ A P, by algebraic multigrid.

        On quadratic elements algebraic multigrid has dense coarse levels: in a box of 212,000 dofs this takes a fifth
        of the time for a solve, and a fiftieth for the set-up.
        """
        linear = self.A.PtAP(interpolation)
        linear.setBlockSize(self.A.getBlockSize())
        linear.setNearNullSpace(motions)
        pc.setMGLevels(2)
        pc.setMGInterpolation(1, interpolation)
        coarse, smoother = pc.getMGCoarseSolve(), pc.getMGSmoother(1)
        coarse.setOperators(linear)
        coarse.setType(PETSc.KSP.Type.PREONLY)
        coarse.getPC().setType(PETSc.PC.Type.GAMG)
        smoother.setType(PETSc.KSP.Type.CHEBYSHEV)
        smoother.setTolerances(max_it=1)
        smoother.getPC().setType(PETSc.PC.Type.PBJACOBI)

    def _set_up(self, trace: sparse.csr_matrix | None, order: np.ndarray | None) -> None:
        """Factor, with C if MUMPS can be called directly for it."""
        pc = self.ksp.getPC()
        if trace is None or not (
            self.direct
            and pc.getType() == PETSc.PC.Type.CHOLESKY
            and pc.getFactorSolverType() == "mumps"
        ):
            self._factor()
            return
        try:
            self._factors = Factors(self.A, trace, order)
            self.condensed = self._factors.condensed
        except RefusedError as reason:
            self.refused = str(reason)
            self._factor()
        except MumpsError as error:
            raise SolverError(
                f"body {self.name!r}: the stiffness cannot be factored ({error})"
            ) from None

    def _factor(self) -> None:
        """Set up the KSP, with our ordering of MUMPS unless the user names one."""
        options, name = (
            PETSc.Options(),
            "body_mat_mumps_icntl_7",
        )  # for an option that not all versions have a call for
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
        return (
            f"{kind} ({pc.getFactorSolverType()})" if pc.getType() in ("cholesky", "lu") else kind
        )

    def at_once(self, loads: np.ndarray) -> np.ndarray | None:
        """A⁻¹ f (k, n) of several loads (k, n), where this rank alone has factors that solve for all of them together."""
        if self._factors is None or self.A.comm.size > 1 or self._first:
            return None
        return self._by(self._factors, loads)

    def solve(self, f: PETSc.Vec, u: PETSc.Vec, relative: float = 0.0) -> None:
        """u ← A⁻¹ f. Collective. Raises SolverError when the true residual is too large.

        A direct solver is checked at its first solve (the certificate checks the last one). An iterative solver stops
        at ‖f − A u‖ / ‖f‖ ≤ `relative`, zero stands for USUAL, unless -body_ksp_rtol is given. It is checked at every
        solve, and refined if its own norm stopped it too early.
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
        target = (
            DIRECT_RESIDUAL if self.direct else 2 * max(precision, usual)
        )  # with room for rounding
        for attempt in range(REFINEMENTS + 1):
            self.A.mult(u, self._residual)
            self._residual.aypx(-1.0, f)
            residual = self._residual.norm()
            # Either the residual is as small as asked, or the backward error ‖f − A u‖/(‖A‖ ‖u‖) is that of a direct
            # solver: no iteration gets below it.
            if residual <= target * size or residual <= min(
                BACKWARD_ERROR * self._norm * u.norm(), DIRECT_RESIDUAL * size
            ):
                return
            if not np.isfinite(residual) or attempt == REFINEMENTS:
                break
            self._solve(self._residual, self._correction)
            u.axpy(1.0, self._correction)
        raise SolverError(
            f"body {self.name!r}: {self.description} left a true residual of "
            f"{residual / size:.1e} relative to the load, {target:.0e} is needed; {self._hint(f)}"
        )

    def _hint(self, f: PETSc.Vec) -> str:
        """Why a solve for f is not precise. Options are the reason if Cholesky's factors do without them, else the
        stiffness is. Collective."""
        if not self.direct:
            return "-body_ksp_rtol sets another precision"
        given = {name: value for name, value in in_force().items() if name.startswith("body_")}
        if given:
            plain = without_options(self.A, f)
            if plain <= DIRECT_RESIDUAL:
                words = " ".join(
                    f"-{name}{f' {value}' if value else ''}" for name, value in given.items()
                )
                return f"without {words} it leaves {plain:.0e}: leave that out"
        explain = self.A.getAttr("causes")
        cause = explain() if explain else ""
        return "its stiffness is singular to double precision" + (f": {cause}" if cause else "")

    @cached_property
    def _norm(self) -> float:
        """‖A‖, the largest sum of a row (N/m)."""
        return self.A.norm(PETSc.NormType.NORM_INFINITY)

    def _solve(self, f: PETSc.Vec, u: PETSc.Vec) -> None:
        if self._factors is not None:
            self._solve_with(self._factors, f, u)
            return
        try:
            self.ksp.solve(f, u)
        except PETSc.Error as error:
            words = f"body {self.name!r}: {self.description} failed: {petsc_message(error)}"
            raise SolverError(words) from None
        reason = self.ksp.getConvergedReason()
        if reason < 0:
            raise SolverError(
                f"body {self.name!r}: {self.description} failed with "
                f"{reason_name(PETSc.KSP.ConvergedReason, reason)} after "
                f"{self.ksp.getIterationNumber()} iterations"
            )

    def _solve_with(self, factors: Factors, f: PETSc.Vec, u: PETSc.Vec) -> None:
        """Solve with factors that have the load and the displacement on the first rank."""
        comm, counts = self.A.comm.tompi4py(), np.diff(self.A.getOwnershipRanges())
        whole = np.empty(self.A.size[0]) if comm.rank == 0 else None
        comm.Gatherv(f.array_r, None if whole is None else [whole, counts])
        moved = self._by(factors, whole)
        local = np.empty(u.local_size)
        comm.Scatterv(None if moved is None else [moved, counts], local)
        u.array[:] = local

    def _by(self, factors: Factors, loads: np.ndarray | None) -> np.ndarray | None:
        """A⁻¹ f by factors. Raises SolverError."""
        try:
            return factors.solve(loads)
        except MumpsError as error:
            raise SolverError(f"body {self.name!r}: {self.description} failed: {error}") from None

    def destroy(self) -> None:
        """Free the objects of PETSc and MUMPS."""
        if self._factors is not None:
            self._factors.destroy()
        for item in (self.ksp, self._residual, self._correction):
            item.destroy()


def without_options(A: PETSc.Mat, f: PETSc.Vec) -> float:
    """The relative residual that Cholesky's factors leave, whatever options are set. Collective."""
    ksp, (u, left) = PETSc.KSP().create(A.comm), A.createVecs()
    try:
        ksp.setOperators(A)
        ksp.setType(PETSc.KSP.Type.PREONLY)
        ksp.getPC().setType(PETSc.PC.Type.CHOLESKY)
        ksp.getPC().setFactorSolverType(best_cholesky(A))
        ksp.solve(f, u)
        A.mult(u, left)
        left.aypx(-1.0, f)
        return float(left.norm() / f.norm())
    except PETSc.Error:
        return np.inf
    finally:
        for thing in (ksp, u, left):
            thing.destroy()


def best_cholesky(A: PETSc.Mat) -> str:
    """Name of the best package for a Cholesky factorization of A that this PETSc has."""
    there = PETSc.Sys.hasExternalPackage
    return (
        "mumps"
        if there("mumps")
        else "cholmod"
        if there("suitesparse") and A.comm.size == 1
        else "petsc"
    )
