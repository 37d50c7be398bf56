"""Small helpers with numbers."""

from __future__ import annotations

import numpy as np


def norm(x: np.ndarray) -> float:
    """‖x‖₂ of a vector."""
    return float(np.linalg.norm(x))
