"""Files from elsewhere: whatever they hold, there is a message and an exit code, and only the output folder changes."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from random import Random

import made_up
import pytest
import scenes
from mpi4py import MPI

from ddmpi.cli import main as cli
from ddmpi.results import checkpoint
from ddmpi.scene.reader import read_scene_file
from ddmpi.system import interrupt
from ddmpi.system.provenance import whereabouts

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("by_itself")]

STEEL = {"young": 2.1e11, "poisson": 0.3}

PLATE = """Point(1) = {0, 0, 0}; Point(2) = {2, 0, 0}; Point(3) = {2, 1, 0}; Point(4) = {0, 1, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1};
Physical Curve("bottom") = {1}; Physical Curve("top") = {3};
"""

TOUCH = "touch VICTIM/touched"


def scene(**mesh) -> dict:
    """A plate of any `mesh` under a block."""
    return {
        "body": [
            {"name": "plate", "mesh": mesh, "material": dict(STEEL), "clamp": ["bottom"]},
            scenes.rectangle(
                "block",
                (0, 1),
                (2, 1),
                (4, 2),
                **STEEL,
                clamp=[{"on": "top", "x": 0.0, "y": -1e-4}],
            ),
        ],
        "contact": [{"bodies": ["plate", "block"], "on": ["top", "bottom"]}],
    }


def drawn(script: str = "", name: str = "plate.geo", **others: str) -> dict[str, str | bytes]:
    """A plate with a further script, and other files, "a_geo" for "a.geo"."""
    text = scenes.to_toml(scene(geometry=name, size=0.5))
    return {"scene.toml": text, name: PLATE + script} | {
        name.replace("_", "."): text for name, text in others.items()
    }


def filed(content: str | bytes, name: str = "plate.msh") -> dict[str, str | bytes]:
    """A plate from a mesh file."""
    return {"scene.toml": scenes.to_toml(scene(file=name)), name: content}


class Place:
    """Folders of a test: `given`, from elsewhere; `victim`, of somebody; `out`, of the results; and for the rest."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.given, self.victim, self.out = (
            folder,
            folder / "given",
            folder / "victim",
            folder / "out",
        )
        for name in ("given", "victim/folder", "here", "tmp"):
            (folder / name).mkdir(parents=True)
        (self.victim / "thesis.txt").write_text("years of work")

    def put(self, files: dict[str, str | bytes]) -> None:
        for name, content in files.items():
            path = self.given / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(
                (content.encode() if isinstance(content, str) else content).replace(
                    b"VICTIM", bytes(self.victim)
                )
            )

    def tree(self) -> dict[str, object]:
        """All but the results: what each file holds, and where each link leads."""
        return {
            str(path): os.readlink(path)
            if path.is_symlink()
            else hashlib.sha256(path.read_bytes()).hexdigest()
            if path.is_file()
            else path.is_dir()
            for path in self.folder.rglob("*")
            if self.out not in (path, *path.parents)
        }


@pytest.fixture
def place(tmp_path, monkeypatch) -> Iterator[Place]:
    """Folders, the current one among them; signals are as before at the end."""
    found = Place(tmp_path)
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    before = {number: signal.getsignal(number) for number in interrupt.SIGNALS}
    yield found
    interrupt._handlers.clear()
    for number, handler in before.items():
        signal.signal(number, handler)
    cli.logs.configure(0)


def told(place: Place, capsys, *arguments: str) -> tuple[int, str]:
    """Exit code and the one message of a command, after which nothing but the output folder has changed."""
    before = place.tree()
    code = cli._main(MPI.COMM_SELF, list(arguments), [])
    # on a busy machine gmsh takes long enough to be waited for in words; and a clamped plate has infinite stresses
    beside = (
        ": gmsh is meshing ",
        "ddmpi: warning: body.plate: the largest",
        " cases warn, each in",
    )
    lines = [
        line
        for line in capsys.readouterr().err.splitlines()
        if not any(words in line for words in beside)
    ]
    assert place.tree() == before
    assert len(lines) == (1 if code else 0), lines
    return code, "\n".join(lines)


