"""The pages of docs/start/ that are run; what docs/understand/theory.md says of the code."""

import re
from pathlib import Path

import numpy as np
import pages
import pytest
import scenes
from mpi4py import MPI

from ddmpi.errors import InputError
from ddmpi.interface import mortar
from ddmpi.judge import accuracy, certificate
from ddmpi.mesh import boundary
from ddmpi.mesh.read import gmsh_session
from ddmpi.methods import krylov, newton, paths

pytestmark = pytest.mark.slow

DOCS = scenes.ROOT / "docs"


@pytest.mark.parametrize(
    "name", ["start/tutorial.md", "start/tutorial_in_space.md", "start/drawing.md"]
)
def test_commands_of_a_page_do_what_it_says(name, tmp_path):
    """Each command of the page runs as its reader would run it, on one rank, prints what is shown, makes pictures.

    The numbers that are shown of the clevis are the same on any mesh, so it has a coarse one here.
    """
    page = (DOCS / name).read_text(encoding="utf-8")
    coarse = r"\1size = 12.0, around = 12"
    page, changed = re.subn(r'("clevis\.step", part = \d, )size = 6\.0', coarse, page)
    assert changed == (8 if name == "start/drawing.md" else 0)
    outcomes = pages.run(
        page, tmp_path, scenes.clean_environment() | {"DDMPI_RANKS": "1"}, scenes.LIMIT
    )
    assert len(outcomes) > 3
    assert pages.differences(outcomes, pages.slack(page)) == []
    for picture, made in pages.IMAGE.findall(page):
        assert (DOCS / name).parent.joinpath(picture).is_file()
        assert (tmp_path / made).is_file()


PLATE = """Point(1) = {0, 0, 0}; Point(2) = {2, 0, 0}; Point(3) = {2, 1, 0}; Point(4) = {0, 1, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1 : 4};
Plane Surface(1) = {1};
"""
BODY = 'Physical Surface("plate") = {1};\n'
NAMES = (
    'Physical Curve("bottom") = {1};\nPhysical Curve("left") = {4};\nPhysical Curve("top") = {3};\n'
)
SQUARES = (
    'SetFactory("OpenCASCADE");\nRectangle(1) = {0, 0, 0, 1, 1};\nRectangle(2) = {1, 0, 0, 1, 1};\n'
)
SOLID = (
    'SetFactory("OpenCASCADE");\nBox(1) = {0, 0, 0, 1, 1, 1};\nPhysical Curve("bottom") = {1};\n'
)
POINT = 'Physical Point("corner") = {2};\n'
ENDS = 'Physical Curve("bottom") = {1};\nPhysical Curve("top") = {3};\n'

