"""Whole answers of tests, compared with approved records: what no promise asks does not change unseen.

A record proves nothing: it was right when somebody approved of it, and the promises beside it are the proof. It says
that a number, a word or a line of the log is another one than before, also where no test looks at it.

While a quick test of a folder in `RECORDED` runs, all answers, lines of the log and messages of errors are noted
(`Notes`). Numbers with one name, such as those of a column, become one (`folded`); texts stand without their numbers,
which are folded, too. `tests/approved/FOLDER.txt` has them by test. `scripts/study approve` writes it anew.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import logging
import math
import os
import re
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

HERE = Path(__file__).resolve().parents[1] / "approved"

RECORDED = ("products",)
"""Folders of tests whose answers have records."""

RENEW = "scripts/study approve, and read the difference before you commit it"

TOLERANCE = 1e-5
"""Of a folded number, beside the size of its group; what printing drops of it is half of this."""

EACH = 1e-8
"""Of each number of a group, as answers are as precise as the method's tolerance."""

ROUNDING = 1e-9
"""Below this share of the largest number of its quantity in the answer a number is told as zero."""

TINY = 1e-9
"""A number in a text below this is rounding."""

SHAKEN = "DDMPI_SHAKEN"
"""A variable: Young's moduli are larger by this share. What changes by more than `TOLERANCE` then is rounding."""

WRITTEN = "DDMPI_NOTED"
"""A variable: the file into which notes are written, in place of comparing them."""

NO_FACTS = {
    "certificate",
    "memory_mib",
    "ranks",
    "seconds",
    "run",
    "started",
    "command",
    "working_folder",
    "slurm",
    "hosts",
    "versions",
    "exchange",
    "format",
    "pointwise_penetration",
    "moment_imbalance",
    "moment_imbalance_bound",
    "residual",
    "lost",
    "certificate_limit",
    "levels",
    "options_unused",
    "n_A",
    "n_A_by_purpose",
    "inner_steps",
    "inner_iterations",
    "eff",
}
"""Entries of a summary that are rounding, or of the machine and the day, or products, of which other kernels of BLAS
take one more or less."""

TOLD_TWICE = ("converged", "order", "n", "m", "displacement_max", "displacement_max_at")
"""Entries that follow from others by a line, which transcripts have."""

NAMED = ("bodies", "contacts", "rigid", "errors", "loads", "reactions", "points", "derivatives")
"""Entries of a summary whose keys are names."""

QUANTITIES = {
    "stress": r"stress|pressure|von_mises|shear$",
    "force": r"force|reaction$",
    "moment": r"moment",
    "length": r"displacement|gap|slip|between|closure",
    "energy": r"energy|dissipated|work",
}
"""Of names, for what is rounding beside what."""

NUMBER = re.compile(r"(?<![\w.])[-+−]?\d+(?:\.\d*)?(?:e[-+]?\d+)?(?![\w])")

UNTOLD = re.compile(r"certificate \(limit|^ +k +update|\d s\b|MiB|GiB|/tmp|seconds|processor")
"""Lines of the log with numbers of the machine, or rounding."""


def folded(values: np.ndarray, size: float | None = None) -> float:
    """One number of a group: the decimal logarithm of its size, and a sum over it whose weights do not repeat.

    A group that is zero beside `size` is 0; a number alone is what it is.
    """
    x = np.asarray(values, float).ravel()
    known = np.isfinite(x)
    largest = float(np.abs(x[known]).max(initial=0.0))
    lost = float(np.flatnonzero(~known).sum() + (~known).sum())
    if largest <= ROUNDING * (size or 0.0) or largest < 1e-200:
        return lost
    if len(x) == 1:
        return float(x[0])
    weights = 0.5 + (np.arange(1, len(x) + 1) * 0.6180339887498949) % 1.0
    return lost + math.log10(largest) + float(weights[known] @ x[known]) / largest


def in_text(numbers: list[float]) -> float:
    """One number of those in a text, each by its own size; beside them stands how often the text comes."""
    found = 0.0
    for k, number in enumerate(numbers, 1):
        weight = 0.5 + (k * 0.6180339887498949) % 1.0
        found += weight * (0.1 * k if number == 0.0 else math.copysign(1.0, number))
        found += weight * (math.log10(abs(number)) if number else 0.0)
    return found


