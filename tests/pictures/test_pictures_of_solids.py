"""Pictures of solids: what is seen, from where, cut open; contacts as maps; rigid partners, mechanisms."""

import dataclasses
import itertools
import json
import re
import shutil
from pathlib import Path

import h5py
import made_up
import made_up_solids
import numpy as np
import PIL.Image
import PIL.ImageSequence
import pytest
from documented import undocumented
from made_up_solids import stacked
from matplotlib import image
from mpi4py import MPI
from scenes import pinched_blocks, run_here, seldom, to_toml, write_scene
from solid_scenes import two_boxes

from ddmpi.cli.report import write_report
from ddmpi.errors import InputError, OutputError
from ddmpi.pictures import views
from ddmpi.pictures.bodies import ANIMATION, animate, coloured, draw_bodies
from ddmpi.pictures.browser import write_view
from ddmpi.pictures.contacts import _aside, draw_contacts, draw_maps, flatten
from ddmpi.pictures.curves import draw_steps
from ddmpi.pictures.draw import draw_all
from ddmpi.pictures.moved import apart, directions, rigid_parts
from ddmpi.pictures.sheet import limits
from ddmpi.results.fields import group_of
from ddmpi.results.tables import STATUS, read_results
from ddmpi.run.run import prepare_scene
from ddmpi.scene.output import VIEWS, Output
from ddmpi.scene.reader import read_scene


@pytest.fixture(scope="module")
def still(tmp_path_factory) -> Path:
    """The folder of two boxes after one load step; not to be changed."""
    folder = tmp_path_factory.mktemp("still")
    stacked(folder)
    return folder


@pytest.fixture(scope="module")
def stepped(tmp_path_factory) -> Path:
    """That of two load steps with quadratic elements and errors."""
    folder = tmp_path_factory.mktemp("stepped")
    stacked(folder, 2, times=(1.0, 2.0), error=True)
    return folder


@pytest.fixture(scope="module")
def marched(tmp_path_factory, stepped) -> Path:
    """The same with all pictures and an animation."""
    folder = tmp_path_factory.mktemp("marched")
    shutil.copytree(stepped, folder, dirs_exist_ok=True)
    draw_all(folder)
    animate(read_results(folder), folder, "")
    return folder


@pytest.mark.slow
def test_there_is_a_picture_of_everything(marched, tmp_path):
    """Solids have the pictures that plane bodies have, and each shows something, twice the same to the last pixel."""
    assert undocumented(marched) == []
    names = {"bodies.png", "contact.png", "convergence.png", "error.png", "steps.png"}
    assert {path.name for path in marched.glob("*.png")} == names
    for name in names:
        pixels = image.imread(marched / name)
        inked = (pixels[..., :3] < 0.99).any(axis=2)
        assert min(pixels.shape[:2]) > 300 and 0.01 < inked.mean() < 0.99, name
    for path in draw_all(marched, 0, 2, into=tmp_path):  # every other one
        assert path.read_bytes() == (marched / path.name).read_bytes(), path.name


@pytest.mark.slow
def test_blocks_of_pixels_leave_no_trace(monkeypatch, still):
    """The picture is the same in one block and in many."""
    one, many = (
        [
            np.asarray(artist.get_array())
            for artist in draw_bodies(read_results(still)).axes[0].images
        ]
        for chunk in (views.CHUNK * 100, 7_000)
        if monkeypatch.setattr(views, "CHUNK", chunk) is None
    )
    assert one[0].any() and (one[0] == many[0]).all()


