"""Small scenes with known answers, and the two ways in which tests run them.

`certified` and `solve_scene` solve a scene in the test's own process; `run_command` starts the real command,
`run_here` calls it. Every child has a time limit and an environment without traces of an MPI that the parent may have
initialised: with them a nested ``mpirun`` dies silently.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import os
import re
import signal
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
DATA = {
    "result.h5",
    "result.xdmf",
    "history.csv",
    "steps.csv",
    "contact_upper-lower.csv",
    "contact_upper-lower.vtu",
    "summary.json",
}
"""Files of a run of `pinched_blocks`, or of a `Stack`, without pictures."""

LIMIT = float(os.environ.get("DDMPI_TEST_LIMIT", "1200"))
"""Seconds until a test or a child counts as hanging. The slowest need 30, and 170 where six others want each core."""

STEEL = {"young": 2.1e11, "poisson": 0.3}
BRASS = {"young": 1.0e11, "poisson": 0.35}
CORK = {"young": 1.6e11, "poisson": 0.0}

COULOMB = {"law": "coulomb", "coefficient": 0.3}
FLOOR = {"name": "floor", "shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}


def seldom(*values, **options):
    """Parameters of a test that is asked with them in the whole suite alone."""
    return pytest.param(*values, marks=pytest.mark.slow, **options)


def by_name(cases: dict, *quick: str) -> list:
    """The parameters of a test by their names, of which those that are not `quick` are asked in the whole suite alone."""
    return [
        pytest.param(case, id=name, marks=[] if name in quick else pytest.mark.slow)
        for name, case in cases.items()
    ]


CLAMP_END = "at the end of a clamp"


def beside_clamps(warnings: list[str]) -> list[str]:
    """All warnings but those of largest stresses at the corners of clamped sides, which most scenes have."""
    return [warning for warning in warnings if CLAMP_END not in warning]


def mumps_is_known() -> bool:
    """Whether MUMPS is there, in a version that is called directly."""
    import scipy.sparse as sparse
    from petsc4py import PETSc

    from ddmpi.body.solver import StiffnessSolver

    A = PETSc.Mat().createAIJ((1, 1), csr=([0, 1], [0], [1.0]), comm=PETSc.COMM_SELF)
    solver = StiffnessSolver(A, "point", sparse.csr_matrix([[1.0]]))
    return solver.condensed is not None and not solver.refused


# Scenes


def pinched_blocks(
    N: int, law: str = "coulomb", length: float = 1.0, stress: float = 1.0, **method
) -> dict:
    """The model scene of the design with squares of side 1/N, in units of `length` m and `stress` Pa."""

    def block(name: str, y: float, traction: dict) -> dict:
        return {
            "name": name,
            "clamp": ["left"],
            "mesh": {
                "shape": "rectangle",
                "origin": [0.0, y * length],
                "size": [3 * length, length],
                "divisions": [3 * N, N],
            },
            "material": {"young": 2.119e11 * stress, "poisson": 0.277},
            "traction": [
                {"on": on, "value": [q * stress for q in value]} for on, value in traction.items()
            ],
        }

    friction = {
        "coulomb": {"coefficient": 0.3},
        "tresca": {"slip_bound": 1.2e7 * stress},
        "none": {},
    }[law]
    return {
        "title": f"pinched blocks, N = {N}",
        "body": [
            block("upper", 1.0, {"top": (0.0, -6.0e7), "right": (2.0e7, 3.0e7)}),
            block("lower", 0.0, {"bottom": (0.0, 4.0e7)}),
        ],
        "contact": [
            {
                "bodies": ["upper", "lower"],
                "on": ["bottom", "top"],
                "friction": {"law": law} | friction,
            }
        ],
        "method": method,
    }


def rectangle(
    name: str,
    origin: Sequence[float],
    size: Sequence[float],
    divisions: Sequence[int],
    order: int = 1,
    young: float = 1e9,
    poisson: float = 0.3,
    **more,
) -> dict:
    """A body that is a rectangle; `more` are its other keys."""
    mesh = {
        "shape": "rectangle",
        "origin": list(origin),
        "size": list(size),
        "divisions": list(divisions),
        "order": order,
    }
    return {"name": name, "mesh": mesh, "material": {"young": young, "poisson": poisson}} | more


def drawn_roller(order: int = 2, size: float = 20.0, **method) -> dict:
    """The scene configs/roller.toml on coarser meshes: Hertz's p0 = 3585.36 MPa, a = 6.2146 mm."""
    scene = tomllib.loads((ROOT / "configs" / "roller.toml").read_text(encoding="utf-8"))
    for body, scale in zip(scene["body"], (1.0, 2.0), strict=True):
        geometry = (ROOT / "configs" / body["mesh"]["geometry"]).resolve()
        body["mesh"] = {"geometry": str(geometry), "size": scale * size, "order": order}
    return scene | {"method": method}


