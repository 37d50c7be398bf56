"""The report of a run: one HTML file that says how the run ended, whatever the end, and needs nothing else."""

import json
import os
import re
import shutil
import subprocess
import sys
from html import escape, unescape
from html.parser import HTMLParser

import made_up
import numpy as np
import pytest
import scenes
from mpi4py import MPI

from ddmpi.cli import main as cli
from ddmpi.cli.report import write_report
from ddmpi.cli.report_markup import Column, number, table
from ddmpi.errors import InputError, OutputError
from ddmpi.judge.equilibrium import Mechanism
from ddmpi.judge.motions import MotionsOfBody
from ddmpi.results.summary import write_mechanism
from ddmpi.system import interrupt

CHROMIUM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)

VOID = {"meta", "img"}

PIXEL = (
    b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR\x00\x00\x00\x01\x00\x00\x00\x01\x08\x00\x00\x00\x00:~\x9bU\x00\x00\x00\n"
    b"IDATx\x9cc`\x00\x00\x00\x02\x00\x01H\xaf\xa4q\x00\x00\x00\x00IEND\xaeB`\x82"
)


class Page(HTMLParser):
    """A report, read back: its text, its tables by caption as rows of cells, and its pictures by what they show."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open, self.text, self.elements = [], "", set()
        self.tables, self.pictures, self.ids = {}, {}, []
        self.feed(text)
        self.close()
        assert not self.open, self.open

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.elements.add(tag)
        assert not given.keys() & {"href", "onclick", "onload", "style"}
        if tag not in VOID:
            self.open.append(tag)
        if tag == "img":
            assert given["src"].startswith("data:image/")
            self.pictures[given["alt"]] = given["src"]
        self.ids += [given["id"]] if "id" in given else []
        if "aria-label" in given:
            self.rows = self.tables.setdefault(given["aria-label"], [])
        elif tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "style" not in self.open:
            self.text += data
        if {"td", "th"} & set(self.open):
            self.rows[-1][-1] += data

    def column(self, caption: str, head: str) -> list[str]:
        heads, *rows = self.table(caption)
        return [row[heads.index(head)] for row in rows]

    def table(self, caption: str) -> list[list[str]]:
        return next(rows for name, rows in self.tables.items() if name.startswith(caption))


def report(folder) -> Page:
    return Page(write_report(folder).read_text(encoding="utf-8"))


def change(folder, **entries) -> dict:
    """The summary in the folder, with some entries changed."""
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8")) | entries
    (folder / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    return summary


@pytest.fixture
def run(tmp_path):
    """The folder of a converged run of two blocks, without pictures."""
    made_up.results(tmp_path)
    return tmp_path


def test_a_report_has_verdict_numbers_and_pictures(run):
    """A converged run: the verdict first, every number with its unit, each picture inside the file."""
    for name in ("bodies.png", "contact.png", "convergence.png", "animation.gif"):
        (run / name).write_bytes(PIXEL)
    summary = change(
        run,
        warnings=["the mesh is coarse"],
        undetermined=["lower is free to slide"],
        seconds={"total": 2},
        options={"body_pc_type": "gamg"},
        command="ddmpi run scene.toml",
        hosts=["node1", "node1"],
        started="2026-11-22T04:19:14Z",
        versions={"ddmpi": "9.8.7", "petsc": "3.18.5"},
    )
    page = report(run)
    contact = summary["contacts"]["upper-lower"]
    assert (
        page.text.index("Made up")
        < page.text.index("Certified")
        < page.text.index("the mesh is coarse")
    )
    assert page.column("Force and moment", "force y MN/m") == [number(contact["force"][1] / 1e6)]
    assert page.column("Force and moment", "slip") == [str(contact["slip"])]
    assert page.column("Largest displacement", "von Mises stress MPa") == ["80.00", "80.00"]
    assert page.column("The worst", "verdict") == ["holds"] * 5
    assert page.column("Time of", "time s") == ["2.00"]
    assert [src[:15] for src in page.pictures.values()] == [
        "data:image/png;",
        "data:image/png;",
        "data:image/gif;",
        "data:image/png;",
    ]
    assert all(page.pictures)  # each says what it shows
    for words in (
        "7.0 %",
        "lower is free to slide",
        "-body_pc_type gamg",
        "ddmpi run scene.toml",
        "2026-11-22",
        "node1",
        "petsc 3.18.5",
        'title = "Made up"',
        "bound",
    ):
        assert words in page.text, words
    assert len(set(page.ids)) == len(page.ids) and "script" not in page.elements


def test_loads_and_forces_of_clamps_are_told_by_group(run):
    """What acts on a body is listed by group; of earlier results, which do not say it, nothing is."""
    page, caption = report(run), "What loads and supports do to bodies, by group"
    assert [row[:3] for row in page.table(caption)[1:3]] == [
        ["upper", "top", "loads"],
        ["upper", "left", "reactions"],
    ]
    assert page.column(caption, "moment N·m/m")[:2] == ["3.000", "-3.000"]
    bodies = change(run)["bodies"]
    change(
        run,
        bodies={
            name: {key: body[key] for key in body if key not in ("loads", "reactions")}
            for name, body in bodies.items()
        },
    )
    assert caption not in report(run).text


def test_everything_is_escaped(run):
    """Text of the scene is text in the report, whatever it looks like."""
    evil = '</pre></title><script>alert("1")</script><img src=x> & $title ${x} \x7f'
    summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    scene = summary["scene"] | {"title": evil}
    scene["contact"][0]["name"] = scene["contact"][0]["bodies"][0] = evil
    change(
        run,
        title=evil,
        warnings=[evil],
        reason=evil,
        command=evil,
        scene=scene,
        options={evil: evil},
        contacts={evil: summary["contacts"]["upper-lower"]},
        units=dict.fromkeys(summary["units"], evil),
    )
    (run / "contact.png").write_bytes(PIXEL)
    page = report(run)
    assert not {"script", "x"} & page.elements
    assert page.text.count(evil) > 8 and len(page.pictures) == 1


def test_all_numbers_of_a_law_are_said(run):
    """Those of a law that is not there yet as well; what varies is no number."""
    summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    law = {"law": "cohesive", "coefficient": 0.25, "cohesion": 5e6, "limit": {"along": "x"}}
    summary["scene"]["contact"][0]["friction"] = law
    change(run, scene=summary["scene"])
    assert "Cohesive 0.25, 5e+06, varying" in report(run).text


def test_a_body_alone_has_no_contacts(run):
    """Neither empty tables nor a pressure that is not computed."""
    summary = change(run)
    assert "contact nodes" in report(run).text and "contacts" in report(run).ids
    name = next(iter(summary["bodies"]))
    body = next(each for each in summary["scene"]["body"] if each["name"] == name)
    scene = summary["scene"] | {"body": [body], "contact": []}
    bodies = {name: summary["bodies"][name]}
    change(run, contacts={}, bodies=bodies, scene=scene, m=0, n_A=1)
    page = report(run)
    assert "contacts" not in page.ids and "contact nodes" not in page.text
    assert "not computed" not in page.text and "normal forces" not in page.text
    assert "elements, 1 body\n" in page.text and "1 solve with" in page.text


def test_a_bond_in_tension_has_no_pressure(run):
    """What would be a negative pressure is the least tension."""
    contacts = change(run)["contacts"]
    ((name, one),) = contacts.items()
    assert "least tension" not in report(run).text
    change(run, contacts={name: one | {"pressure_max": -5e5}})
    assert f"{name}: least tension " in report(run).text


def test_forces_of_bolts_are_said(run):
    """At the top the least one; with the contacts all, with their offsets."""
    assert "olt force" not in report(run).text
    contact = change(run)["contacts"]
    (one,) = contact.values()
    bolts = {
        "left": one | {"pretension": {"force": 5000.0, "offset": 1.302e-4}},
        "right": one | {"pretension": {"force": 4600.0, "offset": 1.2e-4}},
    }
    scene = change(run)["scene"]
    scene["contact"] = [scene["contact"][0] | {"name": name} for name in bolts]
    change(run, contacts=bolts, scene=scene)
    text = report(run).text
    assert "of right, the least of 2" in text
    assert re.search(
        r"Bolt forces: left: 5\.000 kN.* at the offset 130\.2 µm\. right: 4\.600 kN", text
    )


def test_a_run_that_has_not_converged_says_so(run):
    """Without a certified answer the report names what fails, and calls no number an answer."""
    summary = change(run, converged=False, reason="not converged: method.max_iterations is reached")
    summary["certificate"] |= {"friction": 0.24, "penetration": None}
    summary["contacts"]["upper-lower"]["certificate"] |= {"friction": 0.24, "penetration": None}
    change(run, **summary)
    page = report(run)
    assert "No certified answer" in page.text and "Certified" not in page.text
    assert (
        "Above the limit of 5e-07: penetration –, friction 0.24. The numbers below are those"
        in page.text
    )
    assert page.column("The worst", "verdict") == ["holds", "fails", "holds", "fails", "holds"]


@pytest.mark.parametrize(
    ("reason", "head", "words"),
    [
        ("the estimated discretization error is 0.07", "Accuracy not reached", "is 0.07"),
        (
            "no equilibrium found: lower drifts to the left",
            "No equilibrium foundlower drifts to the left",
            "no answer",
        ),
    ],
)
def test_other_ends_have_heads_of_their_own(run, reason, head, words):
    """A certified answer on too coarse a mesh; no equilibrium found, which is no mechanism: its numbers stay."""
    change(run, converged=False, reason=reason)
    page = report(run)
    assert head in page.text and words in page.text and "Above the limit" not in page.text
    assert page.table("Force and moment")


def test_a_mechanism_is_shown_instead_of_numbers(run):
    """A refused run shows how the bodies would move, and no forces or stresses."""
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    motions = np.stack(
        [np.tile(axis, (4, 1)) for axis in np.eye(2)] + [square[:, ::-1] * (-1.0, 1.0)], axis=2
    )
    mechanism = Mechanism(
        (MotionsOfBody.of("upper", square, motions),), np.array([[-0.35, 0.35, 0.7]]), 0.1
    )
    write_mechanism(run, mechanism)
    reason = json.loads((run / "mechanism.json").read_text(encoding="utf-8"))["reason"]
    change(run, converged=False, reason=reason)
    page = report(run)
    assert not page.pictures and f"python -m ddmpi figures {run}" in page.text
    (run / "mechanism.png").write_bytes(PIXEL)
    page = report(run)
    assert list(page.pictures) == [reason]
    assert (
        f"No equilibrium{reason.partition(': ')[2]}" in page.text
        and "imbalance is 0.10" in page.text
    )
    assert not [name for name in page.tables if "Force" in name or "residual" in name]


@pytest.mark.parametrize(("contacts", "shown"), [(1, 3), (5, 3)])
def test_many_load_steps_are_condensed(run, contacts, shown):
    """Of many load steps those at the ends of legs are listed; of many contacts their sums."""
    summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    contact, asked = summary["contacts"]["upper-lower"], summary["scene"]["contact"][0]
    names = [f"c{k}" for k in range(contacts)]
    steps = [
        {"time": k / 10, "outer_iterations": 5, "contacts": dict.fromkeys(names, contact)}
        for k in range(1, 31)
    ]
    scene = summary["scene"] | {
        "time": {"points": [1.0, 2.0, 3.0], "steps": 10, "tolerance": None},
        "contact": [asked | {"name": name} for name in names],
    }
    energy = {
        "external_work": 3.0,
        "strain_energy": 2.0,
        "interface_work": 1.0,
        "dissipated": 0.75,
        "lost": 0.25,
        "residual": 1e-14,
    }
    change(run, contacts=dict.fromkeys(names, contact), steps=steps, scene=scene, energy=energy)
    page = report(run)
    caption = "Forces on the first body;" if contacts == 1 else "Nodes of all contacts"
    assert page.column(caption, "time") == ["1", "2", "3"] and "3 of 30 steps" in page.text
    assert page.column(caption, "open") == [str(contacts * contact["open"])] * shown
    assert page.column("Energy", "energy J/m") == ["3.000", "2.000", "1.000", "0.7500", "0.2500"]
    change(run, scene=scene | {"time": {"points": list(np.arange(1, 31) / 10)}})
    times = report(run).column(caption, "time")
    assert len(times) == len(set(times)) == 24 and (times[0], times[-1]) == ("0.1", "3")


def test_a_sweep_has_a_report(tmp_path):
    """A sweep: a line for each case with what was varied and how it ended, and the plots."""
    (tmp_path / "sweep.json").write_text(json.dumps({"scene": {"title": "Two <blocks>"}}))
    with pytest.raises(InputError, match=r"no sweep\.csv yet"):
        write_report(tmp_path)
    (tmp_path / "sweep.csv").write_text(
        "case,method.theta,status,exit,reason,outer_iterations,n_A,displacement_max,seconds.total,folder,"
        "warnings\n0,0.2,certified,0,,9,120,0.001,0.5,a,slid <far>\n1,2.0,not converged,3,diverged,,,,,b,\n"
    )
    (tmp_path / "n_A-theta.png").write_bytes(PIXEL)
    page = report(tmp_path)
    assert (
        "Two <blocks>" in page.text
        and "1 of 2 cases certified" in page.text
        and list(page.pictures)
    )
    assert "Cases that warn: 1." in page.text and "Case 0: slid <far>" in page.text
    assert page.table("A line")[1:] == [
        ["0", "0.2", "certified", "9", "120", "1.00", "–", "0.50"],
        ["1", "2", "not converged: diverged", "–", "–", "–", "–", "–"],
    ]


def test_the_name_of_the_folder_may_be_no_text(run):
    """As one whose bytes are in another code than UTF-8."""
    folder = run.rename(run.parent / os.fsdecode(b"no\xfftext"))
    assert write_report(folder) == folder / "report.html"
    assert "no\\udcfftext" in (folder / "report.html").read_text(encoding="utf-8")


def test_only_reports_are_overwritten(run):
    """An earlier report is written anew; any other file is left alone."""
    assert write_report(run) == write_report(run, str(run / "report.html")) == run / "report.html"
    other = run / "history.csv"
    before = other.read_bytes()
    for taken in (other, run):
        with pytest.raises(InputError, match="is there already, and no report of ddmpi"):
            write_report(run, str(taken))
    assert other.read_bytes() == before
    with pytest.raises(OutputError, match="cannot be written"):
        write_report(run, str(run / "absent" / "report.html"))


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ({}, "not a complete folder of results: there is no summary.json"),
        ({"checkpoint.h5": ""}, "--restart"),
        ({"summary.json": "["}, "not a complete folder"),
        ({"summary.json": "[]"}, "not a complete folder"),
        ({"summary.json": '{"format": 7}'}, "format 7"),
        ({"summary.json": '{"format": 2}'}, "there is no 'scene'"),
        ({"sweep.json": '{"scene": {}}'}, "has no sweep.csv yet"),
        ({"sweep.json": "{", "sweep.csv": "case\n1\n"}, "not the record of a sweep"),
        ({"sweep.json": "{}", "sweep.csv": "case\n1\n"}, "not the record of a sweep"),
        ({"sweep.json": '{"scene": {}}', "sweep.csv": "case,status\n"}, "has no cases"),
    ],
)
def test_what_is_no_run_is_refused(tmp_path, capsys, files, words):
    """Another folder is refused with one message and exit code 2, and nothing is written into it."""
    for name, content in files.items():
        (tmp_path / name).write_text(content)
    try:
        assert cli._main(MPI.COMM_SELF, ["report", str(tmp_path)], []) == 2
    finally:
        interrupt._handlers.clear()
        cli.logs.close()  # they print into what capsys closes
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1 and words in said[0] and str(tmp_path) in said[0]
    assert {path.name for path in tmp_path.iterdir()} == files.keys()


@pytest.mark.slow
def test_the_command_prints_the_path_and_is_light(run):
    """`ddmpi report DIR` needs neither PETSc nor matplotlib."""
    code = """
