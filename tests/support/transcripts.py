"""What commands say and write, as texts that are compared with approved ones in tests/approved/.

Words are compared to the letter. A number in words may differ by one in its last digit. A line with numbers alone, as of
a column of a table or an entry of JSON, has five digits of each, and may differ by 1e-4 of its largest. What is of the
machine and the day has a mask, and ~ stands for a number that is rounding: `scripts/study approve` writes it where both
of its runs differ.
"""

from __future__ import annotations

import csv
import html
import json
import math
import os
import re
from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parents[1] / "approved"

RENEW = "scripts/study approve, and read the difference before you commit it"

WRITTEN, SHAKEN = "DDMPI_NOTED", "DDMPI_SHAKEN"
"""Variables: the file into which transcripts are written, in place of comparing them; by which share Young's moduli are
larger."""

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
    "options_unused",
    "n_A",
    "n_A_by_purpose",
    "inner_steps",
    "inner_iterations",
    "eff",
}
"""Entries of a summary that are rounding, or of the machine and the day, or products, of which other kernels of BLAS
take one more or less."""

NUMBER = re.compile(r"(?<![\w.])[-+−]?\d+(?:\.\d*)?(?:e[-+]?\d+)?(?![\w.]*\w)|~")

BESIDE = 1e-4
"""Of numbers of a line beside its largest."""

EACH = 1e-9
"""Of a number in words beside itself, as formulas are written with all digits."""

TINY = 1e-9
"""No number of these scenes is smaller but by rounding."""

MASKS = {
    r"/\S*/": "…/",
    r"n_A = \d+": "n_A",
    r"(\d )?\bsolves \d+ with|\b\d+ solves\b": "solves",
    r"\d{4}-\d\d-\d\d[T ][\d:.]+Z?( \w+ \d+)?": "DATE",
    r"\b0\.\d+\.\d+\b": "VERSION",
    r"on \w+, (\d+ ranks?), ddmpi": r"on HOST, \1, ddmpi",
    r"\(\d[\d.]* (s|ms|min|h)\b": "(TIME",
}

MANY = 12
"""Numbers of a line, above which they are folded."""

UNTOLD = re.compile(
    r"at work for|of memory|memory at most|^\w+ \d+ \d+ preonly|processor|seconds|cores|^command ddmpi|^versions ddmpi|^\s*$"
    r"|^\w+ \d+\.\d\d( [a-z]|$)"  # of a phase in a report
    r"|^ +\d+ +[\d.]+ +[\d.]+ ± "  # of a mesh
    r"|^(equilibrium|penetration) .* holds "  # where it is worst
)
"""Lines of the machine."""


def masked(text: str) -> list[str]:
    """The lines of a text but for what is of the machine and the day."""
    found = []
    for line in text.splitlines():
        if not UNTOLD.search(line):
            for pattern, mask in MASKS.items():
                line = re.sub(pattern, mask, line)
            found.append(line.rstrip())
    return found


def numbers(values: Any) -> str:
    """Five digits of each."""
    return " ".join(
        f"{value:.5g}" if isinstance(value, float) else str(value).replace(" ", "_")
        for value in values
    )


def table(text: str) -> Iterator[str]:
    """A table of CSV, a column a line."""
    head, *rows = csv.reader(text.splitlines())
    for k, name in enumerate(head):
        values = [as_number(row[k]) for row in rows]
        if len(rows) > MANY and all(isinstance(value, float) for value in values):
            values = [float(len(values)), fold(values)]
        if name not in ("seconds", "update", "residual", "n_A", "eff"):
            yield f"{name}: {numbers(values)}"


def as_number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text or "-"


def entries(value: Any, name: str = "") -> Iterator[str]:
    """An entry of JSON, a leaf a line; lists of numbers are one, and long ones are folded."""
    flat = np.array(value, dtype=object).ravel().tolist() if isinstance(value, list) else None
    if isinstance(value, dict):
        for key, entry in value.items():
            if key not in NO_FACTS:
                yield from entries(entry, f"{name}.{key}" if name else key)
    elif flat and all(isinstance(each, int | float) for each in flat):
        if len(flat) > MANY:
            flat = [float(len(flat)), fold(flat)]
        yield f"{name}: {numbers(map(float, flat))}"
    elif isinstance(value, list) and value and not all(isinstance(each, str) for each in value):
        for k, entry in enumerate(value):
            yield from entries(entry, f"{name}.{k}")
    elif isinstance(value, float):
        yield f"{name}: {numbers([value])}"
    else:
        yield f"{name}: {json.dumps(value, ensure_ascii=False)}"


