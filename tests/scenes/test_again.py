"""What is done again in another way has the same answer: a run that is stopped several times, meshes refined by number,
a mirror image that moves far. Also a folder without permission."""

import os
import signal
import tempfile
from pathlib import Path

import bolts
import numpy as np
import pytest
from elsewhere import Elsewhere
from problems.bodies import answer_of
from problems.moving import forces, sliding
from scenes import run_here, seldom, write_scene

from ddmpi.body.compliance import Compliance
from ddmpi.errors import InputError
from ddmpi.results.folder import choose_folder
from ddmpi.results.tables import read_results
from ddmpi.system import interrupt


@pytest.mark.slow
def test_a_run_that_is_stopped_again_and_again(tmp_path, monkeypatch):
    """Each run goes on from the checkpoint of the one before; the answer has the bits of a run without a stop."""
    path = write_scene(bolts.joint(steps=6), tmp_path / "scene.toml")
    whole = run_here(path, tmp_path / "whole", "--no-figures")
    stopped, done, mult, left = 0, None, Compliance.mult, [0]

    def noted(self, *arguments):
        left[0] -= 1
        if left[0] == 0:
            interrupt._note(signal.SIGTERM, None)
        return mult(self, *arguments)

    monkeypatch.setattr(Compliance, "mult", noted)
    while done is None or done.code == 6:
        monkeypatch.setattr(interrupt, "_received", [])
        left[0] = 35 if stopped else 80  # one load step takes fewer
        done = run_here(
            path,
            tmp_path / "parts",
            "--no-figures",
            *(["--restart", str(tmp_path / "parts")] if stopped else []),
        )
        stopped += done.code == 6
        assert done.code in (0, 6) and stopped < 100, done.output
    assert whole.code == 0 and stopped >= 3
    assert (tmp_path / "parts" / "steps.csv").read_bytes() == (
        tmp_path / "whole" / "steps.csv"
    ).read_bytes()
    assert done.summary["contacts"] == whole.summary["contacts"]


@pytest.mark.slow
def test_refined_by_number_as_by_a_target(tmp_path):
    """The meshes that a target chose, asked for by their number: the same nodes and displacements."""
    aimed = run_here(
        "configs/punch.toml",
        tmp_path / "aimed",
        "--set",
        "method.target_error=0.07",
        "output.figures=false",
        *(f'body.{k}.mesh.refine="as needed"' for k in (0, 1)),
    )
    numbers = [body["mesh"]["refine"] for body in aimed.summary["scene"]["body"]]
    named = run_here(
        "configs/punch.toml",
        tmp_path / "named",
        "--set",
        "output.figures=false",
        "output.error=true",
        *(f"body.{k}.mesh.refine={number}" for k, number in enumerate(numbers)),
        "body.0.mesh.order=2",
    )
    assert aimed.code == named.code == 0 and min(numbers) > 0
    one, other = (read_results(tmp_path / name).fields for name in ("aimed", "named"))
    assert np.array_equal(one["points"], other["points"]) and np.array_equal(
        one["cells"], other["cells"]
    )
    distance = np.abs(
        one["displacement"] - other["displacement"]
    ).max()  # what the tolerance of a target leaves
    assert distance < 1e-3 * np.abs(other["displacement"]).max()


@pytest.mark.slow
@pytest.mark.parametrize("order", [seldom(1), 2])
def test_a_block_slides_to_the_left_as_to_the_right(order):
    """A mirrored scene of bodies that move far, its meshes mirror images, has the mirrored forces at each step."""
    there = sliding(order, 3)
    answer = forces(answer_of(there).summary)
    mirrored = Elsewhere(Q=np.diag([-1.0, 1.0])).scene(there)
    for motion in mirrored["body"][0]["motion"]:
        motion["shift"][0] *= -1.0
    other = forces(answer_of(mirrored).summary)
    assert len(answer) == len(other) == 6 and np.abs(answer[-1, 1]) > 1.0
    assert other == pytest.approx(
        answer * [1.0, -1.0, 1.0], rel=1e-9, abs=1e-9 * np.abs(answer[:, 1:]).max()
    )


def test_a_folder_without_permission():
    """Refused with the reason, as any user but root meets it."""
    user = os.geteuid()
    with tempfile.TemporaryDirectory() as place:  # that others than its owner reach, as no tmp_path
        closed = Path(place) / "closed"
        closed.mkdir()
        os.chmod(place, 0o755)
        closed.chmod(0o555)
        os.seteuid(user or 65534)
        try:
            for folder, words in (
                (closed, "cannot write there"),
                (closed / "new", "cannot be made"),
            ):
                with (
                    pytest.raises(
                        InputError, match=f"^--output {folder}: {words}: Permission denied$"
                    ),
                    choose_folder(str(folder), None, "scene.toml"),
                ):
                    pass
        finally:
            os.seteuid(user)
        assert not [*closed.iterdir()]
