"""ddmpi itself, the whole command as a user types it; one or two processes."""

from __future__ import annotations

import csv
import shutil
import sys
from pathlib import Path

import numpy as np
from case import Answer, Case, answer_of


def command(folder: Path, count: int) -> list[str]:
    return ["mpirun", "-n", str(count), sys.executable, "-m", "ddmpi", "run", "scene.toml", "--no-figures",
            "--output", "results"]


def clear(case: Case, folder: Path) -> None:
    shutil.rmtree(folder / "results", ignore_errors=True)


def read_output(case: Case, folder: Path) -> Answer:
    import h5py
    import msgspec

    summary = msgspec.json.decode((folder / "results" / "summary.json").read_bytes())
    s = np.zeros((2, len(case.pairs)))  # ddmpi leaves nodes out that face away from the plane
    for number, name in enumerate(summary["contacts"]):
        pairs = np.flatnonzero(case.contact == number)
        with open(folder / "results" / f"contact_{name}.csv", newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                nearest = np.abs(case.points[case.pairs[pairs, 0], 0] - float(row["x"])).argmin()
                s[:, pairs[nearest]] = float(row["normal_force"]), float(row["tangential_force"])
    with h5py.File(folder / "results" / "result.h5") as file:
        distance = np.linalg.norm(file["points"][:, :2] - case.points[case.watched], axis=1)
        u = np.zeros_like(case.points)
        u[case.watched] = file["displacement"][int(distance.argmin()), :2]
    return answer_of(case, u.ravel(), s, summary["outer_iterations"])
