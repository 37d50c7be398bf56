"""FreeFEM (freefem++, libfreefem++ for MUMPS): it has no contact, so that its script does the active set, too."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from case import Answer, Case, answer_of

SCRIPT = Path(__file__).with_name("freefem_contact.edp")


def write_input(case: Case, folder: Path) -> None:
    (folder / "answer.txt").unlink(missing_ok=True)
    nv, nt = len(case.points), len(case.triangles)
    with open(folder / "bodies.msh", "w", encoding="utf-8") as file:
        file.write(f"{nv} {nt} 0\n")
        np.savetxt(file, np.column_stack([case.apart, np.zeros(nv)]), "%.17g %.17g %d")
        np.savetxt(file, np.column_stack([case.triangles + 1, case.body]), "%d")
    (rows, columns, normal), (_, _, tangential) = map(case.relative, (case.normal, case.tangent))
    scale = case.young / 2 / (1 - case.poisson**2)
    with open(folder / "contact.txt", "w", encoding="utf-8") as file:
        file.write(" ".join(map(repr, (*case.lame, float(case.friction), scale))))
        file.write(f" {len(case.clamped)} {len(case.pairs)} {len(rows)}\n")
        for each in (case.clamped, case.load, case.gap):
            np.savetxt(file, each, "%.17g")
        np.savetxt(file, np.column_stack([rows, columns, normal, tangential]), "%d %d %.17g %.17g")


def command(folder: Path, count: int) -> list[str]:
    return ["FreeFem++", "-nw", "-v", "0", str(SCRIPT)]


def read_output(case: Case, folder: Path) -> Answer:
    steps, *x = np.loadtxt(folder / "answer.txt")
    u, s = np.split(np.array(x), [2 * len(case.points)])
    return answer_of(case, u, s.reshape(2, -1), int(steps))
