"""What outer methods have in common."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Step:
    """One line of the history.

    ``update`` is ‖λ_k − λ_{k−1}‖ / ‖λ_k‖ (for Newton, of the forces), ``residual`` the force mismatch
    ‖s_1 − s_2‖ / ‖s_2‖ (for Newton, the residual of the contact equations over the forces),
    ``inner_precision`` the tolerance of the programs (m; for Newton, of GMRES), ``n_A`` the
    multiplications of role 1's and role 2's body so far.
    """

    iteration: int
    update: float
    residual: float
    inner_precision: float
    n_A: tuple[int, int]
