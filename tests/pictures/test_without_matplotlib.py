"""matplotlib is an extra: without it everything but the pictures is there."""

import sys
from pathlib import Path

import pytest
import scenes
from scenes import Run, pinched_blocks

from ddmpi.errors import InputError
from ddmpi.pictures.draw import draw_all
from ddmpi.sweep.plots import draw_plot

pytestmark = pytest.mark.slow

HIDDEN = "import sys; sys.modules['matplotlib'] = None; from ddmpi.cli.main import main; main()"
"""The command, in a Python that does not find matplotlib."""


@pytest.fixture(scope="module")
def hidden(tmp_path_factory) -> Run:
    folder = tmp_path_factory.mktemp("hidden")
    scene, output = scenes.write_scene(pinched_blocks(2), folder / "scene.toml"), folder / "out"
    return scenes.run_python(["-c", HIDDEN, "run", str(scene), "--output", str(output)], 1, folder=output)


def test_a_run_writes_all_but_pictures(hidden):
    """Without matplotlib a run ends well, writes all its data, and says what to install for pictures."""
    assert hidden.code == 0, hidden.output
    assert {"summary.json", "result.h5", "result.xdmf", "history.csv", "contact_upper-lower.csv"} <= hidden.files
    assert not any(name.endswith(".png") for name in hidden.files)
    assert "pictures (matplotlib is not installed: pip install matplotlib" in hidden.output


def test_figures_are_refused(hidden):
    """`ddmpi figures` refuses in one message that names what to install."""
    refused = scenes.run_python(["-c", HIDDEN, "figures", str(hidden.folder)], 1)
    assert refused.code == 2
    assert refused.own_stderr == ("ddmpi: error: no pictures can be drawn; matplotlib is not installed: "
                                  "pip install matplotlib, or Debian's python3-matplotlib\n")


@pytest.mark.parametrize("draw", [draw_all, lambda folder: draw_plot(folder, "n_A:theta")])
def test_drawing_refuses_before_it_reads(draw, tmp_path: Path, monkeypatch):
    """Each way to a picture refuses, before it looks at results."""
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(InputError, match="matplotlib is not installed"):
        draw(tmp_path)
