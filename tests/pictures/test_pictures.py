"""Pictures of any number of bodies and contacts, drawn from files only."""

import json

import h5py
import made_up
import numpy as np
import pytest
from documented import undocumented
from matplotlib import image
from matplotlib import pyplot as plt
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from PIL import Image
from scenes import seldom

from ddmpi.errors import InputError, OutputError
from ddmpi.interface.interface import Lines
from ddmpi.pictures import draw
from ddmpi.pictures.bodies import draw_bodies
from ddmpi.pictures.contacts import draw_contacts
from ddmpi.pictures.curves import draw_contact, draw_convergence, draw_steps
from ddmpi.pictures.draw import draw_all, pictures_of
from ddmpi.pictures.moved import magnify
from ddmpi.pictures.sheet import STYLE, save
from ddmpi.results.fields import drawn_facets
from ddmpi.results.tables import HISTORY, Results, read_results, write_table


def made(folder, *missing: int, **how) -> Results:
    """Results of two blocks whose contact lacks some nodes."""
    made_up.results(folder, **how)
    results = read_results(folder)
    for name, table in results.contacts.items():
        some = ~np.isin(np.arange(len(table["x"])), missing)
        lines = Lines(
            np.arange(len(some)),
            np.column_stack([table["x"], table["y"]]),
            table["length"],
            results.facets[name],
        ).only(some)
        results.facets[name] = drawn_facets(lines)
        results.contacts[name] = {column: values[some] for column, values in table.items()}
    return results


def pressure(results: Results):
    """The curve of the normal stress as it is drawn."""
    return draw_contact(results, "upper-lower").axes[0].lines[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    "how, contacts",
    [
        ({"stresses": False, "friction": made_up.NoFriction()}, ["contact.png"]),
        (
            {"kind": "row", "error": True, "order": 2, "divisions": (12, 4)},
            ["contact_left-middle.png", "contact_middle-right.png", "contacts.png", "error.png"],
        ),
    ],
)
def test_there_is_a_picture_of_everything(tmp_path, how, contacts):
    """Bodies and several contacts share a picture, each contact has its own; these files are documented. Drawn again,
    they are the same to the last pixel."""
    made_up.results(tmp_path, **how)
    drawn = draw_all(tmp_path)
    assert undocumented(tmp_path) == []
    assert sorted(path.name for path in drawn) == sorted(
        ["bodies.png", "convergence.png", *contacts]
    )
    for path in drawn:
        pixels = image.imread(path)
        inked = (pixels[..., :3] < 0.99).any(axis=2)
        assert min(pixels.shape[:2]) > 300 and 0.01 < inked.mean() < 0.99, path.name
        assert (
            len({colour.tobytes() for colour in pixels[::3, ::3].reshape(-1, pixels.shape[2])}) > 20
        ), path.name
    (tmp_path / "again").mkdir()
    for path in draw_all(tmp_path, 0, 2, into=tmp_path / "again"):  # every other one
        assert path.read_bytes() == (tmp_path / path.name).read_bytes(), path.name


@pytest.mark.slow
@pytest.mark.parametrize("make", [draw_convergence, draw_bodies])
def test_pictures_are_drawn_once_as_savefig_draws_them(tmp_path, monkeypatch, make):
    """With the layout, to the last pixel, and with the same words; matplotlib's own way draws them twice."""
    results, drawn = made(tmp_path), []
    draw_of_figure = Figure.draw
    with plt.rc_context(STYLE):
        make(results).savefig(tmp_path / "other.png", metadata={"Title": "π and more"})
        monkeypatch.setattr(Figure, "draw", lambda *of: (drawn.append(of), draw_of_figure(*of)))
        save(make(results), tmp_path / "one.png", {"Title": "π and more"})
    assert len(drawn) == 1
    one, other = (Image.open(tmp_path / f"{name}.png") for name in ("one", "other"))
    assert (np.asarray(one) == np.asarray(other)[..., :3]).all()
    assert one.info["dpi"] == other.info["dpi"] and one.text["Title"] == other.text["Title"]