def page_words(text: str) -> Iterator[str]:
    """The words of a page."""
    text = re.sub(r"<(script|style|svg)\b.*?</\1>", "", text, flags=re.S)
    text = re.sub(r"</(p|tr|h\d|li|div|table|pre)>", "\n", text)
    text = re.sub(r"<[^>]*>", " ", text)
    for line in html.unescape(text).splitlines():
        if line.strip():
            yield " ".join(line.split())


def page(path: Path) -> Iterator[str]:
    """The words of a page, and what its script draws."""
    from browser import unpacked

    text = path.read_text(encoding="utf-8")
    yield from page_words(text)
    if 'id="head"' in text:
        head, arrays = unpacked(path)
        yield from entries({key: head[key] for key in head if key != "arrays"}, "head")
        for name, values in arrays.items():
            yield f"array {name} {len(values)}: {numbers([fold(values)])}"


def vtu(text: str) -> Iterator[str]:
    """The arrays of a file of VTK."""
    for name, values in re.findall(r'Name="(\w+)"[^>]*>([^<]*)<', text):
        found = np.array(values.split(), float)
        yield f"{name} {len(found)}: {numbers([fold(found)])}"


def fold(values: Any) -> float:
    """One number of many, 0 of those that are rounding: the decimal logarithm of their size, and a sum whose weights do
    not repeat."""
    x = np.asarray(values, float).ravel()
    known = np.isfinite(x)
    largest = float(np.abs(x[known]).max(initial=0.0))
    lost = float(np.flatnonzero(~known).sum() + (~known).sum())
    if largest <= TINY:
        return lost
    if len(x) == 1:
        return float(x[0])
    weights = 0.5 + (np.arange(1, len(x) + 1) * 0.6180339887498949) % 1.0
    return lost + math.log10(largest) + float(weights[known] @ x[known]) / largest


def fields(path: Path) -> Iterator[str]:
    """The arrays of a file of fields, folded; those of load steps together."""
    import h5py

    with h5py.File(path) as file:
        found: list[str] = []
        file.visit(found.append)
        arrays: dict[str, list] = {}
        for name in found:
            if isinstance(file[name], h5py.Dataset) and file[name].dtype.kind in "fiu":
                step, _, rest = name.partition("/")
                name = f"step_*/{rest}" if step.startswith("step_") else name
                arrays.setdefault(name, []).append(np.array(file[step + "/" * bool(rest) + rest]))
        for name, values in arrays.items():
            shapes = " ".join("x".join(map(str, each.shape)) for each in values)
            whole = np.concatenate([each.ravel() for each in values])
            yield f"{name} {shapes}: {numbers([fold(whole)])}"


def written(folder: Path, but: str = "checkpoint|log|mechanism.png") -> list[str]:
    """All files below a folder, in words and numbers."""
    found = []
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if not path.is_file() or re.search(but, name):
            continue
        found.append(f"[{name}]")
        if path.suffix in (".png", ".msh", ".npz"):
            continue
        if path.suffix == ".h5":
            found += fields(path)
            continue
        text = path.read_text(encoding="utf-8")
        match path.suffix:
            case ".csv":
                lines = list(table(text))
            case ".json":
                data = json.loads(text)
                lines = list(
                    entries({key: data[key] for key in data if key not in ("scene", "steps")})
                )
            case ".html":
                lines = list(page(path))
            case ".vtu":
                lines = list(vtu(text))
            case ".vtk" | ".xdmf" | ".xmf" | ".pvd":
                lines = []
            case _:
                lines = text.splitlines()
        found += masked("\n".join(lines))
    return found


