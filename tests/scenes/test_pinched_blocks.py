"""The model scene through the real command: the measured answers of the design, and every result file."""

import h5py
import matplotlib.image
import meshio
import numpy as np
import pytest
import scenes
from scenes import ROOT, Run, pinched_blocks

pytestmark = pytest.mark.slow

SIX_DIGITS = 1e-6
EXACT = {"tolerance": 1e-9}
PUBLISHED = {"outer": "relaxation", "algorithm": "original", "splitting": "none", "theta": 0.2, "tolerance": 1e-4}
PNG = {"bodies.png", "contact.png", "convergence.png"}
DATA = scenes.DATA

ANSWERS = {
    # design, section 3: open, slip, stick; normal, tangential resultant (N/m); displacement at (3, 2) (m)
    (22, "coulomb"): ((4, 45, 17), 1.1499786e8, 8.368861e6, (9.221043e-5, 1.7731729e-4)),
    (22, "tresca"): ((4, 42, 20), 1.1493356e8, 5.868415e6, (1.1189385e-4, 1.3447327e-4)),
    (54, "coulomb"): ((9, 110, 43), 1.1507844e8, 8.325063e6, (8.474154e-5, 1.8386317e-4)),
    # an independent P1 code in scipy: sparse LU, non-negative least squares for the coupled dual problem
    (22, "none"): ((4, 62, 0), 1.149542927e8, 0.0, (-1.684004e-4, 1.5922347e-3)),
}
"""Answers of the discrete problem for N and the friction law."""

EXACT_RUNS = {
    "N = 22, Coulomb": (22, "coulomb", EXACT),
    "N = 22, Tresca": (22, "tresca", EXACT),
    "N = 22, no friction": (22, "none", EXACT),
    "N = 54, Coulomb": (54, "coulomb", EXACT),
    "N = 22, Coulomb, published iteration": (22, "coulomb", EXACT | {"algorithm": "original", "theta": 0.25}),
}

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


def run(scene, folder, *arguments: str, here: bool = False) -> Run:
    """On two ranks, or `here` on one."""
    done = (scenes.run_here if here else scenes.run_command)(scene, folder, *arguments)
    assert done.code == 0, done.output
    return done


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("pinched_blocks")


@pytest.fixture(scope="module")
def exact(folder) -> dict[str, Run]:
    """Iterated to the end."""
    done = {}
    for name, (N, law, method) in EXACT_RUNS.items():
        scene = scenes.write_scene(pinched_blocks(N, law, **method), folder / f"{name}.toml")
        done[name] = run(scene, folder / name, "--no-figures", here="algorithm" not in method)
    return done


@pytest.fixture(scope="module")
def shipped(folder) -> dict[str, Run]:
    """The scenes in configs/ just as they are; the Coulomb one with its pictures."""
    return {name: run(ROOT / "configs" / f"{name}.toml", folder / name,
                      *([] if name == "pinched_blocks_coulomb" else ["--no-figures"]), here=name == "punch")
            for name in SHIPPED}


@pytest.fixture(scope="module")
def as_shipped(shipped) -> Run:
    return shipped["pinched_blocks_coulomb"]


@pytest.fixture(scope="module")
def small(folder) -> dict[str, Run]:
    """N = 6, with the bodies in both orders; and without stress, with an option that PETSc does not know."""
    scene = pinched_blocks(6)
    reordered = scene | {"body": scene["body"][::-1]}
    first, second = (scenes.write_scene(each, folder / f"small {k}.toml") for k, each in enumerate((scene, reordered)))
    return {"small": run(first, folder / "small", "--no-figures", "--quiet"),
            "reordered": run(second, folder / "reordered", "--no-figures"),
            "no stress": run(first, folder / "no stress", "--set", "output.stress=false", "-not_an_option", "3")}


BASE = (1.0, 1.0)
BINARY_UNITS = {"stress * 2**30": (1.0, 2.0**30), "length / 2**30": (2.0**-30, 1.0), "both": (2.0**10, 2.0**-20)}
ROUNDED_UNITS = {"MPa and mm": (1e3, 1e-6), "stress * 1e9": (1.0, 1e9), "stress * 1e-9": (1.0, 1e-9),
                 "length * 1e9": (1e9, 1.0), "length * 1e-9": (1e-9, 1.0)}
