"""Solves with a stiffness matrix, direct and iterative, what fails and how; the contact compliance."""

import numpy as np
import pytest
import scipy.sparse as sparse
from by_skfem import to_scipy
from petsc4py import PETSc
from scenes import mumps_is_known
from scipy.sparse.linalg import spsolve

from ddmpi.body.compliance import Compliance
from ddmpi.body.elasticity import Elasticity, assemble
from ddmpi.body.solver import StiffnessSolver, best_cholesky
from ddmpi.errors import SolverError
from ddmpi.interface.matching import pair
from ddmpi.interface.trace import trace
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.refine import raise_order
from ddmpi.mesh.shapes import generate_rectangle
from ddmpi.scene.bodies import BodySpec, Clamp, Foundation, Material, MeshSpec, Traction
from ddmpi.scene.contacts import Coulomb, SettledContact
from ddmpi.surface.boundary import contact_side


def block(divisions=(12, 6), young=2e11, clamp=("left",), size=(2.0, 1.0)) -> Elasticity:
    mesh = generate_rectangle(MeshSpec(shape="rectangle", size=size, divisions=divisions))
    return assemble(
        mesh,
        BodySpec(
            name="upper",
            mesh=MeshSpec(file="unused.msh"),
            clamp=list(clamp),
            material=Material(young=young, poisson=0.3),
            traction=[Traction(on="top", value=(1e6, -2e6))],
        ),
    )


def from_dense(matrix) -> PETSc.Mat:
    rows = sparse.csr_matrix(np.asarray(matrix, float))
    A = PETSc.Mat().createAIJ(
        rows.shape, csr=(rows.indptr, rows.indices, rows.data), comm=PETSc.COMM_SELF
    )
    A.setOption(PETSc.Mat.Option.SPD, True)
    return A


def vector(values) -> PETSc.Vec:
    return PETSc.Vec().createWithArray(np.array(values, float), comm=PETSc.COMM_SELF)


def solve(A: PETSc.Mat, f: PETSc.Vec) -> np.ndarray:
    u = f.duplicate()
    StiffnessSolver(A, "upper").solve(f, u)
    return u.array_r.copy()


needs_mumps = pytest.mark.skipif(
    best_cholesky(block().A) != "mumps", reason="this PETSc has no MUMPS"
)
known_mumps = pytest.mark.skipif(not mumps_is_known(), reason="MUMPS is not called directly")


# Direct


@needs_mumps
def test_ordering_of_mumps(petsc_options):
    """Minimum fill (2), which leaves no option behind; who names another (0, minimum degree) gets it."""

    def ordering() -> int:
        return StiffnessSolver(block().A, "upper").ksp.getPC().getFactorMatrix().getMumpsInfog(7)

    assert ordering() == 2
    assert not PETSc.Options().hasName("body_mat_mumps_icntl_7")
    petsc_options(body_mat_mumps_icntl_7=0)
    assert ordering() == 0
    assert PETSc.Options().getInt("body_mat_mumps_icntl_7") == 0


@pytest.mark.parametrize("package", [None, "mumps", "cholmod", "petsc"])
def test_default_is_a_direct_cholesky_factorization_by_the_best_package_or_that_asked_for(
    package, petsc_options
):
    problem = block()
    if package:
        petsc_options(body_pc_factor_mat_solver_type=package)
    solver, u = StiffnessSolver(problem.A, "upper"), problem.b.duplicate()
    assert (
        solver.direct
        and solver.description == f"preonly + cholesky ({package or best_cholesky(problem.A)})"
    )
    expected = spsolve(to_scipy(problem.A).tocsc(), problem.b.array_r)
    for factor in (1.0, -2.0):  # the second solve uses the same factorization
        solver.solve(factor * problem.b, u)
        assert np.linalg.norm(u.array_r - factor * expected) <= 1e-11 * np.linalg.norm(expected)


# Iterative

ITERATIVE = {
    "cg + gamg": {"body_ksp_type": "cg", "body_pc_type": "gamg"},
    "cg + jacobi": {"body_ksp_type": "cg", "body_pc_type": "jacobi"},
    "minres + jacobi": {"body_ksp_type": "minres", "body_pc_type": "jacobi"},
    "cg + cholesky": {"body_ksp_type": "cg"},
}