def tower(blocks: int, n: int, loose: bool = True, **method) -> dict:
    """Blocks 3 × 1 m on each other on 3n × n elements, sheared at the top, a vertical load beside the middle.

    Clamps hold the lowest block at its bottom and, unless they are `loose`, all others at their left sides.
    """

    def block(k: int) -> dict:
        return {
            "name": f"block{k}",
            "clamp": ["bottom"] if k == 1 else [] if loose else ["left"],
            "mesh": {
                "shape": "quadrilateral",
                "divisions": [3 * n, n],
                "corners": [[0.0, k - 1.0], [3.0, k - 1.0], [3.0, float(k)], [0.0, float(k)]],
            },
            "material": {"young": 2.119e11, "poisson": 0.277},
            "traction": [{"on": "top", "value": [3.0e6, -6.0e7]}] if k == blocks else [],
        }

    return {
        "title": f"tower of {blocks} blocks",
        "body": [block(k + 1) for k in range(blocks)],
        "contact": [
            {
                "bodies": [f"block{k + 1}", f"block{k}"],
                "on": ["bottom", "top"],
                "friction": {"law": "coulomb", "coefficient": 0.3},
            }
            for k in range(1, blocks)
        ],
        "method": method,
    }


def fretting_pad(n: int) -> dict:
    """A pad 20 × 10 mm on 2n × n elements that is pressed and pushed on a stretched part 100 × 20 mm, with friction:
    it slips at one end."""
    aluminium = {"young": 7e10, "poisson": 0.33}
    pad = rectangle("pad", (-0.01, 0.0), (0.02, 0.01), (2 * n, n), **aluminium)
    part = rectangle("part", (-0.05, -0.02), (0.1, 0.02), (10 * n, 2 * n), **aluminium)
    return {
        "body": [
            pad | {"traction": [{"on": "top", "value": [2e7, -1e8]}]},
            part
            | {
                "clamp": ["left", {"on": "bottom", "y": 0.0}],
                "traction": [{"on": "right", "value": [5e7, 0.0]}],
            },
        ],
        "contact": [
            {
                "bodies": ["pad", "part"],
                "on": ["bottom", "top"],
                "friction": {"law": "coulomb", "coefficient": 0.6},
            }
        ],
    }


TURNED = {
    2: {"right": "bottom", "top": "right", "left": "top", "bottom": "left"},
    3: {"front": "left", "back": "right", "right": "front", "left": "back"},
}
"""Names of groups in a mesh that begins at the second corner of its bottom, by the dimension."""


