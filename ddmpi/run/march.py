"""The load steps of a scene: one solve without [time], else those of a march, near or far."""

from ddmpi.coupling.assembly import Assembly
from ddmpi.derive.chain import Chain
from ddmpi.methods.outer import Report, no_report
from ddmpi.results.checkpoint import Checkpoints
from ddmpi.run.gather import StepLog
from ddmpi.run.places import FarMarch
from ddmpi.run.solve import Iteration, Solution, Start, solve
from ddmpi.run.steps import March
from ddmpi.system.clock import Clock


def march(
    assembly: Assembly,
    report: Report = no_report,
    checkpoints: Checkpoints | None = None,
    clock: Clock | None = None,
    start: Start | None = None,
) -> tuple[Solution, StepLog, Assembly]:
    """Solve `assembly` in the load steps of its scene, without [time] in one; the solution, the record of the steps,
    and the assembly at the end.

    Parameters and errors as of `solve`. The solution is that of the last step, with the largest residuals of all steps.
    Collective.
    """
    scene, clock, log = assembly.scene, clock or Clock(), StepLog()
    if scene.time is None:
        # before the solve, as it refuses keys by which there is no derivative
        chain = Chain(assembly, scene.output.derivatives)
        solution = solve(assembly, scene.method, report, checkpoints, clock, start)
        _note(solution, log, chain)
        return solution, log, assembly
    assembly.act(scene.legs[0])
    iteration = Iteration(assembly, scene.method, no_report, clock)
    steps = (FarMarch if scene.far else March)(assembly, iteration, log)
    if checkpoints:
        checkpoints.follow(assembly, outer=steps.outer, steps=steps)
    return steps.run(checkpoints), log, steps.assembly


def _note(solution: Solution, log: StepLog, chain: Chain) -> None:
    """Note the only load step, with its derivatives. Collective."""
    (time,) = chain.assembly.scene.legs
    log.note_step(time, solution)
    if solution.certified:
        step = chain.advance(time, solution.outer, solution)
        log.derive(*chain.entries(time, step, solution), several=False)