MISTAKES: dict[str, dict] = {
    "no name for any curve": {"geo": PLATE + BODY},
    "a name that is spelt otherwise in the scene": {"clamp": ["Bottom"]},
    "the surface's name in the place of a curve's": {"clamp": ["plate"]},
    "one name for a curve and a surface": {"geo": PLATE + BODY.replace("plate", "left") + NAMES},
    "a force on a point": {
        "geo": PLATE + BODY + NAMES + POINT,
        "traction": [{"on": "corner", "value": [1.0, 0.0]}],
    },
    "several surfaces, none named": {"geo": SQUARES + ENDS},
    "surfaces that touch without common nodes": {
        "geo": SQUARES + ENDS + 'Physical Surface("plate") = {1, 2};\n'
    },
    "a named surface without a material": {
        "geo": SQUARES
        + 'Coherence;\nPhysical Surface("one") = {1};\nPhysical Surface("two") = {2};\n'
        + ENDS,
        "material": [{"on": "one", "young": 1.0, "poisson": 0.3}],
    },
    "no `Plane Surface`": {"geo": PLATE.replace("Plane Surface(1) = {1};\n", "") + NAMES},
    "a solid without names": {"geo": SOLID.replace('Curve("bottom")', 'Volume("body")')},
    "a tilted plane": {"geo": PLATE.replace("1, 0}", "1, 1}") + BODY + NAMES},
    "a missing semicolon": {"geo": PLATE.replace("{1 : 4};", "{1 : 4}") + BODY + NAMES},
    "a size in other units than the drawing": {"mesh": {"size": 5e-5}},
    "`contact_size` larger than `size`": {"mesh": {"contact_size": 5.0}},
    "a mesh as a geometry": {"mesh": {"geometry": "plate.msh"}},
    "the names of a contact in the wrong order, or bodies drawn on each other's wrong side": {
        "contact": {"on": ["top", "bottom"]}
    },
    "a contact along a line inside the body": {
        "geo": SQUARES
        + 'Coherence;\nPhysical Surface("plate") = {1, 2};\nPhysical Curve("top") = {2, 3};\n'
        'Physical Curve("bottom") = {1};\n'
    },
    '`pairing = "nodes"` without matching nodes': {
        "mesh": {"size": 0.3},
        "contact": {"pairing": "nodes"},
    },
    "a contact between clamped sides": {"clamp": ["top"], "above": "bottom"},
    "a statement that writes a file": {"geo": PLATE + BODY + NAMES + 'Mesh 2; Save "plate.msh";\n'},
    "`Exit`": {"geo": PLATE + BODY + NAMES + "Exit;\n"},
    "a mesh file saved without any groups": {"saved": PLATE},
    "a mesh file with groups of curves only": {"saved": PLATE + NAMES},
    "the surface of a solid without its cells": {
        "saved": SOLID + 'Physical Surface("skin") = Surface{:};\n'
    },
    "a part that is not there": {"mesh": {"part": "bolt"}},
    "a number that no curve has": {"clamp": [9]},
    "a size on a group that is not there": {"mesh": {"size_on": {"Top": 0.1}}},
    "a curve of a STEP file by a wrong name": {"step": True},
}
"""What is drawn and written otherwise than it should be, by the words of the page."""


def messages() -> dict[str, str]:
    """The table of the page: the messages by their mistakes."""
    rows = re.findall(
        r"^\| (.+) \| `(.+)` \|$", (DOCS / "start" / "drawing.md").read_text(encoding="utf-8"), re.M
    )
    assert {mistake for mistake, _ in rows} == set(MISTAKES)
    return {mistake: message.strip("`") for mistake, message in rows}


def save(folder: Path, script: str, name: str) -> dict:
    """Write a drawing by gmsh as a file of another format; the mesh of a scene that names it."""
    (folder / "script.geo").write_text(script)
    with gmsh_session() as gmsh:
        gmsh.open(str(folder / "script.geo"))
        if name.endswith(".msh"):
            gmsh.model.mesh.generate(3)
        gmsh.write(str(folder / name))
    return {"file": name} if name.endswith(".msh") else {"geometry": name, "size": 0.5}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_each_mistake_has_the_message_of_the_page(mistake, tmp_path, monkeypatch):
    """A mistake in a drawing is refused with the message that docs/start/drawing.md shows for it."""
    monkeypatch.chdir(tmp_path)
    made = dict(MISTAKES[mistake])
    Path("plate.geo").write_text(made.pop("geo", PLATE + BODY + NAMES))
    mesh = {"geometry": "plate.geo", "size": 0.5} | made.pop("mesh", {})
    if "saved" in made:
        mesh = save(tmp_path, made.pop("saved"), "plate.msh")
    if made.pop("step", False):
        mesh = save(
            tmp_path, 'SetFactory("OpenCASCADE");\nRectangle(1) = {0, 0, 0, 2, 1};\n', "plate.step"
        )
    steel = {"young": 1.0, "poisson": 0.3}
    scene = {
        "contact": [
            {"bodies": ["upper", "lower"], "on": ["bottom", "top"]} | made.pop("contact", {})
        ],
        "body": [
            {
                "name": "upper",
                "material": steel,
                "clamp": [made.pop("above", "top")],
                "mesh": {
                    "shape": "rectangle",
                    "origin": [0.0, 1.0],
                    "size": [2.0, 1.0],
                    "divisions": [4, 2],
                },
            },
            {"name": "lower", "mesh": mesh, "material": steel, "clamp": ["bottom"]} | made,
        ],
    }
    with pytest.raises(InputError) as refused:
        scenes.prepare_scene(MPI.COMM_SELF, scene)
    assert pages.agrees(messages()[mistake], str(refused.value)), refused.value


