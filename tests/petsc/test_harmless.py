"""What a scene may set of PETSc: a list, held against all options that the installed PETSc knows."""

import os
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
import scenes
from scenes import call, pinched_blocks, write_scene

from ddmpi.errors import InputError
from ddmpi.petsc.harmless import SOLVERS, WITHIN, check_petsc, kind
from ddmpi.scene.petsc import refuse_reaching

HELP = """
import contextlib, petsc4py
petsc4py.init(["x", "-help"])
from petsc4py import PETSc

PETSc.Sys.pushErrorHandler("ignore")
A = PETSc.Mat().createAIJ((6, 6), nnz=1, comm=PETSc.COMM_SELF)
A.setDiagonal(PETSc.Vec().createWithArray([2.0] * 6, comm=PETSc.COMM_SELF))
A.assemble()

def each(kinds):
    for kind in {kind for name, kind in vars(kinds).items() if name[0] != "_" and isinstance(kind, str)}:
        if kind not in ("shell", "python", "mat"):
            with contextlib.suppress(PETSc.Error):
                yield kind

def solver(ksp_type, pc_type):
    ksp = PETSc.KSP().create(PETSc.COMM_SELF)
    ksp.setOptionsPrefix("body_")
    ksp.setOperators(A)
    ksp.setType(ksp_type)
    ksp.getPC().setType(pc_type)
    ksp.setFromOptions()
    ksp.setUp()

for ksp_type in each(PETSc.KSP.Type):
    with contextlib.suppress(PETSc.Error):
        solver(ksp_type, "none")
for pc_type in each(PETSc.PC.Type):
    with contextlib.suppress(PETSc.Error):
        solver("cg", pc_type)
for tao_type in each(PETSc.TAO.Type):
    with contextlib.suppress(PETSc.Error):
        tao = PETSc.TAO().create(PETSc.COMM_SELF)
        tao.setOptionsPrefix("qp_")
        tao.setType(tao_type)
        tao.setFromOptions()
"""

REACHING = re.compile(
    "view_|_view.*_mat|draw|plot|binary|matlab|python|debug|dump|file|dir|log|history|info|trace|socket|port|saws|lib|"
    "append|prefix|push|pop|option|yaml|error_on|exec|server|print|check|test|_icntl_([1-359]|18|19|2[012569]|3[0-4])$"
)
"""Parts of names of options that reach beyond a run, or may."""

HARMLESS = re.compile(
    "trust_region|truncation|eigenvalues|check_norm_iteration|convergence_test|recycle_history|ksp_view|tao_view|"
    "ls_view|_icntl_29$|pop$|error_if|_python_type|redundant|final_|direct|logarithm|compute_|reuse_"
)
"""Names that only look as if they did."""


@cache
def told() -> dict[str, str]:
    """Options that PETSc's solvers say they have, with what they say."""
    done = subprocess.run(
        [sys.executable, "-P", "-c", HELP],
        capture_output=True,
        text=True,
        timeout=scenes.LIMIT,
        env=scenes.clean_environment(),
    )
    lines = re.findall(r"^ *-((?:body|qp)_\w+)(.*)$", done.stdout, re.MULTILINE)
    assert len(lines) > 1000, done.stderr
    said: dict[str, str] = {}
    for name, words in lines:
        said[name] = said.get(name, "") + words
    return said


@cache
def known() -> list[str]:
    """All names of options in the library of PETSc."""
    from petsc4py import PETSc  # noqa: F401  its library is then among the files of this process

    libraries = set(
        re.findall(
            r"/\S*libpetsc\S*\.so\S*|/\S*petsc4py/lib/\S*PETSc\S*\.so",
            Path("/proc/self/maps").read_text(),
        )
    )
    names = {
        name
        for path in libraries
        for name in re.findall(rb"\0-([a-zA-Z]\w*)(?=\0)", Path(path).read_bytes())
    }
    assert len(names) > 1500
    return sorted(os.fsdecode(name) for name in names)