@pytest.mark.parametrize("options", ITERATIVE.values(), ids=ITERATIVE)
def test_iterative_solution_is_the_direct_one(options, petsc_options):
    problem = block()
    direct = solve(problem.A, problem.b)
    petsc_options(**options)
    solver = StiffnessSolver(problem.A, "upper")
    assert not solver.direct
    assert solver.description.startswith(options["body_ksp_type"])
    u = problem.b.duplicate()
    for _ in range(2):  # every solve is checked, not only the first
        u.set(0.0)
        solver.solve(problem.b, u)
        residual = np.linalg.norm(problem.b.array_r - to_scipy(problem.A) @ u.array_r)
        assert residual <= 2e-10 * problem.b.norm()
        assert np.linalg.norm(u.array_r - direct) <= 1e-7 * np.linalg.norm(direct)
    assert solver.ksp.getIterationNumber() < 500


def test_precision_asked_for_is_that_of_the_true_residual(petsc_options):
    """A kind norm of the method's own is found out, and the solution refined."""
    problem = block((24, 12))
    petsc_options(**ITERATIVE["cg + gamg"], body_ksp_norm_type="preconditioned", body_ksp_rtol=1e-6)
    u = vector(solve(problem.A, problem.b))
    assert (
        np.linalg.norm(problem.b.array_r - to_scipy(problem.A) @ u.array_r)
        <= 2e-6 * problem.b.norm()
    )


def test_an_iterative_solve_is_no_more_precise_than_it_is_asked_to_be():
    """A solve that may be rough takes fewer iterations; the next one is as precise as usual again."""
    problem = block((24, 12))
    solver, u, taken = (
        StiffnessSolver(problem.A, "block", iterative=True),
        problem.b.duplicate(),
        [],
    )
    # The solver knows the solution of a load that it has had.
    load, random = (
        problem.b.duplicate(),
        np.random.default_rng(0),
    )
    for relative, least, most in ((1e-2, 1e-5, 2e-2), (0.0, 0.0, 1e-8), (1e-5, 1e-8, 2e-5)):
        load.array[:] = random.standard_normal(load.size)
        solver.solve(load, u, relative)
        taken.append(solver.ksp.getIterationNumber())
        left = np.linalg.norm(load.array_r - to_scipy(problem.A) @ u.array_r) / load.norm()
        assert least <= left <= most
    assert taken[0] < taken[2] < taken[1]


@pytest.mark.parametrize("shape, size", [("rectangle", (3.0, 1.0)), ("box", (3.0, 1.0, 1.0))])
@pytest.mark.parametrize("clamp", [{"x": 0.0, "y": 0.0, "z": 0.0}, {"x": 0.0}])
def test_quadratic_elements_take_linear_ones_as_their_coarse_level(
    shape, size, clamp, petsc_options
):
    """In few iterations; algebraic multigrid alone is there by its option."""
    mesh = MeshSpec(
        shape=shape,
        origin=(0.0,) * len(size),
        size=size,
        divisions=(12, *(4,) * (len(size) - 1)),
        order=2,
    )
    components = {name: value for name, value in clamp.items() if name in "xyz"[: len(size)]}
    walls = [Clamp(on=on, **components) for on in ("left", "bottom")[: 1 + (len(clamp) == 1)]]
    spec = BodySpec(
        name="block",
        mesh=mesh,
        clamp=walls,
        material=Material(young=2e11, poisson=0.3),
        foundation=[Foundation(on="right", normal=1e9, tangential=1e9)],
    )
    problem = assemble(build_mesh(spec), spec)
    load, u = problem.b.duplicate(), problem.b.duplicate()
    load.array[:] = np.random.default_rng(0).standard_normal(load.size)
    solver = StiffnessSolver(problem.A, "block", iterative=True)
    assert solver.description == "cg + mg"
    solver.solve(load, u)
    assert np.linalg.norm(load.array_r - to_scipy(problem.A) @ u.array_r) <= 1e-9 * load.norm()
    assert solver.ksp.getIterationNumber() <= 35
    petsc_options(body_pc_type="gamg")
    assert StiffnessSolver(problem.A, "block", iterative=True).description == "cg + gamg"


