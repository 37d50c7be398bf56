"""scripts/benchmark.py: what it measures, what its tables say, and that an interrupted study continues."""

import csv
import subprocess
import sys
from pathlib import Path

import benchmark
import pytest
from scenes import LIMIT, clean_environment

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]


def start(folder: Path, *arguments: str) -> str:
    """The script on a tiny mesh; its output."""
    environment = clean_environment() | {"DDMPI_PYTHON": sys.executable}
    done = subprocess.run([ROOT / "scripts/benchmark.py", "--output", folder, "--sizes", *arguments], text=True,
                          capture_output=True, timeout=LIMIT, env=environment, cwd=folder)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def rows(folder: Path) -> list[dict[str, float]]:
    with open(folder / "benchmark.csv", newline="", encoding="utf-8") as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]


def test_benchmark_measures_and_continues(tmp_path):
    """A row has all times and memories; a start keeps what is measured already, and measures what is missing."""
    slow = dict.fromkeys((*benchmark.KEY, *benchmark.MEASURED), 1e3) | {"N": 4, "repetition": 0}
    with open(tmp_path / "benchmark.csv", "w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([slow, slow.values()])
    page = start(tmp_path, "4", "--repeats", "2")
    kept, row = rows(tmp_path)
    assert kept == slow and row["repetition"] == 1
    assert (row["N"], row["n"], row["m"]) == (4, 12 * 4 * 5, 12)
    assert all(value > 0 for name, value in row.items() if name != "repetition")
    assert row["whole"] > sum(row[phase] for phase in ("mesh", "assemble", "factor", "outer", "recover", "output"))
    assert row["memory"] > 20
    ratio = (row["pair_factor"] + row["pair_outer"]) / (row["chosen_factor"] + row["chosen_solve"])
    assert f"| {ratio:.2f} |" in page
    assert (tmp_path / "benchmark_table.md").read_text(encoding="utf-8").strip() == page.strip()
    assert (tmp_path / "figures/benchmark_phases.png").stat().st_size > 10_000


def test_benchmark_takes_the_best_and_fits_growth():
    """The tables show the smallest time, the largest memory, and the exponent of growth."""
    made = [{name: 1.0 for name in benchmark.MEASURED} | {
        "N": N, "repetition": k, "n": N**2, "iterations": 9, "n_A": 99,
        "factor": N**3 * (1 + k), "memory": 100.0 * N**2 + k} for N in (86, 140, 200) for k in (0, 1)]
    found = benchmark.best(made)
    assert list(found) == [86, 140, 200]
    assert found[140]["factor"] == 140**3
    assert found[140]["memory"] == 100.0 * 140**2 + 1
    assert found[140]["repetitions"] == 2
    *_, numbers, _ = benchmark.growth_table(found)
    growth = dict(zip(benchmark.PHASES, numbers.strip("| ").split(" | "), strict=False))
    assert growth["factor"] == "1.50"
    assert growth["outer"] == "0.00"