def run(place: Place, capsys, *more: str) -> tuple[int, str]:
    scene = str(place.given / "scene.toml")
    return told(place, capsys, "run", scene, "--output", str(place.out), "--no-figures", *more)


# Drawings and meshes

HARM = "could start programs or write files"

HIDDEN = f"a = 'Sys'; b = 'temCall'; c = '{TOUCH}';\n"

DRAWINGS = {
    "a command": (drawn(f'SystemCall "{TOUCH}";'), f"{HARM} (SystemCall in line 5 of plate.geo)"),
    "a command behind a comment": (drawn(f'/* " */ SystemCall "{TOUCH}"; // "'), HARM),
    "a command in the background": (drawn(f'NonBlockingSystemCall "{TOUCH}";'), HARM),
    "a short word for it": (drawn(f'System "{TOUCH}";'), HARM),
    "a word made of strings": (drawn(HIDDEN + "S2N[StrCat[a, b]] Str[c];"), HARM),
    "a word made of strings, in full": (
        drawn(HIDDEN + f'StringToName[StrCat[a, b]] "{TOUCH}";'),
        HARM,
    ),
    "a command after a condition that reads on in a string": (
        drawn(f'If(0)\nI"x // ";\nEndIf SystemCall \'{TOUCH}\'; //"\n'),
        HARM,
    ),
    "a command after a long string": (
        drawn(f"a = \"{'x' * 1023} ; SystemCall '{TOUCH}'; b = '\";"),
        HARM,
    ),
    "a size field": (
        drawn(
            f'Field[1] = ExternalProcess; Field[1].CommandLine = "{TOUCH}"; Background Field = 1;'
        ),
        HARM,
    ),
    "a solver": (drawn(f'Solver.Executable0 = "{TOUCH}"; OnelabRun("a", "{TOUCH}");'), HARM),
    "a mesh saved": (drawn('Mesh 2; Save "VICTIM/thesis.txt";'), HARM),
    "a picture": (drawn('Print "VICTIM/thesis.txt";'), HARM),
    "words into a file": (drawn('Printf("gone") > "VICTIM/thesis.txt";'), "cannot be read (gmsh: "),
    "a folder": (drawn('CreateDir "VICTIM/new";'), HARM),
    "a plugin": (drawn('Plugin(BoundaryAngles).Dir = "VICTIM"; Plugin(BoundaryAngles).Run;'), HARM),
    "a temporary file": (drawn('General.TmpFileName = "../victim/thesis.txt";'), HARM),
    "an end": (drawn("Exit 3;"), "ends gmsh (exit code 3)"),
    "an end of all": (
        drawn("Abort;", "plate.GEO") | {"plate.GEO": "Abort;" + PLATE},
        "has no surface",
    ),
    "another script": (
        drawn('Include "other.geo";', other_geo=f'SystemCall "{TOUCH}";'),
        f"{HARM} (SystemCall in line 1 of other.geo)",
    ),
    "another script under a name made of strings": (
        drawn('Include StrCat["other", ".geo"];', other_geo=""),
        "reads a file whose name is not written out (Include in line 5",
    ),
    "a script first read as data": (
        drawn('a() = ListFromFile["a.dat"]; Include "a.dat";', a_dat=f'SystemCall "{TOUCH}";'),
        HARM,
    ),
    "a script as a drawing of CAD": (
        drawn("", "plate.Step") | {"plate.Step": f'SystemCall "{TOUCH}";'},
        "cannot be read",
    ),
    "a script as a solid to merge": (
        drawn('Merge "a.STP";', a_STP=f'SystemCall "{TOUCH}";'),
        "cannot be read",
    ),
    "options beside a drawing": (
        drawn("foo;") | {"plate.geo.opt": f'SystemCall "{TOUCH}";'},
        "syntax error",
    ),
    "a script that is not there": (
        drawn('Include "absent.geo";'),
        "absent.geo cannot be read: No such file",
    ),
    "itself": (drawn('Include "plate.geo";'), "cannot be "),
    "a folder to include": (drawn('Include "..";'), "cannot be read: Is a directory"),
    "noise": (drawn() | {"plate.geo": bytes(range(256)) * 40}, "cannot be read"),
    "nothing": (drawn() | {"plate.geo": b""}, "has no surface"),
}


