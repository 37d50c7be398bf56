"""Pictures of any number of bodies and contacts, drawn from files only."""

import made_up
import numpy as np
import pytest
from matplotlib import image
from matplotlib import pyplot as plt

from ddmpi.errors import InputError, OutputError
from ddmpi.results.pictures import draw_all, draw_bodies, draw_contact, draw_convergence
from ddmpi.results.reader import Results, read_results
from ddmpi.results.tables import write_history


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


def made(folder, *missing: int, **how) -> Results:
    """Results of two blocks whose contact lacks some nodes."""
    made_up.results(folder, **how)
    for table in folder.glob("contact_*.csv"):
        header, *lines = table.read_text().splitlines(keepends=True)
        table.write_text("".join([header, *(line for k, line in enumerate(lines) if k not in missing)]))
    return read_results(folder)


def pressure(results: Results):
    """The curve of the normal stress as it is drawn."""
    return draw_contact(results, "upper-lower").axes[0].lines[0]


@pytest.mark.parametrize("how, contacts", [
    ({}, ["contact.png"]), ({"order": 2}, ["contact.png"]), ({"stresses": False, "friction": made_up.NoFriction()},
                                                            ["contact.png"]),
    ({"kind": "row", "error": True}, ["contact_left-middle.png", "contact_middle-right.png", "error.png"])])
def test_there_is_a_picture_of_everything(tmp_path, how, contacts):
    """All bodies share one picture, and each contact has its own; a single contact's is contact.png."""
    made_up.results(tmp_path, **how)
    drawn = draw_all(tmp_path)
    assert sorted(path.name for path in drawn) == sorted(["bodies.png", "convergence.png", *contacts])
    for path in drawn:
        pixels = image.imread(path)
        inked = (pixels[..., :3] < 0.99).any(axis=2)
        assert min(pixels.shape[:2]) > 300 and 0.01 < inked.mean() < 0.99, path.name
        assert len({colour.tobytes() for colour in pixels[::3, ::3].reshape(-1, pixels.shape[2])}) > 20, path.name


def test_pictures_come_from_files_alone(tmp_path):
    """Drawn twice from the same files, pictures are the same pixel for pixel."""
    made_up.results(tmp_path, error=True)
    first = {path: image.imread(path) for path in draw_all(tmp_path)}
    assert all(np.array_equal(image.imread(path), pixels) for path, pixels in first.items())
    assert draw_all(tmp_path) == list(first)


def test_every_body_is_in_the_picture(tmp_path):
    """The bodies' picture reaches from the first block to the last one."""
    axes = draw_bodies(made(tmp_path, kind="row")).axes[0]
    assert axes.get_xlim()[0] <= 0.0 and axes.get_xlim()[1] >= 9.0
    assert axes.get_xlabel() == "x (m)"


def test_neighbours_are_joined(tmp_path):
    """A contact in one piece is one curve."""
    assert np.array_equal(pressure(made(tmp_path)).get_xdata(), np.linspace(0.0, 3.0, 25))


@pytest.mark.parametrize("order", [1, 2])
def test_pieces_of_a_contact_are_not_joined(tmp_path, order):
    """Where nodes are missing, the curve has a break, and no zone is shaded."""
    nodes = 24 * order + 1
    results = made(tmp_path, *range(8 * order, 12 * order), divisions=(24, 8), order=order)
    results.sides.clear()
    figure = draw_contact(results, "upper-lower")
    for axes in figure.axes:
        for line in axes.lines:
            if line.get_label() in ("normal (pressure)", "tangential", "gap", "slip", "± slip bound"):
                assert len(line.get_xdata()) == nodes - 4 * order + 1
                assert np.flatnonzero(np.isnan(line.get_xdata())).tolist() == [8 * order]
        reach = [patch.get_extents().transformed(axes.transData.inverted()) for patch in axes.patches]
        middle = 1.2  # between x = 1 and 1.5
        assert reach and not any(box.x0 < middle < box.x1 for box in reach)


def test_one_missing_node_is_a_break(tmp_path):
    """A clamped node in the middle of a contact separates its neighbours."""
    assert np.flatnonzero(np.isnan(pressure(made(tmp_path, 10)).get_xdata())).tolist() == [10]


def test_graded_meshes_are_not_torn(tmp_path):
    """Where every edge is 1.6 times as long as the one before, no neighbours count as separate."""
    results = made(tmp_path, divisions=(8, 8))
    table = results.contacts["upper-lower"]
    edges = 1.6 ** np.arange(8)
    table["x"] = np.concatenate([[0.0], np.cumsum(edges)])
    table["length"] = (np.concatenate([[0.0], edges]) + np.concatenate([edges, [0.0]])) / 2
    assert not np.isnan(pressure(results).get_xdata()).any()


def test_a_lone_node_is_visible(tmp_path):
    """Long curves have no markers, but for nodes that no line reaches."""
    curve = pressure(made(tmp_path, *range(49, 60), *range(61, 71), divisions=(150, 4)))
    assert curve.get_xdata()[curve.get_markevery()] == pytest.approx([1.2]) and curve.get_marker() == "o"


def test_a_vertical_contact_is_drawn_over_y(tmp_path):
    """The abscissa of a straight contact is a coordinate, that of a curved one its arc length."""
    results = made(tmp_path, kind="row")
    assert draw_contact(results, "left-middle").axes[1].get_xlabel() == "y (m)"
    results.contacts["left-middle"]["x"][4] += 0.1
    assert draw_contact(results, "left-middle").axes[1].get_xlabel() == "arc length along the contact (m)"


def test_units_have_prefixes(tmp_path):
    """Axes have units, in SI with the prefix that suits the numbers."""
    stresses, motion = draw_contact(made(tmp_path), "upper-lower").axes
    assert stresses.get_ylabel() == "contact stress (MPa)" and motion.get_ylabel() == "gap, slip (µm)"
    assert stresses.lines[0].get_ydata().max() == pytest.approx(50.0)


def test_iterations_of_all_load_steps_follow_each_other(tmp_path):
    """Iterations count on over the load steps, whose curves are not joined."""
    made_up.results(tmp_path)
    write_history(tmp_path, [(step, k, 10.0**-k, 10.0**-k, 0.0, 0, 0, 0, 0) for step in (1, 2) for k in (1, 2, 3)])
    axes = draw_convergence(read_results(tmp_path)).axes[0]
    assert axes.lines[0].get_xdata() == pytest.approx([1, 2, 3, np.nan, 4, 5, 6], nan_ok=True)


def test_titles_are_not_formulas(tmp_path):
    """A title may have dollar signs."""
    made_up.results(tmp_path, title="costs $ and $\\frac")
    assert draw_all(tmp_path)


def test_what_is_wrong_is_named(tmp_path):
    """Without results there is an InputError; a picture that cannot be written is an OutputError with its name."""
    with pytest.raises(InputError, match="not a complete folder of results"):
        draw_all(tmp_path)
    made_up.results(tmp_path)
    (tmp_path / "contact.png").mkdir()
    with pytest.raises(OutputError, match=r"contact.png: Is a directory"):
        draw_all(tmp_path)
    assert not plt.get_fignums()
