"""Results of runs of solids that never were: bodies and contacts with plausible fields, by the writers of results/."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import made_up
import numpy as np
import scipy.sparse as sparse
from solids import grid

from ddmpi.body.estimate import nodal_stress
from ddmpi.body.stress import stress, von_mises
from ddmpi.interface.interface import Drawing, Geometry, Interface, Lines, Partner, Places
from ddmpi.interface.law import law_of
from ddmpi.interface.state import ContactState
from ddmpi.mesh.elements import facet_shares
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.refine import raise_order
from ddmpi.results.fields import Fields, contact_fields, write_fields
from ddmpi.results.tables import ENERGY, Results, leg_values, read_results, write_table
from ddmpi.scene.contacts import NoFriction
from ddmpi.surface.outline import Outline
from ddmpi.system.numbers import RigidMotion


def box(origin=(0.0, 0.0, 0.0), size=(3.0, 1.0, 1.0), divisions=(12, 4, 4), order=1) -> Mesh:
    mesh = grid(divisions)
    mesh = Mesh(np.array(origin) + mesh.points * size, mesh.triangles, mesh.groups)
    return raise_order(mesh, "mesh") if order == 2 else mesh


def tube(radii: tuple[float, float], length: float, divisions=(2, 32, 6), order=1) -> Mesh:
    """Around the z axis; groups inner, outer, bottom and top."""
    mesh = grid(divisions)
    r, turn, z = mesh.points.T
    angle = 2.0 * np.pi * turn
    r = radii[0] + (radii[1] - radii[0]) * r
    points = np.column_stack([r * np.cos(angle), r * np.sin(angle), length * z])
    _, first, number = np.unique(
        np.round(points, 9), axis=0, return_index=True, return_inverse=True
    )
    number = number.ravel()
    names = {"inner": "left", "outer": "right", "bottom": "bottom", "top": "top"}
    mesh = Mesh(
        points[first], number[mesh.triangles], {a: number[mesh.groups[b]] for a, b in names.items()}
    )
    return raise_order(mesh, "mesh") if order == 2 else mesh


def frames(normal: np.ndarray) -> np.ndarray:
    """Unit vectors (k, 3, 3): normals, and two tangents that no one would choose."""
    aside = np.where(np.abs(normal[:, :1]) < 0.9, [[1.0, 0.2, 0.1]], [[0.1, 1.0, 0.3]])
    first = np.cross(normal, aside)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([normal, first, np.cross(normal, first)], axis=1)


def interface(
    name: str, mesh: Mesh, group: str, friction=made_up.COULOMB, kind="unilateral"
) -> Interface:
    """The boundary `group` of a body meets a partner, at the corners of its facets."""
    triangles = mesh.groups[group][:, :3]
    nodes, facets = np.unique(triangles, return_inverse=True)
    facets = facets.reshape(-1, 3)
    xy = mesh.points[nodes]
    area = np.bincount(facets.ravel(), facet_shares(xy[facets]).ravel())
    across, m = (
        np.cross(xy[facets[:, 1]] - xy[facets[:, 0]], xy[facets[:, 2]] - xy[facets[:, 0]]),
        len(nodes),
    )
    normal = np.column_stack([np.bincount(facets.ravel(), np.repeat(each, 3)) for each in across.T])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    sliding = np.arange(m if kind == "bonded" or not isinstance(friction, NoFriction) else 0)
    law, alone = (
        law_of(friction, xy, np.zeros(m), area, sliding, kind),
        sparse.identity(m, format="csr"),
    )
    return Interface(
        name=name,
        bodies=tuple(name.split("-")),
        geometry=Geometry(
            xy, frames(normal)[:, 1:], area, (xy, xy), facets, sparse.csr_matrix((m, m))
        ),
        rows=Places((nodes, np.empty(0, int)), normal, np.zeros(m), (alone, alone)),
        law=law,
        modulus=1e11,
        partner=Partner(RigidMotion(np.zeros(3))),
        drawing=Drawing(Lines(np.arange(m), xy, area, facets), lambda: Outline(xy, facets, alone)),
    )


def state(interface: Interface, pressure: float = 5e7, factor: float = 1.0) -> ContactState:
    """A pressure that ends before the contact does; the first part sticks, the outer one slips along a swirl."""
    xy = interface.xy
    centre, extent = (xy.max(axis=0) + xy.min(axis=0)) / 2, np.ptp(xy, axis=0).max()
    r = np.linalg.norm((xy - centre) * (1.0, 1.3, 1.0), axis=1) / extent
    r = 0.6 * (r - r.min()) / np.ptp(r)
    p = factor * pressure * np.sqrt(np.maximum(0.0, 1.0 - (r / 0.45) ** 2))
    frictional = interface.law.components * len(interface.sliding) > 0
    swirl = np.cross(xy - centre, interface.normal) + 0.3 * extent * np.array([1.0, 0.3, 0.0])
    along = np.einsum("mcd,md->mc", interface.tangents, swirl)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    slips = frictional * np.maximum(r - 0.2, 0.0)[:, None]
    shear = frictional * 0.3 * p[:, None] * np.minimum(r / 0.2, 1.0)[:, None] * along
    status = np.where(
        p == 0.0, "open", np.where(slips[:, 0] > 0.0, "slip", "stick" if frictional else "slip")
    )
    gap = np.where(p == 0.0, 2e-4 * np.maximum(r - 0.45, 0.0), 0.0)
    return ContactState(
        interface,
        p * interface.area,
        shear * interface.area[:, None],
        gap,
        1e-4 * slips * along,
        status,
        resistance=np.where(status == "slip", 0.15 * p * interface.area * frictional, 0.0),
    )


def fields(mesh: Mesh, error=False, stresses=True, factor: float = 1.0) -> Fields:
    """Of a body that is pressed together and bent."""
    x, y, z = mesh.points.T
    u = (
        1e-5
        * factor
        * np.column_stack([-0.3 * x * (3 * z - 2), 0.2 * y * x, -2.0 * z * (1 + np.sin(x)) + x**2])
    )
    sigma = stress(mesh, made_up.STEEL, u) if stresses else None
    return Fields(
        mesh.points,
        mesh.triangles,
        u,
        sigma,
        von_mises(sigma) if stresses else None,
        np.exp(-mesh.points[mesh.triangles[:, :4]].mean(axis=1)[:, 0]) if error else None,
        nodal_stress(mesh, made_up.STEEL, u) if stresses else None,
    )


def scene(
    contacts: Iterable[str], friction=made_up.COULOMB, rigid: Iterable[dict] = (), times=()
) -> dict:
    """What the results need of a resolved scene."""
    made = made_up.scene(list(contacts), friction) | {"rigid": list(rigid)}
    made["body"] = [
        {"name": name, "clamp": []}
        for name in dict.fromkeys("-".join(contacts).split("-"))
        if name not in {each["name"] for each in made["rigid"]}
    ]
    if times:
        made |= {
            "history": {"press": {"times": [0.0, times[-1]], "factors": [0.0, 1.0]}},
            "time": {"points": times},
        }
    return made


def results(
    folder: Path,
    bodies: Mapping[str, Mesh],
    contacts: Mapping[str, tuple[str, str]],
    friction=made_up.COULOMB,
    rigid: Iterable[dict] = (),
    times: Iterable[float] = (),
    **how,
) -> dict:
    """All files of a run of some bodies; contacts by name, with the body and the group that carries it; the summary."""
    times = tuple(times)
    faces = {
        name: interface(name, bodies[body], group, friction)
        for name, (body, group) in contacts.items()
    }
    marched = [
        {name: state(face, factor=factor) for name, face in faces.items()}
        for factor in np.linspace(1.0 / max(len(times), 1), 1.0, max(len(times), 1))
    ]
    states = marched[-1]
    parts = {name: fields(mesh, **how) for name, mesh in bodies.items()}
    entries = {
        name: made_up.body(
            reaction=(1.0, -2.0, 3.0),
            loads={},
            reactions={"left": {"force": (1.0, -2.0, 3.0), "moment": (4.0, 5.0, -6.0)}},
            displacement_max=np.linalg.norm(part.displacement, axis=1).max(),
        )
        for name, part in parts.items()
    }
    order = 1 if next(iter(bodies.values())).triangles.shape[1] == 4 else 2
    steps = [
        {
            "time": time,
            "outer_iterations": 5,
            "contacts": {name: each.totals.resultants for name, each in found.items()},
        }
        for time, found in zip(times or (1.0,), marched, strict=True)
    ]
    summary = made_up.write_results(
        folder,
        scene(contacts, friction, rigid, times),
        entries,
        parts,
        marched,
        times,
        order=order,
        steps=steps,
    )
    for step, factor in enumerate(np.linspace(0.0, 1.0, len(times) + 1)[1:-1]):
        write_fields(
            folder,
            {
                number: fields(mesh, factor=factor, **how)
                for number, mesh in enumerate(bodies.values())
            },
            {
                name: contact_fields(each, leg_values(marched[step][name]))
                for name, each in states.items()
            },
            step=step,
        )
    if times:
        write_table(
            folder / "energy.csv",
            ENERGY,
            [(time, 2.0 * time, time, time, 0.5 * time, 1e-14) for time in times],
        )
    return summary


def stacked(folder: Path, order=1, divisions=(6, 2, 2), **how) -> Results:
    """The results of two boxes, one upon the other, written and read back."""
    boxes = {
        name: box((0.0, 0.0, z), divisions=divisions, order=order)
        for name, z in {"upper": 1.0, "lower": 0.0}.items()
    }
    results(folder, boxes, {"upper-lower": ("upper", "bottom")}, **how)
    return read_results(folder)
