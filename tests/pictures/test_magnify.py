"""What touches is drawn touching, at any magnification, and nothing that does not overlap is drawn overlapping."""

import made_up
import numpy as np
import pytest

from ddmpi.interface.trace import displacement_trace
from ddmpi.mesh.mesh import Mesh
from ddmpi.pictures.bodies import draw_bodies, middles
from ddmpi.pictures.moved import _limits, _shiftable, magnify
from ddmpi.results.tables import Results

TOUCHES = 1e-12


def deformed(
    meshes: dict[str, Mesh],
    u: dict[str, np.ndarray],
    contacts: dict[str, tuple[str, str]],
    magnification: float | None = None,
    rows: int = 0,
) -> tuple[Results, list]:
    """Results of bodies with displacements `u`, whose tables have the nodes of role `rows`; and their interfaces."""
    start = np.cumsum([0, *(len(mesh.points) for mesh in meshes.values())])
    fields = {
        "points": np.concatenate([mesh.points for mesh in meshes.values()]),
        "displacement": np.concatenate(
            [np.broadcast_to(u[name], mesh.points.shape) for name, mesh in meshes.items()]
        ),
        "cells": np.concatenate(
            [mesh.triangles + k for mesh, k in zip(meshes.values(), start, strict=False)]
        ),
        "body": np.repeat(
            np.arange(len(meshes)), [len(mesh.triangles) for mesh in meshes.values()]
        ),
    }
    tables, interfaces = {}, []
    for name, on in contacts.items():
        bodies = name.split("-")
        interface = made_up.interface(name, *(meshes[body] for body in bodies), on)
        closing, slip = np.split(
            sum(
                displacement_trace(
                    interface, k, np.broadcast_to(u[body], meshes[body].points.shape)
                )
                for k, body in enumerate(bodies)
            ),
            2,
        )
        gap = interface.gap - closing
        assert gap.min() > -TOUCHES
        xy = meshes[bodies[1]].points[interface.rows.nodes[1]] if rows else interface.xy
        tables[name] = {
            "x": xy[:, 0],
            "y": xy[:, 1],
            "nx": interface.normal[:, 0],
            "ny": interface.normal[:, 1],
            "gap": gap,
            "initial_gap": interface.gap,
            "slip": slip,
            "status": np.where(gap > TOUCHES, "open", "stick"),
        }
        interfaces.append(interface)
    summary = {
        "title": "",
        "bodies": dict.fromkeys(meshes),
        "scene": made_up.scene(list(contacts)),
        "units": {"length": "m", "stress": "Pa"},
    }
    summary["scene"]["output"]["magnification"] = magnification
    return Results(summary, tables, {}, {}, {}, fields), interfaces


def drawn_gaps(results: Results, interfaces: list) -> tuple[float, list[np.ndarray]]:
    """The magnification, and the normal distances at which each contact's nodes are drawn."""
    factor, shift = magnify(results)
    at = results.fields["points"] + shift + factor * results.fields["displacement"]
    first = [
        np.flatnonzero(np.bincount(results.fields["cells"][results.fields["body"] == k].ravel()))[0]
        for k in range(len(results.summary["bodies"]))
    ]
    found = []
    for interface in interfaces:
        one, two = (
            at[nodes + first[list(results.summary["bodies"]).index(body)]]
            for nodes, body in zip(interface.rows.nodes, interface.bodies, strict=True)
        )
        found.append(np.einsum("ij,ij->i", two - one, interface.normal))
    return factor, found


def rings(inside: float, outside: float) -> dict[str, Mesh]:
    return {"inner": made_up.ring((0.2, inside)), "outer": made_up.ring((outside, 2.0))}


RINGS = {"inner-outer": ("outside", "inside")}


@pytest.mark.parametrize(
    ("gap", "left", "given", "factor"),
    [
        (1e-4, 0.0, None, 2000.0),
        (-1e-4, 0.0, None, 2000.0),
        (0.02, 0.0, None, 10.0),
        (2e-4, 1e-4, 50.0, 50.0),
        (1.0, 0.9999, None, 1.0),
    ],
)
def test_gaps_are_magnified_like_displacements(gap, left, given, factor):
    """What closes is drawn closed, the rest as large as displacements; a visible gap leaves no room for a factor."""
    meshes = {"upper": made_up.block((0.0, 1.0 + gap)), "lower": made_up.block()}
    results, interfaces = deformed(
        meshes,
        {"upper": [1e-5, left - gap], "lower": [0.0, 0.0]},
        {"upper-lower": ("bottom", "top")},
        given,
    )
    drawn, (gaps,) = drawn_gaps(results, interfaces)
    assert drawn == factor and gaps == pytest.approx(factor * left, abs=1e-9)
    fixed = results.fields["body"] == 1
    assert not magnify(results)[1][
        results.fields["cells"][fixed]
    ].any()  # what does not move is drawn where it is