@pytest.mark.parametrize("options", [{}, ITERATIVE["cg + gamg"]], ids=["direct", "iterative"])
def test_large_true_residual_is_an_error(options, petsc_options):
    petsc_options(**options)
    problem, softer = block(), block(young=1e11)
    solver = StiffnessSolver(problem.A, "upper")
    solver.A = softer.A  # what is solved is not what is checked
    softer.A.scale(4.0)
    with pytest.raises(SolverError, match=r"body 'upper': .* left a true residual of .* is needed"):
        solver.solve(problem.b, problem.b.duplicate())


def test_what_rounding_leaves_of_a_residual_is_no_failure():
    """A cantilever of 3 m × 25 mm: relative to the load, no solver gets the residual below 1e-8."""
    problem = block((240, 2), size=(3.0, 0.025))
    A, b = to_scipy(problem.A), problem.b
    direct = spsolve(A.tocsc(), b.array_r)
    assert np.linalg.norm(b.array_r - A @ direct) > 2e-10 * b.norm()
    u = b.duplicate()
    StiffnessSolver(problem.A, "upper", iterative=True).solve(b, u)
    assert np.linalg.norm(u.array_r - direct) <= 1e-5 * np.linalg.norm(direct)


# Failures


def test_iteration_limit_names_the_reason(petsc_options):
    petsc_options(body_ksp_type="cg", body_pc_type="jacobi", body_ksp_max_it=1)
    problem = block()
    solver = StiffnessSolver(problem.A, "upper")
    with pytest.raises(
        SolverError, match=r"'upper': cg \+ jacobi failed.* DIVERGED_\w+ after 1 iter"
    ):
        solver.solve(problem.b, problem.b.duplicate())


SINGULAR = {
    "zero row": np.diag([1.0, 0.0, 2.0, 3.0]),
    "zero": np.zeros((3, 3)),
    "rank one": np.ones((3, 3)),
    "floating chain": np.diag([1.0, 2, 2, 1]) - np.eye(4, k=1) - np.eye(4, k=-1),
    "not a number": np.diag([1.0, np.nan, 2.0]),
    "infinite": np.diag([1.0, np.inf, 2.0]),
}


@pytest.mark.parametrize("package", ["mumps", "cholmod", "petsc"])
@pytest.mark.parametrize("matrix", SINGULAR.values(), ids=SINGULAR)
def test_singular_matrix_is_an_error(matrix, package, petsc_options):
    petsc_options(body_pc_factor_mat_solver_type=package)
    with pytest.raises(SolverError, match="body 'upper'"):
        solve(from_dense(matrix), vector(1.0 + np.arange(len(matrix))))


@pytest.mark.parametrize("options", [{}, ITERATIVE["cg + jacobi"]], ids=["direct", "iterative"])
def test_load_that_is_no_number_is_an_error(options, petsc_options):
    petsc_options(**options)
    problem = block()
    f = problem.b.copy()
    f.array[3] = np.nan
    with pytest.raises(SolverError, match="body 'upper'"):
        solve(problem.A, f)


@pytest.mark.parametrize(
    "options",
    [
        {"body_ksp_type": "cgg"},
        {"body_pc_type": "gmag"},
        {"body_pc_factor_mat_solver_type": "mump"},
    ],
    ids=["ksp", "pc", "package"],
)
def test_unknown_type_is_an_error_for_the_user(options, petsc_options):
    petsc_options(**options)
    problem = block()
    words = rf"'upper': PETSc cannot set up its solver \(.*{next(iter(options.values()))}"
    with pytest.raises(SolverError, match=words):
        solve(problem.A, problem.b)


def test_what_only_a_solve_finds_wrong_is_an_error_for_the_user(petsc_options):
    """A preconditioner that is composed of none can be set up, but not applied."""
    petsc_options(body_ksp_type="cg", body_pc_type="composite")
    problem = block()
    with pytest.raises(SolverError, match=r"'upper': .* failed: .*No composite preconditioners"):
        solve(problem.A, problem.b)