@pytest.mark.slow
def test_load_steps_are_read_as_far_as_they_are_shown(tmp_path, still, marched):
    """Fields of a load step that are not drawn are not read, and without [time] no list of load steps."""
    shutil.copytree(marched, tmp_path / "marched")
    shutil.copytree(still, tmp_path / "still")
    (tmp_path / "still" / "result.xdmf").unlink()
    assert write_view(tmp_path / "still").exists()
    results = read_results(marched)
    results.summary["scene"]["output"]["animation"] = "displacement"
    for hidden, draw in (
        (("stress", "nodal_stress", "nodal_principal"), write_view),
        (("von_mises", "nodal_von_mises"), lambda folder: animate(results, folder, "")),
    ):
        with h5py.File(tmp_path / "marched" / "result.h5", "r+") as file:
            for name in hidden:
                del file[group_of(0)][name]
                file[group_of(0)].create_group(name)  # which cannot be read as a field
        assert draw(tmp_path / "marched").exists()
    page = write_report(marched).read_text(encoding="utf-8")
    assert all(
        f"{what} {axis}" in page for what in ("force", "moment", "reaction") for axis in "xyz"
    )


@pytest.mark.parametrize("cut", [0.0, 1.0])
def test_what_is_nearer_hides_what_is_behind(monkeypatch, cut):
    """Each pixel shows the facet nearest to the eye, at its middle, and nothing of what is in front of a cut."""
    rng = np.random.default_rng(4)
    corners = rng.uniform(0.0, 20.0, (40, 3, 3))
    edges = corners[:, 1:, :2] - corners[:, :1, :2]
    turned = np.linalg.det(edges) < 0.0
    corners[turned] = corners[turned][:, ::-1]
    monkeypatch.setattr(views, "CHUNK", 500)
    corners = np.concatenate([corners, rng.uniform(-1.0, cut, (40, 3, 1))], axis=2)
    face, found, depth = views.rasterise(corners, (20, 20))
    weights = dict(zip(zip(*np.nonzero(face >= 0), strict=True), found, strict=True))
    for row, column in itertools.product(range(20), range(20)):
        a = np.concatenate([corners[..., :2].transpose(0, 2, 1), np.ones((40, 1, 3))], axis=1)
        at = np.linalg.solve(a, np.tile([[column + 0.5], [row + 0.5], [1.0]], (40, 1, 1)))[..., 0]
        z = np.where(
            (at >= 0.0).all(axis=1) & ((at * corners[..., 3]).sum(axis=1) <= 0.0),
            (at * corners[..., 2]).sum(axis=1),
            -np.inf,
        )
        assert depth[row, column] == pytest.approx(z.max())
        assert face[row, column] == (z.argmax() if np.isfinite(z.max()) else -1)
        if face[row, column] >= 0:
            assert weights[row, column] == pytest.approx(at[face[row, column]], abs=1e-9)


@pytest.mark.parametrize("order", [1, 2])
def test_colours_end_where_areas_do(order):
    """And not where nodes are many, as in a refined corner; the areas of nodes are together that of what is drawn."""
    values, area = np.arange(1000.0), np.append(np.ones(500), np.zeros(500))
    assert limits(values[::-1], area[::-1], 0.9) == (49.0, 449.0)
    mesh = made_up_solids.box(size=(2.0, 1.0, 1.0), divisions=(3, 2, 2), order=order)
    skin = views.Skin(views.View(mesh.points), mesh.points, mesh.triangles)
    assert skin.areas(mesh.points).sum() == pytest.approx(10.0)
    flat = made_up.block((0.0, 0.0), (4, 3), order)
    skin = views.Skin(views.View(flat.points), flat.points, flat.triangles)
    assert skin.areas(flat.points).sum() == pytest.approx(np.ptp(flat.points, axis=0).prod())


def test_edges_are_drawn_where_facets_meet_at_an_angle_and_are_seen():
    """Of a box nine edges are seen from a corner, in pieces as long as they are, and three are hidden."""
    mesh = made_up_solids.box(size=(1.0, 1.0, 1.0), divisions=(2, 2, 2))
    view = views.View(mesh.points)
    facets = views.Skin(view, mesh.points, mesh.triangles).facets
    at = 200.0 * view.place(mesh.points)
    at[:, :2] -= at[:, :2].min(axis=0) - 2.0
    edges = views.outlines(at, facets, np.zeros(len(at)))
    assert len(edges) == 24
    seen = (
        np.cross(at[facets[:, 1]] - at[facets[:, 0]], at[facets[:, 2]] - at[facets[:, 0]])[:, 2]
        > 0.0
    )
    corners = np.pad(at, ((0, 0), (0, 1)))[facets[seen]]
    depth = views.rasterise(corners, np.ceil(at[:, 1::-1].max(axis=0)).astype(int) + 2)[2]
    lines = views.unhidden(edges, depth)
    length = np.linalg.norm(200.0 * view.place(np.eye(3))[:, :2], axis=1).sum()
    assert np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1).sum() == pytest.approx(
        3.0 * length, rel=0.03
    )