@pytest.mark.parametrize("on", [("right", "left"), ("top", "bottom")])
def test_bodies_around_an_axis_are_drawn_on_it(on):
    """A press fit is drawn with so small a factor that its overlap is invisible; along the axis bodies shift."""
    radial = on[0] == "right"
    meshes = {"one": made_up.block(), "two": made_up.block((3.0, 0.0) if radial else (0.0, 1.0))}
    results, _ = deformed(meshes, {"one": [0.0, 0.0], "two": [1e-5, 1e-5]}, {"one-two": on})
    n = len(results.contacts["one-two"]["gap"])
    pressed = {"gap": np.zeros(n), "initial_gap": np.full(n, -1e-3), "status": np.full(n, "stick")}
    results.contacts["one-two"] |= pressed
    results.summary["scene"]["axisymmetric"] = True
    factor, shift = magnify(results)
    assert not shift[:, 0].any() and shift[:, 1].any() != radial
    assert (factor - 1.0) * 1e-3 <= 0.002 * results.extent if radial else factor > 10.0


def test_bodies_of_a_sector_are_drawn_where_the_others_meet():
    """Of a wheel in the plane no body is shifted, in space along the wheel's axis alone; of a periodic cell any way."""
    meshes = {"one": made_up.block(), "two": made_up.block((0.0, 1.0))}
    u = {"one": [0.0, 0.0], "two": [1e-5, 1e-5]}
    results, _ = deformed(meshes, u, {"one-two": ("top", "bottom")})
    n = len(results.contacts["one-two"]["gap"])
    pressed = {"gap": np.zeros(n), "initial_gap": np.full(n, -1e-3), "status": np.full(n, "stick")}
    results.contacts["one-two"] |= pressed
    (contact,) = results.summary["scene"]["contact"]
    contact["image"] = {"turn": None, "shift": [1.0, 0.0], "axis": None}
    assert magnify(results)[1].any()
    contact["image"] = {"turn": 60.0, "shift": None, "axis": None}
    factor, shift = magnify(results)
    assert not shift.any() and (factor - 1.0) * 1e-3 <= 0.002 * results.extent
    contact["image"]["axis"] = [3.0, 4.0]  # as of three
    assert _shiftable(results) @ [3.0, 4.0] == pytest.approx([3.0, 4.0])
    assert _shiftable(results) @ [4.0, -3.0] == pytest.approx([0.0, 0.0], abs=1e-15)


@pytest.mark.parametrize("drawn", [True, False])
@pytest.mark.parametrize("overlap", [1e-6, 1e-3, 0.05])
def test_a_shrink_fit_is_drawn_without_air(overlap, drawn):
    """Bodies that no shift makes touch are magnified so little that the overlap, or the air, is invisible."""
    meshes = rings(1.0 + drawn * overlap / 2, 1.0 - drawn * overlap / 2)
    u = {
        name: sign * overlap / 2 * mesh.points / np.linalg.norm(mesh.points, axis=1)[:, None]
        for (name, mesh), sign in zip(meshes.items(), (-1, 1), strict=True)
    }
    results, interfaces = deformed(meshes, u, RINGS)
    if not drawn:
        results.contacts["inner-outer"] |= {
            "gap": np.zeros(24),
            "initial_gap": np.full(24, -overlap),
            "status": np.full(24, "stick"),
        }
    factor, (gaps,) = drawn_gaps(results, interfaces)
    assert factor == {1e-6: 5000.0, 1e-3: 5.0, 0.05: 1.0}[overlap]
    assert np.abs(gaps).max() <= 0.002 * 4.0 + overlap * (not drawn)


@pytest.mark.parametrize("gap", [0.0, 5e-3])
def test_open_nodes_are_magnified_until_their_overlap_is_seen(gap):
    """A gap g is drawn as F g − (F − 1) l, where l is what shifts leave of the gap at first."""
    left, now = gap + 1e-3, gap + 5e-4
    table = {
        "gap": np.array([now]),
        "nx": np.array([0.0]),
        "ny": np.array([-1.0]),
        "status": np.array(["open"]),
    }
    (limit,) = _limits(table, np.array([[0.0, -gap - 1e-3]]), 0.1)
    assert limit * now - (limit - 1.0) * left == pytest.approx(-0.1)


