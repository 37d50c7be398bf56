"""Can the answer be meant? Warnings of certified answers that small-strain theory or the drawing do not cover."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ddmpi.coupling.assembly import Assembly
from ddmpi.interface.state import ContactState

LARGE_MOTION = 0.1
"""A displacement of this part of the body's size is no small one."""

LARGE_GRADIENT = 0.1
"""Strains and rotations of this size are no small ones."""

FAR_SLIP = 1.0
"""Nodes that slid further than this part of the distance to their neighbours are no longer opposite each other."""

RESOLVED = 1e-3
"""Overlaps beyond the end of a contact below this part of the largest displacement are not reported."""


def doubt_answer(assembly: Assembly, u: np.ndarray, contacts: Mapping[str, ContactState]) -> list[str]:
    """Warnings of an answer, the same on all ranks.

    Parameters
    ----------
    u : (nv, d) displacement of the rank's own body (m)
    contacts : state by contact

    Collective.
    """
    moved, extent = float(np.linalg.norm(u, axis=1).max()), assembly.mesh.extent
    own = []
    if moved > LARGE_MOTION * extent:
        own = [f"body.{assembly.spec.name}: its largest displacement of {moved:.3g} is {moved / extent:.2g} times its "
               f"size ({extent:.3g}); small-strain theory means small displacements"]
    else:
        own = _large_gradient(assembly, u)
    found = [warning for each in assembly.world.allgather(own) for warning in each]
    largest = max(assembly.world.allgather(moved))
    for state in contacts.values():
        interface = state.interface
        side = interface.side(assembly.spec.name)
        mine = interface.transfer[side] @ u[interface.nodes[side]], _go_on(assembly, u, interface.beyond[side])
        (u1, ends1), (u2, ends2) = assembly.exchange.swap_objects(mine)
        found += _far_slip(state, u1 - u2) + _overlap_beyond(state, ends1, ends2, RESOLVED * largest)
    return found


def _large_gradient(assembly: Assembly, u: np.ndarray) -> list[str]:
    """A warning where a triangle of the own mesh is strained or turned much, by its corners alone."""
    at, moved = (field[assembly.mesh.triangles[:, :3]] for field in (assembly.mesh.points, u))
    gradient = np.linalg.norm(np.linalg.solve(at[:, 1:] - at[:, :1], moved[:, 1:] - moved[:, :1]), 2, axis=(1, 2))
    k = int(np.argmax(gradient))
    if gradient[k] <= LARGE_GRADIENT:
        return []
    x, y = at[k].mean(axis=0)
    return [f"body.{assembly.spec.name}: strains and rotations reach {gradient[k]:.2g}, as at ({x:.4g}, {y:.4g}); "
            "small-strain theory means small ones"]


def _far_slip(state: ContactState, moved: np.ndarray) -> list[str]:
    """A warning where closed node pairs have `moved` (m, d) far from each other along the contact."""
    interface = state.interface
    along = np.linalg.norm(np.einsum("mcd,md->mc", interface.frame[:, 1:], moved), axis=1)
    slid = np.where(state.status != "open", along, 0.0) / interface.area
    k = int(np.argmax(slid))
    if slid[k] <= FAR_SLIP:
        return []
    return [f"contact.{interface.name}: node pairs slid up to {slid[k]:.3g} times the distance of their neighbours, as "
            f"at ({interface.xy[k, 0]:.4g}, {interface.xy[k, 1]:.4g}); they are no longer opposite each other"]


def _go_on(assembly: Assembly, u: np.ndarray, beyond: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How the deformed boundary goes on at the ends of a contact: from (e, 2) along (e, 2), the body to its left."""
    at = assembly.mesh.points + u
    return at[beyond[:, 0]], (at[beyond[:, 1]] - at[beyond[:, 0]]) * np.where(beyond[:, 2:], 1.0, -1.0)


def _overlap_beyond(state: ContactState, first: tuple[np.ndarray, np.ndarray], second: tuple[np.ndarray, np.ndarray],
                    least: float) -> list[str]:
    """A warning where contact reaches the end of its group and the surfaces beyond it overlap by `least` or more."""
    interface = state.interface
    closed = set(interface.nodes[0][state.status != "open"].tolist())
    for k, end in enumerate(interface.beyond[0][:, 0].tolist()):
        (a, along), (b, back) = ((start[k], direction[k]) for start, direction in (first, second))
        if end not in closed or along @ back >= 0.0:  # one surface goes on to the left of its body, one to the right
            continue
        step = min(np.linalg.norm(along), np.linalg.norm(back))
        away = 1.0 if interface.beyond[0][k, 2] else -1.0
        q = b - away * step * back / np.linalg.norm(back)
        depth = (along[0] * (q - a)[1] - along[1] * (q - a)[0]) / np.linalg.norm(along)  # of q left of the first's
        if depth > least:
            return [f"contact.{interface.name}: contact reaches the end of its group at ({a[0]:.4g}, {a[1]:.4g}), and "
                    f"the surfaces beyond it overlap by {depth:.3g}; name the whole boundary that may touch in `on`"]
    return []