def flattened(mesh, group):
    face = made_up_solids.interface("a-b", mesh, group)
    at, labels, along = flatten(face.xy, face.geometry.facets, *directions(face.normal, face.area))
    a, b, c = at.transpose(1, 0, 2)
    return (
        at,
        labels,
        along,
        np.abs(np.linalg.det(np.stack([b - a, c - a], axis=1))).sum() / 2,
        face,
    )


def test_the_rim_of_a_contact_is_where_it_ends():
    """Not where cells meet others that have points along their edges."""
    points = np.array(
        [[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [4, 0, 0], [4, 2, 0], [2, 1, 0]], float
    )
    cells = np.array([[0, 1, 2], [0, 2, 3], [1, 4, 6], [4, 5, 6], [6, 5, 2]])
    edges, owner = views.rim(points, cells)
    assert sorted(map(tuple, np.sort(edges, axis=1))) == [
        (0, 1),
        (0, 3),
        (1, 4),
        (2, 3),
        (2, 5),
        (4, 5),
    ]
    assert all(set(edge) <= set(cells[cell]) for edge, cell in zip(edges, owner, strict=True))


def test_flats_behind_each_other_stand_side_by_side():
    """Two faces with opposite normals keep their shape and area, and do not lie on each other."""
    box = made_up_solids.box(size=(3.0, 2.0, 1.0), divisions=(3, 2, 2))
    low, high = (made_up_solids.interface("a-b", box, group) for group in ("bottom", "top"))
    points, facets = (
        np.vstack([low.xy, high.xy]),
        np.vstack([low.geometry.facets, high.geometry.facets + len(low.xy)]),
    )
    normal, area = np.vstack([low.normal, high.normal]), np.append(low.area, high.area)
    at, labels, _ = flatten(points, facets, *directions(normal, area))
    a, b, c = at.transpose(1, 0, 2)
    assert np.abs(np.cross(b - a, c - a)).sum() / 2 == pytest.approx(12.0) and labels == (
        "x (side by side)",
        "y",
    )
    first, second = at[: len(low.geometry.facets), :, 0], at[len(low.geometry.facets) :, :, 0]
    assert first.max() < second.min() or second.max() < first.min()


def test_flat_contacts_are_drawn_in_their_coordinates():
    """A face of a box is drawn over the two coordinates that vary on it; an inclined one keeps its area."""
    mesh = made_up_solids.box((1.0, 2.0, 3.0), (3.0, 1.0, 2.0))
    for group, labels, low, high in (
        ("bottom", ("x", "y"), (1, 2), (4, 3)),
        ("left", ("y", "z"), (2, 3), (3, 5)),
        ("back", ("x", "z"), (1, 3), (4, 5)),
    ):
        at, found, _, area, face = flattened(mesh, group)
        assert found == labels and area == pytest.approx(face.area.sum())
        assert at.min(axis=(0, 1)) == pytest.approx(low) and at.max(axis=(0, 1)) == pytest.approx(
            high
        )
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    *_, along, area, face = flattened(
        dataclasses.replace(mesh, points=mesh.points @ turn.T), "bottom"
    )
    assert area == pytest.approx(face.area.sum()) and along[0] @ face.normal[0] == pytest.approx(
        [0.0, 0.0], abs=1e-12
    )


def test_contacts_around_an_axis_are_unrolled():
    """A bore is as wide as its circumference, each facet once and whole; slip turns with it."""
    at, labels, along, area, face = flattened(made_up_solids.tube((0.5, 1.0), 2.0), "inner")
    assert labels == ("around the axis", "z") and area == pytest.approx(
        2.0 * np.pi * 0.5 * 2.0, rel=1e-9
    )
    assert np.ptp(at, axis=(0, 1)) == pytest.approx([np.pi, 2.0], rel=1e-6)
    assert np.ptp(at[..., 0], axis=1).max() < 0.2
    assert np.einsum("lcd,ld->lc", along, face.normal) == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("inside", [False, True])
def test_rigid_partners_are_drawn_where_bodies_may_touch_them(tmp_path, inside):
    """A part of a rigid surface around the contact, moved as the bodies are, and turned to them."""
    bodies = {"tube": made_up_solids.tube((0.5, 1.0), 2.0)}
    partner = {
        "shape": "cylinder",
        "name": "rod",
        "point": [0.0, 0.0, 0.0],
        "axis": [0.0, 0.0, 1.0],
        "radius": 1.1 if inside else 0.45,
        "inside": inside,
        "displacement": [0.1, 0.0, 0.0],
    }
    made_up_solids.results(
        tmp_path, bodies, {"tube-rod": ("tube", "outer" if inside else "inner")}, rigid=[partner]
    )
    results = read_results(tmp_path)
    (drawn,) = rigid_parts(results, 2.0)
    off = drawn.at - (0.2, 0.0, 0.0)
    assert np.linalg.norm(off[:, :2], axis=1) == pytest.approx(partner["radius"])
    assert np.ptp(off[:, 2]) == pytest.approx(2.5)
    a, b, c = off[drawn.facets].transpose(1, 0, 2)
    outward = (np.cross(b - a, c - a) * (a + b + c) * (1.0, 1.0, 0.0)).sum(axis=1)
    assert (outward < 0.0).all() if inside else (outward > 0.0).all()
    assert draw_bodies(results).axes


@pytest.mark.slow
def test_a_mechanism_of_solids_is_drawn(tmp_path):
    """Bodies move by velocity and turning about their centres, not by more than a tenth of the extent."""
    stacked(tmp_path)
    (tmp_path / "mechanism.json").write_text(
        json.dumps(
            {
                "reason": "no equilibrium: upper turns",
                "imbalance": 0.1,
                "bodies": [
                    {
                        "name": "upper",
                        "centre": [1.5, 0.5, 1.5],
                        "velocity": [0.0, 0.2, 0.0, 0.0, 0.0, 0.6],
                    }
                ],
            }
        )
    )
    (drawn,) = draw_all(tmp_path)
    assert drawn.name == "mechanism.png" and image.imread(drawn)[..., :3].std() > 0.05


@pytest.mark.slow
def test_a_contact_has_maps_of_what_may_vary_there(tmp_path, still):
    """Without friction none of friction; bonded none of its bound and the gap, and of normal stress, which may be
    tension."""
    results = stacked(tmp_path, friction=made_up.NoFriction())
    assert [axes.get_ylabel() for axes in draw_maps(results, "upper-lower").axes[3:]] == [
        "pressure (MPa)",
        "gap (µm)",
    ]
    results = read_results(still)
    labels = [axes.get_ylabel() for axes in draw_maps(results, "upper-lower").axes]
    assert "friction / bound (%)" in labels
    surface = results.surfaces["upper-lower"]
    surface["gap"][:] = surface["slip"][:] = surface["utilisation"][:] = 0.0
    surface["pressure"][0] = -surface["pressure"].max()
    labels = [axes.get_ylabel() for axes in draw_maps(results, "upper-lower").axes[3:]]
    assert labels == ["normal stress (MPa)", "friction (MPa)"]
    results.scene["contact"][0]["kind"] = "bonded"
    labels = [axes.get_ylabel() for axes in draw_maps(results, "upper-lower").axes[3:]]
    assert labels == ["normal stress (MPa)", "tangential stress (MPa)"]


@pytest.mark.parametrize(
    ("name", "right", "eye"),
    [
        ("front", [1, 0, 0], [0, -1, 0]),
        ("back", [-1, 0, 0], [0, 1, 0]),
        ("left", [0, -1, 0], [-1, 0, 0]),
        ("right", [0, 1, 0], [1, 0, 0]),
        ("top", [1, 0, 0], [0, 0, 1]),
        ("bottom", [1, 0, 0], [0, 0, -1]),
        ("iso", [0.5**0.5, 0.5**0.5, 0], [3**-0.5, -(3**-0.5), 3**-0.5]),
        ([30, 0], [-0.5, 0.75**0.5, 0], [0.75**0.5, 0.5, 0]),
    ],
)
def test_views_look_at_the_groups_of_a_box_by_their_names(name, right, eye):
    """The eye is in front of the side that gives the view its name, or where its angles say; axes are right-handed."""
    box = made_up_solids.box()
    axes = views.View(box.points, {"view": name}).axes
    assert axes[[0, 2]] == pytest.approx(np.array([right, eye]), abs=1e-5)
    assert np.cross(axes[0], axes[1]) == pytest.approx(axes[2])
    if str(name) in box.groups:
        assert (
            (box.points[box.groups[name]].mean(axis=(0, 1)) - box.points.mean(axis=0)) @ axes[2]
        ) > 0.0
    assert set(VIEWS) >= set(box.groups)


@pytest.mark.parametrize(
    ("axis", "order", "at"),
    [("x", 1, 1.0), ("x", 2, 1.1), ("y", 1, 0.25), ("z", 2, 0.25), ("z", 1, 1.1)],
)
def test_a_cut_has_a_face(axis, order, at):
    """As large as the section, facing the eye, with values of nodes; its rim is closed; what is in front is hidden."""
    mesh, k = (
        made_up_solids.box(size=(2.0, 1.5, 1.25), divisions=(4, 3, 5), order=order),
        "xyz".index(axis),
    )
    view = views.View(mesh.points, {"cut": {axis: at}})
    skin = views.Skin(view, mesh.points, mesh.triangles)
    points, cap = skin.extended(mesh.points), skin.facets[skin.of < 0]
    a, b, c = points[cap].transpose(1, 0, 2)
    areas, size = np.cross(b - a, c - a)[:, k] / 2, np.delete([2.0, 1.5, 1.25], k)
    assert points[cap][..., k] == pytest.approx(at)
    assert areas.sum() == pytest.approx(np.sign(view.axes[2, k]) * size.prod())
    assert np.abs(areas).sum() == pytest.approx(size.prod())
    assert skin.extended(mesh.points @ (1.0, 2.0, 3.0)) == pytest.approx(points @ (1.0, 2.0, 3.0))
    rim = views.outlines(view.place(points), cap, np.zeros(len(points)))
    assert np.linalg.norm(rim[:, 1] - rim[:, 0], axis=1).sum() == pytest.approx(2.0 * size.sum())
    corners = mesh.points[mesh.triangles[skin.cell[skin.of < 0], :4]]
    assert (corners[..., k].min(axis=1) <= at + 1e-9).all() and (
        corners[..., k].max(axis=1) >= at - 1e-9
    ).all()
    kept = points[np.unique(skin.facets)][skin.beyond[np.unique(skin.facets)] <= 0.0]
    assert ((at - kept[:, k]) * view.axes[2, k] >= -1e-9).all()


@pytest.mark.parametrize("order", [1, 2])
def test_a_cut_along_a_side_leaves_nothing_of_what_is_in_front(order):
    """Of two boxes that touch there the one behind the cut is seen as a whole, the other one not at all."""
    below, above = (
        made_up_solids.box((0, 0, z), (1.0, 1.5, 1.0), (2, 3, 2), order) for z in (0.0, 1.0)
    )
    points = np.concatenate([below.points, above.points])
    cells = np.concatenate([below.triangles, above.triangles + len(below.points)])
    skin = views.Skin(views.View(points, {"cut": {"z": 1.0}}), points, cells)
    assert (skin.cell < len(below.triangles)).all() and (skin.of >= 0).sum() >= len(
        below.boundary[0]
    )
    with pytest.raises(InputError, match="meets no body"):
        views.View(points, {"cut": {"z": 1e-12}})


@pytest.mark.slow
def test_pictures_are_cut_and_seen_as_asked_for(tmp_path, marched):
    """By keys of the scene or options of the command; colours and limits are those of what is left."""
    asked = {"view": "front", "cut": {"y": 0.5}, "magnification": 3.0}
    drawn = {
        path.name: image.imread(path) for path in draw_all(marched, 0, 2, into=tmp_path, **asked)
    }
    for name in ("bodies.png", "error.png"):
        whole = image.imread(marched / name)
        assert drawn[name].shape != whole.shape or np.abs(drawn[name] - whole).max() > 0.1
    results = read_results(marched)
    results.summary["scene"]["output"] |= asked
    axes = draw_bodies(results).axes[0]
    assert axes.get_figure()._suptitle.get_text().endswith("displacement × 3, largest 92 µm")
    shutil.copytree(marched, tmp_path / "copy")
    assert draw_contacts(results) and animate(results, tmp_path / "copy", "").exists()
    left, right = axes.get_xlim()
    assert left < 0.0 and 3.0 < right < 3.6
    results.summary["scene"]["output"] |= {"cut": {"x": 1.0}}
    assert draw_bodies(results).axes[0].get_xlim()[1] < 1.6
    results.summary["scene"]["output"] |= {"view": "right", "cut": {"y": 0.8}}  # between nodes
    assert draw_contacts(results).axes[0].get_xlim()[1] > 0.8


@pytest.mark.parametrize(
    ("what", "label"),
    [
        seldom(True, "von Mises stress"),
        seldom("displacement", "displacement"),
        seldom("displacement_z", "displacement z"),
        ("stress_xz", "stress xz"),
        ("principal_3", "principal 3"),
    ],
)
def test_animations_show_the_field_that_is_asked_for(stepped, what, label):
    """By its name, with the column of its file; stresses need stress = true."""
    results = read_results(stepped)
    results.summary["scene"]["output"]["animation"] = what
    values, name, _ = coloured(results, results.fields, what)
    fields, tensor = results.fields, results.fields["nodal_stress"]
    expected = {
        True: fields["nodal_von_mises"],
        "displacement": np.linalg.norm(results.displacement(), axis=1),
        "displacement_z": results.displacement()[:, 2],
        "stress_xz": tensor[:, 2],
        "principal_3": np.linalg.eigvalsh(tensor[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]])[:, 0],
    }[what]
    assert name == label and values == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())
    with pytest.raises(ValueError, match="drop stress = false"):
        Output(animation="stress_xz", stress=False)


