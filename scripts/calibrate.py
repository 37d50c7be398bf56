#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""A friction coefficient and a gap from measured forces, by least squares with derivatives (docs/use/derivatives.md).

scripts/study calibrate         # pinched blocks under three loads, with 0.1 % of noise; a few seconds
"""

from __future__ import annotations

import argparse
import functools
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

import ddmpi
from ddmpi.run.answer import Answer

SCENE = Path(__file__).resolve().parents[1] / "configs" / "pinched_blocks.toml"
CONTACT = "upper-lower"
KEYS = [f"contact.{CONTACT}.friction.coefficient", f"contact.{CONTACT}.gap"]
SIZES = np.array([1.0, 1e-4])
"""Of the coefficient and of the gap (m), so that the unknowns of the fit are alike."""

LOADS, NOISE = (0.6, 1.0, 1.4), 1e-3
"""Factors on the load on the upper block, and the relative error of a measured force."""


@functools.lru_cache(maxsize=2)
def solve(coefficient: float, gap: float) -> list[Answer]:
    """The answers under all loads, with derivatives."""
    given = dict(zip(KEYS, (coefficient, gap), strict=True)) | {
        "output.derivatives": KEYS,
        "output.only": "contacts",
    }
    return [
        ddmpi.solve(
            SCENE,
            overrides=given
            | {
                "body.upper.traction": [
                    {"on": "top", "value": [0.0, -6e7 * load]},
                    {"on": "right", "value": [2e7 * load, 3e7]},
                ]
            },
        )
        for load in LOADS
    ]


def forces(answers: list[Answer]) -> np.ndarray:
    """(6,) the forces on the upper block under each load (N/m)."""
    return np.concatenate([answer.contacts[CONTACT].force for answer in answers])


def calibrate(measured: np.ndarray, guess: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """The coefficient and the gap (2,) that fit the measured forces (6,) best, their standard errors, and how many fits
    were tried."""
    size = np.abs(measured).max()

    def residuals(x: np.ndarray) -> np.ndarray:
        return (forces(solve(*(x * SIZES).tolist())) - measured) / size

    def jacobian(x: np.ndarray) -> np.ndarray:
        rows = [
            np.column_stack([answer.derivative(key).contacts[CONTACT].force for key in KEYS])
            for answer in solve(*(x * SIZES).tolist())
        ]
        return np.vstack(rows) * SIZES / size

    fit = least_squares(
        residuals, guess / SIZES, jac=jacobian, bounds=([0.0, -np.inf], np.inf), xtol=1e-8
    )
    spread = np.sqrt(2.0 * fit.cost / (len(measured) - len(guess)))  # of a residual
    errors = spread * np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))
    return fit.x * SIZES, errors * SIZES, fit.nfev


def main() -> None:
    argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_args()
    exact = np.array([0.37, -4e-5])
    noise = 1.0 + NOISE * np.random.default_rng(0).standard_normal(2 * len(LOADS))
    found, errors, tried = calibrate(forces(solve(*exact.tolist())) * noise, np.array([0.15, 0.0]))
    print(f"friction coefficient {found[0]:.4f} ± {errors[0]:.4f}, where {exact[0]:g} was measured")
    print(f"gap {found[1]:.3e} ± {errors[1]:.1e} m, where {exact[1]:g} was measured")
    print(f"{tried * len(LOADS)} solves")


if __name__ == "__main__":
    main()
