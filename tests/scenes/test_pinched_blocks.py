"""The model scene through the real command: the measured answers of the design, and every result file."""

import numpy as np
import pytest
import scenes
from scenes import ROOT, Run, certified, pinched_blocks, solve_scene

pytestmark = pytest.mark.slow

SIX_DIGITS = 1e-6
PUBLISHED = {"outer": "relaxation", "algorithm": "original", "splitting": "none", "theta": 0.2, "tolerance": 1e-4}

ANSWERS = {
    # design, section 3: open, slip, stick; normal, tangential resultant (N/m); displacement at (3, 2) (m)
    (22, "coulomb"): ((4, 45, 17), 1.1499786e8, 8.368861e6, (9.221043e-5, 1.7731729e-4)),
    (22, "tresca"): ((4, 42, 20), 1.1493356e8, 5.868415e6, (1.1189385e-4, 1.3447327e-4)),
    (54, "coulomb"): ((9, 110, 43), 1.1507844e8, 8.325063e6, (8.474154e-5, 1.8386317e-4)),
    # an independent P1 code in scipy: sparse LU, non-negative least squares for the coupled dual problem
    (22, "none"): ((4, 62, 0), 1.149542927e8, 0.0, (-1.684004e-4, 1.5922347e-3)),
}
"""Answers of the discrete problem for N and the friction law."""

SHIPPED = {
    "pinched_blocks_coulomb": ("tangential_force", 8.368861e6),
    "pinched_blocks_tresca": ("tangential_force", 5.868415e6),
    "pinched_blocks_frictionless": ("normal_force", 1.149542927e8),
    "punch": ("tangential_force", 190.81310),
}
"""One number of each scene in configs/; the last is from the independent code, too, with bounded least squares."""

RESIDUALS = {"force_mismatch": float, "penetration": float, "complementarity": float, "friction": float}
STEP = {"force": [float, float], "moment": float, "normal_force": float, "tangential_force": float, "open": int,
        "slip": int, "stick": int, "dissipated": float}
FORCES = {"force": [float, float], "moment": float}
BODY = {"n": int, "ranks": [int], "n_A": int, "held": bool, "displacement_max": float, "von_mises_max": float,
        "energy": float, "reaction": [float, float], "loads": {}, "reactions": {"left": FORCES},
        "discretization_error": float, "compliance": str, "memory_mib": float}
SUMMARY_KEYS = {
    "format": int, "title": str, "converged": bool, "reason": str, "outer": str, "order": int, "algorithm": str,
    "splitting": str, "friction": str, "n": int, "m": int, "ranks": int, "outer_iterations": int,
    "inner_iterations": int, "n_A": int, "eff": float, "bodies": {"upper": BODY, "lower": BODY},
    "contacts": {"upper-lower": {"m": int, "pairing": str, "pressure_max": float, "certificate": RESIDUALS,
                                 "pointwise_penetration": float, "moment_imbalance": float,
                                 "moment_imbalance_bound": float} | STEP},
    "certificate": RESIDUALS | {"equilibrium": float}, "displacement_max": float, "warnings": [],
    "discretization_error": {"energy_norm": float}, "exchange": {"messages": int, "bytes": int},
    "seconds": {"mesh": float, "assemble": float, "factor": float, "outer": float, "recover": float, "output": float,
                "total": float},
    "versions": {}, "options": {}, "options_unused": [], "scene": {},
}
"""Keys and types of summary.json in format 2."""


def check_types(value, kind, key: str) -> None:
    if isinstance(kind, dict):
        assert isinstance(value, dict), key
        assert value.keys() >= kind.keys(), key
        for name, inner in kind.items():
            check_types(value[name], inner, f"{key}.{name}")
    elif isinstance(kind, list):
        assert isinstance(value, list), key
        assert not kind or len(value) == len(kind), key
        for entry, inner in zip(value, kind, strict=False):
            check_types(entry, inner, key)
    else:
        assert type(value) is kind, f"{key} is {value!r}"


# The answers


