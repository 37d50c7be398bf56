"""The example of docs/use/derivatives.md."""

import calibrate
import numpy as np
import pytest


@pytest.mark.slow
def test_a_coefficient_and_a_gap_are_found_from_forces():
    """From forces without noise both come out as they were, in few solves; with noise within their errors."""
    exact = np.array([0.37, -4e-5])
    measured = calibrate.forces(calibrate.solve(*exact.tolist()))
    found, errors, tried = calibrate.calibrate(measured, np.array([0.3, -1e-5]))
    assert np.abs(found / exact - 1.0).max() < 1e-5 and tried < 10
    assert errors[0] < 1e-5 and errors[1] < 1e-9
