"""view.html: one file that turns the results in a browser."""

import contextlib
import itertools
import json
import re

import made_up
import numpy as np
import pytest
from browser import in_browser, opened, unpacked
from made_up_solids import stacked
from scenes import call, pinched_blocks, rectangle, run_here, write_scene

from ddmpi.cli.report import write_report
from ddmpi.errors import InputError
from ddmpi.pictures.browser import _page, write_view
from ddmpi.pictures.moved import magnify
from ddmpi.results.tables import read_results
from ddmpi.system.files import write_page


def test_a_view_has_what_the_results_have(tmp_path):
    """Meshes, sides of contacts, fields of each load step to a part in 65,535; nothing is fetched from anywhere."""
    results = stacked(tmp_path, times=(1.0, 2.0))
    path = write_view(tmp_path)
    head, arrays = unpacked(path)
    assert "://" not in re.sub(
        r'id="data">.*?</script>', "", path.read_text(encoding="utf-8"), flags=re.S
    )
    assert (
        head["times"] == [1.0, 2.0]
        and not head["flat"]
        and [field["name"] for field in head["fields"]] == ["von_mises", "pressure", "displacement"]
    )
    assert arrays["points"].reshape(-1, 3) == pytest.approx(results.points, abs=1e-4)
    assert np.array_equal(arrays["cells"].reshape(-1, 4), results.fields["cells"])
    assert len(arrays["facets"]) == 3 * 2 * 2 * (2 * 6 * 2 + 2 * 6 * 2 + 2 * 2 * 2)
    u = arrays["moved1"].reshape(-1, 3)
    assert u == pytest.approx(results.displacement(), abs=1e-4 * np.abs(u).max())
    assert arrays["moved0"].reshape(-1, 3) == pytest.approx(0.5 * u, abs=1e-4 * np.abs(u).max())
    surface, stress = results.surfaces["upper-lower"], head["fields"][0]
    assert arrays["pressure1"] == pytest.approx(np.tile(surface["pressure"], 2) / 1e6, abs=0.01)
    assert stress["unit"] == "MPa" and stress["marks"][1][0] == pytest.approx(
        results.fields["von_mises"].max() / 1e6
    )
    most = arrays["surface"].reshape(-1, 3)[head["fields"][1]["marks"][1][1]]
    assert np.linalg.norm(most - surface["points"][surface["pressure"].argmax()]) < 1e-3
    # The upper body's side looks down, the lower one's up.
    above = arrays["above"].reshape(2, -1, 3)
    assert above[0, :, 2] == pytest.approx(-3e-3, rel=1e-3) and above[1, :, 2] == pytest.approx(
        3e-3, rel=1e-3
    )
    upper, lower = np.array(head["shifts"])
    assert upper[2] - lower[2] == pytest.approx(0.45 * np.sqrt(3.0))  # apart along the normal


def test_a_view_closes_gaps_as_pictures_do(tmp_path):
    """A node is drawn where `magnify` has it, whatever the factor."""
    results = stacked(tmp_path)
    results.contacts["upper-lower"]["initial_gap"][:] = 1e-3
    page = _page(results, tmp_path)
    (tmp_path / "view.html").write_text(page, encoding="utf-8")
    head, arrays = unpacked(tmp_path / "view.html")
    factor, shift = magnify(results)
    drawn = arrays["points"].reshape(-1, 3) + head["scale"] * arrays["moved0"].reshape(-1, 3)
    assert head["scale"] == factor and np.abs(shift).max() > 1e-3
    assert drawn == pytest.approx(
        results.points + shift + results.displacement(factor), abs=1e-3 * np.abs(shift).max()
    )


def test_contacts_in_the_plane_are_ribbons(tmp_path):
    """In the plane a contact is drawn on either side as a ribbon as long as it is."""
    made_up.results(tmp_path, title="<script>$data</script>")
    path = write_view(tmp_path)
    head, arrays = unpacked(path)
    assert (
        head["flat"]
        and len(arrays["cells"]) == 0
        and "<script>$data" not in path.read_text(encoding="utf-8")
    )
    at = arrays["surface"].reshape(-1, 3)[arrays["painted"].reshape(-1, 3)]
    across = np.cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0])[:, 2]
    assert np.abs(across).sum() / 2 == pytest.approx(2 * 3.0 * 0.012 * 3.0, rel=1e-3)