@pytest.mark.parametrize("name", DRAWINGS)
def test_a_drawing_starts_no_program_and_writes_no_file(place, capsys, name):
    """A .geo that could do so is refused, whatever it hides it in, and so are files that gmsh would take for one."""
    files, words = DRAWINGS[name]
    place.put(files)
    code, message = run(place, capsys)
    assert code == 2 and words in message and "plate.mesh.geometry: " in message


MESHES = {
    "a script after a space": filed(f' \n$MeshFormat\nSystemCall "{TOUCH}";'),
    "a script after a header": filed(
        f'$MeshFormat\n4.0 0 8\n$EndMeshFormat\nSystemCall "{TOUCH}";\n'
    ),
    "a script of an old version": filed(f'$NOD\n1\n1 0 0 0\n$ENDNOD\nSystemCall "{TOUCH}";\n'),
    "options beside an old mesh": filed("$MeshFormat\n4.0 0 8\n$EndMeshFormat\n")
    | {"plate.msh.opt": f'SystemCall "{TOUCH}";'},
    "an unknown version": filed("$MeshFormat\n9.9 0 8\n$EndMeshFormat\n"),
    "more nodes than there are": filed(
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 99 1 99\n2 1 0 99\n1\n"
    ),
    "noise": filed(
        b"$MeshFormat\n4.1 1 8\n\1\0\0\0\n$EndMeshFormat\n$Nodes\n" + bytes(range(256)) * 40
    ),
    "an input that includes itself": filed(
        "*INCLUDE, INPUT=VICTIM/../given/plate.inp\n", "plate.inp"
    ),
    "an input of other words": filed("*NODE\n1, a, b\n", "plate.inp"),
    "an empty input": filed("", "plate.inp"),
    "no HDF5": filed(f'SystemCall "{TOUCH}";', "plate.med"),
    "an XML of entities": filed(
        "<!DOCTYPE a [<!ENTITY a 'aaaaaaaaaa'>"
        + "".join(f"<!ENTITY a{k} '{f'&a{k - 1 or str()};' * 10}'>" for k in range(1, 12))
        + "]><VTKFile>&a11;</VTKFile>",
        "plate.vtu",
    ),
    "a header of VTK": filed(
        "# vtk DataFile Version 4.2\n\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 99999999999 "
        "double\n0 0 0\n",
        "plate.vtk",
    ),
    "nothing": filed(""),
}


@pytest.mark.parametrize("name", MESHES)
def test_a_mesh_file_is_no_script(place, capsys, name):
    """gmsh runs files as scripts that do not begin as a mesh does; they are refused."""
    place.put(MESHES[name])
    code, message = run(place, capsys)
    assert code == 2 and "plate.mesh.file: " in message and "is not a mesh that " in message


def test_a_trusted_drawing_may_start_programs(place, capsys, monkeypatch):
    """DDMPI_TRUST_GEOMETRY=1 allows all that gmsh does; nothing in a file can."""
    script = f'SystemCall "{TOUCH}"; Printf("now") > "VICTIM/folder/said"; Include "more.geo";\n'
    place.put(drawn(script, more_geo="a = 1;\n"))
    monkeypatch.setenv("DDMPI_TRUST_GEOMETRY", "1")
    arguments = ["run", str(place.given / "scene.toml"), "--output", str(place.out), "--no-figures"]
    assert cli._main(MPI.COMM_SELF, arguments, []) == 0, capsys.readouterr().err
    assert (place.victim / "touched").exists() and (
        place.victim / "folder" / "said"
    ).read_text() == "now\n"