import sys
from ddmpi.cli.main import main
try:
    main(["report", sys.argv[1], "--output", sys.argv[2]])
finally:
    print(*[name for name in ("petsc4py.PETSc", "matplotlib", "h5py", "gmsh", "meshio") if name in sys.modules])
"""
    child = subprocess.run(
        [sys.executable, "-c", code, run, run / "a b.html"],
        capture_output=True,
        text=True,
        timeout=scenes.LIMIT,
        env=scenes.clean_environment(),
        cwd=scenes.ROOT,
    )
    assert (child.returncode, child.stdout.splitlines()) == (0, [str(run / "a b.html"), ""]), (
        child.stderr
    )
    assert "Certified" in Page((run / "a b.html").read_text(encoding="utf-8")).text


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0.0, "0"),
        (-0.0, "0"),
        (12, "12"),
        (None, "–"),
        (115.0e6, "115.0 MN/m"),
        (-8.3688e6, "-8.369 MN/m"),
        (0.9999, "999.9 mN/m"),
        (9.99996, "10.00 N/m"),
        (2.5e-17, "2.500e-17 N/m"),
    ],
)
def test_numbers(value, shown):
    """Numbers have four digits and a prefix that suits them."""
    assert number(value, unit="N/m" if isinstance(value, float) and value else "") == shown


def test_numbers_of_a_table_share_a_prefix():
    """Columns of one unit have one prefix; rounding errors are about zero, a zero and a missing number are not."""
    text = table(
        "t",
        Column("name", ["a", "b", "c"]),
        Column("x", [2.0e6, 1e-9, None], "Pa"),
        Column("y", [-5.0e3, 0.0, 1.0], "Pa"),
    )
    assert Page(text).tables["t"] == [
        ["name", "x MPa", "y MPa"],
        ["a", "2.000", "-0.005000"],
        ["b", "≈ 0", "0"],
        ["c", "–", "1.000e-06"],
    ]


@pytest.mark.slow
@pytest.mark.skipif(not CHROMIUM, reason="no Chromium to open reports with")
def test_a_report_fits_a_phone(run):
    """At 390 pixels wide tables scroll in their own boxes with the names of rows; at 1200 none does."""
    page = write_report(run).read_text(encoding="utf-8")
    script = """<script>addEventListener("load", () => document.title = JSON.stringify([...document.querySelectorAll(
      "iframe")].map(({contentDocument: page}) => {
        const boxes = [...page.querySelectorAll(".wide")].filter(box => box.scrollWidth > box.clientWidth);
        for (const box of boxes) box.scrollLeft = 50;
        return {beyond: page.documentElement.scrollWidth - page.documentElement.clientWidth, moved: boxes.map(
          box => [box, box.querySelector("tbody th")].map(one => one.getBoundingClientRect().left))};
    })))</script>"""
    frame = '<iframe style="width: {}px; height: 800px; border: 0" srcdoc="{}"></iframe>'
    (run / "two.html").write_text(
        script + "".join(frame.format(width, escape(page)) for width in (390, 1200)),
        encoding="utf-8",
    )
    dom = subprocess.run(
        [
            CHROMIUM,
            "--headless=new",
            "--no-sandbox",
            "--disable-gpu",
            "--virtual-time-budget=20000",
            f"--user-data-dir={run / 'profile'}",
            "--dump-dom",
            f"file://{run}/two.html",
        ],
        capture_output=True,
        text=True,
        timeout=scenes.LIMIT,
    )
    phone, desk = json.loads(unescape(re.search("<title>(.*?)</title>", dom.stdout)[1]))
    assert phone["beyond"] == 0 and len(phone["moved"]) >= 3 and desk == {"beyond": 0, "moved": []}
    assert all(name == box for box, name in phone["moved"])
