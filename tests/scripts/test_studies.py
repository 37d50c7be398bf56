"""Every script of a study is started, in its smallest form."""

import re
import runpy
import shlex
import sys
from pathlib import Path

import drawn
import mutants
import mutation
import pytest
from commands import executable, run
from experiment import Ledger
from mpi4py import MPI

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
STUDIES = {
    # script: arguments; words of what it prints and of its pages; numbers of tables and figures
    "large_bodies": (
        "--millions 0.001 --solids 0.001 --ranks 1 --kinds chosen iterative",
        (
            "## pinched_blocks, 0.001 million unknowns on 1 ranks",
            "## two_boxes, 0.001 million",
            "| chosen | explicit |",
            "| iterative | iterative |",
        ),
        1,
        0,
    ),
    "many_bodies": (
        "--stacks 3 --walls 2x3",
        (
            "| scene | bodies | contacts | outer |",
            "| stack 3 | 4 | 3 | ",
            "| wall 2x3 | 7 | 12 | ",  # bricks 2 + 3 + 2, joints 1 + 2 + 1, beds 4 + 4
            " | True |",
        ),
        1,
        0,
    ),
    "reproduce_tables": (
        "--sizes 6 --laws tresca",
        ("| 504 \\| 18 | 36 · ", "8 of them converged and certified"),
        1,
        1,
    ),
    "tradeoff": (
        "--finest 2 --scenes boxes --runs 1",
        ("| order 1, N = 2, pairs | ", "| order 2, N = 2, mortar | "),
        1,
        0,
    ),
    "errors": (
        "--only rail",
        ("| problems of the rule | ", "## Factors", "| rail | ", "| the mesh is too coarse | "),
        1,
        1,
    ),
    "verification": (
        "--coarse --only cgs-1 rings",
        (
            "| NAFEMS CGS-1: contact patch test of unlike bodies, every value | ≤ 1e-08 | ",
            "(exact) |",
            "## Two rings with interference",
            "| mean pressure, gap given (Pa) | 2575.5 | ",
        ),
        0,
        2,
    ),
}


def start(folder: Path, *arguments: str, code: int = 0) -> str:
    return run(
        ROOT / "scripts/study",
        *arguments,
        cwd=folder,
        code=code,
        DDMPI_PYTHON=sys.executable,
        DDMPI_RANKS="1",
    )


LISTED = re.findall(
    r"^    (\w+) +[12]  (\S+\.py)", (ROOT / "scripts/study").read_text(encoding="utf-8"), re.M
)


def test_studies_are_listed(tmp_path):
    """Without a name, or by --help, the command lists all studies; a name that is none ends with a message."""
    said = start(tmp_path)
    assert [line.split()[0] for line in said.splitlines()[1:]] == [name for name, _ in LISTED]
    commands = {
        path.resolve()
        for path in (ROOT / "scripts").glob("*.py")
        if "__main__" in path.read_text("utf-8")
    }
    assert len(LISTED) > 10 and commands <= {
        (ROOT / "scripts" / file).resolve() for _, file in LISTED
    }
    assert start(tmp_path, "--help") == said
    assert "there is no study nothing" in start(tmp_path, "nothing", code=2)


def test_pages_name_commands_that_there_are():
    """A page that names a study or a script which is gone says so."""
    listed = {name for name, _ in LISTED}
    for page in [*(ROOT / "docs").rglob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]:
        text = page.read_text(encoding="utf-8")
        gone = {
            name for name in re.findall(r"scripts/study ([a-z]\w+)", text) if name not in listed
        }
        gone |= {
            path
            for path in re.findall(r"\bscripts/[\w/]+\.(?:py|sh|sbatch)", text)
            if not ((ROOT / path).exists() or (ROOT / "tests" / path).exists())
        }
        assert not gone or re.search(r"no\s+longer\s+has|of that\s+version|in version", text), (
            page,
            gone,
        )


@pytest.mark.parametrize(
    "name", [name for name, _ in LISTED if name not in {"extremes", "fault_injection", *STUDIES}]
)
def test_start(tmp_path, name, monkeypatch, capsys):
    """Every study that no other test starts, starts by its name, on one rank, and says what its arguments are.

    The extremes want two ranks: tests/scenes/test_extremes.py uses their functions.
    """
    python = executable(tmp_path / "python", 'echo "$@"')
    said = run(ROOT / "scripts/study", name, "--help", cwd=tmp_path, DDMPI_PYTHON=str(python))
    monkeypatch.setattr(sys, "argv", said.split())
    with pytest.raises(SystemExit, match=r"^0$"):
        runpy.run_path(sys.argv[0], run_name="__main__")
    assert "usage:" in capsys.readouterr().out


