"""The published iteration beside its paper: θ, precision of inner solves, QP solvers, more than two bodies.

A study is a function of STUDIES, started by its name: scripts/study theta_sensitivity. Tables are written row by
row, so that an interrupted study continues. The paper's tables are in reproduce_tables.py.
"""

from __future__ import annotations

import csv
import functools
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from assembly_study import stack
from experiment import (
    ALGORITHMS,
    LAWS,
    SIZES,
    SPLITTINGS,
    VARIANTS,
    Ledger,
    Row,
    arguments,
    on_two_ranks,
    one_mesh,
    pinched_blocks,
    publish,
    save_figures,
    start,
    table,
    variant,
    where,
)
from mpi4py import MPI
from petsc4py import PETSc
from scenes import prepare_scene

from ddmpi.coupling.assembly import Assembly, prepare
from ddmpi.errors import SolverError
from ddmpi.methods.newton import Newton
from ddmpi.methods.published import PublishedIteration
from ddmpi.methods.subproblem import friction_role
from ddmpi.qp.program import QPResult
from ddmpi.qp.tao import QPSolver
from ddmpi.run.solve import solve

# The iteration linearised at the solution, as a dense matrix. There the nodes keep their status, each body's QP is a
# linear system for its free forces, and an iteration is a linear map: its spectral radius is the factor by which the
# error shrinks in the end.

SOLVED, MOST_STEPS = 1e-10, 500
"""Of the solution at which the iteration is linearised: relative residual, and most steps."""

ON_BOUND = 1e-7
"""Relative distance to a bound below which a force counts as lying on it."""


@dataclass(frozen=True)
class Linearisation:
    """What the map depends on; `size` = m normal and m tangential unknowns.

    Attributes
    ----------
    C : compliances (size, size) of role 1's and role 2's body (m/N)
    pressed : (m,) bool, normal force above zero at the solution
    sticking : (m,) bool, tangential force below its bound
    slip : (m,) ±𝓕 where the tangential force follows the normal one at its bound (Coulomb), else zero
    """

    C: tuple[np.ndarray, np.ndarray]
    pressed: np.ndarray
    sticking: np.ndarray
    slip: np.ndarray

    def all_sticking(self) -> np.ndarray:
        """Eigenvalues, ascending, of M = ½ (C_1 + C_2)(C_1⁻¹ + C_2⁻¹): T_θ = I − θ M if all nodes stick."""
        C1, C2 = self.C
        inverse = np.linalg.inv(C1) + np.linalg.inv(C2)
        return scipy.linalg.eigh((inverse + inverse.T) / 4, np.linalg.inv(C1 + C2), eigvals_only=True)

    def response(self, algorithm: str, splitting: str) -> tuple[np.ndarray, np.ndarray]:
        """The map for all theta: the new state is (P + θ Q) times the old one.

        The state is λ and the part of the last forces that enters the next iteration: s_2ν where it sets the
        slip bound, s_αt where the QP of α is split. Returns P and Q (k, k).
        """
        m = len(self.pressed)
        parts = {"lam": 2 * m}
        if self.slip.any():
            parts["s2n"] = m
        split = [splitting in (f"step{role}", "step1+2") for role in (1, 2)]
        parts |= {f"s{role}t": m for role in (1, 2) if split[role - 1]}
        offsets = np.cumsum([0, *parts.values()])
        k = offsets[-1]
        unit = {name: np.eye(k)[start:end]
                for name, start, end in zip(parts, offsets[:-1], offsets[1:], strict=True)}
        bound = self.slip[:, None] * unit.get("s2n", np.zeros((m, k)))
        s1, s2 = (self._forces(role, algorithm, split[role - 1], unit, bound) for role in (1, 2))
        new = {"lam": unit["lam"], "s2n": s2[:m], "s1t": s1[m:], "s2t": s2[m:]}
        P = np.concatenate([new[name] for name in parts])
        Q = np.zeros_like(P)
        Q[:2 * m] = 0.5 * (self.C[0] + self.C[1]) @ (s1 - s2)
        return P, Q

    def _forces(self, role: int, algorithm: str, split: bool, unit: dict, bound: np.ndarray) -> np.ndarray:
        """How the forces (2m, k) that solve the QP of `role` follow the state."""
        m, C = len(self.pressed), self.C[role - 1]
        d = -unit["lam"] if role == 1 else unit["lam"]
        s = np.zeros_like(d)
        s[m:] = unit.get(f"s{role}t", 0.0)
        free = np.ones(2 * m, bool)
        if role == 2:
            free[:m] = self.pressed
        if role == friction_role(algorithm):
            free[m:] = self.sticking
        normal = np.arange(2 * m) < m
        for block in (normal, ~normal) if split else (np.ones(2 * m, bool),):
            tangential = block & ~normal & ~free
            s[tangential] = bound[tangential[m:]]
            inner = block & free
            s[inner] = np.linalg.solve(C[np.ix_(inner, inner)], d[inner] - C[np.ix_(inner, ~inner)] @ s[~inner])
        return s


