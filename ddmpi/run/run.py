"""One run from a scene to results, in the order of the work: prepare, march, judge, write."""

import contextlib
import gc
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from ddmpi.body.estimate import Deformed, DiscretizationError, estimate_errors, sum_errors
from ddmpi.body.stress import von_mises
from ddmpi.coupling.assembly import NO_SIZES, Assembly, prepare
from ddmpi.coupling.ranks import WorkingRanks, on_working_ranks, team_of
from ddmpi.coupling.team import Team
from ddmpi.derive.entries import ENOUGH, Entry
from ddmpi.derive.errors import measure_errors, shares
from ddmpi.errors import (
    DdmpiError,
    InputError,
    NotConvergedError,
    SolverError,
    naming,
    unknown,
)
from ddmpi.interface.state import ContactState
from ddmpi.judge.accuracy import (
    ENERGY,
    Cost,
    Demand,
    Level,
    MeshLadder,
    Miss,
    demand,
    refine_scene,
    weighted,
)
from ddmpi.judge.bars import UNCERTIFIED, Measured, bar_of
from ddmpi.judge.diagnosis import diagnose, helpful
from ddmpi.judge.edges import Edges, doubt_edges, edges_of, unbounded
from ddmpi.judge.plausible import (
    ROUNDED,
    doubt_answer,
    doubt_cells,
    doubt_mesh,
    doubt_shape,
    doubt_stress,
    locking_of,
    subjects,
)
from ddmpi.kept.kept import Kept
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.refine import Sizes
from ddmpi.methods.newton import Newton
from ddmpi.methods.outer import outer_from_outside
from ddmpi.petsc.events import event
from ddmpi.petsc.options import in_force
from ddmpi.petsc.versions import free_garbage
from ddmpi.pictures.views import View
from ddmpi.results.checkpoint import Checkpoints, continue_from, identify
from ddmpi.results.folder import choose_folder
from ddmpi.results.summary import facts_of
from ddmpi.run.equilibrium import undetermined_motions
from ddmpi.run.gather import (
    Solved,
    conclude,
    fields_of,
    gather_summary,
    write_files,
)
from ddmpi.run.held import coarse_words
from ddmpi.run.march import march
from ddmpi.run.report import log_end, log_plan, log_step, log_warnings
from ddmpi.run.solve import Solution, Start
from ddmpi.scene.keys import flatten
from ddmpi.scene.results import named, wanted_errors
from ddmpi.scene.scene import Settled
from ddmpi.system.agreement import agree_on_mistake, agreed, explained, gathered, merged
from ddmpi.system.clock import Clock
from ddmpi.system.doubts import Doubt, condensed
from ddmpi.system.provenance import peak_memory, versions

log = logging.getLogger("ddmpi")

MIB = 2.0**20

Former = tuple[Mapping[str, ContactState], np.ndarray | None]
"""Of another answer: the states of its contacts, by name, and the motions of loose bodies (m), if the rank has them."""


def run(
    world: MPI.Comm,
    scene: Settled,
    scene_path: str,
    output: str | None,
    figures: bool,
    restart: str | None = None,
) -> None:
    """Solve `scene` and write its results; parameters and errors as of `compute`. Collective on `world`."""
    on_working_ranks(
        world,
        scene,
        lambda ranks: compute(ranks, scene, scene_path, Clock(), output, figures, restart),
    )