def test_pieces_of_a_contact_are_not_joined(tmp_path):
    """Where nodes are missing, the curve has a break, and no zone is shaded."""
    results = made(tmp_path, *range(16, 24), divisions=(24, 8), order=2)
    results.sides.clear()
    figure = draw_contact(results, "upper-lower")
    for axes in figure.axes:
        for line in axes.lines:
            if line.get_label() in (
                "normal (pressure)",
                "tangential",
                "gap",
                "slip",
                "± slip bound",
            ):
                assert len(line.get_xdata()) == 49 - 8 + 1
                assert np.flatnonzero(np.isnan(line.get_xdata())).tolist() == [16]
        reach = [
            patch.get_extents().transformed(axes.transData.inverted()) for patch in axes.patches
        ]
        middle = 1.2  # between x = 1 and 1.5
        assert reach and not any(box.x0 < middle < box.x1 for box in reach)


@pytest.mark.parametrize("kind, drawn", [("unilateral", False), ("bonded", True)])
def test_bonds_carry_shear(tmp_path, kind, drawn):
    """The tangential stress of a contact without a friction law is drawn where it is bonded."""
    results = made(tmp_path, friction=made_up.NoFriction())
    results.summary["scene"]["contact"][0]["kind"] = kind
    lines = draw_contact(results, "upper-lower").axes[0].lines
    assert ("tangential" in [line.get_label() for line in lines]) == drawn


@pytest.mark.parametrize("end", [0, seldom(-1)])
def test_the_curve_ends_where_the_contact_ends(tmp_path, end):
    """A node that hardly faces anything and shares the row of its neighbour is not drawn, in any picture."""
    results = made(tmp_path)
    whole = pressure(results).get_xdata()
    x, row, inner = results.contacts["upper-lower"]["x"], np.arange(25), (1, -2)[end]
    row[end] = row[inner]
    for length, shown in (
        (0.03, whole),
        (0.01, np.delete(whole, end)),
        (-0.001, np.delete(whole, end)),
    ):
        area = np.full(25, 1.0)
        area[end] = length
        lines = Lines(
            row, np.column_stack([x, x]), area, np.column_stack([np.arange(24), np.arange(1, 25)])
        )
        results.facets["upper-lower"] = drawn_facets(lines)
        assert pressure(results).get_xdata().tolist() == shown.tolist()


def test_a_vertical_contact_is_drawn_over_y(tmp_path):
    """The abscissa of a straight contact is a coordinate, that of a curved one its arc length."""
    results = made(tmp_path, kind="row")
    assert draw_contact(results, "left-middle").axes[1].get_xlabel() == "y (m)"
    results.contacts["left-middle"]["x"][4] += 0.1
    assert (
        draw_contact(results, "left-middle").axes[1].get_xlabel()
        == "arc length along the contact (m)"
    )


def in_steps(results: Results) -> Results:
    """The same with what is drawn of load steps."""
    energies = ("external_work", "strain_energy", "interface_work", "dissipated")
    results.energy.update(dict.fromkeys(("time", *energies), np.ones(1)))
    results.legs.update(
        {
            name: {"time": np.ones(len(table["x"])), **table}
            for name, table in results.contacts.items()
        }
    )
    results.summary["scene"]["history"] = {}
    return results


def test_bonded_contacts_have_no_loops(tmp_path):
    """steps.png draws the loops of contacts that can slip, and of bonded ones only if there are no others."""
    results = in_steps(made(tmp_path, kind="row"))
    for bonded, shown in (
        (0, {"left-middle", "middle-right"}),
        (1, {"middle-right"}),
        (2, {"left-middle", "middle-right"}),
    ):
        for contact in results.summary["scene"]["contact"][:bonded]:
            contact["kind"] = "bonded"
        labels = {line.get_label() for line in draw_steps(results).axes[0].lines}
        assert {label for label in labels if not label.startswith("_")} == shown


def test_stresses_of_load_steps_have_prefixes(tmp_path):
    """steps.png labels stresses as contact.png does: kPa for what is some thousand Pa."""
    results = in_steps(made(tmp_path))
    results.legs["upper-lower"]["normal_stress"] = np.linspace(
        0.0, 3e4, len(results.legs["upper-lower"]["time"])
    )
    normal = draw_steps(results).axes[2]
    assert normal.get_ylabel() == "normal stress (kPa)" and normal.lines[
        0
    ].get_ydata().max() == pytest.approx(30.0)


def test_load_steps_whose_first_leg_fails_are_drawn(tmp_path):
    """There are steps, but no end of a leg: steps.png draws loops and energies alone. (The run ended with code 5.)"""
    results = in_steps(made(tmp_path))
    for columns in results.legs.values():
        columns.update({name: values[:0] for name, values in columns.items()})
    assert len(draw_steps(results).axes) == 2