def linearise(assembly: Assembly) -> Linearisation:
    """Solve `assembly` exactly and linearise there. Collective; all m nodes must be able to slide."""
    newton, (interface,) = Newton(assembly.joint, MOST_STEPS), assembly.member.interfaces
    ended = newton.run(SOLVED)
    if ended != "converged":
        raise RuntimeError(f"the solution at which to linearise: {ended}")
    m, law = interface.m, interface.law
    forces, g = newton.forces, newton.bound
    normal, tangential = forces[:m], forces[m:]
    sticking = np.abs(tangential) < g - ON_BOUND * g.max()
    slip = np.where(sticking, 0.0, np.sign(tangential) * law.slope(normal))
    dense = dict(assembly.world.allgather((interface.side(assembly.member.name), assembly.member.C.dense())))
    return Linearisation((dense[0], dense[1]),
                         normal > ON_BOUND * normal.max(), sticking, slip)


def dominant(P: np.ndarray, Q: np.ndarray, theta: float) -> complex:
    """The eigenvalue of P + θ Q of largest modulus, with imaginary part ≥ 0."""
    values = np.linalg.eigvals(P + theta * Q)
    value = values[np.argmax(np.abs(values))]
    return complex(value.real, abs(value.imag))


def largest_theta(P: np.ndarray, Q: np.ndarray, limit: float = 4.0, precision: float = 1e-3) -> float:
    """The θ at which the spectral radius of P + θ Q first reaches one; `limit` if it stays below."""
    low = high = 0.0
    while high < limit:
        low, high = high, min(high + 0.1, limit)
        if abs(dominant(P, Q, high)) >= 1.0:
            break
    else:
        return limit
    while high - low > precision:
        middle = (low + high) / 2
        low, high = (middle, high) if abs(dominant(P, Q, middle)) < 1.0 else (low, middle)
    return low


# Sensitivity to theta

THETAS = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2)
MOST = 200
"""A run that needs more outer iterations counts as not converging."""

LIMIT_KEY = ("law", "algorithm", "splitting", "N")
THETA_KEY = (*LIMIT_KEY, "theta")
THETA_MEASURED = ("stopped", "certified", "outer_iterations", "n_A")
LIMITS = ("factor", "pair_modulus", "half_period", "theta_limit", "stick_smallest", "stick_largest", "observed_factor",
          "observed_limit")
UNSPLIT = {"algorithm": "original", "splitting": "none"}
MARKERS = {"diverged": "x", "max_iterations": "o", "failed": "*", "converged": "s"}
"""How a run without a certified answer is drawn, by why it stopped."""
SMALL = {"markersize": 4, "markerfacecolor": "none", "markeredgewidth": 0.9, "linestyle": ""}
COLOURS = dict(zip(SPLITTINGS, ("#1b4f8f", "#c8501e", "#3a8f5a", "#8a4fa3"), strict=True))


def try_theta(assembly: Assembly, algorithm: str, splitting: str, theta: float) -> Row:
    """How a run at `theta` ended. Collective.

    Its outer iterations are counted until the update first falls below the tolerance; the run continues after that
    if its certificate fails.
    """
    method = variant(assembly.scene, algorithm, splitting, theta=theta, max_iterations=MOST)
    try:
        solution = solve(assembly, method)
    except SolverError as error:  # the same on both ranks, or the study has to end
        if not error.agreed:
            raise
        return {"stopped": "failed", "certified": False, "outer_iterations": MOST, "n_A": 0}
    history = solution.outer.history
    reached = next((step for step in history if step.update <= method.tolerance), history[-1])
    return {"stopped": solution.stopped, "certified": solution.certified, "outer_iterations": reached.iteration,
            "n_A": history[-1].n_A}


