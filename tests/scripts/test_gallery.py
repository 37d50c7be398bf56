"""The gallery: each of its scenes has the number, and the end, that docs/start/gallery.md tells."""

import csv
import re
import sys

import numpy as np
import pytest
from commands import run
from gallery import CHECKS, EXHIBITS, ROOT, WIDEST, beside
from matplotlib import image
from mpi4py import MPI

import ddmpi
from ddmpi.mesh.elements import facet_measures
from ddmpi.results.histories import write_frames
from ddmpi.results.summary import write_mechanism
from ddmpi.results.tables import write_contact
from ddmpi.system.numbers import moment

pytestmark = pytest.mark.slow

PAGE = (ROOT / "docs" / "start" / "gallery.md").read_text(encoding="utf-8")
SLOPE, PUSH = np.deg2rad(15), 20.0 * (10 + 80 * np.tan(np.deg2rad(15))) / 2
ASIDE = PUSH * (np.cos(SLOPE) - 0.1 * np.sin(SLOPE)) / (np.sin(SLOPE) + 0.1 * np.cos(SLOPE))
BALANCES = {
    "dovetail": {"root-disc": [-600 * (1 - 0.2) / (1 + 0.2), -600]},
    "wedge_in_slot": {"left": [ASIDE, PUSH], "right": [-ASIDE, PUSH]},
}
"""Forces on flanks that slide, by their slope, friction and load alone."""


@pytest.mark.parametrize("exhibit", EXHIBITS, ids=lambda exhibit: exhibit.name)
def test_exhibit(exhibit, tmp_path):
    """A scene of the gallery ends as the page says, with its number, and warns of nothing. The lines of its tables have
    the force and the moment of its contacts; what is drawn of those in space has their area."""
    answer = ddmpi.solve(exhibit.path, MPI.COMM_SELF, exhibit.settings)
    if exhibit.refused:
        write_mechanism(tmp_path, answer.solved.solution.mechanism)
    if places := answer.solved.steps.places:
        write_frames(tmp_path, [(time, places[time].frames) for time in sorted(places)])
    exhibit.check(answer.summary | beside(tmp_path))
    if target := exhibit.settings.get("method.target_error"):
        assert answer.summary["discretization_error"]["energy_norm"] <= 0.9 * target
    for name, force in BALANCES.get(exhibit.name, {}).items():
        assert answer.contacts[name].force == pytest.approx(
            force, rel=1e-4 if exhibit.name == "dovetail" else 1e-3
        )
    for name, state in answer.contacts.items():
        write_contact(tmp_path, name, state)
        with open(tmp_path / f"contact_{name}.csv", encoding="utf-8") as file:
            table = {
                column: np.array(values) for column, *values in zip(*csv.reader(file), strict=True)
            }
        at, n = (
            np.column_stack([table[f"{before}{axis}"] for axis in "xyz" if axis in table]).astype(
                float
            )
            for before in ("", "n")
        )
        if at.shape[1] == 3:
            outline = state.interface.drawing.outline
            drawn = facet_measures(outline.xy[outline.cells], axisymmetric=False).sum()
            assert drawn == pytest.approx(state.interface.area.sum(), rel=1e-6), name
            forces = np.column_stack([table[f"force_{axis}"] for axis in "xyz"]).astype(float)
        else:  # −(s_ν n + s_t t), t being n turned counterclockwise
            normal, tangential = (
                table[f"{kind}_force"].astype(float)[:, None] for kind in ("normal", "tangential")
            )
            forces = -normal * n - tangential * n[:, ::-1] * [-1.0, 1.0]
        size = np.abs(forces).sum()
        assert forces.sum(axis=0) == pytest.approx(state.force, abs=1e-9 * size)
        if not state.interface.axisymmetric:
            apart = np.linalg.norm(moment(at, forces) - state.moment)
            assert (
                apart <= state.moment_imbalance[0] * (1.0 + 1e-6) + 1e-9 * size * np.abs(at).max()
            ), name


def test_the_page_shows_every_scene():
    """Each scene that is checked has one section, with pictures, a thumbnail, and lines of its TOML."""
    assert sorted(exhibit.name for exhibit in EXHIBITS) == sorted(CHECKS)
    sections = re.split(r"^## ", PAGE, flags=re.MULTILINE)[1:]
    thumbnails = re.findall(
        r"\[!\[([^]]+)\]\(../figures/gallery_(\w+)\.png\)\]\(#\S+\)<br>\1 \|", PAGE
    )
    assert sorted(thumbnails) == sorted(
        (section.splitlines()[0], exhibit.name)
        for section, exhibit in zip(sections, EXHIBITS, strict=True)
    )
    for section, exhibit in zip(sections, EXHIBITS, strict=True):
        for ending in ("png", "gif") if exhibit.moves else ("png",):
            name = f"figures/gallery_{exhibit.name}.{ending}"
            assert (
                f"](../{name})" in section
                and 1_000 < (ROOT / "docs" / name).stat().st_size < 250_000
            )
        lines = {
            line.split(" # ")[0].strip()
            for line in exhibit.path.read_text(encoding="utf-8").splitlines()
        }
        quoted = [
            line.strip()
            for block in re.findall(r"```toml\n(.*?)```", section, re.DOTALL)
            for line in block.splitlines()
            if line.strip()
        ]
        assert quoted and [line for line in quoted if line not in lines] == [], exhibit.name


def test_the_script_keeps_pictures(tmp_path):
    """The script runs a scene as a user would and leaves its picture, small enough for a page."""
    said = run(
        ROOT / "scripts" / "gallery.py",
        "--only",
        "tipping_tower",
        "--output",
        tmp_path,
        cwd=tmp_path,
        DDMPI_PYTHON=sys.executable,
    )
    assert said.startswith("tipping_tower: 1 m, of 1 m"), said
    (picture,) = tmp_path.iterdir()
    assert picture.name == "gallery_tipping_tower.png" and picture.stat().st_size < 250_000
    pixels = image.imread(picture)
    assert 300 < max(pixels.shape[:2]) <= WIDEST