"""Metres per unit of length and pascals per unit of stress."""


@pytest.fixture(scope="module")
def in_units(folder) -> dict[tuple, dict]:
    """N = 6 for each law and method in many units, in one child mpirun; also N = 22 as published."""
    cases = {(law, "published", unit): pinched_blocks(6, law, *unit, **PUBLISHED)
             for law in ("coulomb", "tresca") for unit in (BASE, *BINARY_UNITS.values())}
    cases |= {(law, "newton", unit): pinched_blocks(6, law, *unit, outer="newton")
              for law in ("coulomb", "tresca") for unit in (BASE, *BINARY_UNITS.values(), *ROUNDED_UNITS.values())}
    cases |= {("coulomb", "published, to the end", unit): pinched_blocks(6, "coulomb", *unit, **PUBLISHED | EXACT)
              for unit in (BASE, ROUNDED_UNITS["MPa and mm"])}
    cases |= {(law, 22): pinched_blocks(22, law, **PUBLISHED) for law in ("coulomb", "tresca")}
    solved = scenes.solve_all({str(case): scene for case, scene in cases.items()}, folder)
    return {case: solved[str(case)] for case in cases}


def displacement_at(done: Run, x: float, y: float) -> np.ndarray:
    with h5py.File(done.folder / "result.h5") as file:
        points, u = file["points"][()], file["displacement"][()]
    upper = np.flatnonzero((np.abs(points - [x, y, 0.0]) < 1e-12).all(axis=1))
    assert len(upper) == 1
    return u[upper[0], :2]


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


@pytest.mark.parametrize("name", EXACT_RUNS)
def test_table_of_the_design(exact, name):
    N, law, _ = EXACT_RUNS[name]
    counts, normal, tangential, displacement = ANSWERS[N, law]
    summary = exact[name].summary
    contact = summary["contacts"]["upper-lower"]
    assert (summary["n"], summary["m"]) == (12 * N * (N + 1), 3 * N)
    assert (contact["open"], contact["slip"], contact["stick"]) == counts
    assert contact["normal_force"] == pytest.approx(normal, rel=SIX_DIGITS)
    assert contact["tangential_force"] == pytest.approx(tangential, rel=SIX_DIGITS)
    assert displacement_at(exact[name], 3.0, 2.0) == pytest.approx(displacement, rel=SIX_DIGITS)


@pytest.mark.parametrize("name", EXACT_RUNS)
def test_certificates_are_below_the_reported_limit(exact, name):
    summary = exact[name].summary
    assert summary["converged"] is True
    assert summary["reason"] == "converged and certified"
    assert 0 < summary["certificate_limit"] <= 1e-7
    assert all(0 <= residual <= summary["certificate_limit"] for residual in summary["certificate"].values())


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenes(shipped, name):
    key, value = SHIPPED[name]
    summary = shipped[name].summary
    assert summary["converged"] is True
    assert summary["warnings"] == []
    assert all(0 <= residual <= summary["certificate_limit"] for residual in summary["certificate"].values())
    (contact,) = summary["contacts"].values()
    assert contact[key] == pytest.approx(value, rel=max(SIX_DIGITS, 2 * summary["certificate_limit"]))


@pytest.mark.parametrize(("law", "iterations", "n_A"), [("coulomb", (40, 47), 1000), ("tresca", (37, 43), 850)])
def test_published_iteration_takes_the_published_counts(in_units, law, iterations, n_A):
    """Design, section 3: N = 22, original, θ = 0.2, tol = 1e-4, η = 0.1."""
    solution = in_units[law, 22]
    assert solution["certified"]
    assert iterations[0] <= solution["outer_iterations"] <= iterations[1]
    assert solution["n_A"] <= n_A
    _, normal, tangential, _ = ANSWERS[22, law]
    assert solution["normal_force"].sum() == pytest.approx(normal, rel=1e-4)
    assert solution["tangential_force"].sum() == pytest.approx(tangential, rel=1e-3)