@pytest.mark.skipif(not mumps_is_known(), reason="MUMPS is not called directly")
def test_factors_that_need_more_memory_than_is_allowed_are_an_error(petsc_options):
    """MUMPS's own numbers are in the message; with more memory there are factors."""
    problem = block((60, 60))
    trace = sparse.csr_matrix(([1.0], ([0], [0])), (1, problem.A.size[0]))
    petsc_options(body_mat_mumps_icntl_23=1)
    words = r"'upper': the stiffness cannot be factored \(MUMPS: INFOG\(1\) = -"
    with pytest.raises(SolverError, match=words):
        StiffnessSolver(problem.A, "upper", trace)
    petsc_options(body_mat_mumps_icntl_23=100)
    assert StiffnessSolver(problem.A, "upper", trace).condensed is not None


# The compliance, of a block whose bottom is the contact


def contact_problem(
    divisions=(8, 4), clamp=("left",), order=1
) -> tuple[Elasticity, sparse.csr_matrix, np.ndarray]:
    """The upper block's problem, its trace B, and C = B A⁻¹ Bᵀ by dense algebra."""
    upper, lower = (
        generate_rectangle(
            MeshSpec(shape="rectangle", origin=(0.0, y), size=(2.0, 1.0), divisions=divisions)
        )
        for y in (1.0, 0.0)
    )
    if order == 2:
        upper, lower = (raise_order(mesh, "mesh") for mesh in (upper, lower))
    spec = BodySpec(
        name="upper",
        mesh=MeshSpec(file="unused.msh"),
        clamp=list(clamp),
        material=Material(young=2e11, poisson=0.3),
        traction=[Traction(on="top", value=(1e6, -2e6))],
    )
    problem, other = assemble(upper, spec), assemble(lower, spec)
    sides = [
        contact_side(upper, upper.facets("bottom"), problem.supports, "upper", 2e11),
        contact_side(lower, lower.facets("top"), other.supports, "lower", 2e11),
    ]
    contact = SettledContact(
        name="upper-lower",
        bodies=("upper", "lower"),
        on=("bottom", "top"),
        friction=Coulomb(coefficient=0.3),
    )
    B = trace(pair(*sides, contact), 0, problem)
    dense = B.toarray()
    return problem, B, dense @ np.linalg.solve(to_scipy(problem.A).toarray(), dense.T)


KINDS = {
    "default": (None, {}, 1e-12),
    "explicit": ("explicit", {}, 1e-12),
    "direct": ("direct", {}, 1e-12),
    "explicit by solves": ("explicit", {"body_pc_factor_mat_solver_type": "cholmod"}, 1e-12),
    "explicit by multigrid": ("explicit", ITERATIVE["cg + gamg"], 1e-8),
    "iterative": ("iterative", {}, 1e-8),
}


@pytest.mark.parametrize(
    ("divisions", "order"), [((8, 4), 1), ((4, 2), 2)], ids=["linear", "quadratic"]
)
@pytest.mark.parametrize("name", KINDS)
def test_compliance_counts_by_purpose(name, divisions, order, petsc_options):
    """It is the dense one, and counts products and solves; zero costs nothing."""
    kind, options, precision = KINDS[name]
    petsc_options(**options)
    problem, B, C = contact_problem(divisions, order=order)
    operator = Compliance(problem.A, B, "upper", kind)
    assert operator.size == len(C) == 16
    assert operator.kind == kind or kind is None
    before, y, columns = operator.count.copy(), np.full(16, np.nan), np.empty((16, 16))
    for i, unit in enumerate(np.eye(16)):
        operator.mult(unit, y, "step1")
        columns[:, i] = y
    operator.mult(np.zeros(16), y, "step1")
    assert not y.any() and operator.count - before == {"step1": 16}
    assert np.abs(columns - C).max() <= precision * np.abs(C).max()
    assert np.abs(operator.dense() - C).max() <= precision * np.abs(C).max()
    assert operator.kind == "explicit" or operator.count["explicit"] == 16
    before, u = operator.count.copy(), problem.b.duplicate()
    operator.solve(problem.b, u, "load")
    assert operator.count - before == {"load": 1}
    expected = B @ spsolve(to_scipy(problem.A).tocsc(), problem.b.array_r)
    assert np.linalg.norm(B @ u.array_r - expected) <= precision * np.linalg.norm(expected)