@pytest.mark.slow
def test_an_animation_of_another_field_is_another_one(tmp_path, marched):
    results = read_results(marched)
    results.summary["scene"]["output"]["animation"] = "stress_xz"
    before = (marched / "animation.gif").read_bytes()
    shutil.copytree(marched, tmp_path / "copy")
    assert 5000 < animate(results, tmp_path / "copy", "").stat().st_size != len(before)


def red_pixels(path) -> list[int]:
    """How many pixels of each frame have the colours of high pressures."""
    found = []
    with PIL.Image.open(path) as picture:
        for frame in PIL.ImageSequence.Iterator(picture):
            red, green, blue = np.moveaxis(np.asarray(frame.convert("RGB")).astype(int), 2, 0)
            found.append(int(((red > 150) & (green < 120) & (blue < 100)).sum()))
    return found


@pytest.mark.slow
def test_animations_show_pressures(tmp_path):
    """Contacts are as red as they are pressed: of solids drawn apart, in the plane along the bodies."""
    results = stacked(tmp_path, times=(1.0, 2.0))
    results.summary["scene"]["output"]["animation"] = "pressure"
    animate(results, tmp_path, "")
    half, whole = red_pixels(tmp_path / "animation.gif")
    assert whole > 2 * half > 0
    flat = pinched_blocks(2) | {
        "time": {"points": [1.0, 2.0], "steps": 1},
        "history": {"load": {"times": [0.0, 2.0], "factors": [0.0, 1.0]}},
        "output": {"animation": "pressure", "stress": False},
    }
    for body in flat["body"]:
        body["traction"] = [each | {"history": "load"} for each in body["traction"]]
    assert (
        run_here(write_scene(flat, tmp_path / "scene.toml"), tmp_path / "flat", "--no-figures").code
        == 0
    )
    animate(read_results(tmp_path / "flat"), tmp_path / "flat", "")
    half, whole = red_pixels(tmp_path / "flat" / "animation.gif")
    assert whole > half + 50


