"""Normals and tangents in space."""

import numpy as np
import pytest

from ddmpi.surface.side import frames, unit


@pytest.mark.parametrize("normals", [np.eye(3), -np.eye(3), np.random.default_rng(3).normal(size=(40, 3))])
def test_frames_are_right_handed(normals):
    """Orthonormal with the normals first, also beside opposite ones."""
    normals = unit(normals)
    found = frames(normals)
    assert found[:, 0] == pytest.approx(normals)
    assert found @ found.transpose(0, 2, 1) == pytest.approx(np.broadcast_to(np.eye(3), found.shape))
    assert np.linalg.det(found) == pytest.approx(np.ones(len(found)))


def test_neighbours_have_nearly_the_same_tangents():
    """Over a cap of 120° tangents turn no faster than normals do."""
    angle = np.linspace(-np.pi / 3, np.pi / 3, 60)
    normals = np.column_stack([np.sin(angle), 0.3 * np.sin(2 * angle), np.cos(angle)])
    found = frames(unit(normals))
    assert np.abs(np.diff(found, axis=0)).max() < 2.0 * np.abs(np.diff(unit(normals), axis=0)).max()
