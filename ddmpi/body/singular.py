"""Why a stiffness is singular to double precision, each cause by its share of the condition number."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import msgspec.structs
import numpy as np
import scipy.sparse as sparse

from ddmpi.body.rigid_motions import free_motions, rigid_motions
from ddmpi.body.stiffness import sum_stiffness
from ddmpi.body.stress import Composite, material_of
from ddmpi.mesh.mesh import Mesh, signed_measures
from ddmpi.scene.bodies import BodySpec, Material
from ddmpi.system.numbers import in_words

POISSON = 0.3
"""Poisson's ratio of the body that one nearly incompressible is compared with."""

LEAST = 1e6
"""A cause that adds less than this factor to the condition number is not named: ten digits are left."""

SLENDER = 30.0
"""Bodies of less than this ratio of length to thickness are not called slender."""


def causes(mesh: Mesh, body: BodySpec, free: np.ndarray, sprung: sparse.csr_matrix | None) -> str:
    """The main cause, as an end of a sentence; empty if none of the known ones is large enough. Not collective.

    Parameters
    ----------
    free : (nv, d, d) projections onto directions in which clamps let the nodes move
    sprung : the rows √k Q (r, d nv) of foundations, or None
    """
    found = [
        _soft_support(mesh, body, free, sprung),
        _incompressible(mesh, body),
        _contrast(body),
        _slender(mesh),
        _thin_cells(mesh),
    ]
    factor, words = max(found)
    return words if factor > LEAST else ""


def _soft_support(
    mesh: Mesh, body: BodySpec, free: np.ndarray, sprung: sparse.csr_matrix | None
) -> tuple[float, str]:
    """By how much the elements are stiffer than the foundations that alone resist a rigid motion."""
    if sprung is None:
        return 1.0, ""
    points = mesh.points
    R = rigid_motions(points, points.mean(axis=0), np.ptp(points, axis=0).max())
    left = sprung @ R.reshape(points.size, -1) @ free_motions(R, free)
    if not left.size:
        return 1.0, ""
    softest = np.linalg.eigvalsh(left.T @ left).min()
    stiffest = sum_stiffness(mesh, material_of(mesh, body)).diagonal.max()
    # per node, as the entries of the stiffness are
    factor = stiffest * len(points) / softest if softest > 0.0 else np.inf
    return factor, (
        "its foundations alone resist a rigid motion, with "
        f"{softest / stiffest:.0e} of the stiffness of its elements; a clamp, or a stiffer foundation, would hold it"
    )


def _incompressible(mesh: Mesh, body: BodySpec) -> tuple[float, str]:
    """By how much stiffer elements are than with an ordinary Poisson's ratio, and the same Young's modulus."""
    material = material_of(mesh, body)

    def ordinary(one: Material) -> Material:
        plain = not isinstance(one.poisson, tuple) and one.poisson > POISSON
        return msgspec.structs.replace(one, poisson=POISSON) if plain else one

    other = (
        replace(material, materials=[ordinary(one) for one in material.materials])
        if isinstance(material, Composite)
        else ordinary(material)
    )
    parts = material.materials if isinstance(material, Composite) else [material]
    most = max((one.poisson for one in parts if not isinstance(one.poisson, tuple)), default=0.0)
    both = [sum_stiffness(mesh, one).diagonal.max() for one in (material, other)]
    return both[0] / both[1], (
        f"with Poisson's ratio {most:.15g} it resists changes of volume {both[0] / both[1]:.0e} times as much as "
        "changes of shape; one nearer to 0.49 leaves more digits"
    )


def _contrast(body: BodySpec) -> tuple[float, str]:
    """By how much the moduli of its materials, and along their axes, differ."""
    moduli = np.concatenate([np.ravel(one.young) for one in body.materials])
    factor = moduli.max() / moduli.min()
    return factor, (
        f"its largest Young's modulus is {factor:.0e} times the smallest; a rigid partner can stand "
        "for the stiff part"
    )


def _slender(mesh: Mesh) -> tuple[float, str]:
    """By how much a body of this length and thickness bends more than it shears, with cells as small as its thickness:
    (length / thickness)⁴."""
    sizes = np.ptp(mesh.points @ np.linalg.svd(np.cov(mesh.points.T))[0], axis=0)
    ratio = sizes.max() / max(sizes.min(), np.finfo(float).tiny)
    return ratio**4 * (ratio > SLENDER), (
        f"it is {ratio:.0f} times as long as it is thick, and bends that much to the fourth power more than its cells"
    )


def _thin_cells(mesh: Mesh) -> tuple[float, str]:
    """The largest ratio of length to height of a cell, squared: that of its stiffnesses across and along."""
    x = mesh.points[mesh.corners]
    edges = [x[:, a] - x[:, b] for a, b in combinations(range(x.shape[1]), 2)]
    longest = np.linalg.norm(edges, axis=2).max(axis=0)
    heights = signed_measures(mesh.points, mesh.corners) / longest ** (mesh.dimension - 1)
    ratio = longest / np.maximum(heights, np.finfo(float).tiny)
    worst = int(ratio.argmax())
    place = in_words(mesh.points[mesh.corners[worst]].mean(axis=0), 4)
    return float(ratio[worst]) ** 2, (
        f"the cell at {place} is {ratio[worst]:.0e} times as long as it is thick"
    )