def scaled(solution: dict, unit: tuple[float, float]) -> dict[str, np.ndarray]:
    """A solution's figures in newtons and metres."""
    length, stress = unit
    figures = {name: solution[name] / (length * stress) for name in ("normal_force", "tangential_force")}
    figures |= {name: solution[name] / length for name in ("gap", "slip", "length")}
    figures |= {body: u / length for body, (_, u) in solution["body"].items()}
    return figures | {"energy": np.array(solution["energy"]) / (length**2 * stress)}


@pytest.mark.parametrize(("method", "unit"), [*(("published", unit) for unit in BINARY_UNITS),
                                              ("newton", "stress * 2**30")])
@pytest.mark.parametrize("law", ["coulomb", "tresca"])
def test_no_bit_depends_on_the_units(in_units, law, method, unit):
    """Powers of two scale without rounding, so that only a number with a hidden unit can change the course.

    Newton's preconditioner takes the logarithm of a length, which rounds.
    """
    base, other = in_units[law, method, BASE], in_units[law, method, BINARY_UNITS[unit]]
    assert base["certified"]
    for key in ("certified", "outer_iterations", "n_A_by_body", "status", "certificate"):
        assert other[key] == base[key], key
    figures = scaled(base, BASE)
    for name, values in scaled(other, BINARY_UNITS[unit]).items():
        assert np.array_equal(values, figures[name]), name


@pytest.mark.parametrize(("law", "method", "unit"), [
    *((law, "newton", unit) for law in ("coulomb", "tresca") for unit in (*BINARY_UNITS, *ROUNDED_UNITS)),
    ("coulomb", "published, to the end", "MPa and mm")])
def test_units_change_rounding_only(in_units, law, method, unit):
    """Rounding may add a step of MPRGP or an iteration of GMRES here and there; the digits of the answer stay."""
    slack, digits = (0.02, 1e-10) if method == "newton" else (0.03, SIX_DIGITS)
    unit = (BINARY_UNITS | ROUNDED_UNITS)[unit]
    base, other = in_units[law, method, BASE], in_units[law, method, unit]
    assert base["certified"] and other["certified"]
    assert abs(other["outer_iterations"] - base["outer_iterations"]) <= slack * base["outer_iterations"]
    assert abs(other["n_A"] - base["n_A"]) <= slack * base["n_A"]
    assert other["status"] == base["status"]
    figures = scaled(base, BASE)
    for name, values in scaled(other, unit).items():
        assert np.abs(values - figures[name]).max() <= digits * np.abs(figures[name]).max(), name


def without_place(value: object) -> object:
    """An entry of the summary without what tells on which rank a body lives."""
    if isinstance(value, dict):
        return {key: without_place(entry) for key, entry in value.items() if key not in ("ranks", "memory_mib")}
    return value


def test_the_order_of_the_bodies_changes_labels_only(small):
    first, second = small["small"].summary, small["reordered"].summary
    for key in ("converged", "n", "m", "outer_iterations", "n_A", "contacts", "bodies", "certificate",
                "displacement_max"):
        assert without_place(first[key]) == without_place(second[key]), key
    for name in ("contact_upper-lower.csv", "history.csv"):
        assert (small["small"].folder / name).read_bytes() == (small["reordered"].folder / name).read_bytes()
    fields = []
    for name in ("small", "reordered"):
        with h5py.File(small[name].folder / "result.h5") as file:
            fields.append(np.concatenate([file["points"][()], file["displacement"][()]], axis=1))
            assert [body["name"] for body in small[name].summary["scene"]["body"]] == (
                ["upper", "lower"] if name == "small" else ["lower", "upper"])
            assert (np.diff(file["body"][()]) >= 0).all()
    half = len(fields[0]) // 2  # both bodies have equally many nodes
    assert np.array_equal(fields[0], np.roll(fields[1], half, axis=0))


# The files


