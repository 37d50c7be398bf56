"""What thousands of ranks would do: a model of weak scaling, from constants measured here.

A wall of bricks in running bond, a rank for each brick. The study measures

  walls     walls of 5 to 200 bricks on one rank: Newton steps, products, coarse unknowns, seconds of each phase a brick
  coarse    the coarse problem of larger walls, factored and solved as the program does it
  files     seconds that writing results takes for each brick, most of them on the first rank
  messages  latency and bandwidth between two ranks of this machine, and of a reduction

and predicts from these the seconds of a run on R ranks. Latency and bandwidth of the cluster are given by --latency
and --bandwidth: what memory does between two ranks of one machine is no measure of a network.

Writes to the folder --output a CSV file for each section (an interrupted study continues) and scale_model.md, with a
figure; once all sections are there also to docs/tables/.
"""

import json
import math
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import scipy.sparse as sparse
from assembly_study import wall
from experiment import Ledger, Row, arguments, publish, save_figures, table, where
from mpi4py import MPI
from scenes import run_command, run_python, to_toml, write_scene
from scipy.optimize import nnls
from scipy.sparse.linalg import splu

import ddmpi

PAGE = "scale_model.md"
WALLS = [(2, 2, 4), (4, 3, 4), (6, 4, 4), (8, 7, 4), (10, 10, 4), (14, 14, 4), (2, 2, 16), (2, 2, 32), (2, 2, 64),
         (2, 2, 128)]
"""Rows, columns, and divisions of a unit of length."""

BRICKS = (100, 1000, 10000, 30000)
"""Of the walls whose coarse problem is measured alone."""

RANKS = (16, 64, 256, 1024, 4096, 10000)
SIZES = (1e4, 1e5, 1e6)
"""Ranks and unknowns a body of the prediction."""

NEIGHBOURS, ENTRY = 6, 16
"""Partners of a brick; bytes of an entry of the coarse matrix, as it is sent."""

SECTIONS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "walls": (("rows", "columns", "N"), ("bricks", "n", "steps", "products", "coarse", "assemble", "factor", "outer",
                                         "rest")),
    "coarse": (("bricks",), ("unknowns", "entries", "factor", "solve", "mebibytes")),
    "files": (("bricks",), ("turn",)),
    "messages": (("ranks",), ("latency", "bandwidth", "reduction")),
}


# Measurements

def measure_wall(rows: int, columns: int, N: int) -> Row:
    """Seconds, products and unknowns n are of one brick."""
    answer = ddmpi.solve(to_toml(wall(rows, columns, N)), MPI.COMM_SELF)
    if not answer.certified:
        sys.exit(f"a wall of {rows} rows: {answer.reason}")
    summary, outer = answer.summary, answer.solved.solution.outer
    bricks, seconds = len(summary["bodies"]), summary["seconds"]
    rest = sum(seconds.get(phase, 0.0) for phase in ("mesh", "recover", "estimate"))
    return {"bricks": bricks, "n": summary["n"] / bricks, "steps": len(outer.history),
            "products": summary["n_A"] / bricks, "coarse": outer._preconditioner.motions.size,
            "rest": rest / bricks} | {phase: seconds[phase] / bricks for phase in ("assemble", "factor", "outer")}


def coarse_matrix(bricks: int, each: int = 5) -> sparse.csc_matrix:
    """A positive definite matrix with the graph of a wall of so many bricks, `each` motions a brick."""
    columns = math.isqrt(bricks)
    number = np.arange(columns * math.ceil(bricks / columns)).reshape(-1, columns)
    pairs = [np.stack([one.ravel(), other.ravel()]) for one, other in
             ((number[:, 1:], number[:, :-1]), (number[1:], number[:-1]), (number[1:, 1:], number[:-1, :-1]))]
    i, j = np.hstack(pairs)
    size = number.size
    graph = sparse.coo_matrix((-np.ones(len(i)), (i, j)), (size, size))
    graph = graph + graph.T + sparse.diags(np.full(size, 2.0 * NEIGHBOURS))
    block = np.eye(each) + 0.1 * np.random.default_rng(0).standard_normal((each, each))
    return sparse.kron(graph, block @ block.T).tocsc()


def measure_coarse(bricks: int) -> Row:
    S = coarse_matrix(bricks)
    start = time.perf_counter()
    factors = splu(S, permc_spec="MMD_AT_PLUS_A")
    factored = time.perf_counter()
    for _ in range(5):
        factors.solve(np.ones(S.shape[0]))
    return {"unknowns": S.shape[0], "entries": S.nnz, "factor": factored - start,
            "solve": (time.perf_counter() - factored) / 5,
            "mebibytes": 12 * (factors.L.nnz + factors.U.nnz) / 2**20}