def test_harmless_scripts_are_drawn(place, capsys):
    """Comments may hold any words; messages, options of pictures, lists from files and several scripts are no harm."""
    place.put(
        drawn(
            """// Save the mesh, SystemCall by hand
    /* Print "x"; */ Printf("Include %g", 1); Print.Text = 0; a() = ListFromFile["a.dat"]; Include 'b c.geo';
    If (#a() == 2 && a(1) > 6 && b == 3 && FileExists("a.dat") && !FileExists("none"))
      Physical Curve("right") = {2};
    EndIf
    """.replace("Include %g", "%g"),
            a_dat="5 7\n",
        )
        | {"b c.geo": "b = 3; // the end"}
    )
    assert run(place, capsys, "--set", 'body.plate.clamp=["bottom","right"]') == (0, "")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_drawing_without_end_can_be_ended(place, number):
    """A signal ends the run while gmsh draws, with exit code and message; gmsh ends with it."""
    place.put(drawn("For i In {1:1000000000}\nEndFor"))
    before = place.tree()
    command = [
        sys.executable,
        "-m",
        "ddmpi",
        "run",
        place.given / "scene.toml",
        "--output",
        place.out,
    ]
    with subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        text=True,
        cwd=scenes.ROOT,
        env=scenes.clean_environment() | {"TMPDIR": str(place.folder / "tmp")},
    ) as process:
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
        end = time.monotonic() + scenes.LIMIT
        while not (gmsh := children.read_text().split()):
            assert time.monotonic() < end and process.poll() is None
            time.sleep(0.05)
        process.send_signal(number)
        words = process.communicate(timeout=scenes.LIMIT)[1]
        while any(scenes.is_alive(each) for each in gmsh):
            assert time.monotonic() < end
            time.sleep(0.05)
    if number == signal.SIGTERM:
        assert (
            process.returncode == 6
            and "interrupted by SIGTERM" in words
            and len(words.splitlines()) == 1
        )
        # Folders of Open MPI 5 do not count.
        left = {path: held for path, held in place.tree().items() if "/tmp/ompi." not in path}
        assert left == before and not place.out.exists()


# Folders of results

DEAD = f"{whereabouts().split()[0]} 999999999"
"""The claim of a process that cannot be."""

PLAIN = filed("") | {
    "scene.toml": scenes.to_toml(scene(shape="rectangle", size=[2.0, 1.0], divisions=[4, 2]))
}


@pytest.mark.parametrize(
    "moved",
    [
        "../victim/thesis.txt",
        "VICTIM/thesis.txt",
        "a\n../given/scene.toml\nb",
        "a\0b",
        b"\xff\xfe",
        "/",
        "",
    ],
)
def test_lists_of_moved_files_reach_no_other_folder(place, capsys, moved):
    """What a killed run has left names files of its own folder; all else in such a list is no name."""
    place.put(PLAIN | {f"../out/.unfinished/{DEAD}/.moved": moved})
    assert run(place, capsys) == (0, "")
    assert (place.out / "summary.json").exists() and not (place.out / ".unfinished").exists()


def linked(place: Place) -> None:
    """The claim of an output folder is a link to a folder of somebody."""
    (place.victim / "folder" / DEAD).mkdir()
    (place.victim / "folder" / DEAD / ".moved").write_text("thesis.txt")
    place.out.mkdir()
    (place.out / ".unfinished").symlink_to(place.victim / "folder")


CLAIMS = {
    "a link": (linked, "is a link"),
    "a file": (lambda place: place.put({"../out/.unfinished": ""}), "cannot write there"),
    **{
        f"the folder {name}": (
            lambda place, name=name: place.put({f"../out/.unfinished/{name}/.moved": "a"}),
            "another run is at work there",
        )
        for name in (
            "foreign",
            "a b",
            "a 1 2",
            "here 99999999999999999999",
            f"{DEAD} job",
            "héros 7",
        )
    },
}