def test_every_option_that_this_petsc_knows():
    """Each is refused, or belongs to a solver and reaches nothing beyond the run, whatever stands before its name."""
    allowed = [
        name
        for name in known()
        for prefix in ("body_", "newton_", "qp_", "qp_tao_bnk_")
        if kind(prefix + name)
    ]
    assert len(set(allowed)) > 400
    for name in known():
        assert not kind(name) and not kind(f"other_{name}") and not kind(f"body{name}"), name
    reaching = {name for name in allowed if REACHING.search(name) and not HARMLESS.search(name)}
    assert not reaching
    loose = [name for name in set(allowed) if not re.match("(ksp|pc|mat|tao)_", name)]
    assert not loose


def test_options_that_a_scene_may_set_have_numbers_and_choices():
    """PETSc itself says so of each: none of them takes the name of a file, and what prints has no other name for it."""
    of_kinds: dict[str, list[str]] = {"": [], "prints": [], "sets": []}
    for name, words in told().items():
        of_kinds[kind(name)].append(name)
        chosen = re.search(r"\(one of\)|\(choose one of\)", words)
        numbers = re.match(
            r":? <(now )?(TRUE|FALSE|UNKNOWN|[-+\d.][-+.\de,]*)( :|>)|: [A-Za-z]", words
        )
        # PETSc's packages are called by a word.
        numbers = numbers or name.endswith("pc_factor_mat_solver_type")
        if kind(name) == "sets":
            assert "PetscOptionsGetViewer" not in words and (chosen or numbers), (name, words)
            assert "stdout" not in words and "file" not in words.lower(), name
    assert len(of_kinds["sets"]) > 300 and len(of_kinds["prints"]) > 10
    assert all(re.search("view$|monitor|reason$|rate$", name) for name in of_kinds["prints"])


REFUSED = [
    ("prefix_push", "dl"),
    ("l_append", "plug"),
    ("dll_append", "x"),
    ("options_file", "x"),
    ("options_file_yaml", "x"),
    ("log_summary", "thesis.txt"),
    ("log_view", True),
    ("log_trace", True),
    ("info", True),
    ("on_error_attach_debugger", True),
    ("start_in_debugger", True),
    ("-start_in_debugger", True),
    ("malloc_dump", True),
    ("saws_port", 8080),
    ("help", True),
    ("body_mat_mumps_icntl_2", 18),
    ("body_mat_mumps_icntl_1", 18),
    ("body_mat_mumps_icntl_3", 18),
    ("skip_petscrc", True),
    ("body_mat_mumps_ooc_tmpdir", "x"),
    ("body_ksp_view_mat", True),
    ("body_ksp_monitor_python", "a.b"),
    ("body_pc_python_type", "a.b"),
    ("newton_pc_python_type", "ddmpi.mprgp.MPRGP"),
    ("body_ksp_python_type", "a.b"),
    ("qp_tao_python_type", "ddmpi.cli.main"),
    ("QP_TAO_PYTHON_TYPE", "a.b"),
    ("qp_tao_monitor", "true"),
    ("qp_tao_monitor", "x"),
    ("qp_tao_gmonitor", True),
    ("qp_tao_view_solution", True),
    ("qp_tao_draw_step", True),
    ("body_ksp_view", "ascii:thesis.txt"),
    ("body_ksp_view ", True),
    ("body_ksp_view\n", True),
    ("body_ksp_monitor", "binary"),
    ("body_ksp_monitor", "ascii"),
    ("body_ksp_monitor", "::ascii_info"),
    ("newton_ksp_monitor_true_residual", "::ascii_info_detail"),
    ("newton_ksp_view", ":thesis.txt"),
    ("newton_ksp_view", "::ascii_info:append"),
    ("body_prefix_push", "x"),
    ("body_dll_append", "x"),
    ("body_options_file", "x"),
    ("body_ksp_type", "/tmp/lib.so"),
    ("body_pc_type", "python"),
    ("body_pc_type", "shell"),
    ("body_pc_factor_mat_solver_type", "matlab"),
    ("body_ksp_type", "cg -options_file x"),
    ("body_ksp_rtol", "-options_file"),
    ("body_ksp_rtol", ""),
    ("body_ksp_type", "[a]"),
    ("body_mg_levels_ksp_view_mat", True),
    ("body_pc_mg_dump_binary", True),
    ("body_ksp_type", "cg\n"),
    ("qp_tao_type", "pythonic"),
    ("body_ksp_typ", "cg"),
    ("body_", 1),
    ("", 1),
    ("body", 1),
    ("bodyksp_type", "cg"),
    ("qp_tao_view", "::ascii_info"),
    ("body_ksp_view", False),
]