def observed_factor(assembly: Assembly, theta: float) -> float:
    """By how much the update shrinks per iteration in the end: slope of its logarithm over the last third."""
    method = variant(assembly.scene, **UNSPLIT, theta=theta, tolerance=1e-10, inner_precision=0.01)
    updates = np.log([step.update for step in solve(assembly, method).outer.history])
    tail = updates[-len(updates) // 3:]
    return float(np.exp(np.polyfit(np.arange(len(tail)), tail, 1)[0]))


def observed_limit(assembly: Assembly, precision: float) -> float:
    """The largest theta with a certified answer within MOST iterations, by bisection from [0.1, 1.5]."""
    low, high = 0.1, 1.5
    while high - low > precision:
        middle = (low + high) / 2
        low, high = (middle, high) if try_theta(assembly, **UNSPLIT, theta=middle)["certified"] else (low, middle)
    return low


def limits(assembly: Assembly, algorithm: str, splitting: str, precision: float) -> Row:
    """Convergence of a variant on one mesh, predicted; for the unsplit original also observed. Collective."""
    linear, row = linearise(assembly), dict.fromkeys(LIMITS, "")
    if assembly.world.rank == 0:
        P, Q = linear.response(algorithm, splitting)
        values = np.linalg.eigvals(P + 0.2 * Q)
        pairs = values[np.angle(values) > np.pi / 20]
        pairs = pairs[np.angle(pairs) < np.pi - 1e-6]
        stick = linear.all_sticking()
        row |= {"factor": abs(dominant(P, Q, 0.2)), "theta_limit": largest_theta(P, Q), "stick_smallest": stick[0],
                "stick_largest": stick[-1]}
        slow = pairs[np.argmax(np.abs(pairs))] if len(pairs) else 0.0
        if abs(slow) > 0.5 * row["factor"]:
            row |= {"pair_modulus": abs(slow), "half_period": np.pi / np.angle(slow)}
    row = assembly.world.bcast(row)
    if (algorithm, splitting) == tuple(UNSPLIT.values()):
        row["observed_factor"] = observed_factor(assembly, 0.2)
        row["observed_limit"] = observed_limit(assembly, precision)
    return {name: round(float(value), 5) if isinstance(value, float) else value for name, value in row.items()}


def theta_page(runs: list[Row], limit_rows: list[Row]) -> str:
    """The page, as Markdown."""
    def sticking(r: Row) -> list:
        c2 = (r["stick_largest"] + 1) ** 2 / 8
        numbers = (r["stick_smallest"], r["stick_largest"], 2 / r["stick_largest"], r["theta_limit"],
                   r["observed_limit"], r["factor"], r["observed_factor"])
        return [r["law"], r["N"], *(f"{number:.3f}" for number in numbers), f"{c2:.2f}", f"{1 / c2:.3f}"]

    complete = sorted({r["N"] for r in limit_rows if r["algorithm"] == "modified"})
    meshes = ", ".join(map(str, complete))

    def local(law: str, algorithm: str, splitting: str) -> list:
        own = where(limit_rows, law=law, algorithm=algorithm, splitting=splitting)
        own = sorted((r for r in own if r["N"] in complete), key=lambda r: r["N"])
        last = own[-1]
        pair = (f"{last['pair_modulus']:.3f}", f"{last['half_period']:.1f}") if last["half_period"] else ("–", "–")
        return [law, algorithm, splitting, ", ".join(f"{r['theta_limit']:.3f}" for r in own),
                f"{last['factor']:.3f}", *pair]

    unsplit = sorted(where(limit_rows, **UNSPLIT), key=lambda r: (LAWS.index(r["law"]), r["N"]))
    pictures = [line for law in LAWS for line in (f"![outer iterations against θ, {law}](figures/theta_{law}.png)", "")]
    return "\n".join([
        "# Sensitivity to θ", "", "Generated by `scripts/study theta_sensitivity`, on the scenes "
        "`configs/pinched_blocks_*.toml`.", "", *statement(runs, limit_rows), "", *pictures,
        "## Where convergence ends, by mesh", "",
        "Original algorithm without splitting. *All nodes stick*: extreme eigenvalues of "
        "M = ½ (C₁+C₂)(C₁⁻¹+C₂⁻¹); T_θ = I − θM, so that 2/λ_max is the exact limit of that linear case. "
        "*At the solution*: spectral radius of the iteration linearised there, with the nodes that are open, "
        "slip and stick. *Observed*: the tail of a run, and bisection for the largest θ with a certified answer "
        f"within {MOST} iterations. c² is the smallest constant with which the theorem's factor 1 − θ + c²θ² "
        "bounds that of the sticking case for all θ, (λ_max + 1)²/8, and 1/c² the theorem's θ*.", "",
        *table(["law", "N", "λ_min", "λ_max", "2/λ_max", "limit at the solution", "observed limit",
                "factor at θ = 0.2, predicted", "observed", "c²", "1/c²"], map(sticking, unsplit)),
        "## The variants", "",
        f"Largest θ that converges locally, from the spectral radius of the linearised iteration, on the meshes "
        f"N = {meshes}; its factor at θ = 0.2 on the finest of them; and the slowest pair of complex eigenvalues "
        "there, if one turns within twenty iterations: its modulus, and the number of iterations after which its "
        "contribution changes sign. Such a pair makes the update swing, with a dip every half period; in which "
        "of these dips the update first falls below the tolerance decides k.", "",
        *table(["law", "algorithm", "splitting", f"θ limit, N = {meshes}", "factor", "pair: modulus", "half period"],
               (local(law, *kind) for law in LAWS for kind in VARIANTS))])


def statement(runs: list[Row], limit_rows: list[Row]) -> list[str]:
    """What was found, in words with computed numbers."""
    def largest(algorithm: str, splitting: str) -> str:
        """Range over laws and meshes of the largest θ of the study up to which all runs are certified."""
        found = []
        for law in LAWS:
            for N in sorted({r["N"] for r in runs}):
                own = sorted((r["theta"], r["certified"])
                             for r in where(runs, law=law, algorithm=algorithm, splitting=splitting, N=N))
                good = [theta for i, (theta, _) in enumerate(own) if all(ok for _, ok in own[:i + 1])]
                found.append(max(good, default=0.0))
        return f"{min(found):g}" if min(found) == max(found) else f"{min(found):g}–{max(found):g}"

    unsplit = where(limit_rows, **UNSPLIT)
    sizes = sorted({r["N"] for r in unsplit})
    lam = [where(unsplit, N=N)[0]["stick_largest"] for N in sizes]
    seen, predicted = ([r[name] for r in unsplit] for name in ("observed_limit", "theta_limit"))
    above = where(runs, **UNSPLIT, theta=0.5)

    def words(splitting: str) -> str:
        return "without splitting" if splitting == "none" else f"splitting in {splitting}"

    return [
        "**In short.** Largest θ of the study up to which every run gave a certified answer within "
        f"{MOST} iterations (range over laws and meshes): " + "; ".join(
            f"{a}, {words(s)}: {largest(a, s)}" for a, s in VARIANTS) + ". "
        f"At θ = 0.5 the unsplit original algorithm fails in {sum(not r['certified'] for r in above)} of {len(above)} "
        f"runs, reported as {', '.join(sorted({r['stopped'] for r in above}))}.", "",
        f"For it the limit, over N = {', '.join(str(N) for N in sizes)} and both laws, is {min(predicted):.3f}–"
        f"{max(predicted):.3f} by linearisation and {min(seen):.3f}–{max(seen):.3f} observed. With all nodes sticking "
        f"it is 2/λ_max = {', '.join(f'{2 / x:.4f}' for x in lam)} on these meshes: it settles, so that θ* does not "
        "shrink with h, as the theorem says. The theorem's upper bound, θ* < 4, is an order of magnitude above where "
        f"convergence ends; its own factor gives θ* = 1/c² = {8 / (max(lam) + 1) ** 2:.3f} on the finest mesh. "
        f"The smallest eigenvalue is {min(r['stick_smallest'] for r in unsplit):.3f} on every mesh, so that the best "
        f"θ of the sticking case is 2/(λ_min + λ_max) = {2 / (2 + max(lam)):.3f}, with a factor of "
        f"{(max(lam) - 2) / (max(lam) + 2):.3f} per iteration.",
    ]


def draw(law: str, runs: list[Row], limit_rows: list[Row]):
    """A row of panels per algorithm, a column per mesh; a figure."""
    import matplotlib.pyplot as plt
    from matplotlib.lines import Line2D

    sizes = sorted({r["N"] for r in runs})
    figure, axes = plt.subplots(2, len(sizes), sharex=True, sharey=True, figsize=(3.7 * len(sizes), 6.6), squeeze=False)
    for panel, (algorithm, N) in zip(axes.flat, ((a, N) for a in ALGORITHMS for N in sizes), strict=True):
        _draw_panel(panel, *(where(rows, law=law, algorithm=algorithm, N=N) for rows in (runs, limit_rows)))
        panel.set_title(f"{algorithm}, N = {N}")
    for panel in axes[:, 0]:
        panel.set_ylabel("outer iterations k")
    for panel in axes[1]:
        panel.set_xlabel("θ")
    handles = [Line2D([], [], color=COLOURS[s], marker="o", markersize=4,
                      label="no splitting" if s == "none" else f"splitting in {s}") for s in SPLITTINGS]
    handles += [Line2D([], [], color="black", marker=MARKERS[stopped], label=words, **SMALL) for stopped, words
                in (("diverged", "diverged"), ("max_iterations", f"not converged in {MOST} iterations"))]
    handles += [Line2D([], [], color="black", linestyle=":", label="limit by linearisation")]
    figure.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=4)
    figure.suptitle(f"Sensitivity with respect to θ – {law.capitalize()} friction")
    return figure