@pytest.mark.parametrize("name", CLAIMS)
def test_folders_claimed_by_others_are_left_alone(place, capsys, name):
    """What stands in the place of a claim and is none is not touched."""
    put, words = CLAIMS[name]
    place.put(PLAIN)
    put(place)
    inside = sorted(place.out.rglob("*"))
    code, message = run(place, capsys)
    assert code == 2 and words in message and sorted(place.out.rglob("*")) == inside


@pytest.mark.parametrize(
    ("name", "code", "words"),
    [
        (".unfinished/foreign/.moved", 3, "1 not run"),
        ("run.log", 5, "run.log: is a link"),
        ("", 5, "is a link"),
    ],
)
def test_sweeps_write_into_no_other_folder(place, capsys, name, code, words):
    """Nor through links in a sweep's folder."""
    place.put(PLAIN)
    sweep = [
        "sweep",
        str(place.given / "scene.toml"),
        "--vary",
        "method.tolerance=1e-9,1e-8",
        "--output",
        str(place.out),
        "--set",
        "output.figures=false",
    ]
    assert cli._main(MPI.COMM_SELF, [*sweep, "--index", "1"], []) == 0, capsys.readouterr().err
    case = place.out / "method.tolerance=1e-9"
    if name == "":
        case.symlink_to(place.victim / "folder")
    else:
        (case / name).parent.mkdir(parents=True)
        (case / name).symlink_to(place.victim / "thesis.txt")
    ended, message = told(place, capsys, *sweep)
    assert ended == code and words in message


def test_reports_are_not_written_through_links(place, capsys):
    """A link in the place of a report is no report."""
    place.out.mkdir()
    made_up.results(place.out, divisions=(6, 2))
    (place.out / "report.html").symlink_to(place.victim / "thesis.txt")
    assert told(place, capsys, "report", str(place.out))[0] == 2


def test_pictures_are_not_drawn_through_links(place, capsys):
    """A picture takes the place of a link, and leaves alone what it leads to."""
    place.out.mkdir()
    made_up.results(place.out, divisions=(6, 2))
    links = [place.out / name for name in ("bodies.png", "convergence.png", "contact.png")]
    for link in links:
        link.symlink_to(place.victim / "thesis.txt")
    assert told(place, capsys, "figures", str(place.out)) == (0, "")
    assert not any(link.is_symlink() for link in links)


# Scenes

DEEP = 100_000


def changed(path: str, value: object) -> str:
    """The plain scene with another value at a dotted path."""
    made = scene(shape="rectangle", size=[2.0, 1.0], divisions=[4, 2])
    *parts, last = (int(part) if part.isdecimal() else part for part in path.split("."))
    inner: dict = made
    for part in parts:
        inner = inner.setdefault(part, {}) if isinstance(inner, dict) else inner[part]
    inner[last] = value
    return scenes.to_toml(made)


LOAD = "body.0.traction"