class Cases:
    """Cases of one scene, each of which takes from those before what it does not change, unless nothing is to be kept,
    as for a single case. Collective on `world`.

    Parameters
    ----------
    survive : whether a mistake of the program that all ranks meet becomes an InternalError, so that other cases can
        follow; not where bodies have several ranks
    """

    def __init__(self, world: MPI.Comm, keep: bool = True, survive: bool = False) -> None:
        self._ranks, self._keep, self._kept = WorkingRanks(world), keep, Kept(locked=True)
        self._team: Team | None = None
        self._beside = world.Dup() if survive else MPI.COMM_NULL

    def compute(self, scene: Settled, scene_path: str, clock: Clock, **more: Any) -> Solved | None:
        """`compute`, with what is kept; None on ranks without a body of their own."""

        def work(ranks: MPI.Comm) -> Solved:
            if team_of(ranks) is not self._team:  # what was kept went with the ranks of the bodies
                self._team, self._kept = team_of(ranks), Kept(locked=True)
            kept = self._kept if self._keep else None
            try:
                with explained():
                    return compute(ranks, scene, scene_path, clock, kept=kept, **more)
            except Exception as error:
                if isinstance(error, DdmpiError) or self._team or self._beside == MPI.COMM_NULL:
                    raise
                mistake = agree_on_mistake(self._beside, error)
                if mistake is None:
                    raise
                self._kept = Kept(locked=True)  # what the case has left may be half done
                raise mistake from error

        return self._ranks.work(scene, work)

    def end(self) -> None:
        """Free all that is kept."""
        self._kept = Kept(locked=True)
        gc.collect()
        if self._beside != MPI.COMM_NULL:
            self._beside.Free()
        self._ranks.end()


def compute(
    world: MPI.Comm,
    scene: Settled,
    scene_path: str,
    clock: Clock,
    output: str | None = None,
    figures: bool = False,
    restart: str | None = None,
    write: bool = True,
    kept: Kept | None = None,
    start: Former | None = None,
    outer: type | None = None,
) -> Solved:
    """Solve `scene` on one mesh after the other until its accuracy target is met, and write the results. Collective.

    Parameters
    ----------
    world : of ranks that all hold bodies
    scene : with output.only, no fields are computed and written, and no pictures
    scene_path : the scene's file; mesh files are looked for beside it first
    output : folder for the results, or None for that of `restart` or a new one under results/
    figures : whether pictures are drawn, if matplotlib is installed
    restart : folder with the checkpoint to go on from, or None
    write : False where nothing is written, and an answer that is not certified is no error
    kept : by earlier cases
    start : of another answer, from whose forces Newton's method begins
    outer : the class that method.outer names, where it is not to be imported

    Raises
    ------
    InputError, SolverError, NotConvergedError, OutputError, InterruptionError
        the same on all ranks. After NotConvergedError the results are there, marked as not converged; after
        the last two a checkpoint is, as far as one could be written.
    """
    told: list[str] = []  # the warnings that the log has
    idle = peak_memory()

    def attempt() -> Solved | None:
        """Solve on the ladder's present mesh and write the results, or return None: the ladder goes on to another mesh,
        which needs the memory of this one."""
        assembly = prepare_scene(
            world, scene, scene_path, clock, ladder.factor, ladder.sizes, kept=kept, outer=outer
        )
        begin = _warm(assembly, start) if start else None
        log_plan(assembly, figures)
        log_warnings(assembly.warnings, told)
        # one solve without [time], else load steps; far motions place bodies anew in each
        noted = checkpoints if write else None
        solution, steps, assembly = march(assembly, log_step, noted, clock, begin)
        error = _estimate(assembly, solution, clock)
        edges = _edges(assembly, solution, clock)
        solved = _measured(Solved(assembly, solution, steps, error, edges), clock)
        if _another_mesh(ladder, solved, _cost(assembly, clock, idle)):
            return None
        _judge(solved, ladder, clock)
        if solved.summary:
            log_end(solved.summary, solution)
            log_warnings(solved.summary["warnings"], told)
        if write:
            write_files(solved, folder, clock, figures, checkpoints)
        return solved

    folder, claim = None, contextlib.ExitStack()
    with naming(scene_path), agreed(world):
        scene.refuse_forceless()
    with agreed(world):
        if write and world.rank == 0:
            folder = claim.enter_context(choose_folder(output, restart, scene_path))
    if write:
        log.info("%s", scene.title or scene_path)
    with claim:
        ladder = MeshLadder(scene)
        identity = {} if world.rank else identify(scene, in_force(), versions())
        state = continue_from(world, restart, identity, ladder) if restart else None
        checkpoints = Checkpoints(world, folder, identity, scene.checkpoint, clock, ladder, state)
        with checkpoints.kept():
            if ladder.levels:
                log.info("continuing with %s", ladder.meshes)
            solved = _climb(attempt, ladder, checkpoints)
    if write:
        _refuse_uncertified(solved, ladder)
    return solved


