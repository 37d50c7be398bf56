"""The kinds of contact compliance in whole runs: one answer, one count; who chooses them, and how precise they are."""

from collections.abc import Iterator

import numpy as np
import pytest
import scenes
import scipy.sparse as sparse
from petsc4py import PETSc
from scenes import mumps_is_known, pinched_blocks, prepare_scene, to_toml
from solid_scenes import box

from ddmpi.body import compliance
from ddmpi.body.compliance import (
    FACTORS,
    FACTORS_WITH_SCHUR,
    LARGEST_CONDENSED,
    LARGEST_RATIO,
    MARGIN,
    choose_kind,
    plan_compliance,
)
from ddmpi.body.elasticity import assemble
from ddmpi.mesh.build import build_mesh
from ddmpi.run.solve import solve
from ddmpi.scene.reader import read_scene
from ddmpi.system.memory import free_memory

METHODS = {"newton": {}, "relaxation": {"theta": 0.2}}


def solved(comm, method: dict) -> tuple:
    """The assembly and the certified answer of pinched blocks, and the CG iterations that they took."""
    assembly, taken = prepare_scene(comm, pinched_blocks(4, **method)), []
    for solver in (body.member.C.solver for body in assembly.bodies):

        def counted(f, u, once=solver._solve, ksp=solver.ksp):
            once(f, u)
            taken.append(ksp.getIterationNumber())

        solver._solve = counted
    answer = solve(assembly, assembly.scene.method)
    assert answer.certified
    return assembly, answer, sum(taken)


@pytest.mark.slow
@pytest.mark.mpi(ranks=2)
@pytest.mark.parametrize("name", METHODS)
def test_kinds_take_the_same_steps(comm, name):
    """The same iterates to the accuracy asked for, and multiplications counted alike, whatever computes them."""
    first = None
    for kind in ("explicit", "direct", "iterative"):
        assembly, answer, _ = solved(comm, METHODS[name] | {"compliance": kind})
        assert {(body.member.C.kind, body.member.C.reason) for body in assembly.bodies} == {
            (kind, "asked for")
        }
        forces, steps, count = (
            answer.outer.forces,
            len(answer.outer.history),
            assembly.joint.multiplications(),
        )
        if first is None:
            first, history, usual = forces, steps, count
        assert np.linalg.norm(
            forces - first
        ) <= 10 * assembly.scene.method.tolerance * np.linalg.norm(first)
        if kind == "iterative" and name == "newton":  # a model leads it
            assert count <= usual
        else:
            exact = kind == "direct"
            assert abs(steps - history) <= (0 if exact else 3)
            assert abs(count - usual) <= (0.02 if exact else 0.2) * usual


@pytest.mark.slow
@pytest.mark.mpi(ranks=2)
@pytest.mark.parametrize("name", METHODS)
def test_iterative_solves_follow_the_precision_that_is_needed(comm, name, petsc_options):
    """Fewer CG iterations than with all solves as precise as the last; a precision that is given is kept."""
    method = METHODS[name] | {"compliance": "iterative"}
    *_, taken = solved(comm, method)
    petsc_options(body_ksp_rtol=1e-10)
    *_, fixed = solved(comm, method)
    assert taken < 0.85 * fixed


# The choice


def choices() -> Iterator[tuple[int, int, float, int, str, str]]:
    """Unknowns, contact unknowns, memory, dimension; the kind, and words of the reason."""
    yield 100_000, 500, np.inf, 2, "explicit", ""
    for n in (0, 1, 2):  # next to nothing
        yield n, n, np.inf, 2, "explicit", ""
    for d, ratio in zip((2, 3), LARGEST_RATIO, strict=True):
        thin = int((ratio * 70_000) ** (1 / 3))
        yield 70_000, thin, np.inf, d, "explicit", ""
        yield 70_000, thin + 10, np.inf, d, "direct", f"{thin + 10} contact unknowns"
        # Thin bodies beyond memory: factors alone are small.
        yield (
            30_000,
            15_000,
            2**31,
            d,
            "direct",
            "",
        )
    n, k = int(LARGEST_CONDENSED[0]), 2000  # factors in space take time with n²
    yield n, 5000, np.inf, 3, "explicit", ""
    yield n + 1, 5000, np.inf, 3, "iterative", f"multigrid is faster than factors at {n + 1} dofs"
    yield 10 * n, 5000, np.inf, 2, "explicit", ""
    # where factors fit without the compliance, a body in the plane keeps them, and one in space does not
    for d, n, growth, without in (
        (2, 1_000_000, 1e6 * np.log2(1e6), "direct"),
        (3, 64_000, 40.0**4, "iterative"),
    ):
        direct, explicit = (
            MARGIN * each[d == 3] * growth for each in (FACTORS, FACTORS_WITH_SCHUR)
        )
        explicit += 8 * k**2
        yield n, k, 1.01 * explicit, d, "explicit", ""
        yield n, k, 0.99 * explicit, d, without, "factors and a dense matrix may take"
        yield n, k, 1.01 * direct, d, without, "factors and a dense matrix may take"
        yield n, k, 0.99 * direct, d, "iterative", "factors may take"