@pytest.mark.parametrize("N, law", ANSWERS)
def test_table_of_the_design(N, law):
    """Newton's method has all digits of the independent codes, and a certificate below its limit."""
    counts, normal, tangential, displacement = ANSWERS[N, law]
    answer = certified(pinched_blocks(N, law, tolerance=1e-9))
    summary, contact = answer.summary, answer.summary["contacts"]["upper-lower"]
    assert (summary["n"], summary["m"]) == (12 * N * (N + 1), 3 * N)
    assert (contact["open"], contact["slip"], contact["stick"]) == counts
    assert contact["normal_force"] == pytest.approx(normal, rel=SIX_DIGITS)
    assert contact["tangential_force"] == pytest.approx(tangential, rel=SIX_DIGITS)
    corner = np.abs(answer.bodies["upper"].points - [3.0, 2.0]).sum(axis=1).argmin()
    assert answer.bodies["upper"].displacement[corner] == pytest.approx(displacement, rel=SIX_DIGITS)
    assert 0 < summary["certificate_limit"] <= 1e-7
    assert all(0 <= residual <= summary["certificate_limit"] for residual in summary["certificate"].values())


@pytest.mark.mpi(ranks=2)
@pytest.mark.parametrize(("law", "iterations", "n_A"), [("coulomb", (40, 47), 1000), ("tresca", (37, 43), 850)])
def test_published_iteration_takes_the_published_counts(comm, law, iterations, n_A):
    """Design, section 3: N = 22, original, θ = 0.2, tol = 1e-4, η = 0.1."""
    solution = solve_scene(comm, pinched_blocks(22, law, **PUBLISHED))
    assert solution["certified"]
    assert iterations[0] <= solution["outer_iterations"] <= iterations[1]
    assert solution["n_A"] <= n_A
    _, normal, tangential, _ = ANSWERS[22, law]
    assert solution["normal_force"].sum() == pytest.approx(normal, rel=1e-4)
    assert solution["tangential_force"].sum() == pytest.approx(tangential, rel=1e-3)


@pytest.mark.mpi(ranks=2)
@pytest.mark.parametrize("law", ["coulomb", "tresca"])
def test_no_bit_of_the_published_iteration_depends_on_the_units(comm, law):
    """Powers of two scale without rounding, so that only a number with a hidden unit can change the course."""
    length, stress = 2.0**10, 2.0**-20
    base, other = (solve_scene(comm, pinched_blocks(6, law, *unit, **PUBLISHED)) for unit in (
        (1.0, 1.0), (length, stress)))
    assert base["certified"]
    for key in ("certified", "outer_iterations", "n_A_by_body", "status", "certificate"):
        assert other[key] == base[key], key
    for name in ("normal_force", "tangential_force"):
        assert np.array_equal(other[name], base[name] * length * stress)
    for name, (_, u) in base["body"].items():
        assert np.array_equal(other["body"][name][1], u * length)


@pytest.mark.mpi(ranks=2)
@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenes(comm, name):
    """The scenes in configs/ just as they are, without a warning."""
    key, value = SHIPPED[name]
    summary = certified(ROOT / "configs" / f"{name}.toml", comm).summary
    assert summary["warnings"] == []
    (contact,) = summary["contacts"].values()
    assert contact[key] == pytest.approx(value, rel=max(SIX_DIGITS, 2 * summary["certificate_limit"]))


# The files


@pytest.fixture(scope="module")
def command(tmp_path_factory) -> Run:
    """The real command on two ranks, with pictures and an option that PETSc does not know."""
    done = scenes.run_command(ROOT / "configs" / "pinched_blocks.toml", tmp_path_factory.mktemp("command") / "out",
                              "-not_an_option", "3")
    assert done.code == 0, done.output
    return done


@pytest.fixture(scope="module")
def laws(tmp_path_factory) -> dict[str, Run]:
    folder = tmp_path_factory.mktemp("laws")
    return {law: scenes.run_here(scenes.write_scene(pinched_blocks(22, law, tolerance=1e-9), folder / f"{law}.toml"),
                                 folder / law, "--no-figures", "--quiet") for law in ("coulomb", "tresca")}


