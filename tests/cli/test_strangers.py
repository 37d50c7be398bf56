"""Folders, meshes and decks of strangers: they crash no rank, write and hand on nothing, and have an end."""

import os
import re
import subprocess
import sys
from pathlib import Path

import h5py
import made_up
import numpy as np
import pytest
import scenes
from crash import crash
from decks import STEEL, grid, step
from scenes import call, pinched_blocks, write_scene

from ddmpi.errors import InputError
from ddmpi.pictures.script import digest, our_digest
from ddmpi.results import checkpoint
from ddmpi.system import hdf5

BOX = grid("A", (2, 1, 1), (2.0, 1.0, 1.0))


@pytest.fixture
def folder(tmp_path) -> Path:
    """A folder of results, and a file of somebody beside it."""
    (tmp_path / "secret.png").write_bytes(b"\x89PNG of somebody else")
    (tmp_path / "out").mkdir()
    made_up.results(tmp_path / "out", divisions=(6, 2))
    return tmp_path / "out"


@pytest.mark.parametrize("script", ["fetch('https://example.org')", "parent.document.title"])
def test_a_report_frames_the_view_of_a_stranger(folder, script):
    """It has an origin of its own, and its script is none that the policy of the report names."""
    (folder / "view.html").write_text(f"<script>{script}</script><b title='\"'>\"></iframe></b>")
    assert call("report", str(folder)).code == 0
    page = (folder / "report.html").read_text()
    (frame,) = re.findall(r"<iframe [^>]*>", page)
    assert 'sandbox="allow-scripts"' in frame and "allow-same-origin" not in page
    (policy,) = re.findall(r'Content-Security-Policy" content="([^"]*)"', page)
    assert (
        f"script-src {our_digest()}" in policy
        and digest(f"<script>{script}</script>") not in policy
    )
    assert not re.search("script-src[^;]*unsafe", page) and "python -m ddmpi view" in page
    assert page.count("</iframe>") == 1


def test_a_view_of_ours_may_run(folder):
    """The policies of report and view have the digest of the one script that a view has."""
    assert call("view", str(folder)).code == 0 and call("report", str(folder)).code == 0
    view, page = (folder / "view.html").read_text(), (folder / "report.html").read_text()
    assert digest(view) == our_digest() and f"script-src {our_digest()}" in view
    assert f"script-src {our_digest()}" in page and "python -m ddmpi view" not in page


def test_a_report_hands_on_no_other_file(folder):
    """A picture that is a link to another file, or no picture, is left out: reports are mailed."""
    (folder / "bodies.png").symlink_to(folder.parent / "secret.png")
    (folder / "contacts.png").write_text("no picture")
    (folder / "steps.png").write_bytes(b"\x89PNG of this run")
    assert call("report", str(folder)).code == 0
    pictures = re.findall(
        r'src="data:image/png;base64,([^"]*)"', (folder / "report.html").read_text()
    )
    assert len(pictures) == 1 and pictures[0].startswith("iVBORyBvZiB0aGlz")


def test_names_of_contacts_lead_to_no_other_folder(folder):
    """Also where a report reads the summary alone: it hands on no picture of another folder."""
    text = (folder / "summary.json").read_text()
    name = next(iter(made_up.CONTACTS["stack"]))
    (folder / "summary.json").write_text(text.replace(f'"{name}"', '"/../../secret"'))
    (folder / "result.h5").unlink()
    (folder / "contact_").mkdir()
    assert (folder / "contact_/../../secret.png").exists()
    assert call("report", str(folder)).code == 0
    assert "data:image/png" not in (folder / "report.html").read_text()


@pytest.mark.parametrize("there", [True, False])
def test_tables_of_paths_are_not_written_through_links(folder, there):
    """A link in the place of path.csv is replaced; what it leads to stays as it is, also what is not there yet."""
    target = folder.parent / "theirs.csv"
    if there:
        target.write_text("distance,x,y,theirs")
    (folder / "path.csv").symlink_to(target)
    assert call("path", str(folder), "--from", "0,0.1", "--to", "1,0.1").code == 0
    assert not (folder / "path.csv").is_symlink() and target.exists() == there
    assert not there or target.read_text() == "distance,x,y,theirs"