def test_summary_has_all_keys_and_types(as_shipped):
    summary = as_shipped.summary
    check_types(summary, SUMMARY_KEYS, "summary")
    assert summary["title"] == "Pinched steel blocks, Coulomb friction"
    assert summary["friction"] == "coulomb"
    assert (summary["n"], summary["m"], summary["ranks"]) == (6072, 66, 2)
    assert sum(body["n_A"] for body in summary["bodies"].values()) == summary["n_A"]
    assert summary["eff"] == pytest.approx(summary["n_A"] / (2 * 66))
    assert sum(summary["contacts"]["upper-lower"][status] for status in ("open", "slip", "stick")) == summary["m"]
    assert summary["options_unused"] == []
    seconds = summary["seconds"]
    assert all(value > 0 for value in seconds.values())
    assert seconds["total"] >= max(value for phase, value in seconds.items() if phase != "total")
    assert all(10 < body["memory_mib"] < 4000 for body in summary["bodies"].values())
    assert summary["versions"].keys() >= {"ddmpi", "python", "petsc", "petsc4py", "mpi4py", "numpy"}
    assert all(isinstance(version, str) and version for version in summary["versions"].values())
    assert len(summary["hosts"]) == 2


def test_summary_says_what_was_solved_and_how(exact):
    summary = exact["N = 22, Coulomb, published iteration"].summary
    assert (summary["algorithm"], summary["splitting"], summary["friction"]) == ("original", "none", "coulomb")
    scene = summary["scene"]
    assert (scene["method"]["theta"], scene["method"]["tolerance"], scene["method"]["max_iterations"]) == (
        0.25, 1e-9, 500)
    assert scene["body"][0]["mesh"]["divisions"] == [66, 22]
    assert scene["body"][0]["material"]["plane"] == "strain"  # a default
    assert scene["contact"][0]["friction"] == {"law": "coulomb", "coefficient": 0.3}


def test_interface_table(exact):
    done = exact["N = 22, Coulomb"]
    contact, columns = done.summary["contacts"]["upper-lower"], done.table("contact_upper-lower.csv")
    assert list(columns) == ["x", "y", "nx", "ny", "length", "normal_force", "tangential_force", "normal_stress",
                             "tangential_stress", "gap", "slip", "slip_total", "status"]
    assert columns["x"] == pytest.approx(np.arange(1, 67) / 22)  # the node at the clamp carries no unknown
    assert columns["y"] == pytest.approx(np.ones(66))
    length = np.r_[np.full(65, 1 / 22), 1 / 44]
    assert columns["length"] == pytest.approx(length)
    assert not columns["nx"].any() and (columns["ny"] == -1.0).all()  # out of the upper block
    assert columns["slip_total"].tolist() == columns["slip"].tolist()
    assert columns["normal_stress"] * length == pytest.approx(columns["normal_force"])
    assert columns["tangential_stress"] * length == pytest.approx(columns["tangential_force"])
    assert columns["normal_force"].sum() == pytest.approx(contact["normal_force"], rel=1e-12)
    assert columns["tangential_force"].sum() == pytest.approx(contact["tangential_force"], rel=1e-12)
    for status in ("open", "slip", "stick"):
        assert (columns["status"] == status).sum() == contact[status]


def test_interface_table_obeys_the_laws_of_contact(exact):
    for name, bound_of in (("N = 22, Coulomb", lambda c: 0.3 * c["normal_stress"]),
                           ("N = 22, Coulomb, published iteration", lambda c: 0.3 * c["normal_stress"]),
                           ("N = 22, Tresca", lambda c: np.full(66, 1.2e7))):
        columns = exact[name].table("contact_upper-lower.csv")
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


