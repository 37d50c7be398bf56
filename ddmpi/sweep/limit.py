"""The factor of a load at which equilibrium ends, by solves of a prepared model on both sides of it."""

import contextlib
import json
import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mpi4py import MPI

from ddmpi.errors import InputError, NotConvergedError
from ddmpi.judge.equilibrium import IMBALANCE
from ddmpi.results.folder import choose_folder
from ddmpi.run.answer import Answer, Model
from ddmpi.scene.keys import looked_up, parse_value
from ddmpi.scene.reader import read_data, read_text
from ddmpi.system.agreement import from_first
from ddmpi.system.files import write_atomically, writing

log = logging.getLogger("ddmpi")

LIMIT = "limit.json"

NO_EQUILIBRIUM = "no equilibrium"
"""How the reason of a run begins that has found none."""

LEAST, MOST = 1e-12, 1e12
"""Factors between which the limit is looked for: at others rounding of this load, or of the rest, is all that there is."""

BORNE = 1e3
"""Largest factor where clamps hold all parts, and where larger ones are beyond the method."""

WITHIN = 1e-3
"""Width of the interval at the end over its upper end."""

BESIDE = 0.3
"""Distance from a guess at which it is tried on either side, over the width of the interval at the end."""

SOLVES, FEW = 24, 3
"""Most solves before the run that is written; so many before a limit is looked for at larger factors."""

LOADED = (
    "traction",
    "volume_force",
    "temperature",
    "clamp",
    "force",
    "moment",
    "displacement",
    "pretension",
)
"""The keys of bodies, rigid partners and contacts that load them."""

LOADS = ("value", "pressure", "force", "moment", "constant")
"""The numbers of a load that a factor multiplies; what else it has, such as its group, stays."""


@dataclass
class Search:
    """What is known of the limit.

    Attributes
    ----------
    held, failed : the largest factor with an answer and the least one without; 0 and infinite at first
    guess : where the limit may be; NaN if nothing tells
    words : why there is no answer at the factor `failed`
    unbalanced : by factor without an answer, the load that nothing balances (N)
    part : at the factor `failed`, of all loads; 0 if no mechanism is known
    solves, failures : how many there were, and without an answer
    most : the largest factor to be tried
    """

    held: float = 0.0
    failed: float = math.inf
    guess: float = math.nan
    words: str = ""
    unbalanced: dict[float, float] = field(default_factory=dict)
    solves: int = 0
    failures: int = 0
    part: float = 0.0
    most: float = MOST

    @property
    def found(self) -> bool:
        """Whether the interval is narrow enough."""
        return math.isfinite(self.failed) and self.failed - self.held <= WITHIN * self.failed

    @property
    def ended(self) -> bool:
        """Whether the limit is found, outside of all factors, or takes too many solves."""
        outside = max(self.held, LEAST) >= min(self.most, self.failed)
        return self.found or outside or self.solves >= SOLVES

    def note(self, factor: float, answer: Answer, part: float, load: float) -> None:
        """Note what a solve with a factor has found: `part` of the loads, which are `load` (N), nothing balances."""
        self.solves += 1
        if answer.certified:
            self._hold(factor, answer)
        elif factor > BORNE and not (self.failures or answer.reason.startswith(NO_EQUILIBRIUM)):
            # so large a multiple is beyond the method, which tells nothing of a limit
            self.most = BORNE
        else:
            self._fail(factor, answer, part, load)

    def _hold(self, factor: float, answer: Answer) -> None:
        # where the load that nothing balances falls to zero with the factor, it is rounding in the end, and no answer
        if 0.0 < self.part * factor <= IMBALANCE * self.failed and not self.guess >= factor:
            self.most = 0.0
            return
        self.held = factor
        # what bears a part of its friction bears all of it at that multiple, if its pressure stays
        shares = [contact["utilisation"] for contact in answer.summary["contacts"].values()]
        most = max((share for share in shares if share is not None), default=0.0)
        if len(self.unbalanced) < 2:
            self.guess = factor / most if most else math.nan

    def _fail(self, factor: float, answer: Answer, part: float, load: float) -> None:
        self.failed, self.words, self.part = factor, answer.reason, part
        self.failures += 1
        if part:
            self.unbalanced[factor] = part * load
        if len(self.unbalanced) > 1:
            # beyond the limit the unbalanced load grows with the factor, about linearly
            (one, small), (other, large) = sorted(self.unbalanced.items())[:2]
            guess = one - small * (other - one) / (large - small) if large > small else 0.0
            self.guess = guess if guess > IMBALANCE * one else math.nan  # the rest is rounding

    def following(self) -> float:
        """The factor to try next: 1, then on either side of a guess, farther away, or between the factors."""
        if not self.solves:
            return 1.0
        step = BESIDE * WITHIN * self.guess
        few = math.isfinite(self.failed) or self.solves < FEW
        sides = self.guess + step, self.guess - step
        for factor in sides if self.failed > sides[0] + step else sides[::-1]:
            if few and max(self.held, LEAST) < factor < min(self.failed, self.most):
                return factor
        if math.isinf(self.failed):
            return min(max(self.held**2, BORNE), self.most)
        if self.failures == 1 and self.held < self.failed / 4.0:
            return self.failed / 2.0  # two of them make a guess
        if not self.held:
            return max(self.failed**2, LEAST)
        return math.sqrt(self.held * self.failed)