SCENES = {
    **{
        f"a load of {load}": (
            changed(LOAD, [{"on": "right", "value": [0.0, load]}]),
            2,
            "traction.0.value.1: ",
        )
        for load in (1e200, -1e300, 1.7e308, float("inf"), 10**400)
    },
    "a stiffness of 1e300": (
        changed("body.0.material.young", 1e300),
        2,
        "young: expected a number <= 1e+100",
    ),
    "a stiffness of 1e-99": (changed("body.0.material.young", 1e-99), 4, "1e-06 is needed"),
    "a place of 1e99": (
        changed("body.0.mesh.origin", [1e99, 0.0]),
        2,
        "plate.mesh: its triangles have no area",
    ),
    "a place of 1e300": (
        changed("body.0.mesh.origin", [1e300, 0.0]),
        2,
        "origin.0: expected a number <= 1e+100",
    ),
    "a size of 1e-300": (
        changed("body.0.mesh.size", [2e-300, 1e-300]),
        2,
        "plate.mesh: its triangles have no area",
    ),
    "a clamp moved by 1e200": (
        changed("body.0.clamp", [{"on": "bottom", "x": 1e200}]),
        2,
        "clamp.0.x: ",
    ),
    "an error of 1e-300": (
        changed("method.target_error", 1e-300),
        2,
        "target_error: expected a number >= 1e-09",
    ),
    **{
        f"{number} divisions": (changed("body.0.mesh.divisions", number), 2, words)
        for number, words in (
            ([10**9, 10**9], "divisions: 2e+18 triangles need more than 3.7e+11 GiB"),
            ([10**9, 1], "GiB are free"),
            ([10**30, 1], "divisions.0: expected a whole number <= 1000000000000"),
        )
    },
    "a list in lists": (f"title = {'[' * DEEP}{']' * DEEP}", 2, "is nested too deeply"),
    "a table in tables": (f"title = {'{a=' * DEEP}1{'}' * DEEP}", 2, "is nested too deeply"),
    "a key of keys": (f"a{'.a' * DEEP} = 1", 2, "is nested too deeply"),
    "a header of keys": (f"[{'a . ' * DEEP}a]", 2, "is nested too deeply"),
    "an integer of many digits": (
        f"title = {'9' * 5000}",
        2,
        "not valid TOML: Exceeds the limit (4300 digits)",
    ),
    "noise": (bytes(range(256)), 2, "not a text file in UTF-8"),
    "a formula of many powers": (
        changed(LOAD, [{"on": "right", "value": [0.0, "9**9**9"]}]),
        2,
        "not a finite number",
    ),
    "a formula that imports": (
        changed(LOAD, [{"on": "right", "value": [0.0, "__import__('os').system('x')"]}]),
        2,
        "cannot be evaluated",
    ),
    "a formula in brackets": (
        changed(LOAD, [{"on": "right", "value": [0.0, "(" * 400 + "x" + ")" * 400]}]),
        2,
        "cannot be evaluated",
    ),
    **{
        f"PETSc's {name}": (
            changed(f"petsc.{name}", value),
            2,
            f"petsc.{name}: could start a program or name a file",
        )
        for name, value in {
            "body_ksp_view": "ascii:VICTIM/thesis.txt",
            "body_ksp_view_mat": "binary",
            "log_view": ":VICTIM/thesis.txt",
            "info": "thesis",
            "log_trace": "thesis",
            "options_file": "given",
            "dll_append": "given",
            "qp_tao_python_type": "given.code",
            "on_error_attach_debugger": True,
            "body_mat_mumps_ooc_tmpdir": "VICTIM",
            "a": "-options_file",
        }.items()
    },
}


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_of_any_numbers_is_answered(place, capsys, name):
    """Numbers out of range, more elements than memory, nesting and options beyond the run have a message each."""
    text, code, words = SCENES[name]
    place.put(PLAIN | {"scene.toml": text})
    found, message = run(place, capsys)
    assert found == code and words in message and not place.out.exists()


def test_petsc_may_print(place, capsys):
    """Options that only print, and ddmpi's own solver by its name, stand in a scene."""
    place.put(PLAIN)
    options = (
        "petsc.body_ksp_view=true",
        "petsc.log_view=::ascii_info_detail",
        "petsc.body_ksp_rtol=1e-9",
        "petsc.qp_tao_python_type=ddmpi.mprgp.MPRGP",
        "petsc.newton_ksp_gmres_restart=-1",
    )
    read_scene_file(place.given / "scene.toml", options)


# Summaries and records

ODD: tuple[object, ...] = (
    None,
    True,
    7,
    -1.5,
    "word",
    [],
    [1],
    [[None]],
    {},
    {"a": None},
    "../../victim/x",
    10**400,
)


def spoilt(summary: dict, seed: int) -> dict:
    """A summary with another value in one place, of any depth."""
    random = Random(seed)
    result = json.loads(json.dumps(summary))
    inner, depth = result, random.randint(1, 4)
    while True:
        keys = list(inner) if isinstance(inner, dict) else range(len(inner))
        key = random.choice(keys)
        depth -= 1
        if depth == 0 or not (isinstance(inner[key], dict | list) and inner[key]):
            inner[key] = random.choice(ODD)
            return result
        inner = inner[key]


