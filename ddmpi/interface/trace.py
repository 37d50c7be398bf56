"""Traces: the displacement of a body at its contact nodes, along normals and tangents."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sparse

from ddmpi.body.elasticity import Elasticity
from ddmpi.interface.interface import Drawing, Interface, Places
from ddmpi.sets import magnitude
from ddmpi.surface.side import dot, nodal
from ddmpi.system.numbers import ROUNDING, Frame


def trace(interface: Interface, side: int, body: Elasticity) -> sparse.csr_matrix:
    """B = [N; T] of the body on `side` (0 or 1): (size, columns of A). Not collective.

    Clamped directions have no entry; their contribution to the trace is constant, and `displacement_trace` of the
    prescribed displacement gives it.
    """
    d, moves = interface.dimension, rows(interface, side).tocoo()
    nodes = interface.rows.nodes[side][moves.col]
    clamped = (body.supports.clamps >= 0).any(axis=1)
    place = np.full(len(clamped), -1)
    place[body.nodes] = np.arange(len(body.nodes))
    # u_ν = u¹·ν¹ + u²·ν² with ν² = −ν¹: the second body's rows have the opposite sign.
    along = _sign(side) * moves.data[:, None] * _own(interface, side)[moves.row]
    # A is P K P with the projection P onto the free directions, so B becomes B P. At clamps aslant to the axes P leaves
    # rounding in the constrained direction, which would make a column of B where A is decoupled.
    values = np.einsum("kij,kj->ki", body.supports.free[nodes], along)
    entry = np.abs(values) > np.where(clamped[nodes], ROUNDING * magnitude(along), 0.0)[:, None]
    columns = d * place[nodes][:, None] + np.arange(d)
    row = np.repeat(moves.row[:, None], d, axis=1)
    return sparse.csr_matrix(
        (values[entry], (row[entry], columns[entry])), (interface.size, body.A.size[1])
    )


def displacement_trace(interface: Interface, side: int, u: np.ndarray) -> np.ndarray:
    """B u (size,) in metres, of a displacement (nv, d) of all nodes of the body on `side`. Not collective."""
    moved = interface.rows.moved(side, u)
    return _sign(side) * dot(moved[interface.law.node], interface.directions)


def sliding_trace(interface: Interface, side: int, u: np.ndarray) -> np.ndarray:
    """Tangential displacement (m, d − 1) in metres at a contact without friction, which has no tangential unknowns;
    empty (0, d − 1) for other contacts. Not collective."""
    if not interface.law.frictionless:
        return np.empty((0, interface.dimension - 1))
    moved = interface.rows.moved(side, u)
    return _sign(side) * np.einsum("mcd,md->mc", interface.tangents, moved)


def nodal_forces(interface: Interface, side: int, s: np.ndarray, nodes: int) -> np.ndarray:
    """−Bᵀ s (nodes, d): forces on all nodes of the body on `side` by contact forces s (size,) (N). Not collective."""
    pulls = rows(interface, side).T @ (s[:, None] * _own(interface, side))
    return nodal(-_sign(side) * pulls, interface.rows.nodes[side], nodes)


def normal_trace(side: int, places: Places, u: np.ndarray) -> np.ndarray:
    """Normal displacement (k,) in metres at places of the interface. Not collective."""
    return _sign(side) * dot(places.normal, places.moved(side, u))


def seen(interface: Interface, frame: Frame) -> Interface:
    """The interface in the axes of a body's frame: its directions are turned back, places stay where they are."""
    back, fixed, probes = frame.turned, interface.fixed, interface.probes
    turned = interface.frame @ back
    return replace(
        interface,
        geometry=replace(interface.geometry, tangents=turned[:, 1:]),
        rows=replace(interface.rows, normal=turned[:, 0]),
        fixed=replace(fixed, normal=fixed.normal @ back),
        probes=replace(probes, normal=probes.normal @ back),
    )


def placed(interface: Interface, frame: Frame) -> Interface:
    """The interface where a frame takes both of its sides."""
    turned, drawing = seen(interface, frame.undone), interface.drawing
    lines, (first, second) = drawing.lines, interface.geometry.at
    lines = replace(
        lines, xy=frame.at(lines.xy), at=None if lines.at is None else frame.at(lines.at)
    )
    return replace(
        turned,
        geometry=replace(
            turned.geometry, xy=frame.at(interface.xy), at=(frame.at(first), frame.at(second))
        ),
        drawing=Drawing(lines, lambda: replace(drawing.outline, xy=frame.at(drawing.outline.xy))),
    )


def components(body: Elasticity, nodes: np.ndarray) -> sparse.csr_matrix:
    """The components along the axes (d k, columns of A) of those of the `nodes` (·,) on which A acts."""
    d, place = body.supports.free.shape[1], np.flatnonzero(np.isin(body.nodes, nodes))
    columns = (d * place[:, None] + np.arange(d)).ravel()
    return sparse.csr_matrix(
        (np.ones(len(columns)), (np.arange(len(columns)), columns)), (len(columns), body.A.size[1])
    )


def rows(interface: Interface, side: int) -> sparse.csr_matrix:
    """The transfer to the nodes of a side, a row for each unknown."""
    return interface.rows.transfer[side][interface.law.node]


def _own(interface: Interface, side: int) -> np.ndarray:
    """The directions (size, d) of all unknowns as a body on `side` has them: those of an image are turned back."""
    image = interface.image
    return interface.directions @ image.turned if side and image else interface.directions


def _sign(side: int) -> float:
    return 1.0 if side == 0 else -1.0