def said(run: Any) -> list[str]:
    """What a command has said, and how it ended."""
    lines = masked(run.stdout)
    lines += [f"! {line}" for line in masked(run.stderr)]
    return [*lines, f"exit code {run.code}"] if run.code else lines


# Comparison


def parts(line: str) -> tuple[str, list[str]]:
    """The words of a line, and its numbers."""
    return NUMBER.sub("#", line), NUMBER.findall(line)


def is_data(line: str) -> bool:
    _, colon, rest = line.partition(": ")
    return bool(colon) and bool(rest) and not re.search(r"[^\s#]", NUMBER.sub("#", rest))


def digit(text: str) -> float:
    """The last digit of a number as it is printed; 0 of whole ones."""
    exponent = Decimal(text.replace("−", "-")).as_tuple().exponent
    return 10.0**exponent if re.search(r"[.e]", text) else 0.0


def agree(line: str, other: str) -> list[bool] | None:
    """Of each number of two lines whether it is the same; None where words differ."""
    (words, mine), (others, theirs) = parts(line), parts(other)
    if words != others:
        return None
    values = [
        [0.0 if text == "~" else float(text.replace("−", "-")) for text in each]
        for each in (mine, theirs)
    ]
    largest = max((abs(x) for x in values[1]), default=0.0)
    found = []
    for x, y, text, former in zip(*values, mine, theirs, strict=True):
        if "~" in (text, former) or max(abs(x), abs(y)) < TINY:
            found.append(True)
            continue
        limit = (
            BESIDE * largest if is_data(other) else max(digit(text), digit(former), EACH * abs(y))
        )
        found.append(abs(x - y) <= 1.01 * limit)
    return found


def differences(found: list[str], kept: list[str]) -> list[str]:
    """Lines that are not as approved."""
    import difflib

    told = []
    bare = [[parts(line)[0] for line in lines] for lines in (kept, found)]
    for kind, i, j, k, n in difflib.SequenceMatcher(None, *bare, autojunk=False).get_opcodes():
        if kind != "equal":
            told += [f"- {line}" for line in kept[i:j]] + [f"+ {line}" for line in found[k:n]]
            continue
        for old, new in zip(kept[i:j], found[k:n], strict=True):
            if not all(agree(new, old) or []) and parts(new)[1]:
                told += [f"- {old}", f"+ {new}"]
    return told


def compare(name: str, lines: list[str]) -> None:
    """A transcript with the approved one; AssertionError tells lines that differ."""
    if file := os.environ.get(WRITTEN):
        with open(file, "a", encoding="utf-8") as notebook:
            notebook.write(json.dumps({"name": name, "text": lines}) + "\n")
        return
    path = HERE / f"{name}.txt"
    assert path.is_file(), f"there is no approved transcript {path.name}; run {RENEW}"
    told = differences(lines, path.read_text(encoding="utf-8").splitlines())
    assert not told, "\n".join(["not as approved:", *told, f"if it is right, run {RENEW}"])


def merged(name: str, less: list[str], more: list[str]) -> list[str]:
    """What two runs have in common, with ~ for numbers that are rounding. SystemExit where words differ."""
    found = []
    if len(less) != len(more):
        raise SystemExit(f"{name}: lines hang on rounding")
    for line, other in zip(less, more, strict=True):
        same = agree(line, other)
        if same is None:
            raise SystemExit(f"{name}: words hang on rounding:\n{line}\n{other}")
        words = NUMBER.split(line)
        told = [text if one else "~" for text, one in zip(parts(line)[1], same, strict=True)]
        found.append("".join(a + b for a, b in zip(words, [*told, ""], strict=True)))
    return found


def renew(name: str, less: list[str], more: list[str]) -> list[str]:
    """Write a transcript; returns what has changed, if something has."""
    path = HERE / f"{name}.txt"
    former = path.read_text(encoding="utf-8").splitlines() if path.is_file() else None
    text = merged(name, less, more)
    if former is not None and not differences(text, former) and len(text) == len(former):
        return []
    path.write_text("\n".join(text) + "\n", encoding="utf-8")
    return [f"transcript {name}" if former is not None else f"new transcript {name}"]
