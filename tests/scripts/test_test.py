"""What tests/conftest.py makes of pytest; test.sh, check.sh and setup.sh of scripts/."""

import re

import scenes


def test_no_test_has_a_time_limit_of_its_own():
    """The limit is to catch what hangs, on any machine, and stands in one place."""
    own = re.compile(r"\b(?:timeout|limit)=\d|monotonic\(\) \+ \d|^LIMIT = \d", re.M)
    found = {path.name: len(own.findall(path.read_text(encoding="utf-8")))
             for path in (scenes.ROOT / "tests").rglob("*.py")}
    found["test_peers.py"] -= 2  # of programs to compare with: what is tested
    found["scenes.py"] -= 1  # until mpirun, which is told to end, is killed
    assert {name: times for name, times in found.items() if times} == {}
