"""Stress of a computed displacement."""

from __future__ import annotations

import numpy as np

from ddmpi.mesh.elements import ELEMENTS
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import Material


def stress(mesh: Mesh, material: Material, u: np.ndarray) -> np.ndarray:
    """Stress of each triangle: its mean, which is that at the centroid.

    Parameters
    ----------
    u : (nv, 2) displacement (m)

    Returns
    -------
    (nt, 4) array of σ_xx, σ_yy, σ_zz, σ_xy in Pa; σ_zz is zero in plane stress. Not collective.
    """
    p, t = mesh.points, mesh.triangles
    e1, e2 = p[t[:, 1]] - p[t[:, 0]], p[t[:, 2]] - p[t[:, 0]]
    mean = ELEMENTS[t.shape[1]].gradients.mean(axis=0)  # of the gradients of the shape functions
    v = [sum(c * u[t[:, i]] for i, c in enumerate(mean[:, a]) if c) for a in range(3)]
    d1, d2 = v[1] - v[0], v[2] - v[0]  # ∇u = Σ_a v_a ∇λ_a
    area2 = (e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0])[:, None]
    du_dx = (d1 * e2[:, 1:] - d2 * e1[:, 1:]) / area2
    du_dy = (d2 * e1[:, :1] - d1 * e2[:, :1]) / area2
    first, shear = material.lame
    exx, eyy, gxy = du_dx[:, 0], du_dy[:, 1], du_dy[:, 0] + du_dx[:, 1]
    trace = first * (exx + eyy)
    szz = trace if material.plane == "strain" else np.zeros_like(trace)
    return np.column_stack([trace + 2 * shear * exx, trace + 2 * shear * eyy, szz, shear * gxy])


def von_mises(sigma: np.ndarray) -> np.ndarray:
    """Von Mises stress (nt,) in Pa from `stress`."""
    xx, yy, zz, xy = sigma.T
    return np.sqrt(0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3 * xy**2)