@pytest.mark.slow
def test_contacts_of_bodies_that_move_far_are_painted_where_they_are(tmp_path):
    """Each load step has the pressure of its own contact, on both sides, where the bodies are then."""
    made = {
        "history": {
            name: {"times": [k, k + 1.0], "factors": [0.0, 1.0]}
            for k, name in enumerate(("press", "go"))
        },
        "time": {"points": [1.0, 2.0], "steps": 2, "motions": "far"},
        "output": {"steps": "all", "figures": False},
        "body": [
            rectangle(
                "block",
                (0, 0.1),
                (1, 0.5),
                (8, 4),
                young=1000.0,
                clamp=["top"],
                motion=[
                    {"shift": [0.0, -0.104], "history": "press"},
                    {"shift": [1.2, 0.0], "history": "go"},
                ],
            ),
            rectangle("base", (-1, -1), (4, 1), (27, 6), young=1000.0, clamp=["bottom"]),
        ],
        "contact": [{"bodies": ["block", "base"], "on": ["bottom", "top"]}],
    }
    run_here(write_scene(made, tmp_path / "scene.toml"), tmp_path / "out")
    legs, (head, arrays) = (
        read_results(tmp_path / "out").legs["block-base"],
        unpacked(write_view(tmp_path / "out")),
    )
    field = next(field for field in head["fields"] if field["name"] == "pressure")
    assert head["times"] == [0.5, 1.0, 1.5, 2.0]
    for k, (time, shift) in enumerate(zip(head["times"], (0.0, 0.0, 0.6, 1.2), strict=True)):
        largest, at = (
            legs["normal_stress"][legs["time"] == time].max(),
            arrays[f"surface{k}"].reshape(-1, 3),
        )
        assert [at[:, 0].min(), at[:, 0].max()] == pytest.approx([shift, shift + 1.0], abs=1e-3)
        assert np.abs(at[:, 1]).max() < 0.1 and set(arrays[f"bearer{k}"]) == {0, 1}
        assert len(arrays[f"pressure{k}"]) == len(at) and (largest > 0.0) == (k > 0)
        assert arrays[f"pressure{k}"].max() == pytest.approx(largest, rel=1e-3, abs=1e-9)
        assert field["marks"][k][0] == pytest.approx(largest, rel=1e-9)


def test_a_view_overwrites_nothing_else(tmp_path):
    """Nor does a report overwrite a view, or a page of a check either; those of version 0.22 are known, too."""
    stacked(tmp_path)
    other = tmp_path / "notes.html"
    other.write_text("mine")
    with pytest.raises(InputError, match="no view of ddmpi"):
        write_view(tmp_path, str(other))
    assert other.read_text() == "mine" and write_view(tmp_path) == write_view(tmp_path)
    with pytest.raises(InputError, match="no report of ddmpi"):
        write_report(tmp_path, str(tmp_path / "view.html"))
    assert write_report(tmp_path) == write_report(tmp_path)
    pages = {"": {"report"}, " report": {"report"}, " view": {"view", "page"}, " page": {"page"}}
    for words, kind in itertools.product(pages, ("report", "view", "page")):
        other.write_text(f'<meta name="generator" content="ddmpi 0.22.0{words}">', "utf-8")
        known = kind in pages[words]
        with contextlib.nullcontext() if known else pytest.raises(InputError):
            write_page(other, "", kind)


def test_without_equilibrium_there_is_no_view(tmp_path):
    """It would show bodies at rest."""
    stacked(tmp_path)
    (tmp_path / "mechanism.json").write_text("{}", encoding="utf-8")
    with pytest.raises(InputError, match="no equilibrium"):
        write_view(tmp_path)


def test_a_run_writes_the_view_and_its_report_has_it(tmp_path):
    """With `[output] view = true`; the command `view` writes it anew."""
    scene = write_scene(
        pinched_blocks(2) | {"output": {"view": True, "figures": False}}, tmp_path / "scene.toml"
    )
    assert run_here(scene, tmp_path / "out").code == 0
    view = tmp_path / "out" / "view.html"
    first = view.read_text(encoding="utf-8")
    assert call("view", str(view.parent)).code == 0 and view.read_text(encoding="utf-8") == first
    assert call("report", str(view.parent)).code == 0
    page = (view.parent / "report.html").read_text(encoding="utf-8")
    assert (
        "<iframe srcdoc=" in page
        and "script-src" in page
        and first[-60:-40].replace("<", "&lt;") in page
    )
    # In the plane nothing turns.
    assert "Drag to move, wheel to zoom." in page and "Drag to turn" not in page


def drawn(folder, changes) -> dict[str, dict[str, str]]:
    """What the view in `folder` draws as it is, and after each of `changes` of a control."""
    with opened(write_view(folder), "#look", 500, 400) as page:
        page.wait("document.body.dataset.sum")
        found = {"as_it_was": page.tell("({...document.body.dataset})")}
        found["as_it_was"]["folded"] = page.tell("!document.querySelector('details').open")
        for name, value in changes:
            page.set(name, value)
            found[f"{name} {value}"] = page.tell("({...document.body.dataset})")
    assert all(
        int(each["colours"]) > 8 and int(each["pixels"]) > 2000 for each in found.values()
    ), found
    assert len({each["sum"] for each in found.values()}) == len(found), found
    return found


@pytest.mark.slow
@in_browser
def test_a_browser_draws_the_view_and_its_slider_moves(tmp_path):
    """In headless Chromium: bodies in many colours; another picture at the other load step, cut open, and apart."""
    stacked(tmp_path, times=(1.0, 2.0))
    found = drawn(tmp_path, [("step", 0), ("axis", "x"), ("apart", 1), ("field", "pressure")])
    # In a window of 500 pixels the controls would hide the bodies.
    assert found["as_it_was"]["folded"]
    assert found["step 0"]["step"] == "0" and found["field pressure"]["field"] == "pressure"
    assert int(found["axis x"]["triangles"]) > int(found["step 0"]["triangles"])  # those of the cut