def measure_files(bricks: int) -> Row:
    """Seconds of writing all results without pictures, a brick, on one rank."""
    with tempfile.TemporaryDirectory() as place:
        path = write_scene(wall(2, bricks // 2, 4), Path(place) / "scene.toml")
        run = run_command(path, Path(place) / "out", "--no-figures", ranks=1, limit=600)
        if run.code:
            sys.exit(run.output)
        return {"turn": run.summary["seconds"]["output"] / len(run.summary["bodies"])}


def measure_messages(ranks: int) -> Row:
    child = run_python(["-m", "mpi4py", __file__, "--time-messages"], ranks=ranks, limit=120)
    if child.code:
        sys.exit(child.output)
    return json.loads(child.stdout.splitlines()[-1])


def time_messages(world: MPI.Comm, repetitions: int = 200) -> None:
    """What the ranks of `measure_messages` do; the smallest times, from rank 0."""
    def smallest(work, times: int) -> float:
        found = []
        for _ in range(times):
            world.Barrier()
            start = time.perf_counter()
            work()
            found.append(time.perf_counter() - start)
        return min(found)

    def there_and_back(data: np.ndarray) -> None:
        if world.rank == 0:
            world.Send(data, 1)
            world.Recv(data, 1)
        elif world.rank == 1:
            world.Recv(data, 0)
            world.Send(data, 0)

    small, large, few = np.zeros(1), np.zeros(2**20), np.zeros(16)
    found = {"latency": smallest(lambda: there_and_back(small), repetitions) / 2,
             "bandwidth": 2 * large.nbytes / smallest(lambda: there_and_back(large), 20),
             "reduction": smallest(lambda: world.Allreduce(few.copy(), few), repetitions)}
    if world.rank == 0:
        print(json.dumps(found))


# The model

def power(x: list[float], y: list[float]) -> tuple[float, float]:
    """c and p of y ≈ c xᵖ, least squares of the logarithms."""
    p, logarithm = np.polyfit(np.log(x), np.log(y), 1)
    return float(np.exp(logarithm)), float(p)


def growing(x: list[float], y: list[float], p: float) -> tuple[float, float, float]:
    """a, c ≥ 0 and p of y ≈ a + c xᵖ, least squares of the relative error."""
    columns = np.column_stack([np.ones(len(x)), np.power(x, p)]) / np.array(y)[:, None]
    a, c = nnls(columns, np.ones(len(x)))[0]
    return float(a), float(c), p


class Model:
    """Seconds of a run on R ranks with a brick of n unknowns on each.

    Parameters
    ----------
    found : rows of all sections
    latency, bandwidth : of a message between two ranks (s, bytes/s)
    """

    def __init__(self, found: dict[str, list[Row]], latency: float, bandwidth: float) -> None:
        self.latency, self.bandwidth = latency, bandwidth
        many, large = where(found["walls"], N=4), [row for row in found["walls"] if row["rows"] == 2]
        n = [row["n"] for row in large]
        self.by_size = {phase: growing(n, [row[phase] for row in large], p) for phase, p in
                        (("assemble", 1.0), ("factor", 1.5), ("rest", 1.0))}
        self.by_size["product"] = growing(n, [row["outer"] / row["products"] for row in large], 1.0)  # C has n entries
        self.steps = power([row["bricks"] for row in many], [row["steps"] for row in many])
        self.products = power([row["bricks"] for row in many], [row["products"] for row in many])
        self.finer = power(n, [row["products"] for row in large])[1]
        self.motions = max(row["coarse"] / row["bricks"] for row in many)
        self.n = many[0]["n"]
        coarse = found["coarse"]
        self.coarse = {name: power([row["unknowns"] for row in coarse], [row[name] for row in coarse])
                       for name in ("entries", "factor", "solve", "mebibytes")}
        self.turn = found["files"][-1]["turn"]

    def seconds(self, R: int, n: float) -> dict[str, float]:
        """By part of a run."""
        steps = _at(self.steps, R)
        products = _at(self.products, R) * (n / self.n) ** self.finer
        unknowns, tree = self.motions * R, math.ceil(math.log2(R)) * self.latency
        vector = 8 * 6 * math.sqrt(n) / NEIGHBOURS / self.bandwidth  # a side's share of a brick's 6√n contact unknowns
        return {
            "assemble, recover, estimate": _at(self.by_size["assemble"], n) + _at(self.by_size["rest"], n),
            "factor": _at(self.by_size["factor"], n),
            "products": products * _at(self.by_size["product"], n),
            "neighbours": products * 2 * NEIGHBOURS * (self.latency + vector),
            "reductions": products * (6 * tree + 2 * 8 * unknowns / self.bandwidth),
            "coarse problem": products * _at(self.coarse["solve"], unknowns) + steps * (
                _at(self.coarse["factor"], unknowns) + ENTRY * _at(self.coarse["entries"], unknowns) / self.bandwidth),
            "files": R * self.turn,
        }


def _at(law: tuple[float, ...], x: float) -> float:
    *constant, c, p = law
    return sum(constant) + c * x**p


# Page

def page(found: dict[str, list[Row]], model: Model) -> str:
    lines = ["# Thousands of ranks, on paper", "", "Generated by `scripts/study scale_model`; [scaling.md]"
             "(../studies/scaling.md) says what follows.", "", "## Walls on one rank", "",
             "Of one brick: unknowns, products, seconds.", ""]
    lines += table(("bricks", "n", "Newton steps", "products", "coarse unknowns", "assemble", "factor", "outer",
                    "recover, estimate"),
                   [(row["bricks"], f"{row['n']:.0f}", row["steps"], f"{row['products']:.0f}", row["coarse"],
                     *(f"{row[phase]:.2g}" for phase in ("assemble", "factor", "outer", "rest"))) for row in
                    found["walls"]])
    lines += ["## The coarse problem alone", ""]
    lines += table(("bricks", "unknowns", "entries", "factored in (s)", "solved in (s)", "factors (MiB)"),
                   [(row["bricks"], row["unknowns"], row["entries"], f"{row['factor']:.2g}", f"{row['solve']:.2g}",
                     f"{row['mebibytes']:.0f}") for row in found["coarse"]])
    lines += ["## Messages on this machine", "", "A small message, a large one, and a reduction of 16 numbers.", ""]
    lines += table(("ranks", "latency (µs)", "bandwidth (GB/s)", "reduction (µs)"),
                   [(row["ranks"], f"{1e6 * row['latency']:.2g}", f"{row['bandwidth'] / 1e9:.2g}",
                     f"{1e6 * row['reduction']:.3g}") for row in found["messages"]])
    lines += ["## Constants", "", "y = a + c xᵖ, fitted to the tables; seconds, n unknowns a brick, K bricks.", ""]
    lines += table(("y", "a", "c", "p"), [
        (name, f"{sum(law[:-2]):.2g}", f"{law[-2]:.2g}", f"{law[-1]:.2f}") for name, law in {
            **{f"{phase}, by n": law for phase, law in model.by_size.items()},
            "Newton steps, by K": model.steps, "products, by K": model.products,
            **{f"coarse {name}, by unknowns": law for name, law in model.coarse.items()}}.items()])
    lines += [f"Products grow with n to the power {model.finer:.2f}; {model.motions:.1f} coarse unknowns a brick; "
              f"writing takes {1e3 * model.turn:.1f} ms a brick.", "", "## Prediction", "",
              f"Seconds with a latency of {1e6 * model.latency:g} µs and {model.bandwidth / 1e9:g} GB/s.", ""]
    for n in SIZES:
        parts = {R: model.seconds(R, n) for R in RANKS}
        lines += [f"### {n:.0e} unknowns a rank", ""]
        lines += table(("ranks", *parts[RANKS[0]], "all"),
                       [(R, *(f"{value:.2g}" for value in own.values()), f"{sum(own.values()):.3g}")
                        for R, own in parts.items()])
    return "\n".join(lines)


def draw(model: Model):
    """Seconds by part over ranks, stacked, for each size; a figure."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(SIZES), figsize=(11.0, 3.8))
    ranks = np.geomspace(RANKS[0], RANKS[-1], 60)
    for each, n in zip(axes, SIZES, strict=True):
        parts = [model.seconds(int(R), n) for R in ranks]
        each.stackplot(ranks, [[part[name] for part in parts] for name in parts[0]], labels=list(parts[0]))
        each.set(xscale="log", xlabel="ranks", title=f"{n:.0e} unknowns a rank")
        each.grid(False)
    axes[0].set_ylabel("seconds")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="upper center", ncols=4, bbox_to_anchor=(0.5, 0.0))
    return figure


def main() -> None:
    parser = arguments(__doc__, "scale_model")
    parser.add_argument("--latency", type=float, default=2e-6, help="of a message in the cluster (s)")
    parser.add_argument("--bandwidth", type=float, default=1e10, help="of the cluster (bytes/s)")
    parser.add_argument("--bricks", type=int, default=200, help="of the largest wall that is solved")
    parser.add_argument("--time-messages", action="store_true", help="for the ranks that send them")
    options = parser.parse_args()
    world = MPI.COMM_WORLD
    if options.time_messages:
        return time_messages(world)
    walls = [each for each in WALLS if each[0] * each[1] <= options.bricks]
    work = {"walls": (walls, measure_wall), "coarse": ([(K,) for K in BRICKS], measure_coarse),
            "files": ([(20,)], measure_files), "messages": ([(2,), (4,), (8,), (16,)], measure_messages)}
    found = {section: Ledger(world, options.output / f"{section}.csv", *SECTIONS[section]).fill(*work[section])
             for section in SECTIONS}
    model = Model(found, options.latency, options.bandwidth)
    text = page(found, model)
    publish(PAGE, text, options.output, walls == WALLS,
            lambda folder: save_figures(folder, {"scale_model": lambda: draw(model)}, dpi=100))
    print(text)


if __name__ == "__main__":
    main()
