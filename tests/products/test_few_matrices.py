"""What a small run takes of SciPy, most of whose time is the making of sparse matrices."""

import sys

import pytest
from kinds import Kind
from promises import FEATURES
from scenes import certified


def matrices(scene: dict) -> int:
    """How many sparse matrices a run makes."""
    made = 0

    def look(frame, event, _) -> None:
        nonlocal made
        code = frame.f_code
        files = "sparse/_compressed.py", "sparse/_coo.py"
        made += event == "call" and code.co_name == "__init__" and code.co_filename.endswith(files)

    before = sys.getprofile()
    sys.setprofile(look)
    try:
        certified(scene)
    finally:
        sys.setprofile(before)
    return made


@pytest.mark.parametrize(
    ("name", "most"), [("traction by force", 60), ("rigid floor", 300)], ids=str
)
def test_a_small_run_makes_few_sparse_matrices(name, most):
    """45 for a body alone and 253 on a floor with SciPy 1.10; they were 91 and 451."""
    assert 0 < matrices(FEATURES[name](Kind("space", 1, False)).scene) <= most