@pytest.mark.parametrize("name", STUDIES)
def test_study(tmp_path, name):
    """A study ends without an error and writes its tables, pages and figures."""
    arguments, words, tables, figures = STUDIES[name]
    output = tmp_path / "out"
    said = start(tmp_path, name, *shlex.split(arguments), "--output", str(output))
    written = said + "".join(path.read_text(encoding="utf-8") for path in output.glob("*.md"))
    for word in words:
        assert word in written
    assert len(list(output.glob("*.csv"))) == tables
    assert len(list(output.glob("figures/*.png"))) == figures


def test_mutants_are_of_this_code():
    """Every mutant of the mutation study has its line in the code, once, and its test; equivalent ones have the line."""
    assert len(mutation.MUTANTS) >= 40
    assert mutation.wrong_texts([*mutation.MUTANTS, *mutants.EQUIVALENT]) == []
    for mutant in mutation.MUTANTS:
        path, _, name = mutant.tests.partition("::")
        written = (ROOT / "tests" / path).read_text(encoding="utf-8")
        assert f"def {name.partition('[')[0]}(" in written or not name, mutant.name


def test_wrong_lines_are_drawn_from_lines_that_compute(tmp_path):
    """A seed draws the same lines again, longer draws begin with shorter ones, and each changes one line that computes."""
    (tmp_path / "room").mkdir()
    (tmp_path / "room" / "module.py").write_text(
        '"""A - b."""\n\ndef f(a: list[int - 1], k) -> float:\n    """Not a + b."""\n'
        "    if a < k:\n        raise ValueError(f'{a - k} is less')\n    return max(a, 0) + a.T[k, 1] * -k\n",
        encoding="utf-8",
    )
    places = drawn.candidates(tmp_path)
    assert places == {("room/module", 5): 2, ("room/module", 7): 8}
    normal = mutation.normal_form((tmp_path / "room/module.py").read_text(encoding="utf-8"))
    becomes = set()
    for seed in range(60):
        first, second = drawn.draw(tmp_path, 2, seed)
        assert [first] == drawn.draw(tmp_path, 1, seed)
        assert {first.line, second.line} == {5, 7}
        for one in (first, second):
            rest = normal.splitlines(), one.source.splitlines()
            assert [pair for pair in zip(*rest, strict=True) if pair[0] != pair[1]] == [
                (normal.splitlines()[one.line - 1], one.source.splitlines()[one.line - 1])
            ]
            becomes.add(one.replacement)
    assert becomes == {
        "if a <= k:",
        "if not a < k:",
        "return max(a, 0) - a.T[k, 1] * -k",
        "return min(a, 0) + a.T[k, 1] * -k",
        "return max(a, 0) + a[k, 1] * -k",
        "return max(a, 0) + a.T[k, 2] * -k",
        "return max(a, 0) + a.T[k, 1] / -k",
        "return max(a, 0) + a.T[k, 1]",
        "return max(a, 0) + -k",
        "return max(a, 0) + a.T[k, 1] * k",
    }


def test_a_ledger_keeps_whole_rows_and_fills_in_the_others(tmp_path):
    """An interrupted study continues: whole rows stay, a torn last one and missing ones are measured."""
    path, asked = tmp_path / "made.csv", []

    def measure(law: str, N: int) -> dict:
        asked.append((law, N))
        return {"n_A": 10 * N, "certified": True, "more": "is left out"}

    def fill() -> list[dict]:
        ledger = Ledger(MPI.COMM_SELF, path, ("law", "N"), ("n_A", "certified"))
        return ledger.fill([("tresca", 2), ("tresca", 4), ("coulomb", 2)], measure)

    rows = fill()
    assert rows[1] == {"law": "tresca", "N": 4, "n_A": 40, "certified": True}
    assert fill() == rows
    path.write_text(path.read_text()[:-8])
    assert fill() == rows
    assert asked == [("tresca", 2), ("tresca", 4), ("coulomb", 2), ("coulomb", 2)]
    with pytest.raises(SystemExit, match="other columns"):
        Ledger(MPI.COMM_SELF, path, ("law", "N"), ("n_A",))
