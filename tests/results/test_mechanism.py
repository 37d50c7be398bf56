"""The picture of a mechanism and the file that it is drawn from."""

import json

import numpy as np
import pytest
from matplotlib import image

from ddmpi.errors import InputError
from ddmpi.judge.equilibrium import Mechanism, describe
from ddmpi.judge.motions import MotionsOfBody
from ddmpi.results.mechanism import draw_mechanism, move, outlines, write_mechanism

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])


def tipping() -> Mechanism:
    motions = np.stack([np.tile(axis, (4, 1)) for axis in np.eye(2)] + [SQUARE[:, ::-1] * (-1.0, 1.0)], axis=2)
    body = MotionsOfBody.of("block", SQUARE, motions)
    return Mechanism((body,), np.array([[-0.35, 0.35, 0.7]]), np.array([0.0, 0.0, 0.7]), 0.1,
                     frozenset({frozenset({"block", "base"})}))


def test_a_mechanism_is_drawn_from_its_file(tmp_path):
    """mechanism.json holds all that mechanism.png shows."""
    write_mechanism(tmp_path, tipping(), [("block", SQUARE, TRIANGLES), ("base", SQUARE - (0, 1), TRIANGLES)],
                    [("floor", np.array([[0.0, -1.0], [1.0, -1.0]]))], "Costs $5 and $6", "mm")
    content = json.loads((tmp_path / "mechanism.json").read_text(encoding="utf-8"))
    assert content["reason"] == describe(tipping()) == "no equilibrium: block tips to the left about (0, 0)"
    assert [(body["name"], body["loose"]) for body in content["bodies"]] == [("block", True), ("base", False)]
    assert np.allclose(content["bodies"][0]["outline"], [SQUARE])
    first = image.imread(draw_mechanism(tmp_path, {"Title": "a"}))
    assert np.array_equal(image.imread(draw_mechanism(str(tmp_path))), first)
    assert ((first[..., 0] > first[..., 2] + 0.15).mean()) > 0.02  # the colour of what moves


def test_a_file_that_is_missing_is_an_input_error(tmp_path):
    """A folder without a mechanism is named."""
    with pytest.raises(InputError, match=r"mechanism\.json: cannot be read"):
        draw_mechanism(tmp_path)


def test_outlines_of_a_ring():
    """A body with a hole has two outlines, the inner one clockwise; quadratic ones pass through the middles."""
    points = np.concatenate([SQUARE * 3 - 1, SQUARE])
    ring = np.concatenate([[[k, (k + 1) % 4, 4 + (k + 1) % 4], [k, 4 + (k + 1) % 4, 4 + k]] for k in range(4)])
    outer, inner = outlines(ring)
    area = [np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) / 2 for x, y in (points[outer].T, points[inner].T)]
    assert area == pytest.approx([9.0, -1.0])
    assert [loop.tolist() for loop in outlines(np.array([[0, 1, 2, 3, 4, 5]]))] == [[0, 3, 1, 4, 2, 5]]


def test_bodies_are_drawn_turned_and_not_stretched():
    """A turn about a point keeps all lengths and that point; a small motion is the velocity."""
    moved = move(SQUARE, np.array([0.5, 0.5]), [-0.25, 0.25, 0.5])
    assert moved[0] == pytest.approx([0.0, 0.0]) and moved[1] == pytest.approx([np.cos(0.5), np.sin(0.5)])
    assert move(SQUARE, np.array([0.5, 0.5]), [0.1, 0.2, 0.0]) == pytest.approx(SQUARE + np.array([0.1, 0.2]))