def other_diagonals(scene: dict) -> dict:
    """The scene with rectangles, quadrilaterals and boxes whose cells are cut the other way in the plane of x and y:
    their corners begin one corner further on."""
    names = {}
    bodies = []
    for body in scene["body"]:
        mesh = dict(body["mesh"])
        divisions = mesh["divisions"]
        names[body["name"]] = turned = TURNED[len(divisions)]
        if corners := mesh.pop("corners", None):
            around = [corners[k] for k in (1, 2, 3, 0)] + [
                corners[k] for k in (5, 6, 7, 4)[: len(corners) - 4]
            ]
        else:
            low = np.array(mesh.pop("origin"))
            high = low + mesh.pop("size")
            around = [
                [*np.where(way, high[:2], low[:2]).tolist(), *map(float, above)]
                for above in ([low[2:], high[2:]] if len(low) > 2 else [[]])
                for way in ((1, 0), (1, 1), (0, 1), (0, 0))
            ]
        mesh |= {
            "shape": "quadrilateral" if len(divisions) == 2 else "hexahedron",
            "corners": around,
            "divisions": [divisions[1], divisions[0], *divisions[2:]],
        }
        loads = {
            key: [
                turned.get(each, each)
                if isinstance(each, str)
                else each | {"on": turned.get(each["on"], each["on"])}
                for each in body.get(key, [])
            ]
            for key in ("clamp", "traction")
        }
        bodies.append(body | {"mesh": mesh} | loads)
    contacts = [
        contact
        | {
            "on": [
                names[body].get(on, on)
                for body, on in zip(contact["bodies"], contact["on"], strict=True)
            ]
        }
        for contact in scene.get("contact", [])
    ]
    return scene | {"body": bodies, "contact": contacts}


@dataclass(frozen=True)
class Block:
    """One block of a stack: material and height (m)."""

    young: float
    poisson: float
    height: float

    def confined(self, plane: str) -> float:
        """σ_yy / ε_yy where ε_xx = 0 (Pa).

        Plane strain: E(1−ν)/((1+ν)(1−2ν)). Plane stress: with σ_zz = 0 Hooke's law reads
        E ε_xx = σ_xx − ν σ_yy and E ε_yy = σ_yy − ν σ_xx, and ε_xx = 0 gives σ_xx = ν σ_yy, so that
        σ_yy = E ε_yy / (1−ν²).
        """
        E, nu = self.young, self.poisson
        return E / (1 - nu**2) if plane == "stress" else E * (1 - nu) / ((1 + nu) * (1 - 2 * nu))

    def side_ratio(self, plane: str) -> float:
        """σ_xx / σ_yy where ε_xx = 0."""
        return self.poisson if plane == "stress" else self.poisson / (1 - self.poisson)

    @property
    def shear(self) -> float:
        """Shear modulus (Pa), the same in both planes."""
        return self.young / (2 * (1 + self.poisson))