def _climb(
    attempt: Callable[[], Solved | None], ladder: MeshLadder, checkpoints: Checkpoints
) -> Solved:
    """What an `attempt` has solved, the first one that does not go on to another mesh. Collective."""
    while True:
        try:
            solved = attempt()
        except (InputError, SolverError) as failure:
            # an error on a finer mesh leaves the answer on the one before; a refused checkpoint leaves nothing
            refused = isinstance(failure, InputError) and checkpoints.continuing
            if refused or not failure.agreed or not ladder.fall_back(str(failure)):
                raise
            solved = None
        if solved is not None:
            return solved
        checkpoints.leave()
        gc.collect()
        free_garbage()


def _refuse_uncertified(solved: Solved, ladder: MeshLadder) -> None:
    """Raise NotConvergedError, on all ranks, with advice, unless the answer is certified and meets its target."""
    solution, scene = solved.solution, ladder.scene
    world, statuses, slender = solved.assembly.world, None, False
    if not solution.certified:
        statuses = solution.statuses.whole()
        thin = any(doubt_shape(body.mesh, body.spec.name) for body in solved.assembly.bodies)
        slender = world.allreduce(thin, MPI.LOR)
    with agreed(world):
        if solution.given and solution.unbalanced:
            raise NotConvergedError(
                f"{solution.reason} (the certificate fails: {', '.join(solution.violations)})"
            )
        if solution.mechanism or solution.drift:
            raise NotConvergedError(solution.reason)
        if statuses:
            raise NotConvergedError(
                diagnose(
                    solution.reason,
                    solution.stopped,
                    solution.violations,
                    scene.method,
                    solution.outer.history,
                    statuses,
                    helpful(scene, in_force(), slender),
                    solution.precision,
                )
            )
        if ladder.missed:
            raise NotConvergedError(ladder.missed)


def _warm(assembly: Assembly, start: Former) -> Start:
    """What makes the beginning for `Newton.begin`: the forces of another answer that the laws of now allow, with their
    gaps and motions. Collective, also the call of it. Raises InputError, on all ranks, where the answer has other
    contacts or nodes, or is of load steps."""
    forces, (states, motions), joint = [np.empty(0)], start, assembly.joint
    with agreed(assembly.world):
        if assembly.scene.time is not None or assembly.scene.method.outer != "newton":
            raise InputError(
                'start: needs a scene without load steps and method.outer = "newton"; leave start out'
            )
        for interface in assembly.space.interfaces:
            state = states.get(interface.name)
            if state is None or len(state.gap) != interface.m:
                raise InputError(
                    f"start: that answer has {'no' if state is None else 'other nodes at the'} contact "
                    f"{interface.name!r}; begin from an answer on the same meshes"
                )
            forces += [state.normal_force, state.tangential_force[interface.law.sliding].ravel()]
    motions, size = assembly.world.bcast(motions), joint.rigid.size
    alpha = motions if motions is not None and len(motions) == size else np.zeros(size)

    def begin() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        s = assembly.space.laws.project(np.concatenate(forces))
        return (
            s,
            joint.product(s, "newton") + joint.offset - joint.d - joint.rigid.spread(alpha),
            alpha,
        )

    return begin


def prepare_scene(
    world: MPI.Comm,
    scene: Settled,
    scene_path: str,
    clock: Clock | None = None,
    refinement: int = 1,
    sizes: Mapping[str, Sizes] = NO_SIZES,
    factor: bool = True,
    kept: Kept | None = None,
    outer: Any = None,
) -> Assembly:
    """`prepare` for a scene whose shapes are meshed `refinement` times finer, between the checks of a method from
    outside, that of `compute`, and of the pictures' cut, which has to meet a body; their errors name the scene's file.
    Collective."""
    scene = refine_scene(scene, refinement)
    with naming(scene_path):
        with agreed(world):
            outer = outer_from_outside(scene.method.outer, outer) if scene.method.outside else None
        assembly = prepare(
            world, scene, Path(scene_path).parent, clock, refinement, sizes, factor, kept
        )
        _refuse_cut(assembly)
        _refuse_points(assembly)
    return replace(assembly, outer=outer)