@pytest.mark.skipif(not shutil.which("ffmpeg"), reason="no ffmpeg to write videos")
def test_an_animation_is_a_video_too(marched):
    """Where ffmpeg is installed, of the same size but for a line of pixels."""
    video = (marched / "animation.mp4").read_bytes()
    assert video[4:8] == b"ftyp" and len(video) > 2000


@pytest.mark.slow
def test_a_video_that_fails_is_told(tmp_path, marched, monkeypatch):
    """With the words of ffmpeg."""
    tool = tmp_path / "ffmpeg"
    tool.write_text("#!/bin/sh\necho no encoder >&2\nexit 1\n")
    tool.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    shutil.copytree(marched, tmp_path / "copy")
    with pytest.raises(OutputError, match="no encoder"):
        animate(read_results(marched), tmp_path / "copy", "")


@pytest.mark.slow
def test_animations_of_solids_have_no_bands(tmp_path, monkeypatch, still):
    """Shaded colours go over into each other on white, as the colours of all frames are chosen for these."""
    monkeypatch.setitem(ANIMATION, "frames", 2)
    shutil.copytree(still, tmp_path, dirs_exist_ok=True)
    with PIL.Image.open(animate(read_results(tmp_path), tmp_path, "")) as picture:
        frame = picture.convert("RGB")
    assert frame.getpixel((0, 0)) == (255, 255, 255)
    assert len(frame.getcolors(256)) > 140


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"view": "frnt"}, "--view: 'frnt' is not valid; expected one of .*did you mean 'front'"),
        ({"view": [10.0, 95.0]}, r"--view\.1: expected a number <= 90"),
        ({"view": [1.0]}, "--view: expected a list"),
        ({"cut": {"w": 1.0}}, r"--cut\.w: unknown key"),
        ({"cut": {"x": float("nan")}}, "finite number"),
        ({"cut": {"x": 1.0, "y": 0.5}}, "a cut has one of x, y and z"),
        ({"magnification": -1.0}, "--magnification"),
        ({"cut": {"x": 3.0}}, "x = 3 meets no body; they reach from 0 to 3"),
    ],
)
def test_what_is_asked_for_is_checked(still, asked, words):
    """In one message, with the option and what would have been right."""
    with pytest.raises(InputError, match=words):
        draw_all(still, **asked)


