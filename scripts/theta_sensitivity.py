#!/usr/bin/env bash
"exec" "${0%/*}/on_two_ranks.sh" "$0" "$@"  # to Python, a string

__doc__ = """The paper's two figures: outer iterations against theta, for the eight variants of each law.

Also: up to which theta each variant converges and how fast, predicted by the iteration linearised at
the solution (contraction.py) and observed, by mesh. Writes to the folder --output: theta.csv and
theta_limits.csv (a line per run, written at once, so that an interrupted study continues), theta.md,
figures/theta_*.png.
"""

import functools

import numpy as np
from contraction import dominant, largest_theta, linearise
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
    publish,
    save_figures,
    table,
    variant,
    where,
)
from mpi4py import MPI

from ddmpi.coupling.assembly import Assembly
from ddmpi.errors import SolverError
from ddmpi.run.solve import solve

THETAS = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2)
MOST = 200
"""A run that needs more outer iterations counts as not converging."""

LIMIT_KEY = ("law", "algorithm", "splitting", "N")
KEY = (*LIMIT_KEY, "theta")
MEASURED = ("stopped", "certified", "outer_iterations", "n_A")
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


def page(runs: list[Row], limit_rows: list[Row]) -> str:
    """The Markdown page."""
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
        "# Sensitivity to θ", "", "Generated by `scripts/theta_sensitivity.py`, on the scenes "
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
def main(world: MPI.Comm) -> None:
    parser = arguments(__doc__, "theta")
    parser.add_argument("--sizes", type=int, nargs="+", default=(6, 22, 38), metavar="N",
                        help="meshes of the figures, squares of side 1/N (default: %(default)s)")
    parser.add_argument("--limit-sizes", type=int, nargs="+", default=SIZES, metavar="N",
                        help="meshes on which the limit of the unsplit original is looked for (default: %(default)s)")
    parser.add_argument("--thetas", type=float, nargs="+", default=THETAS, metavar="THETA", help="default: %(default)s")
    parser.add_argument("--precision", type=float, default=0.005, help="of observed limits (default: %(default)s)")
    options = parser.parse_args()

    assembly = one_mesh(world)
    runs = Ledger(world, options.output / "theta.csv", KEY, MEASURED).fill(
        [(law, *kind, N, theta) for N in options.sizes for law in LAWS for kind in VARIANTS
         for theta in options.thetas],
        lambda law, algorithm, splitting, N, theta: try_theta(assembly(law, N), algorithm, splitting, theta))
    limit_rows = Ledger(world, options.output / "theta_limits.csv", LIMIT_KEY, LIMITS).fill(
        [(law, *kind, N) for N in sorted({*options.sizes, *options.limit_sizes}) for law in LAWS for kind in VARIANTS
         if kind == tuple(UNSPLIT.values()) or N in options.sizes],
        lambda law, algorithm, splitting, N: limits(assembly(law, N), algorithm, splitting, options.precision))
    if world.rank == 0:
        publish("theta.md", page(runs, limit_rows), options.output, complete=False)
        save_figures(options.output / "figures",
                     {f"theta_{law}": functools.partial(draw, law, runs, limit_rows) for law in LAWS})
        print("\n".join(statement(runs, limit_rows)), f"\n\nPage and figures are in {options.output}")


main()
