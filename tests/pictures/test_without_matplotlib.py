"""matplotlib is an extra: without it everything but the pictures is there."""

import sys
from pathlib import Path

import pytest
import scenes
from scenes import pinched_blocks

from ddmpi.errors import InputError
from ddmpi.pictures.draw import draw_all
from ddmpi.sweep.plots import draw_plot

pytestmark = pytest.mark.slow

HIDDEN = "import sys; sys.modules['matplotlib'] = None; from ddmpi.cli.main import main; main()"
"""The command, in a Python that does not find matplotlib."""


def test_a_run_writes_all_but_pictures(tmp_path):
    """Without matplotlib a run ends well, writes all its data, and says what to install for pictures."""
    scene, output = scenes.write_scene(pinched_blocks(2), tmp_path / "scene.toml"), tmp_path / "out"
    run = scenes.run_python(
        ["-c", HIDDEN, "run", str(scene), "--output", str(output)], 1, folder=output
    )
    assert run.code == 0, run.output
    assert run.files == scenes.DATA
    assert (
        "pictures (matplotlib is not installed: pip install matplotlib, or Debian's" in run.output
    )


@pytest.mark.parametrize("draw", [draw_all, lambda folder: draw_plot(folder, "n_A:theta")])
def test_drawing_refuses_before_it_reads(draw, tmp_path: Path, monkeypatch):
    """Each way to a picture refuses, before it looks at results."""
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(InputError, match="matplotlib is not installed"):
        draw(tmp_path)