@pytest.mark.every(5)
@pytest.mark.parametrize(
    "command", [["report"], ["view"], ["figures"], ["path", "--from", "0,0", "--to", "1,1"]]
)
@pytest.mark.parametrize("name", ["summary.json", "history.csv", "result.h5", "view.html"])
def test_pipes_in_folders_end_no_command_in_waiting(folder, command, name):
    """A pipe, which nobody writes to, is no file of results."""
    (folder / name).unlink(missing_ok=True)
    os.mkfifo(folder / name)
    run = call(command[0], str(folder), *command[1:])
    assert run.code == 2 and f"{name}: is no file" in run.messages[0]


def test_a_crash_of_hdf5_is_a_message(folder, tmp_path, monkeypatch):
    """Of a mesh, of a folder's fields, and of a checkpoint: the process that reads it ends, the command says so."""
    (tmp_path / "plate.med").write_bytes(b"\x89HDF")
    scene = pinched_blocks(1)
    scene["body"][0]["mesh"] = {"file": "plate.med"}
    monkeypatch.setattr("ddmpi.mesh.read._read_other", crash)
    run = call(
        "run", str(write_scene(scene, tmp_path / "scene.toml")), "--output", str(tmp_path / "new")
    )
    assert (
        run.code == 2
        and "plate.med is not a mesh that can be read: reading it ends the process (signal SIGSEGV"
        in (run.messages[0])
    )
    monkeypatch.setattr("ddmpi.system.hdf5._walk", crash)
    for command in ("report", "view", "figures"):
        run = call(command, str(folder))
        assert run.code == 2 and "reading it ends the process (signal SIGSEGV" in run.messages[0]
    checkpoint.write(tmp_path / "checkpoint.h5", {"scene": {}}, [{"a": 1}])
    assert checkpoint.read(tmp_path / "checkpoint.h5") == ({"scene": {}}, [{"a": 1}])
    monkeypatch.setattr(checkpoint, "read_tree", crash)
    with pytest.raises(InputError, match=r"reading it ends the process \(signal SIGSEGV"):
        checkpoint.read(tmp_path / "checkpoint.h5")


@pytest.mark.slow
def test_a_file_that_leads_hdf5_round_in_circles_is_a_message(folder, monkeypatch):
    """A node of a tree of names that is its own neighbour: libhdf5 goes on to it forever."""
    with h5py.File(folder / "result.h5", "w", libver="earliest") as file:
        for k in range(40):
            file[f"field {k}"] = np.zeros(3)
    content = bytearray((folder / "result.h5").read_bytes())
    node = content.index(b"TREE")
    content[node + 8 : node + 24] = 2 * node.to_bytes(8, "little")
    (folder / "result.h5").write_bytes(content)
    monkeypatch.setattr(hdf5, "SECONDS", 1)
    with pytest.raises(InputError, match="reading it takes more than 1 s of processor time"):
        hdf5.probe(folder / "result.h5")


@pytest.mark.slow
def test_files_are_read_where_a_machine_limits_processor_time(folder):
    """A limit below that for files, as of `ulimit -t`, which no process may raise."""
    code = "import resource, sys; resource.setrlimit(resource.RLIMIT_CPU, (8, 8)); from pathlib import Path; "
    code += "from ddmpi.system.hdf5 import probe; probe(Path(sys.argv[1])); print('read')"
    run = scenes.run_python(["-c", code, str(folder / "result.h5")], 1)
    assert (run.code, run.stdout) == (0, "read\n"), run.stderr


def test_a_small_file_stands_for_no_large_array(folder):
    """A dataset of a terabyte that was never written takes no memory."""
    with h5py.File(folder / "result.h5", "r+") as file:
        file.create_dataset("huge", (10**11,), "f8", chunks=(1000,))
    with pytest.raises(InputError, match=r"it holds arrays of 8e\+11 bytes"):
        hdf5.probe(folder / "result.h5")


def _stored(file, name, array, other):
    file.create_dataset(name, array.shape, array.dtype, external=[(other, 0, array.nbytes)])


def _linked(file, name, array, other):
    file[name] = h5py.ExternalLink(other, "theirs")


def _linked_group(file, name, array, other):
    file[name] = array
    file.create_group("more")["theirs"] = h5py.ExternalLink(other, "/")


def _virtual(file, name, array, other):
    layout = h5py.VirtualLayout(array.shape, array.dtype)
    layout[...] = h5py.VirtualSource(other, "theirs", array.shape)
    file.create_virtual_dataset(name, layout)