@dataclass
class Facts:
    """Of one test: groups of numbers with how many they are, and the folded numbers of texts."""

    groups: dict[str, tuple[int, float | None]] = field(default_factory=dict)
    texts: dict[str, float | None] = field(default_factory=dict)
    said: dict[str, list[list[float]]] = field(default_factory=dict)

    def add(self, numbers: dict[str, Any], suffix: str) -> None:
        """Groups of numbers, each told beside its quantity."""
        sizes: dict[str, float] = defaultdict(float)
        for name, values in numbers.items():
            x = np.abs(np.asarray(values, float))
            sizes[quantity(name)] = max(sizes[quantity(name)], float(np.nanmax(x, initial=0.0)))
        for name, values in numbers.items():
            size = sizes[quantity(name)] if quantity(name) else 0.0
            if name.endswith(("error", "utilisation")):
                size = 1.0  # shares
            self.groups[name + suffix] = (np.size(values), folded(np.asarray(values, float), size))

    def say(self, text: str) -> None:
        """A text, without its numbers and without folders."""
        if UNTOLD.search(text):
            return
        text = re.sub(r"/\S*/", "…/", re.sub(r"n_A = \d+", "n_A", text))
        found = [float(number.replace("−", "-")) for number in NUMBER.findall(text)]
        numbers = [x if abs(x) > TINY else 0.0 for x in found]
        bare = " ".join(NUMBER.sub("#", text).split())
        if re.search("[a-z]", bare):
            self.said.setdefault(bare, []).append(numbers)


@cache
def quantity(name: str) -> str:
    last = name.rpartition(".")[2].removesuffix("_max").removesuffix("_mean")
    if last.endswith(("_at", "_bound")):
        return ""
    return next((key for key, words in QUANTITIES.items() if re.search(words, last)), "")


def leaves(value: Any, name: str, numbers: dict[str, list], texts: list[str]) -> None:
    """All numbers and texts below an entry of a summary, by names in which * stands for those of bodies and contacts."""
    if isinstance(value, dict):
        star = name.rpartition(".")[2] in NAMED
        for key, entry in value.items():
            if key not in NO_FACTS:
                if star:
                    texts.append(f"{name}: {key}")
                leaves(entry, f"{name}.*" if star else f"{name}.{key}", numbers, texts)
    elif isinstance(value, list):
        if not value:
            numbers[f"{name}"].extend([])
        for entry in value:
            leaves(entry, name, numbers, texts)
    elif isinstance(value, str):
        texts.append(f"{name}: {value}")
    else:
        numbers[name].append(math.nan if value is None else float(value))


def of_answer(answer: Any, facts: Facts, suffix: str) -> None:
    """All that a run knows of its answer."""
    numbers: dict[str, Any] = defaultdict(list)
    texts: list[str] = []
    summary = {key: value for key, value in answer.summary.items() if key != "scene"}
    for key, value in summary.items():
        if key not in NO_FACTS and key not in TOLD_TWICE:
            leaves(value, key, numbers, texts)
    scene: dict[str, list] = defaultdict(list)
    leaves(answer.summary["scene"], "scene", scene, [])
    numbers["scene"] = [x for name in sorted(scene) for x in scene[name] if math.isfinite(x)]
    texts = [text for text in texts if not text.startswith(("warnings", "steps", "title"))]
    for contact in answer.contacts.values():
        table = contact.table()
        for column in table.dtype.names:
            values = table[column]
            if values.dtype.kind in "US":
                values = np.array([("open", "slip", "stick").index(word) for word in values])
            numbers[f"table.{column}"].extend(values.tolist())
        numbers["table.between"].extend(contact.between.tolist())
    for fields in answer.bodies.values():
        for name, values in vars(fields).items():
            if isinstance(values, np.ndarray):
                numbers[f"fields.{name}"].extend(values.ravel().tolist())
    for name in answer.history.dtype.names or ():
        if name not in ("update", "residual", "inner_precision", "n_A"):
            numbers[f"history.{name}"] = answer.history[name].tolist()
    facts.add(numbers, suffix)
    for text in (*texts, *repr(answer).splitlines()[1:]):
        facts.say(text)