@pytest.mark.parametrize("kind", ["explicit", "direct"])
@pytest.mark.parametrize("divisions", [(1, 1), (3, 1)])
def test_compliance_where_all_free_nodes_touch(divisions, kind):
    """Nothing is left to condense: the Schur complement is the whole stiffness."""
    problem, B, C = contact_problem(divisions, ["top"])
    operator = Compliance(problem.A, B, "upper", kind)
    assert np.abs(operator.dense() - C).max() <= 1e-12 * np.abs(C).max()


ROUTES = {  # options, what counts in MUMPS's module, why MUMPS is not called directly
    "own order": ({}, {}, ""),
    "MUMPS's order": ({}, {}, ""),
    "an ordering by option": ({"body_mat_mumps_icntl_7": 0}, {}, ""),
    "an option of PETSc's": (
        {"body_mat_mumps_icntl_10": 0},
        {},
        "-body_mat_mumps_icntl_10 is an option of PETSc's",
    ),
    "another MUMPS": (
        {},
        {"VERSIONS": (("4.1",), ("4.2",), ("4.3",))},
        "is not among those that ddmpi knows",
    ),
    "no agreement": ({}, {"AGREEMENT": -1.0}, "the compliance does not agree with a solve"),
}


@known_mumps
@pytest.mark.parametrize("route", ROUTES)
def test_one_factorization_gives_the_compliance_and_solves(route, petsc_options, monkeypatch):
    """C and solves with A, or solves alone where MUMPS is not called directly, and why it is not."""
    options, changed, refused = ROUTES[route]
    petsc_options(**options)
    for name, value in changed.items():
        monkeypatch.setattr(f"ddmpi.petsc.mumps.{name}", value)
    problem, B, C = contact_problem()
    order = np.random.default_rng(1).permutation(problem.b.size).astype(np.int32)
    solver = StiffnessSolver(problem.A, "upper", B, None if route == "MUMPS's order" else order)
    assert refused in solver.refused and bool(refused) == bool(solver.refused) == (
        solver._factors is None
    )
    assert bool(refused) == (solver.condensed is None)
    if solver._factors:
        assert np.abs(np.triu(solver.condensed) - np.triu(C)).max() <= 1e-12 * np.abs(C).max()
        # INFOG(7) is ICNTL(7) as it was used.
        assert (solver._factors._data.infog[6] == 1) == (route == "own order")
        for f in (problem.b.array_r, B[3].toarray()[0]):  # many entries and one
            found, moved = B @ solver._factors.solve(f), B @ spsolve(to_scipy(problem.A).tocsc(), f)
            assert np.abs(found - moved).max() <= 1e-12 * np.abs(moved).max()
    u, expected = problem.b.duplicate(), spsolve(to_scipy(problem.A).tocsc(), problem.b.array_r)
    for factor in (1.0, -2.0):
        f = problem.b.copy()
        f.scale(factor)
        solver.solve(f, u)
        assert np.linalg.norm(u.array_r - factor * expected) <= 1e-12 * np.linalg.norm(expected)


@needs_mumps
def test_singular_matrix_with_a_compliance_is_an_error():
    for matrix in SINGULAR.values():
        size = len(matrix)
        with pytest.raises(SolverError, match="body 'upper'"):
            solver = StiffnessSolver(
                from_dense(matrix), "upper", sparse.csr_matrix(np.eye(size)[:1])
            )
            solver.solve(vector(1.0 + np.arange(size)), vector(np.zeros(size)))


def test_rows_that_depend_on_each_other():
    """More rows than contact dofs, as where fine meshes meet coarse ones: C is singular."""
    problem, B, _ = contact_problem()
    many = sparse.vstack([B, 2.0 * B, B[:5]], format="csr")
    operator, dense = Compliance(problem.A, many, "upper"), many.toarray()
    C = dense @ np.linalg.solve(to_scipy(problem.A).toarray(), dense.T)
    y = np.empty(len(C))
    operator.mult(np.arange(len(C), dtype=float), y, "step1")
    assert np.linalg.norm(y - C @ np.arange(len(C))) <= 1e-12 * np.linalg.norm(y)
    assert np.abs(operator.dense() - C).max() <= 1e-12 * np.abs(C).max()