def test_a_cut_beside_all_bodies_is_refused_before_a_run():
    """Not when the pictures are drawn; and in the plane there is none."""
    for scene, words in (
        (
            two_boxes(2) | {"output": {"cut": {"x": 9.0}}},
            "scene.toml: a cut at x = 9 meets no body",
        ),
        (pinched_blocks(2) | {"output": {"view": "iso"}}, "output.view: only pictures of solids"),
    ):
        with pytest.raises(InputError, match=words):
            prepare_scene(
                MPI.COMM_SELF, read_scene("scene.toml", to_toml(scene)), "scene.toml", factor=False
            )


def test_maps_show_what_is_closed(still):
    """Of a contact that is closed in a small part only, this and its surroundings."""
    results = read_results(still)
    surface = results.surfaces["upper-lower"]
    whole = draw_maps(results, "upper-lower").axes[0]
    assert whole.get_xlim()[1] > 2.9
    x, y, _ = surface["points"].T
    surface["status"][:] = np.where(
        (x <= 0.5) & (y <= 0.25), STATUS.index("stick"), STATUS.index("open")
    )
    small = draw_maps(results, "upper-lower").axes[0]
    assert 0.5 < small.get_xlim()[1] < 1.5


@pytest.mark.slow
def test_pressure_and_tension_are_told_apart(still):
    """Where a contact bears tension, colours are white at zero; else they begin there."""
    results = read_results(still)
    table = results.contacts["upper-lower"]
    assert draw_contacts(results).axes[-1].get_ylim()[0] == 0.0
    table["normal_stress"][0] = -0.25 * table["normal_stress"].max()
    low, high = draw_contacts(results).axes[-1].get_ylim()
    assert low == pytest.approx(-high)