@dataclass(frozen=True)
class Stack:
    """Two blocks between a fixed floor and a ceiling that comes down by `approach` and moves by `shift`.

    Nothing strains along x, so both bodies' displacements are linear in y and elements of any order are exact.
    The sides see to that in one of three ways: rollers (u_x = 0; no shift), the exact tractions, or
    the exact displacements. On n elements per side; `approach`, `shift`, `gap` in metres.
    """

    n: int
    friction: dict
    approach: float = 1e-3
    shift: float = 0.0
    gap: float = 0.0
    sides: str = "tractions"
    plane: str = "strain"
    first: str = "upper"
    upper: Block = Block(**STEEL, height=0.8)
    lower: Block = Block(**BRASS, height=0.5)
    width: float = 1.2
    order: int = 1
    corner: tuple[float, float] = (-0.3, 0.2)

    @property
    def blocks(self) -> dict[str, Block]:
        return {"upper": self.upper, "lower": self.lower}

    @property
    def pressure(self) -> float:
        """p = max(0, (δ − g₀) / (H₁/M₁ + H₂/M₂)), Pa."""
        compliance = sum(b.height / b.confined(self.plane) for b in self.blocks.values())
        return max(0.0, (self.approach - self.gap) / compliance)

    @property
    def _shear_compliance(self) -> float:
        return sum(b.height / b.shear for b in self.blocks.values())

    @property
    def slip_bound(self) -> float:
        """Largest tangential stress (Pa); Tresca's holds whether the gap is open or not."""
        law = self.friction["law"]
        return {
            "coulomb": self.friction.get("coefficient", 0.0) * self.pressure,
            "tresca": self.friction.get("slip_bound", 0.0),
            "none": 0.0,
        }[law]

    @property
    def shear(self) -> float:
        """τ = min(U / (H₁/G₁ + H₂/G₂), bound), with the sign of U, Pa."""
        return float(
            np.clip(self.shift / self._shear_compliance, -self.slip_bound, self.slip_bound)
        )

    @property
    def slip(self) -> float:
        """U − τ (H₁/G₁ + H₂/G₂), m."""
        return self.shift - self.shear * self._shear_compliance

    @property
    def opening(self) -> float:
        """What is left of the gap (m)."""
        return max(0.0, self.gap - self.approach)

    @property
    def status(self) -> str:
        if self.pressure == 0.0:
            return "open"
        sticks = self.friction["law"] != "none" and abs(self.shear) < self.slip_bound
        return "stick" if sticks else "slip"

    @property
    def contact_nodes(self) -> int:
        """Displacements given on the sides take the two corners out of the contact."""
        return self.order * self.n + (-1 if self.sides == "displacements" else 1)

    def field(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Constant and slope of the exact displacement: u(y) = constant + slope·y, for y in the scene's frame."""
        block, floor = self.blocks[name], self.corner[1]
        slope = np.array([self.shear / block.shear, -self.pressure / block.confined(self.plane)])
        if name == "lower":
            return -slope * floor, slope
        ceiling = floor + self.lower.height + self.gap + self.upper.height
        return np.array([self.shift, -self.approach]) - slope * ceiling, slope

    def displacement(self, name: str, points: np.ndarray) -> np.ndarray:
        """Exact displacement (nv, 2) in metres at `points` (nv, 2)."""
        constant, slope = self.field(name)
        return constant + np.multiply.outer(points[:, 1], slope)

    def scene(self, **method) -> dict:
        return {
            "body": [self._body("upper"), self._body("lower")],
            "contact": [
                {
                    "bodies": [self.first, "lower" if self.first == "upper" else "upper"],
                    "on": ["bottom", "top"] if self.first == "upper" else ["top", "bottom"],
                    "friction": self.friction,
                }
            ],
            "method": method,
        }

    def _body(self, name: str) -> dict:
        block, (x, y) = self.blocks[name], self.corner
        if name == "lower":
            clamp = [{"on": "bottom", "x": 0.0, "y": 0.0}]
        else:
            y += self.lower.height + self.gap
            clamp = [{"on": "top", "x": self.shift, "y": -self.approach}]
        across = -block.side_ratio(self.plane) * self.pressure
        constant, slope = self.field(name)
        affine = {c: {"constant": constant[i], "y_slope": slope[i]} for i, c in enumerate("xy")}
        sides = {
            "rollers": {"clamp": [{"on": on, "x": 0.0} for on in ("left", "right")]},
            "displacements": {"clamp": [{"on": on, **affine} for on in ("left", "right")]},
            "tractions": {
                "traction": [
                    {"on": on, "value": [sign * across, sign * self.shear]}
                    for on, sign in (("right", 1.0), ("left", -1.0))
                ]
            },
        }[self.sides]
        return {
            "name": name,
            "clamp": clamp + sides.get("clamp", []),
            "traction": sides.get("traction", []),
            "mesh": {
                "shape": "rectangle",
                "origin": [x, y],
                "size": [self.width, block.height],
                "divisions": [self.n, self.n],
                "order": self.order,
            },
            "material": {"young": block.young, "poisson": block.poisson, "plane": self.plane},
        }


def confined_blocks(n: int, gap: float, friction: dict | None = None, **changes) -> Stack:
    """Blocks pressed together between rigid side walls, `gap` apart at first."""
    return Stack(n, friction or {"law": "none"}, gap=gap, **{"sides": "rollers"} | changes)


def sheared_stack(n: int, shift: float, friction: dict, **changes) -> Stack:
    """Blocks pressed together and then sheared."""
    return Stack(n, friction, shift=shift, **changes)


def to_toml(scene: dict) -> str:
    """The scene as TOML, a line per top-level key."""
    return "".join(f"{key} = {_toml(value)}\n" for key, value in scene.items())


def _toml(value: object) -> str:
    if isinstance(value, dict):
        keys = {key: json.dumps(key) if "." in key else key for key in value}
        return "{ " + ", ".join(f"{keys[key]} = {_toml(value[key])}" for key in value) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_toml(entry) for entry in value) + "]"
    return repr(float(value)) if isinstance(value, float) else json.dumps(value, ensure_ascii=False)