def _refuse_cut(assembly: Assembly) -> None:
    """InputError, on all ranks, where the pictures' cut meets no body. Collective."""
    if assembly.scene.output.cut:
        ends = merged(
            assembly.world,
            {
                body.number: np.array([body.mesh.points.min(axis=0), body.mesh.points.max(axis=0)])
                for body in assembly.bodies
            },
        )
        with agreed(assembly.world):
            View(np.concatenate([*ends.values()]), assembly.scene.resolved()["output"])


def _refuse_points(assembly: Assembly) -> None:
    """InputError, on all ranks, where errors are wanted at physical points that meshes do not have. Collective."""
    wanted = [named(result) for result in wanted_errors(assembly.scene)]
    key = "output.errors" if assembly.scene.output.errors else "method.target"
    with agreed(assembly.world):
        for body in assembly.bodies:
            points = body.mesh.vertices
            for one in wanted:
                if one.point and one.name == body.spec.name and one.point not in points:
                    raise InputError(
                        f"{key}: body {one.name!r} has no physical point {one.point!r}"
                        f"{unknown(one.point, points)}"
                    )


def _estimate(assembly: Assembly, solution: Solution, clock: Clock) -> DiscretizationError:
    """The discretization error of all bodies; none with output.only, unless meshes follow it. Collective."""
    if assembly.scene.output.only and not assembly.scene.method.target_error:
        return DiscretizationError(np.nan, {}, {}, 0.0)
    with clock.phase("estimate"):
        names = [body.spec.name for body in assembly.bodies]
        found = estimate_errors(
            [
                Deformed(
                    body.mesh,
                    body.material,
                    solution.displacements[body.spec.name],
                    body.member.elasticity.acting.heated,
                )
                for body in assembly.bodies
            ],
            keep=bool(assembly.scene.output.errors),
        )
        errors = dict(zip(names, found, strict=True))
        numbers = {name: (error.total, error.energy, error.area) for name, error in errors.items()}
        bodies = gathered(assembly.world, numbers)
        return sum_errors(
            bodies, errors, assembly.world.bcast(np.sum(list(bodies.values()), axis=0))
        )


def _cost(assembly: Assembly, clock: Clock, idle: float) -> Cost:
    """What all ranks have used since the last mesh; `idle` is the memory of this rank before the first one (MiB).
    Collective."""
    team, used = team_of(assembly.world), clock.lap("factor")
    seconds, memory = team.do("used") if team else (used[0], peak_memory())
    number = team.comm.size if team else 1
    mine = np.array([seconds, used[1] * number, memory * MIB, idle * number * MIB])
    return Cost(*assembly.world.allreduce(mine).tolist())


def _another_mesh(ladder: MeshLadder, solved: Solved, cost: Cost) -> bool:
    """Whether the ladder goes on to a finer mesh, or back to the last one with a certified answer, which has to be
    solved again. Collective."""
    assembly, solution, error = solved.assembly, solved.solution, solved.error.relative
    if not solution.certified:
        return ladder.fall_back(solution.reason)
    world, bodies = assembly.world, assembly.bodies
    dofs = world.allreduce(sum(body.mesh.points.size for body in bodies))
    level = Level(ladder.refinement, assembly.n, error, dofs, solved.bars, cost)
    misses, rate = ladder.misses(level), ladder.rate(level)
    drawn = {body.spec.name: body.mesh for body in bodies if body.spec.mesh.drawn}
    squares = _squares(solved, misses) if misses else {}
    wanted = {
        name: demand(squares[name], rate, mesh.dimension)
        for name, mesh in drawn.items()
        if name in squares
    }
    demands = merged(world, wanted)
    alone = _demands_alone(solved, drawn)
    if not ladder.proceed(level, demands, alone):
        return False
    ladder.draw({name: (mesh, squares[name]) for name, mesh in drawn.items()})
    return True