@pytest.mark.parametrize("n, k, memory, d, kind, words", list(choices()))
def test_kind_is_chosen_from_sizes_and_memory(n, k, memory, d, kind, words):
    found, reason = choose_kind(n, k, memory, d, LARGEST_CONDENSED[0])
    assert found == kind and words in reason


def test_contacts_that_clamps_hold_have_no_compliance():
    """Nor have bodies that touch nothing; one displacement that is free makes a contact."""
    A = PETSc.Mat().createAIJ((4, 4), nnz=1, comm=PETSc.COMM_SELF)
    held, free, none = (
        sparse.csr_matrix((([1.0] * k, ([0] * k, [3] * k))), (m, 4))
        for m, k in ((2, 0), (2, 1), (0, 0))
    )
    found = [plan_compliance(A, B, "explicit", np.inf) for B in (held, free, none)]
    assert found == [
        ("direct", "clamps constrain its whole contact: C = 0"),
        ("explicit", "asked for"),
        ("direct", "it touches nothing"),
    ]


@pytest.mark.parametrize(
    "divisions, order, solves, factor, kind",
    [
        ((18, 6, 6), 1, 1, 0.9, "explicit"),
        ((18, 6, 6), 1, 1, 1.1, "iterative"),
        ((18, 6, 6), 1, 2, 1.1, "explicit"),
        ((18, 6, 6), 1, 2, 2.2, "iterative"),
        ((6, 18, 6), 2, 1, 0.9, "explicit"),
        ((6, 6, 18), 2, 1, 1.3, "iterative"),
        ((120, 6, 6), 1, 1, 4.0, "explicit"),
        ((6, 6, 120), 1, 1, 9.0, "iterative"),
    ],
)
def test_order_shape_and_load_steps_decide_in_space(
    divisions, order, solves, factor, kind, monkeypatch
):
    """Boxes of `factor` times the largest number of dofs of their order; slender ones have cheap factors."""
    spec = read_scene(
        "",
        to_toml(
            {
                "body": [
                    box(name, (0, 0, z), divisions, divisions, order, clamp=["bottom"])
                    for name, z in (("a", 0), ("b", -999))
                ],
                "contact": [{"bodies": ["a", "b"], "on": ["bottom", "top"]}],
            }
        ),
    ).body[0]
    A = assemble(build_mesh(spec), spec).A
    largest = [0.0, 0.0]
    largest[order - 1] = A.size[0] / factor
    monkeypatch.setattr(compliance, "LARGEST_CONDENSED", largest)
    B = sparse.csr_matrix(([1.0], ([0], [0])), (5, A.size[0]))
    assert plan_compliance(A, B, None, np.inf, order == 2, solves)[0] == kind


@pytest.mark.slow
@pytest.mark.mpi(ranks=2)
def test_memory_decides_in_a_run(comm, monkeypatch):
    """On one rank only: bodies of unlike kinds work together."""
    import ddmpi.coupling.assembly

    if comm.rank == 1:
        monkeypatch.setattr(ddmpi.coupling.assembly, "free_memory", lambda: 1e4)
    assembly, *_ = solved(comm, {})
    assert assembly.member.C.kind == ("explicit", "iterative")[comm.rank]