# In process


def prepare_scene(comm, scene: dict):
    """The `ddmpi.coupling.assembly.Assembly` of a scene. Collective on `comm`, at most as many ranks as bodies."""
    from ddmpi.coupling.assembly import prepare
    from ddmpi.scene.reader import read_scene

    return prepare(comm, read_scene("scene of a test", to_toml(scene)))


def certified(scene: dict, comm=None, left: float = 1e-3, **overrides):
    """The certified answer to a scene, on one rank without `comm`; in names of `overrides` __ stands for a dot.

    On one rank its numbers agree with each other; forces and moments on bodies balance but for `left` of the largest.
    """
    from consistent import assert_consistent
    from mpi4py import MPI

    import ddmpi

    settings = {key.replace("__", "."): value for key, value in overrides.items()}
    answer = ddmpi.solve(scene, comm or MPI.COMM_SELF, settings)
    assert answer.certified, answer.reason
    if answer.summary["ranks"] == 1:
        assert_consistent(answer, left)
    return answer


def assert_refused(scene: dict, *words: str) -> None:
    """One message with these words says before any work why there is no answer."""
    import pytest
    from mpi4py import MPI

    import ddmpi
    from ddmpi.errors import InputError

    with pytest.raises(InputError) as refused:
        ddmpi.solve(scene, MPI.COMM_SELF)
    assert all(word in str(refused.value) for word in words), refused.value


def the_interface(assembly):
    """The interface of a scene with one contact, also on the rank that does not own it. Collective."""
    (interface,) = sum(assembly.world.allgather(assembly.space.interfaces), ())
    return interface


def everywhere(assembly, x: np.ndarray) -> np.ndarray:
    """A vector of the interfaces on all ranks, from the parts that the ranks own. Collective."""
    return np.concatenate(assembly.world.allgather(x))


def exact_forces(assembly) -> np.ndarray:
    """The contact forces (N) of the coupled problem by brute force, on all ranks. Collective."""
    from brute_force import solve_coupled

    return everywhere(assembly, solve_coupled(assembly))


def joint_compliance(assembly) -> np.ndarray:
    """The sum of the compliances of two bodies, dense. Collective."""
    return sum(assembly.world.allgather(sum(body.member.C.dense() for body in assembly.bodies)))


