"""Closed forms that several verification problems share."""

from __future__ import annotations

import numpy as np

from ddmpi.interface.state import ContactState
from problems import AROUND, AWAY, Curve, along


def shear(young: float, poisson: float) -> float:
    """G"""
    return young / 2 / (1 + poisson)


def confined(young: float, poisson: float) -> float:
    """M = E(1 − ν)/((1 + ν)(1 − 2ν)): stress over strain where there is no strain across."""
    return young * (1 - poisson) / (1 + poisson) / (1 - 2 * poisson)


def plane_strain(young: float, poisson: float) -> tuple[float, float]:
    """The E and ν with which formulas of plane stress hold in plane strain."""
    return young / (1.0 - poisson**2), poisson / (1.0 - poisson)


def lame_fit(
    a: float,
    b: float,
    c: float,
    fit: float,
    inner: tuple[float, float],
    outer: tuple[float, float] | None = None,
) -> float:
    """The pressure of rings a < b < c that overlap by `fit` at the radius b (Lamé), of one material or two.

    Materials are E and ν in plane stress, those of `plane_strain` in plane strain.
    """
    (E, nu), (F, mu) = inner, outer or inner
    return (
        fit
        / b
        / (((b**2 + a**2) / (b**2 - a**2) - nu) / E + ((c**2 + b**2) / (c**2 - b**2) + mu) / F)
    )


def fitted_pressure(
    a: float, b: float, bore: float, c: float, material: tuple[float, float]
) -> float:
    """The pressure at the `bore` of a ring up to c that is put over one from a to b > bore, each by Lamé at its radius.

    The material is as of `lame_fit`.
    """
    young, poisson = material
    inner = (
        (b**2 + a**2) / (b**2 - a**2) - poisson
    ) * bore  # its pressure times b is that at the bore
    outer = ((c**2 + bore**2) / (c**2 - bore**2) + poisson) * bore
    return (b - bore) * young / (inner + outer)


def clamped_fit(a: float, b: float, c: float, fit: float, young: float, poisson: float) -> float:
    """The same of rings of one material in plane strain, whose rims a and c are clamped."""
    G = shear(young, poisson)
    return fit / sum(
        abs(b - rim**2 / b) / (2 * G / (1 - 2 * poisson) + 2 * G * rim**2 / b**2) for rim in (a, c)
    )


def lame_ball(a: float, b: float, c: float, fit: float, young: float, poisson: float) -> float:
    """The same of a hollow ball in a shell of one material."""
    gives = [
        b / young * ((1 - 2 * poisson) * b**3 + (1 + poisson) * other**3 / 2) / abs(b**3 - other**3)
        for other in (a, c)
    ]
    return fit / sum(gives)


def hertz_values(
    state: ContactState, parts: int, modulus: float, radius: float, allowed: tuple[float, float]
) -> tuple[dict[str, tuple], Curve]:
    """The greatest pressure and the radius of a contact of which 1/`parts` is modelled, beside those of its force.

    The pressure by least squares of p² over r² up to 0.8 a, the radius by the second moment, Σ s r² = 2/5 P a².
    """
    position = AWAY if state.interface.xy.shape[1] == 3 else AROUND
    force, r, p = float(state.normal_force.sum()), position(state.interface.xy), state.pressure
    a = (3.0 * parts * force * radius / (4.0 * modulus)) ** (1 / 3)
    top = 3.0 * parts * force / (2.0 * np.pi * a**2)
    near = r < 0.8 * a
    _, square = np.polyfit(r[near] ** 2, p[near] ** 2, 1)
    second = np.sqrt(2.5 * float(state.normal_force @ r**2) / force)
    values = {
        "p₀ (Pa)": (np.sqrt(max(square, 0.0)), top, allowed[0]),
        "a (m)": (second, a, allowed[1]),
    }
    return values, along(
        state, lambda x: top * np.sqrt(np.maximum(1.0 - (x / a) ** 2, 0.0)), position, limit=1.3 * a
    )
