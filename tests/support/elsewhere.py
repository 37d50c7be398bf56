"""The same scene elsewhere: turned, mirrored, in other units, with its tables in another order, on other ranks; and
whether its answer is the same."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

MIRRORED = {
    2: ([0, 3, 2, 1], {"bottom": "left", "left": "bottom", "top": "right", "right": "top"}),
    3: (
        [0, 3, 2, 1, 4, 7, 6, 5],
        {"left": "front", "front": "left", "right": "back", "back": "right"},
    ),
}
"""Of a mirrored mesh: its corners, from the same one in the order of a mesh, and the groups that change places."""


def corners(mesh: dict) -> np.ndarray:
    """The corners (2^d, d) of a body on a structured mesh, in the order of the key `corners`."""
    if "corners" in mesh:
        return np.array(mesh["corners"], float)
    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    if len(mesh["size"]) == 3:
        unit = np.array([[*xy, z] for z in (0, 1) for xy in unit])
    return np.array(mesh.get("origin", [0.0] * unit.shape[1]), float) + unit * mesh["size"]


@dataclass(frozen=True)
class Elsewhere:
    """Where a scene is put: turned or mirrored by the orthogonal Q, shifted, in units of `length` m and `stress` Pa.

    `order` −1 reverses the tables of bodies and contacts, `role` −1 exchanges the two bodies of each contact.
    """

    Q: np.ndarray | None = None
    shift: float = 0.0
    length: float = 1.0
    stress: float = 1.0
    order: int = 1
    role: int = 1

    def turned(self, vectors: Any) -> np.ndarray:
        return np.array(vectors, float) if self.Q is None else np.array(vectors, float) @ self.Q.T

    def place(self, points: Any) -> np.ndarray:
        """Points of the scene there, in its unit of length; the shift is along the last axis."""
        moved = self.turned(points)
        moved[..., -1] += self.shift
        return moved / self.length

    def scene(self, scene: dict) -> dict:
        """The scene there. Clamps hold all components at rest unless Q is left out; a mirrored mesh is the mirror
        image: structured meshes are cut in the same way along all of their axes."""
        scene = json.loads(json.dumps(scene))  # in which no two tables are one
        for body in scene["body"]:
            self._put(body)
        d = len(corners(scene["body"][0]["mesh"])[0])
        for rigid in scene.get("rigid", []):
            rigid |= {
                key: self.place(rigid[key]).tolist()
                for key in ("point", "center", "pivot")
                if key in rigid
            }
            force = self.stress * self.length ** (d - 1)
            rigid |= (
                {"force": (self.turned(rigid["force"]) / force).tolist()}
                if "force" in rigid
                else {}
            )
            rigid |= {"normal": self.turned(rigid["normal"]).tolist()} if "normal" in rigid else {}
            rigid |= {key: rigid[key] / self.length for key in ("radius",) if key in rigid}
            if "displacement" in rigid:
                rigid["displacement"] = (self.turned(rigid["displacement"]) / self.length).tolist()
        swap = self._swap(d)[1]
        for contact in scene["contact"]:
            contact.setdefault("name", "-".join(contact["bodies"]))
            contact["on"] = [swap.get(on, on) for on in contact["on"]]
            if len(contact["on"]) == 2:
                contact["bodies"], contact["on"] = (
                    contact["bodies"][:: self.role],
                    contact["on"][:: self.role],
                )
            if "slip_bound" in contact.get("friction", {}):
                contact["friction"]["slip_bound"] /= self.stress
            if "gap" in contact:
                contact["gap"] /= self.length
        return scene | {key: scene[key][:: self.order] for key in ("body", "contact")}

    def _swap(self, dimension: int) -> tuple[list[int], dict[str, str]]:
        mirrored = self.Q is not None and np.linalg.det(self.Q) < 0
        return MIRRORED[dimension] if mirrored else (list(range(2**dimension)), {})

    def _put(self, body: dict) -> None:
        mesh = body["mesh"]
        at = corners(mesh)
        order, swap = self._swap(at.shape[1])
        divisions = (
            mesh["divisions"][:2][::-1] + mesh["divisions"][2:] if swap else mesh["divisions"]
        )
        body["mesh"] = {
            "shape": "quadrilateral" if at.shape[1] == 2 else "hexahedron",
            "divisions": divisions,
            "corners": self.place(at[order]).tolist(),
            "order": mesh.get("order", 1),
        }
        body["material"]["young"] /= self.stress
        clamps = [{"on": each} if isinstance(each, str) else each for each in body.get("clamp", [])]
        for each in [*clamps, *body.get("traction", [])]:
            each["on"] = swap.get(each["on"], each["on"])
            if "value" in each:
                each["value"] = (self.turned(each["value"]) / self.stress).tolist()
            if "pressure" in each:
                each["pressure"] /= self.stress
        for each in clamps:
            moved = {key: each[key] / self.length for key in "xyz" if key in each}
            assert self.Q is None or not any(moved.values())
            each |= moved
        body["clamp"] = [each if len(each) > 1 else each["on"] for each in clamps]
        if "volume_force" in body:
            body["volume_force"] = (
                self.turned(body["volume_force"]) * self.length / self.stress
            ).tolist()


HERE = Elsewhere()


@dataclass(frozen=True)
class Found:
    """What all ranks know of an answer."""

    certified: bool
    reason: str
    summary: dict
    points: dict[str, np.ndarray]
    moved: dict[str, np.ndarray]


def found(scene: dict, comm=None) -> Found:
    """The answer to a scene, on one rank without `comm`. Collective."""
    from mpi4py import MPI

    import ddmpi

    comm = comm or MPI.COMM_SELF
    answer = ddmpi.solve(scene, comm)
    bodies = {
        name: body for part in comm.allgather(dict(answer.bodies)) for name, body in part.items()
    }
    return Found(
        answer.certified,
        answer.reason,
        answer.summary,
        {name: body.points for name, body in bodies.items()},
        {name: body.displacement for name, body in bodies.items()},
    )


def assert_same(
    one: Found, other: Found, where: Elsewhere = HERE, within: float = 1e-9, forces: bool = True
) -> None:
    """The second answer is the first one elsewhere: displacements, and the resultants and statuses of contacts.

    Without `forces` displacements alone are compared: forces of nodes that several contacts share are not unique. What
    can move without any force is not compared at all.
    """
    assert one.certified == other.certified, (one.reason, other.reason)
    if not one.certified:
        assert "no equilibrium" in one.reason and "no equilibrium" in other.reason, (
            one.reason,
            other.reason,
        )
        return
    undetermined = one.summary["undetermined"]
    assert len(undetermined) == len(other.summary["undetermined"])
    largest = one.summary["displacement_max"]
    for name, points in one.points.items():
        far, node = cKDTree(other.points[name]).query(where.place(points))
        assert far.max() * where.length < 1e-9 * np.abs(points).max()
        error = other.moved[name][node] * where.length - where.turned(one.moved[name])
        assert undetermined or np.abs(error).max() <= within * largest, name
    in_newtons = one.summary["units"]["force"] == "N"
    unit = where.stress * where.length ** (2 if in_newtons else 1)
    bodies = {
        contact["name"]: set(contact["bodies"]) for contact in other.summary["scene"]["contact"]
    }
    for name, contact in one.summary["contacts"].items() if forces else ():
        same = other.summary["contacts"][name]
        assert [same[key] for key in ("open", "slip", "stick")] == [
            contact[key] for key in ("open", "slip", "stick")
        ]
        force = (
            (where.role if bodies[name] <= one.points.keys() else 1)
            * np.array(same["force"])
            * unit
        )
        assert (
            np.abs(force - where.turned(contact["force"])).max()
            <= within * np.abs(contact["force"]).max()
        )