def test_summary_has_all_keys_and_types(command):
    """Of format 2, with what was solved, how, where, by which versions and how fast."""
    summary = command.summary
    check_types(summary, SUMMARY_KEYS, "summary")
    assert summary["friction"] == "coulomb" and summary["ranks"] == 2 and len(summary["hosts"]) == 2
    assert sum(body["n_A"] for body in summary["bodies"].values()) == summary["n_A"]
    assert summary["eff"] == pytest.approx(summary["n_A"] / (2 * summary["m"]))
    assert sum(summary["contacts"]["upper-lower"][status] for status in ("open", "slip", "stick")) == summary["m"]
    assert summary["options_unused"] == ["not_an_option"]
    assert command.output.count("not_an_option") == 1  # by us, and not by PETSc once more
    seconds = summary["seconds"]
    assert all(value > 0 for value in seconds.values())
    assert seconds["total"] >= max(value for phase, value in seconds.items() if phase != "total")
    assert all(10 < body["memory_mib"] < 4000 for body in summary["bodies"].values())
    assert summary["versions"].keys() >= {"ddmpi", "python", "petsc", "petsc4py", "mpi4py", "numpy"}
    assert all(isinstance(version, str) and version for version in summary["versions"].values())
    assert summary["scene"]["body"][0]["material"]["plane"] == "strain"  # a default
    assert summary["scene"]["contact"][0]["friction"] == {"law": "coulomb", "coefficient": 0.3}


def test_what_is_printed_and_drawn(command, laws):
    """Progress once, by one rank, and pictures; nothing with --quiet, no pictures with --no-figures."""
    assert command.stdout.count("converged and certified (") == 1
    assert command.stdout.startswith(command.summary["title"])
    assert command.files == scenes.DATA | {"bodies.png", "contact.png", "convergence.png"}
    quiet = laws["coulomb"]
    assert (quiet.code, quiet.stdout, quiet.own_stderr, quiet.files) == (0, "", "", scenes.DATA)


def test_interface_table(laws):
    """A line for each node that carries unknowns, whose stresses are forces over lengths and add up to the summary."""
    done = laws["coulomb"]
    contact, columns = done.summary["contacts"]["upper-lower"], done.table("contact_upper-lower.csv")
    assert list(columns) == ["x", "y", "nx", "ny", "length", "normal_force", "tangential_force", "normal_stress",
                             "tangential_stress", "gap", "slip", "slip_total", "status"]
    assert columns["x"] == pytest.approx(np.arange(1, 67) / 22)  # the node at the clamp carries no unknown
    assert columns["y"] == pytest.approx(np.ones(66))
    length = np.r_[np.full(65, 1 / 22), 1 / 44]
    assert columns["length"] == pytest.approx(length)
    assert not columns["nx"].any() and (columns["ny"] == -1.0).all()  # out of the upper block
    assert columns["slip_total"].tolist() == columns["slip"].tolist()
    for kind in ("normal", "tangential"):
        assert columns[f"{kind}_stress"] * length == pytest.approx(columns[f"{kind}_force"])
        assert columns[f"{kind}_force"].sum() == pytest.approx(contact[f"{kind}_force"], rel=1e-12)
    for status in ("open", "slip", "stick"):
        assert (columns["status"] == status).sum() == contact[status]


@pytest.mark.parametrize("law, bound_of", [("coulomb", lambda columns: 0.3 * columns["normal_stress"]),
                                           ("tresca", lambda columns: np.full(66, 1.2e7))])
def test_interface_table_obeys_the_laws_of_contact(laws, law, bound_of):
    """Pressure where it is closed, friction on its bound against the slip, within it where nodes stick."""
    columns = laws[law].table("contact_upper-lower.csv")
    gap, slip, shear, bound = (*(columns[c] for c in ("gap", "slip", "tangential_stress")), bound_of(columns))
    opened, slipping, sticking = (columns["status"] == s for s in ("open", "slip", "stick"))
    largest = np.abs(slip).max()
    assert (columns["normal_force"] >= 0).all()
    assert (columns["normal_force"][opened] == 0).all() and (gap[opened] > 0).all()
    assert np.abs(gap[~opened]).max() <= 1e-7 * largest
    assert np.abs(slip[sticking]).max() <= 1e-7 * largest
    assert (np.abs(shear[sticking]) < bound[sticking]).all()
    assert np.abs(shear[slipping]) == pytest.approx(bound[slipping], rel=1e-6)
    assert (shear[slipping] * slip[slipping] >= -1e-7 * largest * bound.max()).all()