@pytest.mark.parametrize(("name", "value"), REFUSED)
def test_options_that_reach_beyond_the_run_are_refused(name, value):
    """By name and by value; the message says that the command line may give them."""
    with pytest.raises(
        InputError,
        match=r"could start a program or name a file, which no scene may do.*command line",
    ):
        refuse_reaching("scene.toml", {"petsc": {name: value}})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("body_ksp_type", "cg"),
        ("body_pc_type", "gamg"),
        ("body_ksp_rtol", 1e-9),
        ("body_ksp_rtol", "1e-9"),
        ("newton_ksp_gmres_restart", -1),
        ("-newton_ksp_rtol", 1e-6),
        ("body_pc_factor_mat_solver_type", "cholmod"),
        ("body_mat_mumps_icntl_7", 0),
        ("body_mat_mumps_icntl_10", 0),
        ("body_mat_mumps_cntl_1", 0.1),
        ("qp_tao_type", "python"),
        ("qp_tao_python_type", "ddmpi.mprgp.MPRGP"),
        ("qp_tao_python_type", "ddmpi.apg.APG"),
        ("qp_tao_type", "gpcg"),
        ("qp_tao_monitor", True),
        ("body_ksp_view", True),
        ("body_ksp_view", "::ascii_info_detail"),
        ("newton_ksp_monitor_true_residual", True),
        ("body_ksp_norm_type", "preconditioned"),
        ("Body_KSP_max_it", 3),
        ("body_mg_levels_1_ksp_type", "chebyshev"),
        ("body_mg_levels_pc_sor_its", 2),
        ("body_mg_coarse_pc_type", "lu"),
        ("body_mg_levels_ksp_chebyshev_esteig", "0,0.1,0,1.1"),
        ("body_pc_gamg_threshold", "0.01,-1"),
        ("body_pc_hypre_boomeramg_P_max", 4),
        ("body_sub_pc_factor_levels", 1),
        ("qp_tao_bnk_ksp_type", "stcg"),
        ("body_ksp_error_if_not_converged", True),
        ("body_pc_sor_omega", 1.2),
        ("body_ksp_initial_guess_nonzero", False),
    ],
)
def test_what_solvers_are_told_by_scenes(name, value):
    """Types, tolerances, limits and orders of elimination, of solvers within solvers too; and ddmpi's own QP solvers."""
    check_petsc({name: value})
    assert re.match(SOLVERS + WITHIN, name.lstrip("-").lower())


def test_the_command_line_may_give_any_option(tmp_path):
    """Whoever starts a run decides, with --set as with an option of PETSc."""
    scene = write_scene(pinched_blocks(2), tmp_path / "scene.toml")
    run = call(
        "check",
        str(scene),
        "--output",
        str(tmp_path / "out"),
        "--no-figures",
        "--set",
        "petsc.log_view=true",
    )
    assert run.code == 0, run.messages


def test_a_library_of_a_stranger_is_not_loaded(tmp_path):
    """A prefix that is pushed, and the rest of a name after it, load no library."""
    pushed = pinched_blocks(2) | {
        "petsc": {"prefix_push": "dl", "l_append": str(tmp_path / "plug"), "prefix_pop": True}
    }
    for command in ("run", "check"):
        run = call(
            command,
            str(write_scene(pushed, tmp_path / "scene.toml")),
            "--output",
            str(tmp_path / "out"),
        )
        assert (
            run.code == 2
            and "petsc.prefix_push: could start a program or name a file" in run.messages[0]
        )