def _demands_alone(solved: Solved, drawn: Mapping[str, Mesh]) -> dict[str, Demand]:
    """By result the demand of drawn bodies' meshes that are made for it alone. Collective."""
    world, number = solved.assembly.world, sum(len(mesh.triangles) for mesh in drawn.values())
    parts = {
        result: {name: np.abs(solved.errors[result].cells[name]) for name in drawn}
        for result in solved.bars
        if solved.errors[result].cells
    }
    mine = [sum(squares.sum() for squares in part.values()) for part in parts.values()]
    *sums, cells = world.allreduce(np.array([*mine, number])).tolist()
    rows = np.zeros((len(parts), 3))
    for row, total, (result, part) in zip(rows, sums, parts.items(), strict=True):
        floored = weighted({result: part}, {result: total}, {result: Miss(1.0, 1.0)}, cells)
        for name, squares in floored.items():
            row += demand(squares, drawn[name].order, drawn[name].dimension)
    rows = world.allreduce(rows)
    return {result: Demand(*row) for result, row in zip(parts, rows.tolist(), strict=True)}


def _squares(solved: Solved, misses: Mapping[str, Miss]) -> dict[str, np.ndarray]:
    """The squared errors (nt,) of this rank's bodies, by name, of which finer meshes are made. Collective."""
    energy = {name: estimate.squares for name, estimate in solved.error.estimates.items()}
    of_results = {
        name: {body: np.abs(cells) for body, cells in measured.cells.items()}
        for name, measured in solved.errors.items()
    }
    parts = {ENERGY: energy} | of_results
    sums = [sum(squares.sum() for squares in parts[name].values()) for name in misses]
    cells = sum(map(len, energy.values()))
    *sums, cells = solved.assembly.world.allreduce(np.array([*sums, cells])).tolist()
    return weighted(parts, dict(zip(misses, sums, strict=True)), misses, cells)


def _of_answer(solved: Solved, free: list[str], edges: Edges) -> list[str]:
    """The warnings of an answer, of load steps before it as well, with its `edges`. Collective."""
    assembly, solution, steps = solved.assembly, solved.solution, solved.steps
    scene, world = solved.scene, assembly.world
    doubts = doubt_answer(assembly, solution)
    infinite = doubt_edges(assembly.in_world(), solution.states, edges)
    # pressures that are rounding are neither finite nor infinite, and those of corners are not of single nodes alone
    rounded = subjects(doubts, *ROUNDED)
    infinite = [doubt for doubt in infinite if rounded.isdisjoint(subjects([doubt]))]
    corners = subjects(infinite)

    def beside_corners(some: Sequence[str]) -> list[str]:
        return [doubt for doubt in some if corners.isdisjoint(subjects([doubt], "alone"))]

    warnings = [*coarse_words(solution.held), *beside_corners(doubts), *infinite]
    warnings += beside_corners(steps.doubts_beside([*doubts, *free]))
    if not scene.output.only:
        stresses = {name: _resolved(solved, name) for name in solved.fields}
        here = assembly.in_world()
        warnings += doubt_mesh(here, solved.error, solution.displacements, stresses)
        warnings += doubt_stress(here, stresses, edges.by_body)
    unsolved = f"their equations are not solved to {ENOUGH:.0e}"
    for key, entry in () if world.rank else steps.derived[0].items():
        if entry is None:
            words = f"derivatives.{key}: not given, because {steps.derived[2].get(key, unsolved)}"
            warnings.append(Doubt(words, "derivatives", of=f"derivatives.{key}"))
    return warnings + ([] if world.rank else _doubt_split(steps.derived[0]))