def test_what_turns_has_a_loop_of_its_moment(stepped):
    """Where contact forces cancel, as of a shaft in its hub, steps.png draws the moment that varies most."""
    results = read_results(stepped)
    assert draw_steps(results).axes[0].get_ylabel() == "tangential force (N)"
    for axis in "xyz":
        results.steps[f"force_{axis}"][:] = 0.0
    results.steps["moment_y"][:] = [1e9, -1e9]
    axes = draw_steps(results).axes[0]
    assert (
        axes.get_ylabel() == "moment (N·m)" and axes.lines[0].get_label() == "upper-lower, moment y"
    )
    assert axes.lines[0].get_ydata().tolist() == [0.0, 1e9, -1e9]


def test_resultants_of_solids_lie_on_their_line_of_action(still):
    """But for a torsion, the force has the contact's moment about the origin there."""
    results = read_results(still)
    axes = draw_contacts(results).axes[0]
    contact, view = results.summary["contacts"]["upper-lower"], views.View(results.points)
    force, moment = np.array(contact["force"]), np.array(contact["moment"])
    line = next(
        np.array([text.xyann, text.xy])
        for text in axes.texts
        if text.arrow_patch
        and np.linalg.norm(text.xy - view.place(results.points.mean(axis=0))[:2]) < 2.0
    )
    line = line - view.place(apart(results, view)["upper"])[:2]
    at = np.cross(force, moment) / (force @ force)
    direction, off = view.place(force)[:2], line[1] - view.place(at)[:2]
    assert direction[0] * off[1] == pytest.approx(
        direction[1] * off[0], abs=1e-9 * np.linalg.norm(direction)
    )
    assert np.linalg.norm(line[1] - view.place(np.array([1.5, 0.5, 1.0]))[:2]) < 0.5