@pytest.mark.slow
@in_browser
def test_a_view_turns_as_it_is_dragged_and_tells_its_largest_value(tmp_path):
    """A drag of 100 pixels turns it by 40 degrees; the mark moves with its place, and its words are those of the results."""
    results = stacked(tmp_path)
    with opened(write_view(tmp_path), "#look") as page:
        sum_before, azimuth = page.wait("document.body.dataset.sum"), page.tell("state.azimuth")
        words = page.tell("document.querySelector('#mark').textContent")
        place = page.tell("document.querySelector('#mark').style.left")
        page.pointer((300, 300), (350, 300), (400, 300))
        assert page.tell("state.azimuth") == pytest.approx(azimuth - 40.0)
        assert page.tell("document.body.dataset.sum") != sum_before
        assert page.tell("document.querySelector('#mark').style.left") != place
    largest = results.fields["von_mises"].max() / 1e6
    assert words.startswith(f"max {float(f'{largest:.3g}'):g} MPa at ("), words


@pytest.mark.slow
@in_browser
def test_a_largest_value_out_of_sight_is_said_to_be(tmp_path):
    """The largest pressure lies below the upper body: between closed bodies and from above it is hidden, from below not."""
    stacked(tmp_path)
    words = "document.querySelector('#mark').textContent"
    with opened(write_view(tmp_path), "#field=pressure&look") as page:
        page.wait(f"{words}.startsWith('out of sight: max ')")
        page.set("apart", 1)
        page.tell("state.apart = 2; state.elevation = -15; draw(); return 0")
        page.wait(f"{words}.startsWith('max ')")
        page.tell("state.elevation = 30; draw(); return 0")
        page.wait(f"{words}.startsWith('out of sight: max ')")


@pytest.mark.slow
@in_browser
def test_axisymmetric_bodies_turn_around_their_axis(tmp_path):
    """Three quarters of a turn (two sections, 54 strips along the outlines), a half, a whole turn, and none."""
    made_up.results(tmp_path)
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    summary["scene"]["axisymmetric"] = True
    (tmp_path / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    found = drawn(tmp_path, [("turn", 180), ("turn", 360), ("turn", 0)])
    head, arrays = unpacked(tmp_path / "view.html")
    points, section, strip = (
        arrays["points"].reshape(-1, 3),
        len(arrays["facets"]) // 3,
        len(arrays["edges"]),
    )
    assert (
        head["turned"]
        and not head["flat"]
        and head["high"][0] == pytest.approx(points[:, 0].max(), rel=1e-3)
    )
    assert head["low"][::2] == [-head["high"][0]] * 2 and len(arrays["rims"]) > 0
    assert [float(each["triangles"]) for each in found.values()] == [
        2 * section + 54 * strip,
        2 * section + 36 * strip,
        72 * strip,
        section,
    ]


def test_a_view_of_a_sector_has_all_of_its_wheel(tmp_path):
    """With `output.sectors`: in each quarter nodes that have turned with it, as far displaced and as stressed."""
    mesh = {"shape": "annulus", "center": [0.0, 0.0], "radii": [1.0, 2.0], "angles": [0, 90]}
    ring = {
        "name": "ring",
        "mesh": mesh | {"divisions": [4, 4]},
        "material": {"young": 2.1e11, "poisson": 0.3},
        "traction": [{"on": "outer", "pressure": "1e8 * (1 + 0.2*x*y*(x**2 - y**2))"}],
    }
    flanks = {"bodies": ["ring", "ring"], "on": ["end", "start"], "image": {"turn": 90.0}}
    scene = {
        "body": [ring],
        "contact": [flanks | {"friction": {"law": "coulomb", "coefficient": 0.3}}],
        "output": {"figures": False, "sectors": True},
    }
    run = run_here(write_scene(scene, tmp_path / "scene.toml"), tmp_path / "out")
    assert run.code == 0, run.output
    one = read_results(tmp_path / "out")
    head, arrays = unpacked(write_view(tmp_path / "out"))
    points, moved = (arrays[name].reshape(4, -1, 3)[:, :, :2] for name in ("points", "moved0"))
    turned = np.eye(2)
    for k in range(4):
        assert points[k] == pytest.approx(one.points @ turned.T, abs=1e-4)
        right = one.displacement() @ turned.T
        assert moved[k] == pytest.approx(right, abs=1e-4 * np.abs(right).max())
        turned = np.array([[0.0, -1.0], [1.0, 0.0]]) @ turned
    stresses = arrays["von_mises0"].reshape(4, -1)
    assert (stresses == stresses[0]).all() and stresses.any()
    assert arrays["pressure0"].any() and arrays["painted"].max() + 1 == len(arrays["pressure0"])
    assert head["low"][:2] == pytest.approx([-2.0, -2.0])
    assert head["high"][:2] == pytest.approx([2.0, 2.0])
