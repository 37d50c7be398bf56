"""Numbered curves and faces of drawings: what each is, in words and in pictures."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ddmpi.check.drawing import GROUPS, Looked, Plan, as_results, meshed, seen_from
from ddmpi.check.nearby import Boundary
from ddmpi.mesh.boundary import creases, segments
from ddmpi.mesh.elements import facet_measures
from ddmpi.mesh.mesh import Mesh
from ddmpi.results.tables import Results
from ddmpi.scene.scene import Settled
from ddmpi.system.files import LONGEST
from ddmpi.system.numbers import in_words

SQUARE = "", "", "²"
"""The powers of the unit of length of lengths and areas, by the dimension of what has them."""

EDGEWISE = 0.1
"""Facets are not numbered whose normal points less to the eye."""


def describe_faces(mesh: Mesh, boundary: Boundary, unit: str) -> Iterator[str]:
    """What each numbered face is, by its number: "8: plane, normal +z, 314 mm², about (0, 0, 5)". Not collective."""
    d = mesh.dimension
    for name in sorted(mesh.faces, key=int):
        face, some = mesh.faces[name], boundary.groups[name]
        at, normal = boundary.at[some].mean(axis=1), boundary.normal[some]
        measures = facet_measures(boundary.at[some])
        middle, mean = (measures @ values / measures.sum() for values in (at, normal))
        words = [face.kind]
        if face.radius:  # normals of a hollow one point to each other
            hollow = np.einsum("kd,kd->k", normal, at - middle) @ measures < 0.0
            words += [f"r {face.radius:.3g}", *["hollow"] * bool(hollow)]
        elif np.ptp(normal, axis=0).max() < 1e-6:
            axis = int(np.abs(mean).argmax())
            words.append("normal " + ("+" if mean[axis] > 0.0 else "-") + "xyz"[axis] if abs(mean[axis]) > 1 - 1e-9
                         else f"normal {in_words(np.round(mean, 4) + 0.0, 3)}")
        yield (f"{name}: {', '.join(words)}, {face.measure or measures.sum():.4g} {unit}{SQUARE[d - 1]}, about "
               f"{in_words(np.array(face.place), 4)}")


def face_pictures(scene: Settled, bodies: Mapping[str, Looked]) -> dict[str, Callable[[], Any]]:
    """The pictures, by their names, of each body with numbered faces, of solids from both sides. Not collective."""
    return {f"faces_{name if len(name.encode()) < LONGEST - 20 else k}{'_behind' * behind}.png": partial(
        draw_faces, as_results(scene, {name: body}, []), name, body, bool(behind))
        for k, (name, body) in enumerate(bodies.items()) if body.mesh.faces for behind in range(scene.dimension - 1)}


def draw_faces(results: Results, name: str, body: Looked, behind: bool) -> Any:
    """A body with the numbers of its faces; a figure. `results` are of this body alone."""
    numbered = {face: body.boundary.groups[face] for face in body.mesh.faces}
    boundary = dataclasses.replace(body.boundary, groups=numbered)
    results = seen_from(results, behind, cut=None)
    plan = Plan(results, results.points)
    colours = {face: GROUPS[k % len(GROUPS)] for k, face in enumerate(numbered)}
    plan.show(meshed(plan, [dataclasses.replace(body, boundary=boundary)], colours))
    placed, hidden, far = list[np.ndarray](), list[str](), np.full(2, 1e3 * np.abs(results.points).max())
    for face, some in numbered.items():
        at, normal = boundary.at[some].mean(axis=1), boundary.normal[some]
        if not plan.view.solid:
            plan.lines(body.mesh.points[segments(boundary.facets[some])], colors=colours[face], linewidth=2.4, zorder=4)
        facing = np.where(plan.shows(at), plan.place(normal)[:, 2], 0.0) if plan.view.solid else np.ones(len(at))
        seen = at[facing > max(EDGEWISE, facing.max() / 2.0)]
        if len(seen):
            # as far as possible from the rim of the face, and from the numbers so far
            ends = creases(body.mesh.points, boundary.facets[some][:, :body.mesh.dimension], normal).rim
            rim = plan.place(body.mesh.points[ends].mean(axis=1))[:, :2]
            flat = plan.place(seen)[:, :2]
            k = int(np.argmax(cKDTree(np.vstack([[far], *placed, rim])).query(flat)[0]))
            placed.append(flat[k])
            plan.label(face, seen[k])
        else:
            hidden.append(face)
    what = ("curves", "faces")[body.mesh.dimension - 2]
    plan.figure.suptitle(f"{results.heading()}{name}: numbered {what}{', from behind' * behind}"
                         + f"\nnot seen: {', '.join(hidden)}" * bool(hidden))
    return plan.figure