def _draw_panel(panel, runs: list[Row], limit_rows: list[Row]) -> None:
    top = MOST * 1.15
    for i, splitting in enumerate(SPLITTINGS):
        own = sorted(where(runs, splitting=splitting), key=lambda r: r["theta"])
        k = [r["outer_iterations"] if r["certified"] else np.nan for r in own]
        panel.plot([r["theta"] for r in own], k, "o-", color=COLOURS[splitting], markersize=4, linewidth=1.2)
        height = top * 1.15**i  # a line of markers for each splitting, so that none hides another
        for stopped, marker in MARKERS.items():
            lost = [r["theta"] for r in where(own, certified=False, stopped=stopped)]
            if lost:
                panel.plot(lost, np.full(len(lost), height), marker, color=COLOURS[splitting], **SMALL)
        for r in where(limit_rows, splitting=splitting):
            panel.axvline(r["theta_limit"], color=COLOURS[splitting], linestyle=":", linewidth=1)
    panel.set_yscale("log")
    panel.axhspan(MOST * 1.06, top * 1.15**4, color="#f1f1f1", linewidth=0, zorder=0)
    panel.set_ylim(10, top * 1.15**4)
    ticks = [10, 20, 50, 100, 200]
    panel.set_yticks(ticks, labels=[str(t) for t in ticks])
    panel.minorticks_off()
    panel.set_xlim(0.0, max(THETAS) + 0.04)
    panel.set_xticks(np.arange(0.0, max(THETAS) + 0.04, 0.2))