def find_limit(
    world: MPI.Comm,
    scene: str,
    settings: Sequence[str],
    load: str,
    output: str | None,
    figures: bool = False,
) -> None:
    """Look for the factor of a load at which equilibrium ends; write limit.json, and beside it the run just past the
    limit with its mechanism. Collective.

    Parameters
    ----------
    scene, settings : path of the scene, and ``KEY=VALUE``
    load : a history, whose factors are multiplied; or the key of a load, of a number or of a list of numbers
    output : folder for what is written, or None for a new one under results/
    figures : whether the mechanism is drawn

    Raises what `ddmpi.run.run.run` does, InputError for a load that there is not, and NotConvergedError where a solve
    ends without an answer for another reason than that there is no equilibrium.
    """
    key, value = from_first(world, lambda: _find(scene, settings, load))
    given = {name: parse_value(text) for name, _, text in (one.partition("=") for one in settings)}
    folder = from_first(world, lambda: _folder(scene, output))
    with Model(scene, world) as model:
        search = _searched(world, model, given, (key, value))
        limited = math.isfinite(search.failed)
        if limited and not search.words.startswith(NO_EQUILIBRIUM):
            raise NotConvergedError(
                f"at the factor {search.failed:.6g} of {load} the run ends without an answer, and not for lack of an "
                f"equilibrium: {search.words}"
            )
        middle = (search.held + search.failed) / 2.0 if search.held else 0.0
        found = {
            "load": load,
            "factor": middle if limited else None,
            "interval": [search.held, search.failed if limited else None],
            "mechanism": search.words or None,
            "solves": search.solves + limited,
        }
        try:
            if limited:
                with contextlib.suppress(NotConvergedError):
                    model.write(given | {key: scaled(value, search.failed)}, str(folder), figures)
            from_first(world, lambda: _write(folder, found))
        finally:  # whatever becomes of the files
            _tell(search, load)


def _tell(search: Search, load: str) -> None:
    """Log the limit of a load."""
    if math.isinf(search.failed):
        log.info("no limit: there is equilibrium up to the factor %g of %s", search.held, load)
    elif not search.held:
        log.info("no equilibrium at the factor %g of %s either", search.failed, load)
    elif not search.found:
        between = search.held, search.failed, load
        log.info("equilibrium ends between the factors %.6g and %.6g of %s", *between)
    else:
        ends = (search.held + search.failed) / 2.0, load, search.held, search.failed
        log.info("equilibrium ends at the factor %.6g of %s (%.6g to %.6g)", *ends)


def _searched(
    world: MPI.Comm, model: Model, given: dict[str, Any], load: tuple[str, Any]
) -> Search:
    """The search to its end, with values by key, and the key and the value of the load. Collective."""
    search, (key, value) = Search(), load
    while not search.ended:
        factor = search.following()
        with quiet():
            answer = model.solve(given | {key: scaled(value, factor)}, only="contacts")
        part, acting, loose = world.bcast(_of_solve(answer))
        search.most = search.most if loose else BORNE
        search.note(factor, answer, part, acting)
        log.info("factor %.6g: %s", factor, answer.reason)
    return search


def _of_solve(answer: Answer) -> tuple[float, float, bool] | None:
    """On the first rank: the part of the loads that nothing balances, these loads (N), and whether a part is loose."""
    if not answer.solved:
        return None
    mechanism, loose = answer.solved.solution.mechanism, bool(answer.solved.assembly.loose)
    return (mechanism.imbalance, mechanism.load, loose) if mechanism else (0.0, 0.0, loose)


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """A context without messages of runs."""
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        log.setLevel(level)


def _find(scene: str, settings: Sequence[str], load: str) -> tuple[str, Any]:
    """The key of what is multiplied, and its value. Raises InputError."""
    data = read_data(scene, read_text(scene), settings)
    if load in data.get("history", {}):
        load = f"history.{load}.factors"
    value, parts = looked_up(data, load, "--load "), load.split(".")
    named = isinstance(value, str) and parts[-1] in ("on", "history")
    # a clamp without a displacement is the name of a group
    named |= parts[2:3] == ["clamp"] and len(parts) < 5 and not isinstance(value, dict)
    loads = (
        not named
        and len(parts) > 2
        and (parts[2] in LOADED or parts[::2] == ["history", "factors"])
    )
    if loads and _zero(value):
        raise InputError(f"--load {load}: is zero, and so are all multiples of it; give it a size")
    if not loads or scaled(value, 2.0) == value:
        raise InputError(
            f"--load {load}: is neither a history nor a load with numbers that a factor multiplies, such as "
            "body.NAME.traction.0, body.NAME.volume_force or rigid.NAME.force"
        )
    return load, value


def _folder(scene: str, output: str | None) -> Path:
    """The folder for what is written, as a run has it. Raises InputError."""
    with choose_folder(output, None, scene) as folder:
        return folder


def _write(folder: Path, found: dict[str, Any]) -> None:
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps(found, indent=2, ensure_ascii=False) + "\n"
        write_atomically(folder / LIMIT, text.encode())


def _zero(value: Any) -> bool:
    """Whether a load has numbers, and all that a factor multiplies are zero."""
    if isinstance(value, dict):
        value = [entry for key, entry in value.items() if key in LOADS or key.endswith("slope")]
    return bool(value) and all(map(_zero, value)) if isinstance(value, list) else value == 0


def scaled(value: Any, factor: float) -> Any:
    """A number, a list, a formula or the numbers of a load times a factor."""
    if isinstance(value, dict):
        return {
            key: scaled(entry, factor) if key in LOADS or key.endswith("slope") else entry
            for key, entry in value.items()
        }
    if isinstance(value, list):
        return [scaled(entry, factor) for entry in value]
    return f"({value}) * {factor!r}" if isinstance(value, str) else value * factor