def test_iterations_of_all_load_steps_follow_each_other(tmp_path):
    """Iterations count on over the load steps, whose curves are not joined."""
    made_up.results(tmp_path)
    write_table(
        tmp_path / "history.csv",
        HISTORY,
        [(step, k, 10.0**-k, 10.0**-k, 0.0, 0, 0, 0, 0) for step in (1, 2) for k in (1, 2, 3)],
    )
    axes = draw_convergence(read_results(tmp_path)).axes[0]
    assert axes.lines[0].get_xdata() == pytest.approx([1, 2, 3, np.nan, 4, 5, 6], nan_ok=True)


def test_what_is_wrong_is_named(tmp_path):
    """Without results there is an InputError; a picture that cannot be written is an OutputError with its name."""
    with pytest.raises(InputError, match="not a complete folder of results"):
        draw_all(tmp_path)
    made_up.results(tmp_path)
    (tmp_path / "bodies.png").mkdir()
    with pytest.raises(OutputError, match=r"bodies.png: Is a directory"):
        draw_all(tmp_path)
    assert not plt.get_fignums()


FLOOR = {
    "name": "floor",
    "shape": "plane",
    "point": [0.0, 0.0],
    "normal": [0.0, 2.0],
    "displacement": [0.0, 0.0],
}
BORE = {
    "name": "floor",
    "shape": "circle",
    "center": [1.5, 3.0],
    "radius": 3.0,
    "inside": True,
    "displacement": [1e-5, 0.0],
}


def with_rigid(folder, rigid: dict) -> Results:
    """The stack on a rigid partner, which carries what the contact above it carries."""
    made_up.results(folder)
    results = read_results(folder)
    results.contacts["lower-floor"] = {**results.contacts["upper-lower"], "y": np.zeros(25)}
    results.facets["lower-floor"] = results.facets["upper-lower"]
    results.summary["contacts"]["lower-floor"] = results.summary["contacts"]["upper-lower"]
    results.summary["scene"]["contact"].append(
        {"name": "lower-floor", "bodies": ["lower", "floor"], "friction": {"law": "none"}}
    )
    results.summary["scene"]["rigid"] = [rigid]
    return results


def segments(axes) -> list:
    """The lines of each collection of lines."""
    return [each.get_segments() for each in axes.collections if isinstance(each, LineCollection)]


@pytest.mark.parametrize(
    ("drawing", "rigid"),
    [
        (draw_bodies, BORE),
        seldom(draw_contacts, FLOOR),
        seldom(draw_bodies, FLOOR),
        seldom(draw_contacts, BORE),
    ],
)
def test_rigid_partners_are_drawn(tmp_path, rigid, drawing):
    """A plane is a little longer than the bodies, a bore an arc at them; hatched behind, magnified as bodies are."""
    results = with_rigid(tmp_path, rigid)
    axes = drawing(results).axes[0]
    x, y = axes.lines[0].get_data()
    factor = magnify(results)[0] if drawing is draw_bodies else 0.0
    if rigid is FLOOR:
        assert (x.min(), x.max()) == pytest.approx((-0.12, 3.12)) and not y.any()
        away = np.tile((0.0, -1.0), (len(x), 1))
    else:
        middle = np.array(BORE["center"]) + factor * np.array(BORE["displacement"])
        assert np.hypot(x - middle[0], y - middle[1]) == pytest.approx(np.full(len(x), 3.0))
        assert -0.1 < x.min() < 0.1 and 2.9 < x.max() < 3.1 and y.max() < 1.0
        away = (np.column_stack([x, y]) - middle) / 3.0
    axes.figure.canvas.draw()
    image = np.asarray(axes.figure.canvas.buffer_rgba())
    column, row = (axes.transData.transform(np.column_stack([x, y])) + 6.0 * away).astype(int).T
    inside = (row >= 0) & (row < len(image)) & (column >= 0) & (column < image.shape[1])
    assert (image[len(image) - 1 - row[inside], column[inside], :3] < 0x80).all(axis=1).any()