def solve_scene(comm, scene: dict) -> dict:
    """Solve a scene of one contact as the command does, and gather what tests look at. Collective on `comm`."""
    from ddmpi.body.estimate import estimate_error
    from ddmpi.run.solve import solve
    from ddmpi.system.agreement import merged

    assembly = prepare_scene(comm, scene)
    solution = solve(assembly, assembly.scene.method)
    (state,) = merged(comm, solution.states).values()
    interface, own = state.interface, []
    for body in assembly.bodies:
        u = solution.displacements[body.spec.name]
        own.append(
            {
                "name": body.spec.name,
                "points": body.mesh.points,
                "u": u,
                "energy": estimate_error(
                    body.mesh, body.material, u, body.member.elasticity.acting.heated
                ).energy
                / 2,
                "n_A": body.member.C.count.total(),
            }
        )
    bodies = [each for rank in comm.allgather(own) for each in rank]
    energies = {b["name"]: b["energy"] for b in bodies}
    return {
        "certified": solution.certified,
        "reason": solution.reason,
        "outer_iterations": len(solution.outer.history),
        "n_A": sum(b["n_A"] for b in bodies),
        "n_A_by_body": {b["name"]: b["n_A"] for b in bodies},
        "n": assembly.n,
        "m": interface.m,
        "sliding": interface.sliding,
        "length": interface.area,
        "normal_force": state.normal_force,
        "tangential_force": state.tangential_force[:, 0],
        "gap": state.gap,
        "slip": state.slip[:, 0],
        "status": state.status.tolist(),
        "certificate": {kind: value for kind, (value, _) in solution.certificate.worst().items()},
        "limit": solution.limit,
        "energy": [energies[name] for name in interface.bodies],
        "body": {b["name"]: (b["points"], b["u"]) for b in bodies},
    }


# As a child process


@dataclass(frozen=True)
class Run:
    """What a child left behind; `folder` holds the results, if there are any."""

    code: int
    stdout: str
    stderr: str
    folder: Path | None = None

    @property
    def output(self) -> str:
        return self.stdout + self.stderr

    @property
    def messages(self) -> list[str]:
        """The messages to the user about errors: where each begins."""
        kinds = tuple(f"ddmpi: {kind}" for kind in ("error", "internal error", "interrupted"))
        return [line for line in self.output.splitlines() if line.startswith(kinds)]

    @property
    def own_stderr(self) -> str:
        """What ddmpi or Python wrote to stderr; MPI and hwloc may have words of their own."""
        return own_lines(self.stderr)

    @property
    def summary(self) -> dict:
        return json.loads((self.folder / "summary.json").read_text(encoding="utf-8"))

    @property
    def files(self) -> set[str]:
        """Names of everything in the folder of results; empty without a folder."""
        return {path.name for path in self.folder.iterdir()} if self.folder.is_dir() else set()

    def table(self, name: str) -> dict[str, np.ndarray]:
        """The columns of a CSV file of results, in their order."""
        with open(self.folder / name, newline="", encoding="utf-8") as file:
            header, *rows = csv.reader(file)
        columns = zip(*rows, strict=True)
        return {
            key: np.array(column)
            if key in ("status", "contact", "body")
            else np.array(column, float)
            for key, column in zip(header, columns, strict=True)
        }


def own_lines(stderr: str) -> str:
    """The messages in `stderr` that are ddmpi's, Python's or PETSc's, with their indented lines."""
    ours = r"^(?:ddmpi|Traceback|[\w.]+(?:Error|Exception)\b|\S+: \w*Warning: |\[\d+\]PETSC)"
    return "".join(re.findall(rf"{ours}.*\n?(?:  .*\n?)*", stderr, re.MULTILINE))