@pytest.mark.parametrize("name", ["N = 22, Coulomb", "N = 22, Coulomb, published iteration"])
def test_history_has_a_line_per_outer_iteration(exact, name):
    summary, history = exact[name].summary, exact[name].table("history.csv")
    nodes = ("open", "slip", "stick")
    assert list(history) == ["step", "iteration", "update", "residual", "inner_precision", *nodes, "n_A"]
    assert (history["step"] == 1).all()
    assert (sum(history[status] for status in nodes) == summary["m"]).all()
    assert {status: history[status][-1] for status in nodes} == {
        status: summary["contacts"]["upper-lower"][status] for status in nodes}
    assert history["iteration"].tolist() == list(range(1, summary["outer_iterations"] + 1))
    assert history["residual"][-1] <= summary["certificate_limit"]
    stopped_by = history["update" if "published" in name else "residual"]
    assert (stopped_by[:-1] > 1e-9).all() and stopped_by[-1] <= 1e-9
    count = history["n_A"]
    assert (np.diff(count) > 0).all()
    assert count[-1] <= summary["n_A"] <= count[-1] + 2  # and one for the displacement of each body


def test_xdmf_reads_back(as_shipped):
    mesh = meshio.read(as_shipped.folder / "result.xdmf")
    points, cells, point_data, cell_data = mesh.points, mesh.cells, mesh.point_data, mesh.cell_data
    assert points.shape == (2 * 67 * 23, 3)
    assert (points.min(axis=0).tolist(), points.max(axis=0).tolist()) == ([0, 0, 0], [3, 2, 0])
    assert [block.type for block in cells] == ["triangle"]
    triangles = cells[0].data
    assert triangles.shape == (4 * 66 * 22, 3)
    a, b, c = (points[triangles[:, i], :2] for i in range(3))
    area = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    assert area == pytest.approx(np.full(len(area), 1 / 22**2 / 2))

    u = point_data["displacement"]
    assert u.shape == points.shape
    assert not u[points[:, 0] == 0].any()
    assert np.linalg.norm(u, axis=1).max() == pytest.approx(as_shipped.summary["displacement_max"], rel=1e-12)
    body = cell_data["body"][0]
    assert np.array_equal(body, np.where(points[triangles, 1].mean(axis=1) > 1.0, 0, 1))  # in the scene's order

    xx, xy, xz, yy, yz, zz = cell_data["stress"][0].T
    assert not xz.any() and not yz.any()
    assert zz == pytest.approx(0.277 * (xx + yy))
    assert cell_data["von_mises"][0] == pytest.approx(
        np.sqrt(0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3 * xy**2))


def test_pictures_are_pictures(as_shipped):
    assert as_shipped.files == DATA | PNG
    for name in PNG:
        pixels = matplotlib.image.imread(as_shipped.folder / name)
        assert min(pixels.shape[:2]) > 300, name
        assert len({colour.tobytes() for colour in pixels[::3, ::3].reshape(-1, pixels.shape[2])}) > 20, name
        drawn = (pixels[..., :3] < 0.99).any(axis=2)
        assert 0.01 < drawn.mean() < 0.99, name


def test_no_figures_leaves_pictures_out(exact, small):
    assert exact["N = 22, Coulomb"].files == DATA
    assert small["small"].files == DATA


def test_stress_can_be_left_out(small):
    done = small["no stress"]
    assert done.files == DATA | PNG
    with h5py.File(done.folder / "result.h5") as file:
        assert set(file) == {"points", "cells", "body", "displacement", "contacts", "surfaces"}
        with h5py.File(small["small"].folder / "result.h5") as full:
            assert set(full) - set(file) == {f"{where}{name}" for where in ("", "nodal_")
                                             for name in ("stress", "principal", "von_mises")}
            assert np.array_equal(file["displacement"][()], full["displacement"][()])
    mesh = meshio.read(done.folder / "result.xdmf")
    assert (set(mesh.point_data), set(mesh.cell_data)) == ({"displacement"}, {"body"})


def test_options_that_nothing_used_are_reported(small):
    done = small["no stress"]
    assert done.summary["options_unused"] == ["not_an_option"]
    assert done.output.count("not_an_option") == 1  # by us, and not by PETSc once more


def test_what_is_printed(as_shipped, small):
    """Progress once, by one rank; nothing at all with --quiet; no message about errors."""
    assert as_shipped.stdout.count("converged and certified (") == 1
    assert as_shipped.stdout.startswith("Pinched steel blocks, Coulomb friction\n")
    assert as_shipped.own_stderr == ""
    assert (small["small"].stdout, small["small"].own_stderr) == ("", "")
