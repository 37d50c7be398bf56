"""Colours of one field end at the same value in all pictures and views of a run."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from browser import unpacked
from made_up_solids import stacked
from matplotlib.colorbar import Colorbar

from ddmpi.pictures.bodies import ANIMATION, animate, draw_bodies
from ddmpi.pictures.browser import write_view
from ddmpi.pictures.contacts import draw_contacts, draw_maps
from ddmpi.pictures.scales import pressure_ends, stress_end
from ddmpi.pictures.sheet import limits
from ddmpi.results.histories import at_step


@pytest.fixture
def ends(monkeypatch) -> dict[str, list[tuple[float, float]]]:
    """By the beginning of the words beside them, the ends of all bars of colours that are drawn."""
    found, draw = {}, plt.Figure.colorbar

    def noted(self, image, *args, label="", **more) -> Colorbar:
        found.setdefault(label.partition(" (")[0], []).append(image.get_clim())
        return draw(self, image, *args, label=label, **more)

    monkeypatch.setattr(plt.Figure, "colorbar", noted)
    return found


def test_stresses_have_one_scale(tmp_path, ends, monkeypatch):
    """In the picture of each load step, cut open or not, in the view and in the animation: that of the largest load."""
    results = stacked(tmp_path, times=(1.0, 2.0))
    for time, cut in (1.0, {}), (2.0, {"x": 0.4}):
        step = at_step(results, tmp_path, time)
        step.summary["scene"]["output"]["cut"] = cut
        draw_bodies(step, tmp_path)
    results.summary["scene"]["output"] |= {"animation": True, "cut": {}}
    monkeypatch.setitem(ANIMATION, "frames", 2)
    monkeypatch.setitem(ANIMATION, "pixels", 200)
    animate(results, tmp_path, "")
    end = stress_end(results, tmp_path) / 1e6
    assert [end for _, end in ends["von Mises stress"]] == pytest.approx([end] * 3)
    head, _ = unpacked(write_view(tmp_path))
    assert head["fields"][0]["high"] == pytest.approx(end)
    # at half the load the stresses, and what ends their colours, are half as large
    assert stress_end(at_step(results, tmp_path, 1.0)) / 1e6 == pytest.approx(end / 2)
    plt.close("all")


@pytest.mark.slow
def test_pressures_have_one_scale(tmp_path, ends, monkeypatch):
    """On bodies, in maps, in the view and in the animation of all load steps: by areas, as for one contact."""
    results = stacked(tmp_path, times=(1.0, 2.0))
    for time in (1.0, 2.0):
        step = at_step(results, tmp_path, time)
        draw_contacts(step)
        draw_maps(step, "upper-lower")
    results.summary["scene"]["output"]["animation"] = "pressure"
    monkeypatch.setitem(ANIMATION, "frames", 2)
    monkeypatch.setitem(ANIMATION, "pixels", 200)
    animate(results, tmp_path, "")
    least, most = (end / 1e6 for end in pressure_ends(results))
    assert ends["pressure"] == [pytest.approx((least, most))] * 5 and least == 0.0
    head, _ = unpacked(write_view(tmp_path))
    assert head["fields"][1]["high"] == pytest.approx(most)
    legs, area = results.legs["upper-lower"], results.contacts["upper-lower"]["area"]
    values = legs["normal_stress"]
    assert most * 1e6 == limits(values, np.tile(area, 2) * (values != 0.0), 0.98)[1]
    plt.close("all")


def test_pressures_of_no_contacts_are_stresses(tmp_path, ends, monkeypatch):
    """An animation of bodies without contacts has nothing else to show, with the scale of all stresses."""
    results = stacked(tmp_path, times=(1.0, 2.0))
    results.summary["scene"]["output"]["animation"] = "pressure"
    results.summary["scene"]["contact"] = []
    monkeypatch.setitem(ANIMATION, "frames", 1)
    animate(results, tmp_path, "")
    end = pytest.approx((0.0, stress_end(results, tmp_path) / 1e6))
    assert ends == {"von Mises stress": [end]}