def test_resultants_on_one_line_stand_side_by_side():
    """Opposite and equal arrows that overlap are moved apart, by steps to one side; others stay."""
    up = np.array([[0.0, 0.0], [0.0, 1.0]])
    raised, other, on_end = (up + np.array(shift) for shift in ((0.0, 0.3), (1.0, 0.0), (0.0, 1.5)))
    first, down, second, away, behind = _aside([up, up[::-1], raised, other, on_end], 0.1)
    assert (first == up).all() and (away == other).all() and (behind == on_end).all()
    assert np.abs(down[:, 0]) == pytest.approx(0.1) and down[:, 1] == pytest.approx([1.0, 0.0])
    assert second[:, 0] == pytest.approx(2.0 * down[:, 0]) and second[:, 1] == pytest.approx(
        [0.3, 1.3]
    )


@pytest.mark.slow
def test_a_largest_value_out_of_sight_is_said_to_be(still):
    """The title says so where the largest stress is at the middle of the side behind, and not of the one in front."""
    results = read_results(still)
    results.summary["scene"]["output"]["view"] = "front"
    points, fields, y = results.points, results.fields, results.points[:, 1]
    for depth, behind in ((y.min(), False), (y.max(), True)):
        off = np.abs(points - points.mean(axis=0))[:, [0, 2]].sum(axis=1)
        node = np.where(y == depth, off, np.inf).argmin()
        cell = (fields["cells"] == node).any(axis=1).argmax()
        for name, place in (("nodal_von_mises", node), ("von_mises", cell)):
            fields[name] = np.ones(len(fields[name]))
            fields[name][place] = 2.0
        title = draw_bodies(results)._suptitle.get_text()
        assert "up to 2 " in title and ("(out of sight)" in title) == behind, title
    fields["nodal_von_mises"] = np.full(len(points), 3.0)  # as its colours show
    assert re.search(
        r"up to 2 (\w+) in a cell, 3 \1 at a node", draw_bodies(results)._suptitle.get_text()
    )