@on_two_ranks
def theta_sensitivity(world: MPI.Comm) -> None:
    """The paper's two figures: outer iterations against theta, for the eight variants of each law.

    Also: up to which theta each variant converges and how fast, predicted by the iteration linearised at the solution
    and observed, by mesh. Writes theta.csv, theta_limits.csv, theta.md and figures/theta_*.png.
    """
    parser = arguments(theta_sensitivity.__doc__, "theta")
    parser.add_argument("--sizes", type=int, nargs="+", default=(6, 22, 38), metavar="N",
                        help="meshes of the figures, squares of side 1/N (default: %(default)s)")
    parser.add_argument("--limit-sizes", type=int, nargs="+", default=SIZES, metavar="N",
                        help="meshes on which the limit of the unsplit original is looked for (default: %(default)s)")
    parser.add_argument("--thetas", type=float, nargs="+", default=THETAS, metavar="THETA", help="default: %(default)s")
    parser.add_argument("--precision", type=float, default=0.005, help="of observed limits (default: %(default)s)")
    options = parser.parse_args()

    assembly = one_mesh(world)
    runs = Ledger(world, options.output / "theta.csv", THETA_KEY, THETA_MEASURED).fill(
        [(law, *kind, N, theta) for N in options.sizes for law in LAWS for kind in VARIANTS
         for theta in options.thetas],
        lambda law, algorithm, splitting, N, theta: try_theta(assembly(law, N), algorithm, splitting, theta))
    limit_rows = Ledger(world, options.output / "theta_limits.csv", LIMIT_KEY, LIMITS).fill(
        [(law, *kind, N) for N in sorted({*options.sizes, *options.limit_sizes}) for law in LAWS for kind in VARIANTS
         if kind == tuple(UNSPLIT.values()) or N in options.sizes],
        lambda law, algorithm, splitting, N: limits(assembly(law, N), algorithm, splitting, options.precision))
    if world.rank == 0:
        publish("theta.md", theta_page(runs, limit_rows), options.output, complete=False)
        save_figures(options.output / "figures",
                     {f"theta_{law}": functools.partial(draw, law, runs, limit_rows) for law in LAWS})
        print("\n".join(statement(runs, limit_rows)), f"\n\nPage and figures are in {options.output}")


# Precision of the inner solves