def _resolved(solved: Solved, body: str) -> tuple[np.ndarray, np.ndarray] | None:
    """The von Mises stresses of cells (nt,) and at nodes (nv,) of a body of this rank; None where they are not wanted, or
    rounding: without energy, as a body moves rigidly, and under pure pressure."""
    field = solved.fields[body]
    of_cells, stress = field.von_mises, field.nodal_stress
    if of_cells is None or stress is None or not solved.error.estimates[body].energy:
        return None
    of_nodes = von_mises(stress)
    rounding = of_nodes.max() <= solved.solution.limit * np.abs(stress).max()
    return None if rounding else (of_cells, of_nodes)


def _of_meshes(assembly: Assembly) -> list[str]:
    """The warnings of meshes, which may be why there is no answer. Collective."""
    thin = {}
    for body in assembly.bodies:
        doubts = (doubt(body.mesh, body.spec.name) for doubt in (doubt_cells, doubt_shape))
        thin[body.spec.name] = [doubt for doubt in doubts if doubt]
    of_all = gathered(assembly.world, thin)
    return [doubt for body in assembly.scene.body for doubt in of_all.get(body.name, ())]


def _doubt_split(derived: Mapping[str, Entry | None]) -> list[str]:
    """The warning of derivatives that depend on how contacts share the force at a node, if any."""
    lost = {
        contact: None
        for entry in derived.values()
        for contact, results in (entry or {"contacts": {}})["contacts"].items()
        for _, value in flatten(results)
        if value is None or (isinstance(value, list) and None in value)
    }
    if not lost:
        return []
    return [
        f"derivatives: null in {', '.join(lost)} where they depend on how contacts share the force at a node that they "
        "have in common: nothing but the sum of such forces is determined"
    ]


def _edges(assembly: Assembly, solution: Solution, clock: Clock) -> Edges | None:
    """Where stresses at contacts are infinite; None without an answer. Collective."""
    if not solution.certified:
        return None
    with clock.phase("doubt"):
        return edges_of(assembly.in_world(), solution.states)


def _measured(solved: Solved, clock: Clock) -> Solved:
    """The answer with its fields, errors and bars of results, and on the first rank the summary without warnings and
    ladder. Collective."""
    assembly, moved = solved.assembly, solved.solution.displacements
    world = assembly.world
    with clock.phase("recover"), agreed(world), event("Stress"):
        fields = {
            body.spec.name: fields_of(assembly, body, moved[body.spec.name], solved.error)
            for body in assembly.bodies
            if not solved.scene.output.only
        }
    errors = _errors(solved, clock)
    with agreed(world):
        parts = shares(assembly, errors)
        fields = {name: replace(one, error_share=parts.get(name)) for name, one in fields.items()}
    endless = set[str]()
    if errors and solved.edges:
        endless = unbounded(assembly.in_world(), solved.edges)
    solved = replace(solved, fields=fields, errors=errors)
    summary = gather_summary(solved, clock.started)
    with agreed(world):
        facts = facts_of(summary, errors, endless) if summary and errors else {}
        bars = {name: bar_of(named(name), errors[name], known) for name, known in facts.items()}
    return replace(solved, summary=summary, bars=world.bcast(bars))


def _judge(solved: Solved, ladder: MeshLadder, clock: Clock) -> None:
    """Put warnings, bars and what led to the mesh into the summary. Collective."""
    assembly, solution, edges = solved.assembly, solved.solution, solved.edges
    with clock.phase("doubt"):
        free = [] if solution.mechanism else undetermined_motions(assembly, solution.states)
        warnings = [*assembly.warnings, *locking_of(solved.scene)]
        if edges:
            warnings += _of_answer(solved, free, edges)
        else:
            warnings += [*_of_meshes(assembly), *solved.steps.doubts_beside(())]
    if solved.summary:
        conclude(solved, ladder, condensed(warnings), free)


def _errors(solved: Solved, clock: Clock) -> dict[str, Measured]:
    """What is known of the errors of results. Collective."""
    solution, wanted = solved.solution, wanted_errors(solved.scene)
    if not solution.certified:
        return {result: Measured(word=UNCERTIFIED) for result in wanted}
    if not wanted:
        return {}
    assert isinstance(solution.outer, Newton)
    with clock.phase("errors"):
        return measure_errors(solved.assembly, solution.outer, solution, wanted, solved.factors)
