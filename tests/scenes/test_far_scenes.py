"""Bodies that move far against closed forms, as `scripts/study far` has them on finer meshes, and refusals."""

import csv
import subprocess
import sys

import far
import numpy as np
import pytest
from mpi4py import MPI
from scenes import LIMIT, clean_environment, to_toml

import ddmpi
from ddmpi.errors import InputError
from ddmpi.results.histories import at_step, placed
from ddmpi.results.tables import read_results


def solve(scene):
    answer = ddmpi.solve(to_toml(scene), MPI.COMM_SELF)
    assert answer.certified, answer.reason
    return answer


@pytest.mark.parametrize("order", [1, 2])
def test_a_block_slides_under_coulomb_friction(order):
    """T = μ N in every step of sliding; the forces at the end do not depend on the number of steps; N ripples
    little."""
    found = far.forces(solve(far.block(order, 20)).summary, 1.0)
    late = found[found[:, 0] > 1.2]
    assert np.abs(late[:, 1]) == pytest.approx(far.FRICTION * np.abs(late[:, 2]), rel=1e-9)
    assert (late[:, 1] < 0.0).all() and (late[:, 2] > 0.0).all()  # on the block: against its way, and upwards
    (once,) = far.forces(solve(far.block(order, 1)).summary, 1.0)
    assert once[1:] == pytest.approx(found[-1, 1:], rel=1e-9)
    assert 1e-6 < far.ripple(found) < 5e-3


@pytest.mark.parametrize("order", [1, 2])
def test_a_turn_of_both_bodies_changes_nothing(order):
    """Forces turn with the bodies, and friction dissipates nothing."""
    change, lost = far.turn_errors(solve(far.turned(order)).summary)
    assert change < 1e-9 and lost < 1e-9


def test_a_pin_is_pushed_into_a_hub():
    """The force at full depth is μ times Lamé's pressure times the bore, within what its ends add; away from them the
    pressure is Lamé's, and the force grows as strip theory says."""
    rows, (least, most, lame), apart = far.pin(steps=20)
    forces, strips = ({float(row[0]): float(row[column]) for row in rows} for column in (1, 2))
    assert forces[20.0] == pytest.approx(float(rows[-1][3]), rel=0.01)
    assert forces[16.0] - forces[12.0] == pytest.approx(strips[16.0] - strips[12.0], rel=0.03)
    assert lame == pytest.approx(78.75) and apart < 0.05 and 0.98 * lame < least < most < 1.04 * lame


def test_results_are_where_the_bodies_are(tmp_path):
    """Files and pictures of each step: frames, places of contacts, and displacements with and without the motion."""
    scene = far.block(1, 2, way=16.0) | {"output": {"steps": "all"}}
    path, out = tmp_path / "block.toml", tmp_path / "out"
    path.write_text(to_toml(scene), encoding="utf-8")
    done = subprocess.run([sys.executable, "-m", "ddmpi", "run", path, "--output", out], text=True, capture_output=True,
                          timeout=LIMIT, env=clean_environment())
    assert done.returncode == 0, done.stdout + done.stderr
    with open(out / "frames.csv", encoding="utf-8") as file:
        frames = {(float(row["time"]), row["body"]): (float(row["shift_x"]), float(row["shift_y"]))
                  for row in csv.DictReader(file)}
    assert frames[1.5, "slider"] == pytest.approx((0.5, -far.PRESSED)) and frames[2.0, "base"] == (0.0, 0.0)
    for time, x in ((1.0, 0.0), (1.5, 0.5), (2.0, 1.0)):
        results = at_step(read_results(out), out, time)
        at = results.contacts["slider-base"]["x"]
        assert x - 1e-9 <= at.min() and at.max() <= x + 1.0 + 1e-9 and np.ptp(at) > 0.9
        block = np.unique(results.fields["cells"][results.fields["body"] == 0])
        moved, u = (results.fields[name][block, :2] for name in ("displacement", "displacement_in_frame"))
        assert moved - u == pytest.approx(np.tile([x, -far.PRESSED], (len(u), 1)), abs=1e-12)
        assert 1e-4 < np.abs(u).max() < far.PRESSED
        drawn = placed(results)
        assert drawn.points[block] == pytest.approx(results.points[block] + [x, -far.PRESSED])
    assert all((out / name).stat().st_size > 5000 for name in ("bodies.png", "contact.png", "steps.png"))


@pytest.mark.parametrize(("change", "words"), [
    (lambda scene: scene["time"].pop("motions"), 'bodies move far with motions = "far"'),
    (lambda scene: [each.pop("motion", None) for each in scene["body"]], "no body and no rigid partner has a motion"),
    (lambda scene: scene["body"][0]["motion"].append({"pivot": [0.0, 0.0], "shift": [1.0, 0.0]}), "pivot"),
    (lambda scene: scene["body"][0]["motion"].append({"history": "press"}), "a motion has a shift"),
    (lambda scene: scene["contact"][0].update(gap=0.1), "gap"),
    (lambda scene: scene["contact"][0].update(pairing="nodes"), "nodes do not stay opposite"),
    (lambda scene: scene["body"][0].update(motion={"shift": [0.0, -0.9], "history": "press"}), "pass through"),
    (lambda scene: scene["body"][0].update(clamp=[]), "slider")])
def test_a_scene_that_cannot_be_is_refused(change, words):
    """One message, before any work or at the step in which a body would run through another."""
    scene = far.block(1, 2)
    change(scene)
    with pytest.raises(InputError, match=words):
        ddmpi.solve(to_toml(scene), MPI.COMM_SELF)


def test_a_body_that_leaves_its_partner_is_told_of():
    """A block that is pushed off the end: no forces, and words in a warning."""
    answer = solve(far.block(1, 4, way=80.0))
    assert answer.contacts["slider-base"].normal_force.sum() == 0.0
    assert any("do not face each other" in words for words in answer.summary["warnings"])