@pytest.mark.parametrize("far", [0.0, 40.0])
def test_the_middle_of_a_body_is_far_from_its_own_boundary(far):
    """Where other bodies are does not matter."""
    meshes = {"upper": made_up.block((0.0, 1.0)), "lower": made_up.block((far, 0.0))}
    results, _ = deformed(meshes, {"upper": [0.0, 0.0], "lower": [0.0, 0.0]}, {})
    assert np.array(middles(results)) == pytest.approx(
        np.array([[1.5, 1.5], [1.5 + far, 0.5]]), abs=1e-9
    )


def test_rows_on_the_second_body_are_drawn_alike():
    """The magnification does not depend on which body the rows of a table stand at, as by mortar they may at either."""
    meshes = {"inner": made_up.ring((0.2, 0.999)), "outer": made_up.ring((1.0, 2.0))}
    u = {"inner": [0.0, -0.001], "outer": [0.0, 0.0]}
    (one, shift), (other, again) = (
        magnify(deformed(meshes, u, RINGS, rows=rows)[0]) for rows in (0, 1)
    )
    assert one == other > 1.0 and again == pytest.approx(shift, abs=1e-3)


@pytest.mark.parametrize("clearance", [1e-4, 1e-2, 0.2])
def test_a_pin_does_not_run_through_its_plate(clearance):
    """A pin that is moved until it touches is drawn touching, with air on the other side."""
    u = {"inner": [0.0, -clearance], "outer": [0.0, 0.0]}
    results, interfaces = deformed(rings(1.0 - clearance, 1.0), u, RINGS)
    factor, (gaps,) = drawn_gaps(results, interfaces)
    assert (factor > 1.0) == (clearance < 0.2)
    assert gaps.min() >= -0.002 * 4.0 and np.argmin(gaps) == np.argmin(interfaces[0].xy[:, 1])
    assert gaps.max() >= 1.99 * clearance


def test_no_magnification_moves_bodies_out_of_all_bounds():
    meshes = {"upper": made_up.block((0.0, 1.0)), "lower": made_up.block()}
    u = {"upper": [0.0, 0.0], "lower": [0.0, -1e-4]}
    results, _ = deformed(meshes, u, {"upper-lower": ("bottom", "top")}, 1e30)
    assert magnify(results)[0] * 1e-4 == pytest.approx(100.0 * 3.0)  # 100 times the blocks' extent


def test_bodies_are_drawn_at_the_magnification_in_the_title():
    """bodies.png has bodies that touch, and the magnification in its title."""
    meshes = {"upper": made_up.block((0.0, 1.0 + 1e-4)), "lower": made_up.block()}
    results, _ = deformed(
        meshes, {"upper": [0.0, -1e-4], "lower": [0.0, 0.0]}, {"upper-lower": ("bottom", "top")}
    )
    figure = draw_bodies(results)
    outline = np.concatenate(figure.axes[0].collections[-1].get_segments())
    heights = outline[np.isclose(outline[:, 0], 3.0), 1]
    # There is one line where they touch.
    assert np.unique(heights.round(9)) == pytest.approx(np.linspace(0.0, 2.0, 17))
    assert "displacement × 2000, largest 100 µm" in figure._suptitle.get_text()


@pytest.mark.parametrize("orientation", [1, -1])
def test_no_cell_is_drawn_inside_out(orientation):
    """A thin layer below a block that is pressed by a tenth of its thickness is drawn at half of it, not through itself."""
    x, y = np.meshgrid([0.0, 1.0], [0.0, 0.02, 1.0], indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel()])[:, ::orientation]
    cells = np.array([[0, 3, 1], [3, 4, 1], [1, 4, 2], [4, 5, 2]])[:, ::orientation]
    u = np.where(points[:, ::orientation][:, 1:] > 0.0, 1.0, 0.0) * np.array([0.0, -0.002])
    mesh = Mesh(points, cells, {})
    results, _ = deformed({"block": mesh}, {"block": u[:, ::orientation]}, {})
    factor, shift = magnify(results)
    assert factor == 5.0 and not shift.any()
    at = points + factor * u[:, ::orientation]
    assert (np.sign(np.linalg.det(at[cells[:, 1:]] - at[cells[:, :1]])) > 0).all()