def test_theory_has_the_numbers_of_the_code():
    """The constants that docs/understand/theory.md names are those of the code."""
    page = " ".join((DOCS / "understand" / "theory.md").read_text(encoding="utf-8").split())
    count = {3: "three", 6: "six", 10: "ten"}
    for words in (
        f"three and more bodies also the deformations v = M_a⁻¹x with C_a x = μ M_a⁻¹ x, μ > {krylov.SMOOTH[1]:g}"
        f" (in space {krylov.SMOOTH[2]:g})",
        f"loose bodies or {count[krylov.MANY]} and more bodies",
        f"where it leaves at most {newton.GAIN:g} of the residual",
        f"the length, 1 to {newton.LENGTHS[-1]:g}, that leaves least",
        f"is below {count[int(newton.ERROR)]} times that",
        f"Where {count[newton.PATIENCE]} steps leave more than {newton.PROGRESS:g} of the smallest residual",
        f"as long as each leaves less than {newton.PROGRESS:g} of the residual",
        f"δ = {paths.SOFTEST:g}, 100, 10",
        f"are tried where the residual is below {paths.NEAR:g}",
        f"ε = 1e{np.log10(krylov.HELD_LOOSELY):.0f}, and D_s",
        f"GMRES solves it to 1e{np.log10(krylov.FORCING):.0f}",
        f"all below {certificate.FACTOR:g} times the tolerance (and {certificate.LARGEST_LIMIT:g}, whatever",
        f"covered by less than {100 * mortar.UNCOVERED:g} %",
        f"turns by more than {np.rad2deg(boundary.SHARPEST):.0f}°",
    ):
        assert words in page
    assert accuracy.CAUTION == 1 / 5  # "by a fifth in order 1 and a tenth in order 2"


def test_theory_points_to_what_there_is():
    """Classes, attributes and modules in the table of symbols of docs/understand/theory.md exist."""
    page = (DOCS / "understand" / "theory.md").read_text(encoding="utf-8")
    table = page[page.index("## Symbols") : page.index("## Sources")]
    sources = [path.read_text(encoding="utf-8") for path in (scenes.ROOT / "ddmpi").rglob("*.py")]
    cells = [row.split("|")[-2] for row in table.splitlines()[4:] if row.startswith("|")]
    assert len(cells) > 10
    for cell in cells:
        owner = ""
        for name in re.findall(r"`([^`]+)`", cell):
            if "/" in name:
                assert (scenes.ROOT / name).is_file()
                continue
            first, _, attribute = name.partition(".")
            owner = first or owner
            where = [text for text in sources if re.search(rf"^(class|def) {owner}\b", text, re.M)]
            where = where or [text for text in sources if re.search(rf"\b{owner}\b", text)]
            assert any(re.search(rf"\b{attribute}\b", text) for text in where), name


def test_rooms_point_to_what_there_is():
    """What docs/rooms.md says is in a module is a word of it."""
    page = (DOCS / "rooms.md").read_text(encoding="utf-8")
    found = re.findall(r"`([\w.]+)`\s+(?:in|of)\s+`(ddmpi/[\w/]+\.py)`", page)
    assert len(found) > 20
    for name, path in found:
        text = (scenes.ROOT / path).read_text(encoding="utf-8")
        assert all(re.search(rf"\b{word}\b", text) for word in name.split(".")), (name, path)