FIXED = "fixed"
ETAS = (1.0, 0.3, 0.1, 0.05, 0.03, 0.02, 0.01, 0.001, FIXED)
USUAL = 0.1
"""The program's default, with which the others are compared."""

REPEATS = 6
SHOWN = (("original", "none"), ("original", "step1+2"))
PRECISION_KEY = ("N", "law", "algorithm", "splitting", "eta")


def run_repeatedly(assembly: Assembly, algorithm: str, splitting: str, eta: float | str, repeats: int) -> Row:
    """n_A of the first run, and the outer iterations of all, 0 for one that does not converge. Collective."""
    row = {}
    for repeat in range(repeats):
        theta = assembly.scene.method.theta * (1 + repeat * 1e-13)
        method = variant(assembly.scene, algorithm, splitting, theta=theta, max_iterations=MOST, inner_precision=eta)
        assembly.member.restart()
        outer = PublishedIteration(assembly, method)
        try:
            converged = outer.run(method.tolerance) == "converged"
        except SolverError as error:  # the same on both ranks, or the study has to end
            if not error.agreed:
                raise
            converged = False
        row[f"k_{repeat}"] = len(outer.history) if converged else 0
        if repeat == 0:
            row["n_A"] = outer.history[-1].n_A
    return row


def precision_page(rows: list[Row], N: int) -> str:
    """The two tables, as Markdown."""
    rows = where(rows, N=N)
    etas = [eta for eta in ETAS if where(rows, eta=eta)]
    shown = [(law, *kind) for law in LAWS if where(rows, law=law) for kind in SHOWN]
    repeats = len(_iterations(rows[0]))

    def cell(eta: float | str, law: str, algorithm: str, splitting: str) -> str:
        (row,) = where(rows, eta=eta, law=law, algorithm=algorithm, splitting=splitting)
        return f"{_words(_iterations(row))} · {row['n_A']}"

    def together(eta: float | str) -> list[str]:
        own = where(rows, eta=eta)
        ks = [_iterations(row) for row in own]
        cost, base = (sum(row["n_A"] for row in some) for some in (own, where(rows, eta=USUAL)))
        spread = max((max(k) - min(k)) / (max(k) + min(k)) for k in ks if min(k) > 0)
        return [_label(eta), f"{cost / base:.2f}", f"{sum(max(k) > min(k) for k in ks)} of {len(ks)}",
                f"±{spread:.0%}", f"{sum(k.count(0) for k in ks)} of {len(ks) * repeats}"]

    header = [f"{law}, {a}, {'no splitting' if s == 'none' else s}" for law, a, s in shown]
    return "\n".join([
        "# Precision of the inner solves", "", "Generated by `scripts/study inner_precision`.", "",
        f"N = {N}, θ = 0.2, tolerance 1e-4. k (range over {repeats} runs whose θ differs in the thirteenth digit, "
        "where they differ) · n_A of the first run.", "",
        *table(["η", *header], ([_label(eta), *(cell(eta, *case) for case in shown)] for eta in etas)),
        "All variants together: multiplications relative to η = 0.1 (sum over the variants), in how "
        "many variants k depends on rounding errors, and by how much at most (half the range over its middle).", "",
        *table(["η", "n_A", "variants whose k depends on rounding", "largest spread", "runs that do not converge"],
               map(together, etas))])


def _iterations(row: Row) -> list[int]:
    return [value for name, value in row.items() if name.startswith("k_")]


def _label(eta: float | str) -> str:
    return "fixed, as η = 0.1 ends" if eta == FIXED else f"{eta:g}"


def _words(k: list[int]) -> str:
    if 0 in k:
        return f"{k.count(0)} of {len(k)} do not converge in {MOST}"
    return f"{k[0]}" + (f" ({min(k)}–{max(k)})" if max(k) > min(k) else "")


