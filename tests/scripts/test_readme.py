"""The README: its example runs, and its figures are those of the tables."""

import contextlib
import io
import re

from scenes import ROOT

TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_example_prints_what_stands_below_it():
    code = re.search(r"```python\n(.*?)```", TEXT, re.S)[1]
    shown = "".join(line[2:] + "\n" for line in code.splitlines() if line.startswith("# "))
    assert len([line for line in code.splitlines() if line and not line.startswith("#")]) <= 12
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(code, {})
    # a place may be left out, as (…)
    assert re.fullmatch(
        re.escape(shown).replace(re.escape("(…)"), r"\([^()]*\)"), printed.getvalue()
    )


def test_ratios_to_other_programs_are_those_of_the_table():
    """Of the three scenes that it names, with as many unknowns, the README has the ratios of docs/tables/peers.md."""
    peers = (ROOT / "docs" / "tables" / "peers.md").read_text(encoding="utf-8")
    head, _, *rows = re.search(r"\| \| two boxes.*?\n\n", TEXT, re.S)[0].strip().splitlines()
    sizes = re.findall(r"([\d,]+)(?: unknowns)? \|", head)
    assert len(sizes) == 3 and len(rows) == 2
    for row in rows:
        program, *ratios = (cell.strip() for cell in row.strip("|").split("|"))
        for scene, size, ratio in zip(("boxes", "ball", "wall"), sizes, ratios, strict=True):
            assert re.search(
                rf"\| {scene} \| {re.escape(program)} \| \d+ \| {size} \| [\d.]+ \| {ratio} \|",
                peers,
            )