@pytest.mark.parametrize(
    ("elsewhere", "command"),
    [(_stored, "report"), (_linked, "view"), (_linked_group, "figures"), (_virtual, "check")],
)
def test_data_in_other_files_are_not_handed_on(folder, elsewhere, command):
    """A view would have the bytes of a file of the user's, or of another run of his, which whoever made the folder names."""
    other = folder.parent / "theirs.h5"
    with h5py.File(folder / "result.h5", "r+") as file, h5py.File(other, "w") as theirs:
        array = file["displacement"][()]
        theirs["theirs"] = array
        del file["displacement"]
        elsewhere(file, "displacement", array, str(other))
    with pytest.raises(InputError, match="its data lie in other files"):
        hdf5.probe(folder / "result.h5")
    asked = folder
    if command == "check":
        (folder / "result.h5").rename(folder / "plate.med")
        scene = pinched_blocks(1)
        scene["body"][0]["mesh"] = {"file": "plate.med"}
        asked = write_scene(scene, folder / "scene.toml")
    run = call(command, str(asked))
    assert run.code == 2 and "its data lie in other files" in run.messages[0]


@pytest.mark.slow
def test_names_are_no_formulas(tmp_path):
    """A picture shows them as they are, also where matplotlib would take them for formulas that it cannot read."""
    names = ["c$\\bad$", "b$x_{$"]
    scene = pinched_blocks(1) | {"title": "of <b>$ and $^$"}
    for body, name in zip(scene["body"], names, strict=True):
        body["name"] = name
    scene["contact"][0] |= {"bodies": names, "name": "<b>$"}
    path = str(write_scene(scene, tmp_path / "scene.toml"))
    for command, picture in ("check", "bodies.png"), ("run", "convergence.png"):
        out = tmp_path / command
        run = call(command, path, "--output", str(out))
        assert run.code == 0 and (out / picture).exists(), (run.messages, os.listdir(out))


def test_a_deck_controls_no_terminal(tmp_path):
    """Names that it prints have their control characters in words, those beyond ASCII too."""
    deck = (
        BOX.replace("A_Z0", "A\x1b[2J\x9b0m") + STEEL + "*SOLID SECTION, ELSET=A, MATERIAL=STEEL\n"
    )
    deck += "*SURFACE, NAME=\x1b]0;x\x07\u202e\n1, S1\n2, S4\n*BOUNDARY\nA_X0, 1, 3\n"
    deck += (
        "*SURFACE, NAME=B\n2, S6\n"
        + "*TIE, NAME=T\n\x1b]0;x\x07\u202e, B\n"
        + step("*DLOAD", "1, P1, 1.")
    )
    (tmp_path / "deck.inp").write_text(deck)
    run = call("import", str(tmp_path / "deck.inp"), "--output", str(tmp_path / "new"), "--partial")
    said = run.stdout + run.stderr
    assert run.code == 0 and "\\x1b]0;x" in said and not re.search("[\x1b\x07\x9b\u202e]", said)


def test_decks_that_include_each_other_have_an_end(tmp_path):
    """Thirty files, each of which includes the next one twice, are a thousand million files."""
    for k in range(30):
        (tmp_path / f"{k}.inp").write_text(
            "*NODE\n1, 0, 0\n" + f"*INCLUDE, INPUT={k + 1}.inp\n" * 2
        )
    (tmp_path / "30.inp").write_text("*NODE\n2, 1, 0\n")
    run = call("import", str(tmp_path / "0.inp"), "--output", str(tmp_path / "new"))
    assert run.code == 2 and "included more than 1000 times" in run.messages[0]
    assert not (tmp_path / "new").exists()


@pytest.mark.slow
def test_a_handful_of_mutated_files(tmp_path):
    """The study's commands all end with an answer or a message, two for each specimen of these kinds."""
    study = [
        str(scenes.ROOT / "scripts" / "study"),
        "mutated_files",
        "--kinds",
        "deck,vtu,inp,drawing,checkpoint,sweep",
        "--count",
        "16",
        "--seed",
        "3",
    ]
    done = subprocess.run(
        study,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=scenes.LIMIT,
        env=scenes.clean_environment() | {"DDMPI_PYTHON": sys.executable},
    )
    assert done.returncode == 0 and "| all | 16 |" in done.stdout, done.stdout + done.stderr
    assert "0 with a traceback or signal" in done.stdout