@on_two_ranks
def inner_precision(world: MPI.Comm) -> None:
    """What the adaptive inner precision saves, and what it costs in reliability.

    The inner solves of outer iteration k are as precise as eta times the last outer update. Runs with several eta, and
    with one fixed precision, which eta = 0.1 would reach at the end. Each run is repeated with theta changed in the
    thirteenth digit: where k changes with it, rounding errors decide. Writes inner_precision.csv and .md.
    """
    parser = arguments(inner_precision.__doc__, "inner_precision")
    parser.add_argument("--size", type=int, default=22, metavar="N", help="mesh (default: %(default)s)")
    parser.add_argument("--laws", nargs="+", default=LAWS, choices=LAWS, metavar="LAW")
    parser.add_argument("--etas", nargs="+", default=ETAS, metavar="ETA", type=lambda eta: eta if eta == FIXED else
                        float(eta), help=f"{USUAL} is solved in any case (default: %(default)s)")
    parser.add_argument("--repeats", type=int, default=REPEATS, metavar="R", help="default: %(default)s")
    options = parser.parse_args()

    assembly = one_mesh(world, options.laws)
    measured = "n_A", *(f"k_{i}" for i in range(options.repeats))
    rows = Ledger(world, options.output / "inner_precision.csv", PRECISION_KEY, measured).fill(
        [(options.size, law, *kind, eta) for law in options.laws for kind in VARIANTS for eta in ETAS
         if eta in (USUAL, *options.etas)],
        lambda N, law, *case: run_repeatedly(assembly(law, N), *case, options.repeats))
    if world.rank == 0:
        text = precision_page(rows, options.size)
        publish("inner_precision.md", text, options.output, complete=False)
        print(text)


# QP solvers

TYPES = ("python", "gpcg", "tron", "bntr", "bncg", "blmvm", "bqpip")
QP_COLUMNS = ("type", "outer_iteration", "multiplications", "seconds", "failure")


class Recorder(QPSolver):
    """Solves QPs, and keeps with what arguments `solve` was called."""

    def __init__(self) -> None:
        super().__init__()
        self.calls: list[tuple] = []

    def solve(self, *call) -> QPResult:
        self.calls.append(call)
        return super().solve(*call)


def record_qps(assembly: Assembly) -> tuple[list[tuple], int]:
    """The QPs of this rank's body in a run, as arguments of `QPSolver.solve`, and its role. Collective."""
    method = variant(assembly.scene, "original", "none")
    outer = PublishedIteration(assembly, method)
    outer.subproblem.solver = recorder = Recorder()
    ended = outer.run(method.tolerance)
    if ended != "converged":
        raise RuntimeError(f"the run to record ended with: {ended}")
    return recorder.calls, outer.subproblem.role


def compare_types(assembly: Assembly, calls: list[tuple], types: list[str]) -> list[Row]:
    """Every QP by every type; making the dense matrix of bqpip is a row of its own, iteration 0."""
    rows, count = [], assembly.member.C.count

    def add(kind: str, iteration: int, action: Callable[[], object]) -> None:
        count.clear()
        start, failure = time.perf_counter(), ""
        try:
            action()
        except SolverError as error:
            failure = str(error)
        except PETSc.Error as error:
            failure = " ".join(str(error).split()[-20:])
        seconds = round(time.perf_counter() - start, 5)
        rows.append(dict(zip(QP_COLUMNS, (kind, iteration, count.total(), seconds, failure), strict=True)))

    for kind in types:
        solver = QPSolver()
        solver.type = kind
        if kind == "bqpip":
            add(kind, 0, assembly.member.C.dense)
        for iteration, call in enumerate(calls, 1):
            add(kind, iteration, lambda call=call, solver=solver: solver.solve(*call))
    return rows


def qp_page(rows: list[Row], N: int, law: str) -> str:
    """The table, as Markdown."""
    types = list(dict.fromkeys(row["type"] for row in rows))
    number = max(row["outer_iteration"] for row in rows)
    whole = {kind: [row for row in where(rows, type=kind) if row["outer_iteration"]] for kind in types}

    def line(k: int) -> list[str]:
        return [_qp_cell(where(rows, type=kind, outer_iteration=k)) for kind in types]

    lines = ["# QP solvers", "", "Generated by `scripts/study compare_qp_solvers`.", "",
             f"QPs of role 2, original algorithm, {law.capitalize()} friction, N = {N} ({number} QPs). "
             "Multiplications by A⁻¹ (milliseconds), each multiplication a solve with the factored stiffness; "
             "`python` is MPRGP.", "",
             *table(["outer iteration", *types], [
                 *([k, *line(k)] for k in (1, 2, 5, 10, 20, 30, 40) if k <= number),
                 [f"all {number}", *(f"**{_qp_cell(whole[kind])}**" for kind in types)],
                 ["once, for the dense matrix", *line(0)]])]
    failed = {kind: [row for row in own if row["failure"]] for kind, own in whole.items()}
    lines += [f"- {kind} failed on {len(own)} of {number}, first: {own[0]['failure']}"
              for kind, own in failed.items() if own]
    if not any(failed.values()):
        lines.append("No type failed on any QP.")
    return "\n".join([*lines, ""])