class Notes(logging.Handler):
    """What is solved, logged and refused while a test runs."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.facts, self.answers, self.errors = Facts(), 0, list[BaseException]()

    def emit(self, record: logging.LogRecord) -> None:
        for line in record.getMessage().splitlines():
            self.facts.say(line)

    def answer(self, answer: Any) -> Any:
        self.answers += 1
        of_answer(answer, self.facts, "" if self.answers == 1 else f"#{self.answers}")
        return answer

    def whole(self) -> Facts:
        for error in self.errors:
            for line in str(error).splitlines():
                self.facts.say(f"{type(error).__name__}: {line}")
        for text, numbers in self.facts.said.items():
            self.facts.texts[text] = len(numbers) + in_text([x for each in numbers for x in each])
        return self.facts


@contextlib.contextmanager
def noted() -> Iterator[Notes]:
    """Notes of what is done within the block. The log is told as with logging at INFO."""
    from ddmpi.errors import DdmpiError
    from ddmpi.run.answer import Model

    notes, log = Notes(), logging.getLogger("ddmpi")
    solve, settle, level = Model.solve, Model.settle, log.level
    shaken = 1.0 + float(os.environ.get(SHAKEN, "0"))

    def raised(error: DdmpiError, *given: Any) -> None:
        Exception.__init__(error, *given)
        notes.errors.append(error)

    def shaking(model: Model, *given: Any, **more: Any) -> Any:
        settled = settle(model, *given, **more)
        for body in settled.body:
            for material in body.materials:
                shake(material, shaken)
        return settled

    with (
        mock.patch.object(
            Model, "solve", lambda *given, **more: notes.answer(solve(*given, **more))
        ),
        mock.patch.object(Model, "settle", shaking if shaken != 1.0 else settle),
        mock.patch.object(DdmpiError, "__init__", raised),
    ):
        log.addHandler(notes)
        log.setLevel(logging.INFO)
        try:
            yield notes
        finally:
            log.removeHandler(notes)
            log.setLevel(level)


def shake(material: Any, factor: float) -> None:
    """Make a settled material stiffer."""
    from msgspec.structs import force_setattr

    for key in ("young", "shear"):
        value = getattr(material, key)
        if value is not None:
            new = tuple(factor * x for x in value) if isinstance(value, tuple) else factor * value
            force_setattr(material, key, new)


# Records in a file


def file_of(folder: str) -> Path:
    return HERE / f"{folder}.txt"


def short(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:5]


def written(tests: dict[str, Facts]) -> str:
    """The text of a file of records: names of groups, texts, sets of texts without numbers, and by test the numbers."""
    named: dict[str, dict[str, str]] = {"group": {}, "text": {}, "set": {}}

    def name(kind: str, text: str) -> str:
        named[kind][short(text)] = text
        return short(text)

    lines, function = [], ""
    for test, facts in sorted(tests.items()):
        of, bracket, which = test.partition("[")
        if of != function:
            lines += ["", of]
            function = of
        lines.append(f" {bracket}{which}")
        for room, names in by_room(facts).items():
            values = " ".join(as_number(*facts.groups[name]) for name in names)
            head = f"{room}: {' '.join(name.removeprefix(room) for name in names)}"
            lines.append(f"  {name('group', head)} {values}")
        said = [name("text", text) for text in sorted(facts.texts) if facts.texts[text] == 1.0]
        found = [f"{name('set', ' '.join(said))}"] if said else []
        for text in sorted(facts.texts):
            if facts.texts[text] != 1.0:
                found.append(f"{name('text', text)}={plain(facts.texts[text])}")
        lines.append("  " + " ".join(found))
    heads = [f"{kind} {key} {named[kind][key]}" for kind in named for key in sorted(named[kind])]
    title = [
        "Approved records of the answers of tests, written by scripts/study approve; what they are says",
        "tests/support/approved.py",
    ]
    return "\n".join([*title, *heads, *lines, ""])


def by_room(facts: Facts) -> dict[str, list[str]]:
    """Names of groups by what they begin with."""
    rooms: dict[str, list[str]] = defaultdict(list)
    for name in sorted(facts.groups):
        parts = name.partition("#")[0].split(".")
        rooms[f"{parts[0]}.{'*.' * ('*' in parts[1:2])}" if len(parts) > 1 else ""].append(name)
    return dict(sorted(rooms.items()))


def plain(value: float | None) -> str:
    return "~" if value is None else f"{value:.5f}".rstrip("0").rstrip(".") or "0"


def as_number(count: int, value: float | None) -> str:
    if count == 1:
        return "~" if value is None else f"{value:.7g}"
    return f"{count}:{plain(value)}"


def back(text: str) -> float | None:
    return None if text == "~" else float(text)


@cache
def approved(folder: str) -> dict[str, Facts]:
    """The records of a folder of tests, by test."""
    named: dict[str, dict[str, str]] = {"group": {}, "text": {}, "set": {}}
    tests: dict[str, Facts] = {}
    function, facts = "", Facts()
    for line in file_of(folder).read_text(encoding="utf-8").splitlines()[2:]:
        word, _, rest = line.strip().partition(" ")
        if word in named and line.startswith(word):
            key, _, text = rest.partition(" ")
            named[word][key] = text
        elif line.startswith("  ") and word in named["group"]:
            room, names = named["group"][word].split(": ")
            for name, value in zip(names.split(" "), rest.split(" "), strict=True):
                count, _, number = value.rpartition(":")
                facts.groups[room + name] = (int(count or 1), back(number))
        elif line.startswith("  "):
            for each in line.split():
                key, equals, number = each.partition("=")
                for text in [key] if equals else named["set"][key].split():
                    facts.texts[named["text"][text]] = back(number or "1")
        elif line.startswith(" "):
            facts = tests[function + line[1:]] = Facts()
        else:
            function = line
    return tests


def former(folder: str) -> dict[str, Facts]:
    """The records of a folder, none before the first ones are written."""
    return approved(folder) if file_of(folder).is_file() else {}


def differences(found: Facts, kept: Facts) -> list[str]:
    """What of a test is not as approved, in words."""
    told = []
    for name in sorted(found.groups.keys() | kept.groups.keys()):
        here, there = found.groups.get(name), kept.groups.get(name)
        if here is None or there is None:
            told.append(f"{name}: {'gone' if here is None else 'new'}")
        elif here[0] != there[0]:
            told.append(f"{name}: {here[0]} numbers, approved {there[0]}")
        elif there[1] is not None and not near(here[1], there[1], here[0]):
            told.append(f"{name}: {as_number(*here)}, approved {as_number(*there)}")
    for text in sorted(found.texts.keys() | kept.texts.keys()):
        if text not in kept.texts:
            told.append(f"new: {text}")
        elif text not in found.texts:
            told.append(f"gone: {text}")
        elif kept.texts[text] is not None and not near(found.texts[text], kept.texts[text], 0):
            told.append(f"numbers in: {text}")
    return told


def near(one: float | None, other: float | None, count: int) -> bool:
    if one is None or other is None:
        return one is other
    if count == 1:
        return abs(one - other) <= TOLERANCE * abs(other)
    return abs(one - other) <= 2.0 * TOLERANCE + EACH * count


def both(test: str, one: Facts, other: Facts) -> Facts:
    """What two runs of a test have in common; numbers that differ are rounding, and none. SystemExit where texts differ."""
    facts = Facts()
    hangs = f"{test}: what it says or counts hangs on rounding: "
    if one.groups.keys() != other.groups.keys() or one.texts.keys() != other.texts.keys():
        raise SystemExit(f"{hangs}{differences(one, other)}")
    for name, (count, value) in one.groups.items():
        same = other.groups[name]
        if same[0] != count:
            raise SystemExit(f"{hangs}{name}")
        facts.groups[name] = (count, value if near(value, same[1], count) else None)
    for text, value in one.texts.items():
        facts.texts[text] = value if near(value, other.texts[text], 0) else None
    return facts


# Tests


def name_of(item: Any) -> str:
    return f"{item.path.stem.removeprefix('test_')}: {item.name.removeprefix('test_')}"


def has_record(item: Any) -> bool:
    """Whether a test is to have one: a quick one of one rank in a folder with records, or that is to have them."""
    folder = item.path.parent.name
    if folder not in RECORDED or not (file_of(folder).is_file() or WRITTEN in os.environ):
        return False
    return not any(item.get_closest_marker(name) for name in ("slow", "mpi"))


def compared(item: Any) -> Callable[[Callable], Callable]:
    """Makes a test compare what it does with its record. It then raises AssertionError, which names what differs."""

    def of(test: Callable) -> Callable:
        @functools.wraps(test)
        def run(*given: Any, **more: Any) -> None:
            with noted() as notes:
                test(*given, **more)
            facts = notes.whole()
            if facts.groups or facts.texts:
                compare(item.path.parent.name, name_of(item), facts)

        return run

    return of


def compare(folder: str, name: str, facts: Facts) -> None:
    """Facts of a test with its record, or with WRITTEN into the file of notes."""
    if file := os.environ.get(WRITTEN):
        with open(file, "a", encoding="utf-8") as notebook:
            line = {"folder": folder, "name": name, "groups": facts.groups, "texts": facts.texts}
            notebook.write(json.dumps(line) + "\n")
        return
    kept = approved(folder).get(name)
    assert kept is not None, f"there is no approved record of this test; run {RENEW}"
    told = differences(facts, kept)
    assert not told, "\n".join(["not as approved:", *told, f"if it is right, run {RENEW}"])