def clean_environment() -> dict[str, str]:
    """The environment without an outer MPI's traces, with what mpirun wants on a small machine or as root.

    After MPI_Abort, Open MPI 4 gives the other ranks a second to end. Told to kill them at once
    (odls_base_sigkill_timeout 0), it deadlocked in PMIx_server_finalize in one or two of a hundred starts.
    """
    environment = {
        key: value
        for key, value in os.environ.items()
        if not key.startswith(("OMPI_", "PMIX_", "PRTE_", "PMI_", "ORTE_", "OPAL_", "PYTEST_"))
    }
    environment |= {
        "OMPI_MCA_rmaps_base_oversubscribe": "1",
        "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
        "OMPI_MCA_reachable": "weighted",
        "OMPI_MCA_pml": "ob1",
        "OMPI_MCA_mpi_yield_when_idle": "1",
        "OMP_NUM_THREADS": "1",
        "MPLBACKEND": "agg",
        "PYTHONUNBUFFERED": "1",
    }
    environment["PYTHONPATH"] = os.pathsep.join(
        [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    )
    if os.getuid() == 0:
        for name in ("OMPI_ALLOW_RUN_AS_ROOT", "PRTE_ALLOW_RUN_AS_ROOT"):
            environment |= {name: "1", f"{name}_CONFIRM": "1"}
    return environment


def run_python(
    arguments: list[str],
    ranks: int = 2,
    folder: Path | None = None,
    cwd: Path | None = None,
    quiet: bool = True,
    limit: float = LIMIT,
) -> Run:
    """``mpirun -n RANKS python ARGUMENTS``; an AssertionError when it has not ended after `limit` seconds.

    Unless `quiet`, mpirun says what it has to say of a rank that was killed, also where it is told to be quiet.
    Open MPI 5 ends what it says about a run that failed with a zero byte, which is taken out.
    """
    launcher = [
        word for word in os.environ.get("MPIRUN", "mpirun").split() if quiet or word != "--quiet"
    ]
    command = [*launcher, "-n", str(ranks), sys.executable, *arguments]
    with subprocess.Popen(
        command,
        env=clean_environment(),
        cwd=cwd,
        text=True,
        encoding="utf-8",
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as child:
        try:
            stdout, stderr = child.communicate(timeout=limit)
        except subprocess.TimeoutExpired:
            child.terminate()  # mpirun ends its ranks
            try:
                stdout, stderr = child.communicate(timeout=5.0)
            except subprocess.TimeoutExpired:
                child.kill()
                stdout, stderr = child.communicate()
            raise AssertionError(
                f"still running after {limit:g} s: {' '.join(command)}\n{stdout}{stderr}"
            ) from None
    return Run(child.returncode, stdout, stderr.replace("\0", ""), folder)


def is_alive(process: str) -> bool:
    """Whether the process of this number runs; those that nobody has waited for do not, as below a first process."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def run_command(
    scene: Path | str,
    folder: Path,
    *arguments: str,
    ranks: int = 2,
    cwd: Path | None = None,
    limit: float = LIMIT,
) -> Run:
    """``mpirun -n RANKS python -m ddmpi run SCENE --output FOLDER ARGUMENTS``."""
    return run_python(
        ["-m", "ddmpi", "run", str(scene), "--output", str(folder), *arguments],
        ranks,
        folder,
        cwd,
        limit=limit,
    )


def run_here(scene: Path | str, folder: Path, *arguments: str) -> Run:
    """`run_command` on one rank in this process."""
    return call("run", str(scene), "--output", str(folder), *arguments, folder=folder)


def call(*arguments: str, folder: Path | None = None, comm=None) -> Run:
    """``ddmpi ARGUMENTS`` in this process, on one rank or on those of `comm`, without PETSc's options. Other errors than
    its own come through.

    `folder` is where the results will be.
    """
    from mpi4py import MPI

    from ddmpi.cli import main as cli
    from ddmpi.system import interrupt, logs

    own, petsc = cli.split_arguments(list(arguments))
    assert not petsc, "PETSc reads its options once in a process"
    before, noted = (
        {number: signal.getsignal(number) for number in interrupt.SIGNALS},
        dict(interrupt._handlers),
    )
    stdout, stderr = io.StringIO(), io.StringIO()
    comm = comm or MPI.COMM_SELF
    with (
        logs.told_by_first(comm.rank, False),
        contextlib.redirect_stdout(stdout),
        contextlib.redirect_stderr(stderr),
        mock.patch("gc.freeze"),
    ):  # what tests have left is no part of the start of a process
        try:
            code = cli._main(comm, own, petsc)
        finally:
            logs.close()
            interrupt._handlers.clear()
            interrupt._handlers.update(noted)
            for number, handler in before.items():
                signal.signal(number, handler)
    return Run(code, stdout.getvalue(), stderr.getvalue(), folder)


def write_scene(scene: dict, path: Path) -> Path:
    path.write_text(to_toml(scene), encoding="utf-8")
    return path
