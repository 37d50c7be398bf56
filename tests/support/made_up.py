"""Results of runs that never were: blocks and contacts with plausible fields, written by the writers of results/."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

import h5py
import numpy as np
from boundaries import holding

from ddmpi.body.estimate import nodal_stress
from ddmpi.body.stress import stress, von_mises
from ddmpi.interface.interface import Interface
from ddmpi.interface.matching import pair
from ddmpi.interface.state import ContactState, ContactTotals
from ddmpi.judge.certificate import Certificate, ContactResiduals
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.refine import raise_order
from ddmpi.mesh.shapes import generate_rectangle
from ddmpi.results.fields import Fields, contact_fields, table_fields, write_fields
from ddmpi.results.summary import rigid_partners, summarize, write_summary
from ddmpi.results.tables import (
    HISTORY,
    leg_values,
    write_contact,
    write_legs,
    write_sides,
    write_steps,
    write_table,
)
from ddmpi.results.xdmf import write_xdmf
from ddmpi.scene.bodies import Material, MeshSpec
from ddmpi.scene.contacts import Coulomb, NoFriction, SettledContact
from ddmpi.surface.boundary import contact_side

STEEL = Material(young=2.119e11, poisson=0.277)

COULOMB = Coulomb(coefficient=0.3)

STACK = {"upper": (0.0, 1.0), "lower": (0.0, 0.0)}
"""Two blocks of 3 m × 1 m, one upon the other, by their lower left corners."""

ROW = {"left": (0.0, 0.0), "middle": (3.0, 0.0), "right": (6.0, 0.0)}
"""Three such blocks side by side."""

CONTACTS = {
    "stack": {"upper-lower": ("bottom", "top")},
    "row": {"left-middle": ("right", "left"), "middle-right": ("right", "left")},
}


def block(origin=(0.0, 0.0), divisions=(24, 8), order: int = 1) -> Mesh:
    mesh = generate_rectangle(
        MeshSpec(shape="rectangle", origin=origin, size=(3.0, 1.0), divisions=divisions)
    )
    return raise_order(mesh, "mesh") if order == 2 else mesh


def ring(radii=(1.0, 2.0), around: int = 24, order: int = 1) -> Mesh:
    """A whole ring around the origin with groups inside and outside, two elements across."""
    angle = 2 * np.pi * np.arange(around) / around
    points = np.concatenate(
        [r * np.column_stack([np.cos(angle), np.sin(angle)]) for r in np.linspace(*radii, 3)]
    )
    a = np.arange(2 * around)
    b = a + 1 - around * (a % around == around - 1)
    triangles = np.concatenate(
        [np.column_stack([a, a + around, b + around]), np.column_stack([a, b + around, b])]
    )
    loop = np.column_stack([a, b])[:around]
    mesh = Mesh(points, triangles, {"inside": loop, "outside": loop + 2 * around})
    return raise_order(mesh, "mesh") if order == 2 else mesh


def interface(
    name: str, first: Mesh, second: Mesh, on: tuple[str, str], friction=COULOMB
) -> Interface:
    """Of two meshes without clamps."""
    sides = [
        contact_side(
            mesh,
            mesh.facets(group),
            holding(np.full((len(mesh.points), 2), -1)),
            body,
            STEEL.plane_modulus,
        )
        for mesh, group, body in zip((first, second), on, name.split("-"), strict=True)
    ]
    return pair(
        *sides, SettledContact(name=name, bodies=tuple(name.split("-")), on=on, friction=friction)
    )


def state(interface: Interface, pressure: float = 5e7) -> ContactState:
    """A pressure that ends before the contact does; the first third slips backwards, the last one forwards."""
    t = np.linspace(0.0, 1.0, interface.m)
    p = pressure * np.sqrt(np.maximum(0.0, 1.0 - (1.2 * t) ** 4))
    frictional = interface.law.name != "none"
    shear = 0.3 * p * np.clip(6.0 * (t - 0.5), -1.0, 1.0) * frictional
    slip = 1e-4 * np.sign(t - 0.5) * np.maximum(np.abs(t - 0.5) - 1 / 6, 0.0) * frictional
    status = np.where(p == 0.0, "open", np.where((slip != 0.0) | (not frictional), "slip", "stick"))
    return ContactState(
        interface,
        p * interface.area,
        (shear * interface.area)[:, None],
        np.where(p == 0.0, 2e-4 * (t - 1 / 1.2), 0.0),
        slip[:, None],
        status,
        resistance=np.where(status == "slip", 0.15 * p * interface.area * frictional, 0.0),
    )


def fields(mesh: Mesh, error: bool = False, stresses: bool = True) -> Fields:
    """Of a block that is pressed together and bent."""
    x, y = mesh.points.T
    u = 1e-5 * np.column_stack([-0.3 * x * (3 * y - 2), -2.0 * y * (1 + np.sin(x)) + x**2])
    sigma = stress(mesh, STEEL, u) if stresses else None
    return Fields(
        mesh.points,
        mesh.triangles,
        u,
        sigma,
        von_mises(sigma) if stresses else None,
        np.exp(-mesh.points[mesh.triangles[:, :3]].mean(axis=1)[:, 0]) if error else None,
        nodal_stress(mesh, STEEL, u) if stresses else None,
    )


def scene(contacts: list[str], friction=COULOMB, title: str = "Made up") -> dict:
    """What the results need of a resolved scene."""
    law = (
        {"law": "none"}
        if isinstance(friction, NoFriction)
        else {"law": "coulomb", "coefficient": friction.coefficient}
    )
    return {
        "title": title,
        "method": {"outer": "newton", "tolerance": 1e-8},
        "output": {"length_unit": "m", "stress_unit": "Pa"},
        "body": [{"name": body} for body in dict.fromkeys("-".join(contacts).split("-"))],
        "contact": [
            {"name": name, "bodies": name.split("-"), "friction": law} for name in contacts
        ],
    }


def body(**changes) -> dict:
    values = {
        "n": 432,
        "ranks": [0],
        "held": True,
        "displacement_max": 1e-4,
        "displacement_max_at": (1.0, 0.5),
        "von_mises_max": 8e7,
        "von_mises_max_at": (0.5, 0.25),
        "energy": 12.0,
        "points": {"tip": {"displacement": (1e-5, -1e-4)}},
        "reaction": (1.0, -2.0),
        "loads": {"top": {"force": (-1.0, 2.0), "moment": 3.0}},
        "reactions": {"left": {"force": (1.0, -2.0), "moment": -3.0}},
        "discretization_error": 0.05,
        "n_A_by_purpose": {"newton": 90, "recover": 10},
        "inner_steps": {},
        "solver": "preonly, cholesky (mumps)",
        "compliance": "explicit",
        "memory_mib": 120.5,
    }
    return values | changes


def run(contacts: Mapping[str, ContactState], energy_norm: float = 0.07, **changes) -> dict:
    """What the summary says of a run whose only load step has led to these contacts."""
    steps = [
        {
            "time": 1.0,
            "outer_iterations": 9,
            "rigid": rigid_partners(each.totals for each in contacts.values()),
            "contacts": {name: each.totals.resultants for name, each in contacts.items()},
        }
    ]
    return {
        "converged": True,
        "reason": "converged and certified",
        "order": 1,
        "ranks": 2,
        "outer_iterations": 9,
        "inner_iterations": 70,
        "certificate_limit": 5e-7,
        "exchange": {"messages": 30, "bytes": 4000},
        "discretization_error": {
            "energy_norm": energy_norm,
            "quadratic_n": None,
            "target": None,
            "levels": [],
        },
        "steps": steps,
        "solvers": {"qp": "none"},
        "options": {},
        "options_unused": [],
        "warnings": [],
        "undetermined": [],
        "held_motions": [],
    } | changes


def totals(states: Mapping[str, ContactState]) -> dict[str, ContactTotals]:
    return {name: each.totals for name, each in states.items()}


def certificate(
    contacts: Iterable[str], bodies: Iterable[str], **changes: dict[str, float]
) -> Certificate:
    """One of a good answer, with changes by contact, whose names have an underscore for the dash."""
    good = ContactResiduals(0.0, 1e-12, 2e-12, 3e-12)
    return Certificate(
        {name: good._replace(**changes.get(name.replace("-", "_"), {})) for name in contacts},
        dict.fromkeys(bodies, 1e-15) | changes.get("equilibrium", {}),
    )


def results(
    folder: Path,
    kind: str = "stack",
    order: int = 1,
    friction=COULOMB,
    error: bool = False,
    stresses: bool = True,
    divisions=(24, 8),
    title: str = "Made up",
) -> dict:
    """All files of a run of two blocks, one upon the other ("stack"), or of three side by side ("row"); its summary."""
    meshes = {
        name: block(origin, divisions, order)
        for name, origin in {"stack": STACK, "row": ROW}[kind].items()
    }
    states = [
        state(interface(name, *(meshes[body] for body in name.split("-")), on, friction))
        for name, on in CONTACTS[kind].items()
    ]
    parts = [fields(mesh, error, stresses) for mesh in meshes.values()]
    moved = {
        name: {
            "displacement_max": np.linalg.norm(part.displacement, axis=1).max(),
            "displacement_max_at": part.points[np.linalg.norm(part.displacement, axis=1).argmax()],
        }
        for name, part in zip(meshes, parts, strict=True)
    }
    return write_results(
        folder,
        scene(list(CONTACTS[kind]), friction, title),
        {name: body(**of) for name, of in moved.items()},
        dict(zip(meshes, parts, strict=True)),
        [{each.interface.name: each for each in states}],
        order=order,
    )


def write_results(
    folder: Path,
    scene: dict,
    bodies: dict,
    parts: Mapping[str, Fields],
    marched: Sequence[Mapping[str, ContactState]],
    times: Sequence[float] = (),
    **changes,
) -> dict:
    """All files of a run but the fields before its end, from those of each body and the states of contacts at the ends
    of its legs, which have `times`, or of its only one; its summary. `changes` are those of `run`."""
    states = marched[-1]
    summary = summarize(
        scene, run(states, **changes), bodies, totals(states), certificate(states, parts)
    )
    places = write_fields(
        folder,
        dict(enumerate(parts.values())),
        {name: contact_fields(each) for name, each in states.items()},
        tables={name: table_fields(each) for name, each in states.items()},
    )
    write_xdmf(
        folder,
        times,
        {name: places[number] for number, name in enumerate(parts)},
        {name: places[name] for name in states},
    )
    for name, each in states.items():
        write_contact(folder, name, each)
        write_sides(folder, name, each)
        if times:
            write_legs(
                folder,
                name,
                each.interface,
                [
                    (time, found[name], leg_values(found[name]))
                    for time, found in zip(times, marched, strict=True)
                ],
            )
    counts = [
        sum(each.count(status) for each in states.values()) for status in ("open", "slip", "stick")
    ]
    write_table(
        folder / "history.csv",
        HISTORY,
        [(1, k, 3.0 * 10.0**-k, 10.0**-k, 1e-3, *counts, 20 * k) for k in range(1, 10)],
    )
    write_steps(folder, summary["steps"])
    write_summary(folder, summary)
    return summary


def named_grids(folder: Path) -> dict[str, list[dict]]:
    """What ParaView finds: by name of a body or contact, for each time its arrays by name, and the time."""
    root = ElementTree.parse(folder / "result.xdmf").getroot()
    (top,) = root.find("Domain")
    assert top.get("Reference") == "XML"
    hidden = root.find("." + top.text.strip().removeprefix("/Xdmf"))
    assert (hidden.get("GridType"), hidden.get("CollectionType")) == ("Collection", "Spatial")
    return _grids(hidden, folder)


def grids_by_kind(folder: Path) -> dict[str, list[dict]]:
    """The same by kind of cells, of all bodies with such cells."""
    (top,) = ElementTree.parse(folder / "result.xdmf").getroot().find("Domain")
    return _grids([each for each in top if each.tag == "Grid"], folder)


def _grids(parent: Iterable[ElementTree.Element], folder: Path) -> dict[str, list[dict]]:
    """The grids of an element by name, of each its arrays by name at all times."""
    with h5py.File(folder / "result.h5") as file:

        def array(item):
            if item.get("ItemType") != "HyperSlab":
                shape = [int(number) for number in item.get("Dimensions").split()]
                found = (
                    file[item.text.removeprefix("result.h5:")][()]
                    if item.get("Format") == "HDF"
                    else np.array(item.text.split(), item.get("DataType").lower()).reshape(shape)
                )
                assert list(found.shape) == shape
                return found
            start, stride, count = np.array(item[0].text.split(), int).reshape(3, -1)
            assert (stride == 1).all() and item.get("Dimensions") == " ".join(map(str, count))
            return array(item[1])[tuple(slice(a, a + n) for a, n in zip(start, count, strict=True))]

        def grid(each):
            children = [child for child in each if child.tag not in ("Time", "Information")]
            found = {child.get("Name", child.tag): array(child[0]) for child in children}
            (topology,) = (child for child in children if child.tag == "Topology")
            found["Topology"] = found["Topology"] - int(topology.get("BaseOffset", 0))
            found["kind"], time = topology.get("TopologyType"), each.find("Time")
            assert len(found["Topology"]) == int(topology.get("NumberOfElements"))
            return found | {"time": None if time is None else float(time.get("Value"))}

        return {
            each.get("Name"): [
                grid(one) for one in (each if each.get("GridType") == "Collection" else [each])
            ]
            for each in parent
        }