@pytest.mark.slow
def test_plan_says_what_was_chosen_and_why(tmp_path):
    scene = scenes.write_scene(pinched_blocks(6), tmp_path / "scene.toml")
    run = scenes.run_here(scene, tmp_path / "out", "--no-figures")
    assert run.code == 0, run.output
    way = "\n" if mumps_is_known() else " through PETSc (MUMPS is not called directly: "
    assert f"upper, lower: direct solver{way}" in run.stdout
    kind = "explicit" if mumps_is_known() else "direct"
    assert [body["compliance"] for body in run.summary["bodies"].values()] == [kind, kind]
    run = scenes.run_command(
        scene, tmp_path / "petsc", "--no-figures", "-body_mat_mumps_icntl_10", "0", ranks=1
    )
    assert (
        "upper, lower: direct solver through PETSc (MUMPS is not called directly: -body_mat_mumps_icntl_10 is an "
        "option of PETSc's), compliance direct ("
    ) in run.stdout
    run = scenes.run_here(
        scene, tmp_path / "direct", "--no-figures", "--set", "method.compliance=direct"
    )
    assert "upper, lower: direct solver, compliance direct (asked for)\n" in run.stdout


@pytest.mark.slow
def test_an_option_too_coarse_for_a_certificate_is_named(tmp_path):
    """Where -body_ksp_rtol allows no certified answer, the run ends at the first certificate and says so."""
    scene = scenes.write_scene(
        pinched_blocks(6, theta=0.2, tolerance=1e-4), tmp_path / "scene.toml"
    )
    run = scenes.run_command(
        scene,
        tmp_path / "out",
        "--no-figures",
        "-body_ksp_type",
        "cg",
        "-body_pc_type",
        "gamg",
        "-body_ksp_rtol",
        "1e-2",
    )
    assert run.code == 3 and len(run.messages) == 1
    assert (
        "-body_ksp_rtol 0.01" in run.messages[0] and "-body_ksp_rtol 0.01" in run.summary["reason"]
    )
    assert "going on" not in run.stdout and "TAO" not in run.stderr and "rounding" not in run.stderr


@pytest.mark.slow
@pytest.mark.mpi(ranks=2)
def test_a_solver_that_fails_names_an_option_too_coarse(comm, petsc_options, monkeypatch):
    """A SolverError under a coarse -body_ksp_rtol names the option."""
    import ddmpi.run.solve as module
    from ddmpi.errors import SolverError

    petsc_options(body_ksp_type="cg", body_pc_type="gamg", body_ksp_rtol=1e-2)
    assembly = prepare_scene(comm, pinched_blocks(2))

    def fails(*_):
        raise SolverError("TAO ended")

    monkeypatch.setattr(module.Newton, "run", fails)
    with pytest.raises(SolverError, match=r"TAO ended; -body_ksp_rtol 0\.01 is too coarse"):
        module.solve(assembly, assembly.scene.method)


def machine(
    folder, available: int | None = None, groups: dict[str, str] | None = None, process: str = ""
):
    """A file system that says so."""
    (folder / "proc/self").mkdir(parents=True)
    if available is not None:
        (folder / "proc/meminfo").write_text(f"MemTotal: 99 kB\nMemAvailable:   {available} kB\n")
    (folder / "proc/self/cgroup").write_text(process)
    for path, limit in (groups or {}).items():
        file = folder / "sys/fs/cgroup" / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(limit + "\n")
    return folder


def test_free_memory(tmp_path):
    """That of the machine, or what control groups of either version leave; unknown where nothing says so."""
    assert 2**20 < free_memory() < np.inf
    assert free_memory(tmp_path) == np.inf
    assert (
        free_memory(machine(tmp_path / "no limit", None, {"memory.max": "max"}, "0::/\n")) == np.inf
    )
    assert free_memory(machine(tmp_path / "1", 2048)) == 2048 * 1024
    second = {"job/step/memory.max": "max", "job/memory.max": "1000000"}
    assert free_memory(machine(tmp_path / "2", 2048, second, "0::/job/step\n")) == 1e6
    first = {
        "memory/job/memory.limit_in_bytes": "500000",
        "memory/memory.limit_in_bytes": "9223372036854771712",
    }
    assert (
        free_memory(machine(tmp_path / "3", 2048, first, "8:pids:/job\n4:memory:/job\n0::/\n"))
        == 5e5
    )