def _qp_cell(rows: list[Row]) -> str:
    """Sums over `rows`, or that something failed."""
    if not rows:
        return "–"
    failed = sum(bool(row["failure"]) for row in rows)
    text = f"{sum(row['multiplications'] for row in rows)} ({1e3 * sum(row['seconds'] for row in rows):.0f})"
    if failed:
        return f"failed ({text})" if len(rows) == 1 else f"{failed} failed ({text})"
    return text


@on_two_ranks
def compare_qp_solvers(world: MPI.Comm) -> None:
    """What each TAO type costs on the QPs of a real run.

    Records the QPs of role 2 (contact and friction) in a run of the original algorithm. Solves each with every type
    and prints multiplications by the inverse stiffness and time; where a type fails, the page says why. Writes
    qp_solvers.md and qp_solvers.csv.
    """
    parser = arguments(compare_qp_solvers.__doc__, "qp_solvers")
    parser.add_argument("--size", type=int, default=22, metavar="N", help="mesh (default: %(default)s)")
    parser.add_argument("--law", default="coulomb", choices=LAWS)
    parser.add_argument("--types", nargs="+", default=TYPES, metavar="TYPE", help="TAO types (default: %(default)s)")
    options = parser.parse_args()

    assembly = prepare(world, pinched_blocks(options.law, options.size, "method.compliance=direct"))
    calls, role = record_qps(assembly)
    (rows,) = filter(None, world.allgather(compare_types(assembly, calls, options.types) if role == 2 else None))
    if world.rank == 0:
        options.output.mkdir(parents=True, exist_ok=True)
        with open(options.output / "qp_solvers.csv", "w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, QP_COLUMNS)
            writer.writeheader()
            writer.writerows(rows)
        text = qp_page(rows, options.size, options.law)
        publish("qp_solvers.md", text, options.output, complete=False)
        print(text)


# More than two bodies

def operators(assembly: Assembly) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """C, S and the displacements Z (size, 3 per interface) that a coarse problem takes."""
    space = assembly.space
    C, S, columns = np.zeros((space.size, space.size)), np.zeros((space.size, space.size)), []
    for body in assembly.bodies:
        own, member = body.member.dense(), body.member
        at = np.concatenate([np.arange(space.size)[space.parts[name]] for name in member.parts])
        C[np.ix_(at, at)] += own
        S[np.ix_(at, at)] += np.linalg.inv(own)
    for interface, part in space.each():
        along = np.linalg.norm(interface.xy - interface.xy[0], axis=1)
        Z = np.zeros((space.size, 3))
        Z[part.start:part.start + interface.m, :2] = np.stack([np.ones(interface.m), along], axis=1)
        Z[part.start + interface.m:part.stop, 2] = 1.0
        columns.append(Z)
    return C, S, np.hstack(columns)


def published_beyond_two() -> None:
    """Where the linear part of the published iteration converges with more than two bodies.

    Where all nodes stick, an iteration takes θ/2 · C S e from the error e of the interfaces' displacements. C and S are
    sums over the bodies: of their contact compliances C_a, and of the inverses of these. Prints for stacks of K clamped
    blocks the ends of the spectrum of C S / 4, the θ at which the iteration ceases to converge, and its best rate: as
    it is, and with three displacements of each interface (two translations, a rotation) solved for exactly each time.
    """
    parser = arguments(published_beyond_two.__doc__)
    parser.add_argument("--bodies", nargs="+", type=int, default=[2, 3, 4, 6, 10], metavar="K")
    parser.add_argument("--divisions", type=int, default=6, metavar="N")
    options = parser.parse_args()
    rows = []
    for K in options.bodies:
        C, S, Z = operators(prepare_scene(MPI.COMM_SELF, stack(K, True, options.divisions)))
        P = np.eye(len(C)) - Z @ np.linalg.solve(Z.T @ S @ Z, Z.T @ S)
        for what, T in (("none", C @ S / 4), ("3 displacements", P @ C @ S / 4)):
            found = np.sort(np.linalg.eigvals(T).real)
            low, high = found[0 if what == "none" else Z.shape[1]], found[-1]
            rows.append([K, what, f"{low:.2f}", f"{high:.1f}", f"{1 / high:.3f}", f"{(high - low) / (high + low):.3f}"])
    print("\n".join(table(["bodies", "coarse correction", "smallest", "largest", "θ below", "best rate"], rows)))


STUDIES = (theta_sensitivity, inner_precision, compare_qp_solvers, published_beyond_two)

if __name__ == "__main__":
    start(*STUDIES)