@pytest.mark.parametrize("mirrored", [seldom(False), True])
def test_the_axis_is_drawn(tmp_path, mirrored):
    """Bodies around an axis are drawn with it, and with their other half if that is wanted; partners end at it."""
    results = with_rigid(tmp_path, BORE | {"center": [0.0, 1.0], "radius": 1.0})
    results.summary["scene"] |= {"axisymmetric": True}
    results.summary["scene"]["output"] |= {"mirrored": mirrored}
    axes = draw_bodies(results).axes[0]
    axis, partner, *_ = axes.lines
    assert not any(axis.get_xdata()) and axis.get_linestyle() == "-."
    drawn = np.concatenate([np.concatenate(each) for each in segments(axes) if len(each) > 40])
    assert (drawn[:, 0].min() < -2.5) == mirrored and partner.get_xdata().min() >= 0.0
    assert len(axes.lines) == 3 + mirrored and axes.get_xlabel() == "radius x (m)"
    assert max(np.hypot(*np.diff(partner.get_xydata(), axis=0).T)) < 0.1  # in one piece


def arrows(axes) -> list[np.ndarray]:
    """Start and end (2, 2) of the resultants."""
    return [
        np.array([text.xyann, text.xy])
        for text in axes.texts
        if text.arrow_patch and not text.get_text()
    ]


def test_resultants_are_drawn_where_they_act(tmp_path):
    """The force of a contact is drawn through the point that its moment says, as steep as it is."""
    results = with_rigid(tmp_path, FLOOR)
    contact = results.summary["contacts"]["upper-lower"]
    (fx, fy), moment = contact["force"], contact["moment"]
    axes = draw_contacts(results).axes[0]
    (first, last), *_ = arrows(axes)
    direction = last - first
    assert direction[0] * fy - direction[1] * fx == pytest.approx(0.0, abs=1e-9 * abs(fy))
    x, y = (first + last) / 2
    assert x * fy - y * fx == pytest.approx(moment, rel=1e-9)


@pytest.mark.slow
def test_resultants_of_rounding_are_not_drawn(tmp_path):
    """Where the forces of a contact cancel, as in a shrink fit, the picture has no resultant, and no word of one."""
    results = made(tmp_path)
    for factor, drawn in ((1.0, True), (1e-9, False)):
        contact = results.summary["contacts"]["upper-lower"]
        results.summary["contacts"]["upper-lower"] = contact | {
            "force": [factor * x for x in contact["force"]]
        }
        axes = draw_contacts(results).axes[0]
        assert (
            any("resultants" in text.get_text() for text in axes.get_legend().get_texts()) == drawn
        )
        assert bool(arrows(axes)) == drawn


def test_several_ranks_share_the_pictures(tmp_path, monkeypatch):
    """Each picture is drawn once, whoever draws it."""
    made_up.results(tmp_path)
    monkeypatch.setattr(
        draw, "pictures_of", lambda *_: ((f"{k}.png", plt.figure) for k in range(4))
    )
    shares = [[path.name for path in draw_all(tmp_path, number, 3)] for number in range(3)]
    assert shares == [["0.png", "3.png"], ["1.png"], ["2.png"]] and (tmp_path / "3.png").exists()


@pytest.mark.parametrize("contacts, single", [(2, 2), (6, 6), (7, 0)])
def test_of_many_contacts_only_the_overview_is_drawn(tmp_path, monkeypatch, contacts, single):
    """Up to six contacts have pictures of their own."""
    results = made(tmp_path)
    table, entry = results.contacts["upper-lower"], results.summary["contacts"]["upper-lower"]
    names = [f"c{k}" for k in range(contacts)]
    monkeypatch.setitem(results.summary, "contacts", dict.fromkeys(names, entry))
    results.contacts.clear()
    results.contacts.update(dict.fromkeys(names, table))
    results.facets.update(dict.fromkeys(names, results.facets["upper-lower"]))
    results.summary["scene"]["contact"] = [
        results.summary["scene"]["contact"][0] | {"name": name} for name in names
    ]
    drawn = [name for name, _ in pictures_of(results, results)]
    assert "contacts.png" in drawn and sum(name.startswith("contact_") for name in drawn) == single


def test_results_of_an_earlier_version_name_it(tmp_path):
    """A folder without the facets of contacts has no pictures: the message has the version that wrote it."""
    made_up.results(tmp_path)
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8")) | {
        "versions": {"ddmpi": "0.7.0"}
    }
    (tmp_path / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    with h5py.File(tmp_path / "result.h5", "r+") as file:
        del file["contacts"]
    assert read_results(tmp_path).contacts["upper-lower"]["x"].size == 25
    with pytest.raises(InputError, match=r"ddmpi 0\.7\.0 wrote these results"):
        draw_all(tmp_path)