@pytest.mark.parametrize("command", ["report", "figures"])
def test_summaries_of_other_types(place, capsys, command):
    """A report or pictures of a summary with a value of another type: they are made, or there is one message."""
    place.out.mkdir()
    summary = made_up.results(place.out, divisions=(6, 2))
    codes = []
    for seed in range(20) if command == "report" else (14, 15, 17):  # pictures do not read all
        (place.out / "summary.json").write_text(json.dumps(spoilt(summary, seed)))
        codes.append(told(place, capsys, command, str(place.out))[0])
    assert set(codes) == {0, 2}


@pytest.mark.parametrize(
    "content",
    [
        "[]",
        "7",
        '"a"',
        "{}",
        '{"format": 2}',
        '{"format": 2, "contacts": 3}',
        '{"format": 2, "contacts": {"/../../victim/x": {}}}',
        "nan",
        "\0",
        "[" * DEEP,
    ],
)
@pytest.mark.parametrize("command", ["report", "figures", "gather", "sweep-plot"])
def test_what_is_no_summary(place, capsys, monkeypatch, command, content):
    """Any JSON in the place of a summary or a sweep's record has one message and exit code 2."""
    monkeypatch.setattr("ddmpi.sweep.table.PATIENCE", 0.1)
    place.put(PLAIN | {"../out/summary.json": content, "../out/contact_/a": ""})
    arguments = [command, str(place.out)]
    if command in ("gather", "sweep-plot"):
        place.put(
            {
                "../out/sweep.json": content,
                "../out/sweep.csv": "case,n_A,status,folder\n0,1,certified,.\n",
            }
        )
        arguments = (
            ["sweep-plot", str(place.out), "n_A:case"]
            if command == "sweep-plot"
            else [
                "sweep",
                str(place.given / "scene.toml"),
                "--vary",
                "method.tolerance=1e-9,1e-8",
                "--gather",
                "--output",
                str(place.out),
            ]
        )
    assert told(place, capsys, *arguments)[0] == 2


def test_plots_stay_in_the_folder_of_their_sweep(place, capsys):
    """Whatever the columns of its table are called."""
    place.out.mkdir()
    made_up.results(place.out, divisions=(6, 2))
    (place.out / "sweep.csv").write_text(
        "case,/../../victim/x.n_A,status,folder\n0,1,certified,.\n"
    )
    (place.out / "sweep.json").write_text('{"scene": {}}')
    assert told(place, capsys, "sweep-plot", str(place.out), "n_A:case") == (0, "")


def test_checkpoints_of_other_types(place, capsys, monkeypatch):
    """A checkpoint that is whole, and holds something else, is refused."""
    place.put(PLAIN)
    here = place.given / "here"
    here.mkdir()
    place.out.mkdir()
    command = [
        "run",
        str(place.given / "scene.toml"),
        "--no-figures",
        "--set",
        "checkpoint.iterations=1",
    ]
    monkeypatch.setattr("ddmpi.results.checkpoint.Checkpoints.remove", lambda self: None)
    cli._main(MPI.COMM_SELF, [*command, "--output", str(here)], [])
    capsys.readouterr()
    for spoil in (
        lambda i, s: i.clear(),
        lambda i, s: s[0].clear(),
        lambda i, s: s[0].update(outer=7),
        lambda i, s: s[0].update(ladder={"levels": "a"}),
        lambda i, s: i.update(scene=[]),
    ):
        identity, states = checkpoint.read(here / "checkpoint.h5")
        spoil(identity, states)
        checkpoint.write(place.out / "checkpoint.h5", identity, states)
        code, message = told(place, capsys, *command, "--restart", str(place.out))
        assert code == 2 and "checkpoint" in message
