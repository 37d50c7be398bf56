"""The scene: what is refused and in which words, overrides, defaults, profiles and affine loads."""

import datetime
import json
import re
import tomllib
from collections.abc import Iterator
from decimal import Decimal
from enum import StrEnum
from pathlib import Path

import msgspec
import numpy as np
import pytest

from ddmpi.errors import InputError
from ddmpi.scene.bodies import Clamp, Material
from ddmpi.scene.contacts import Coulomb, NoFriction, Profile, Tresca
from ddmpi.scene.formulas import check_formulas, evaluate, varies
from ddmpi.scene.keys import differences, override
from ddmpi.scene.method import METHODS, Method, Published
from ddmpi.scene.reader import as_data, read_data, read_scene, read_scene_file, write_toml
from ddmpi.scene.scene import Scene, Settled
from ddmpi.scene.values import AffineScalar, AffineVector
from ddmpi.sweep.cases import build_cases

ROOT = Path(__file__).resolve().parents[2]

TEXT = """
title = "two blocks"

[[body]]
name = "upper"
mesh = { shape = "rectangle", origin = [0.0, 1.0], size = [3.0, 1.0], divisions = [6, 2] }
material = { young = 2e11, poisson = 0.3 }
clamp = ["left", { on = "right", x = 1e-3 }]
traction = [{ on = "top", value = [0.0, -6.0e7] }]

[[body]]
name = "lower"
mesh = { file = "lower.msh" }
material = { young = 1e11, poisson = 0.25 }
clamp = [{ on = "bottom", x = 0.0, y = { constant = 1e-4, x_slope = 2e-4 } }]
volume_force = [0.0, -7.8e4]

[[contact]]
bodies = ["upper", "lower"]
on = ["bottom", "top"]
friction = { law = "coulomb", coefficient = 0.3 }

[method]
theta = 0.25

[petsc]
body_ksp_rtol = 1e-9
"""

WITHOUT_METHOD = TEXT.replace("[method]\ntheta = 0.25\n", "")


def scene(*settings: str, text: str = TEXT) -> Settled:
    return read_scene("case.toml", text, list(settings))


def message(*settings: str, text: str = TEXT) -> str:
    """The words by which a scene is refused."""
    with pytest.raises(InputError) as error:
        scene(*settings, text=text)
    said = str(error.value)
    assert error.value.exit_code == 2 and said.startswith(("case.toml: ", "--set "))
    return said


def refuses(settings: str | list[str], words: str, text: str = TEXT) -> None:
    """The message is one line, and has all parts of `words`, which stand between bars."""
    said = message(*([settings] if isinstance(settings, str) else settings), text=text)
    assert "\n" not in said
    for part in words.split("|"):
        assert part in said


PROFILE = "contact.upper-lower.friction.coefficient"


def test_a_number_is_not_said_to_be_a_vector():
    """The example of a value of a traction is not that of a gap."""
    words = (
        "contact.upper-lower.gap.value: expected a number or words in quotes or a table (got True)"
    )
    assert message("contact.0.gap={value=true}").endswith(words)


# The words of types and limits are those of msgspec, by its version.
REFUSED = [
    # unknown keys, wrong types, numbers out of range
    ("titel=x", "titel: unknown key|did you mean 'title'|petsc"),
    ("body.lower.clmap=[]", "body.lower.clmap: unknown key|did you mean 'clamp'"),
    (
        'body.upper.clamp.1={on="left", w=0.0}',
        "body.upper.clamp.1.w: unknown key (valid here: on, x, y, z",
    ),
    ("method.theta=fast", "method.theta: expected a number|'fast'"),
    ("method.max_iterations=1.5", "method.max_iterations: expected a whole number|1.5"),
    (
        "body.upper.material.young=true",
        "body.upper.material.young: expected a number or a list (got True)",
    ),
    ("title=3", "title: expected words in quotes|3"),
    (
        "body.upper.clamp=left",
        "body.upper.clamp: expected a list (got 'left')|write clamp = [\"left\"]",
    ),
    (
        "body.upper.traction.0.value=[1.0]",
        "body.upper.traction.0.value: expected a list of length 2 or 3, got 1; write value = [x, y], in space [x, y, z]",
    ),
    (
        "body.upper.mesh.divisions=[2,2,2]",
        "body.upper.mesh.divisions: a rectangle has divisions = [nx, ny], got [2, 2, 2]",
    ),
    ("petsc.qp_tao_type={a=1}", "petsc.qp_tao_type: |expected|words in quotes"),
    ("method.theta=0", "method.theta: expected a number > 0|got 0"),
    ("method.max_iterations=0", "method.max_iterations: expected a whole number >= 1|got 0"),
    (
        "method.inner_precision=fix",
        "method.inner_precision: 'fix' is not valid; expected a number or fixed",
    ),
    (
        "body.upper.material.poisson=0.5",
        "body.upper.material.poisson: expected a number < 0.5|got 0.5",
    ),
    (PROFILE + "=-0.3", PROFILE + ": expected a number >= 0|-0.3"),
    (
        "body.upper.traction={on='top', value=[0.0, 1.0]}",
        "body.upper.traction: expected a list, got a table; write traction = [{ … }]",
    ),
    (
        'contact={bodies=["upper", "lower"]}',
        "contact: expected a list, got a table; write [[contact]]",
    ),
    # names and words
    ('body.0.name=""', "body.0.name: |length >= 1"),
    (
        "body.0.name=a/b",
        "body.a/b.name: a name has no '.', '=', '/', blank or control character (got 'a/b')",
    ),
    (
        "body.upper.material.young=1" + 400 * "0",
        "body.upper.material.young: ",
    ),
    (
        "body.upper.material.plane=stres",
        "body.upper.material.plane: 'stres' is not valid; expected one of strain, stress|did you mean 'stress'",
    ),
    (
        "body.upper.material.thickness=2.0",
        "body.upper.material.thickness: such parts are in plane stress",
    ),
    (
        'body.upper.material={young=1.0, poisson=0.3, plane="stress", thickness=2.0}',
        "body.upper.material.thickness: bodies with contacts or foundations have the depth alone",
    ),
    (
        "body.upper.mesh.shape=circle",
        "body.upper.mesh.shape: 'circle'|expected one of annulus, ball, box, cylinder, hexahedron, quadrilateral",
    ),
    (PROFILE + "={along='w',points=[0],values=[1]}", PROFILE + ".along: 'w'|arc, x, y, z"),
    (
        "contact.0.friction.law=coulom",
        "contact.upper-lower.friction.law: 'coulom' is not valid; expected one of "
        "coulomb, tresca, none|did you mean 'coulomb'",
    ),
    (
        "contact.0.friction=none",
        "contact.upper-lower.friction: expected a table (got 'none')|write friction = { law = \"none\" }",
    ),
    ('contact.0.friction={law="coulomb"}', PROFILE + ": |required and missing"),
    # what engineers write at first
    (
        "contact.0.friction=0.3",
        "contact.upper-lower.friction: expected a table (got 0.3); write friction = { law = "
        '"coulomb", coefficient = 0.3 }',
    ),
    ("contact.0.friction={coefficient=0.3}", "missing (one of coulomb, tresca, none)"),
    ("contact.0.penalty=1e9", "penalty: unknown key; contact is hard; a soft joint has a softness"),
    (
        "body.upper.material.expansion=1e-5",
        "body.upper.material.expansion: no body has a temperature, so nothing expands",
    ),
    (
        "body.upper.material.young=[1e11, 1e10, 1e10]",
        "body.upper.material: an isotropic material has|[ν12, ν13, ν23]|shear = G12",
    ),
    ("body.upper.material.angle=30.0", "angle: an isotropic material has no axes"),
    (
        "body.upper.material.young=[1e11, 1e10]",
        "body.upper.material.young: expected a list of length 3, got 2",
    ),
    (
        "body.upper.material={young=[1e11, 1e10, 1e10], poisson=[3.5, 0.3, 0.3], shear=5e9}",
        "body.upper.material|the matrix of its compliances is not positive definite",
    ),
    (
        "body.upper.material={young=[1e11, 1e10, 1e10], poisson=[0.3, 0.3, 0.3], shear=[5e9, 5e9, 3e9]}",
        "body.upper.material.shear: in the plane it is one number, G12",
    ),
    (
        "body.upper.temperature=80.0",
        "body.upper.temperature: has no effect, because the material has no expansion|1.2e-5",
    ),
    (
        ["body.upper.material.expansion=1e-5", "body.upper.temperature={}"],
        "body.upper.temperature|value",
    ),
    (
        ["body.upper.material.expansion=1e-5", "body.upper.temperature=z"],
        "body.upper.temperature: there is no z in the plane",
    ),
    (
        ["body.upper.material.expansion=1e-5", 'body.upper.temperature={value=3.0, history="day"}'],
        "body.upper.temperature.history: there is no [history.day]",
    ),
    ("body.upper.material.E=1e-5", "material.E: unknown key; did you mean 'young'?"),
    (
        "body.upper.axisymmetric=true",
        "unknown key; axisymmetric = true stands at the top of the scene",
    ),
    ("body.upper.material.plane=axisymmetric", "expected one of strain, stress; axisymmetric = "),
    ("body.upper.material=steel", "(got 'steel'); write material = { young = …, poisson = … }"),
    (
        "body.upper.traction.0.force=[0.0, 1.0]",
        "body.upper.traction.0: a traction has either a value|or the total force (N)",
    ),
    ('body.upper.traction=[{on="top", force=1e6}]', "write force = [x, y]"),
    ('body.upper.traction=[{on="top", force=[1e6, 0, 0]}]', "traction.0.force|is in space"),
    ('body.upper.clamp=[{on="left", ux=0.0}]', "ux: unknown key; did you mean 'x'?"),
    (
        "body.upper.clamp=[left, right]",
        "clamp: expected a list (got '[left, right]'); the shell must leave quotation "
        'marks around words: \'body.upper.clamp=["left", "right"]\'',
    ),
    ("body.upper.mesh={file=a.msh}", "'body.upper.mesh={file=\"a.msh\"}'"),
    ("body.upper.mesh=a.msh", 'write mesh = { file = "….msh" }'),
    (
        'body.upper.mesh={file="a.step", size=1.0}',
        'body.upper.mesh: a.step is a drawing; write geometry = "a.step", size = h',
    ),
    ("method=newton", "method: expected a table (got 'newton'); write [method]"),
    (
        "body.upper.material={young=[3.0, 2.0, 1.0], poisson=[0.3, 0.3, 0.3]}",
        "or, in space, [G12, G13, G23]",
    ),
    # profiles, numbers that are none
    (
        PROFILE + "={points=[0,1],values=[1]}",
        PROFILE + ": points and values must be equally many|2 points and 1 values",
    ),
    (PROFILE + "={points=[],values=[]}", PROFILE + ": |at least one"),
    (PROFILE + "={points=[0,2,1],values=[1,1,1]}", PROFILE + ": points must ascend"),
    (
        "body.upper.traction.0.value=[0.0,-inf]",
        "body.upper.traction.0.value.1: must be a finite number (got -inf)",
    ),
    (["petsc.a=1", "petsc.body_ksp_atol=1e200"], "petsc.body_ksp_atol: expected a number <= 1e"),
    # what does not fit together
    (
        "body.upper.name=lower",
        'body.lower: 2 [[body]] tables have this name|give each name = "…" of its own',
    ),
    (
        'contact.0.bodies=["uper","lower"]',
        "contact.uper-lower.bodies: there is no body 'uper'; did you mean 'upper'?|upper, lower",
    ),
    (
        ["body.upper.mesh.order=2", "body.lower.mesh.order=1"],
        "bodies have mesh.order 1 and 2|give all bodies the same",
    ),
    ("body.upper.mesh.order=3", "body.upper.mesh.order: 3 is not valid; expected one of 1, 2"),
    (
        "body.upper.material.plane=stress",
        "'upper' is in plane stress and 'lower' in plane strain; they cannot touch",
    ),
    ("body.lower.mesh.shape=rectangle", "body.lower.mesh: a mesh is either|rectangle|file"),
    ("body.lower.mesh={}", "body.lower.mesh: a mesh is either|rectangle|file"),
    ("body.lower.mesh.size=[1,1]", "body.lower.mesh: size belongs to shape = |not to a file"),
    (
        'body.upper.mesh={shape="rectangle",divisions=[1,1]}',
        'body.upper.mesh: shape = "rectangle" needs size = [width, height]|size is missing',
    ),
    # loads, formulas, materials of parts
    (
        'body.upper.traction=[{on="top"}]',
        "body.upper.traction.0: a traction has either a value|or a pressure",
    ),
    (
        'body.upper.traction.0.value=["0", "-6e7*(1+w)"]',
        'body.upper.traction.0.value: the formula "-6e7*(1+w)" cannot '
        "be evaluated|'w' is not known|known are x, y, z, pi",
    ),
    (
        "body.upper.clamp.1.x=1e-3*sn(y)",
        "body.upper.clamp.1.x: the formula \"1e-3*sn(y)\"|the function 'sn' is not known",
    ),
    (
        'body.lower.volume_force=["0", "2*(x"]',
        'body.lower.volume_force: the formula "2*(x"|not a formula',
    ),
    ("body.upper.clamp.1.x=1/0", 'body.upper.clamp.1.x: the formula "1/0" is inf'),
    ("body.upper.clamp.1.x=x^2", "a power is written **"),
    ("body.upper.clamp.1.x=max(x)", "max takes 2 values, as in max(x, y)"),
    ('body.upper.clamp.1.x=""', "body.upper.clamp.1.x: expected words in quotes of length >= 1"),
    ("body.upper.material.young=2*x", "body.upper.material.young: expected a number"),
    (
        'body.upper.material=[{on="a", young=1.0, poisson=0.3}]',
        'body.upper.material: on = "a" names a physical surface of a mesh file, and a rectangle',
    ),
    (
        'body.lower.material=[{on="a", young=1.0, poisson=0.3}, {on="a", young=2.0, poisson=0.3}]',
        "body.lower.material: 2 entries are on 'a'",
    ),
    (
        "body.lower.material=[{young=1.0, poisson=0.3}, {young=2.0, poisson=0.3}]",
        "body.lower.material: 2 entries are without on",
    ),
    (
        'body.lower.material=[{on="a", young=1.0, poisson=0.3, plane="stress"}, {young=2.0, poisson=0.3}]',
        "body.lower.material: |give all entries the same plane",
    ),
    (
        'body.upper.clamp=[{on="left"}]',
        'body.upper.clamp.0: |prescribes one or several of x, y and, in space, z|clamp = ["left"]',
    ),
]
"""Settings, and what the message has: parts of it, in any order, between bars."""


@pytest.mark.parametrize(
    ("settings", "words"), REFUSED, ids=[str(settings)[:60] for settings, _ in REFUSED]
)
def test_refusal_names_file_key_and_remedy(settings, words):
    """A wrong scene is refused in one line that names file, key and what would be right."""
    refuses(settings, words)


BAD_SETTINGS = [
    ("method.theta", "--set method.theta|KEY=VALUE|method.theta=0.3"),
    ("=3", "--set =3|KEY=VALUE"),
    ("title=Gr\udcf6\udcdfe", r"--set 'title=Gr\udcf6\udcdfe': not text in UTF-8"),
    (
        "body.uper.material.young=1",
        "--set body.uper.material.young|'uper'|upper, lower|did you mean 'upper'",
    ),
    ("body.2.material.young=1", "--set body.2.material.young|'2'|upper, lower"),
    ("contact.-1.on=[]", "--set contact.-1.on|'-1'"),
    ("contact.².on=[]", "--set contact.².on|'²'|upper-lower"),
    (
        "contact.uper-lower.on=[]",
        "there is no entry 'uper-lower'; did you mean 'upper-lower'? (entries: upper-lower)",
    ),
    ("body.lower.volume_force.2=1.0", "body.lower.volume_force.2|'2'|0 to 1"),
    ("method.theta.x=1", "--set method.theta.x|method.theta is a value, not a table"),
    ("body.upper.clamp.0.x=1.0", "--set body.upper.clamp.0.x|is a value, not a table"),
]


@pytest.mark.parametrize(("setting", "words"), BAD_SETTINGS)
def test_bad_setting_is_refused(setting, words):
    """A setting that leads nowhere is refused, with the key as it was written."""
    refuses(setting, words)


@pytest.mark.parametrize(
    ("removed", "key"),
    [
        ('name = "upper"\n', "body.0.name"),
        ("material = { young = 1e11, poisson = 0.25 }\n", "body.lower.material"),
        ("young = 2e11, ", "body.upper.material.young"),
        ('on = "top", ', "body.upper.traction.0.on"),
        ('bodies = ["upper", "lower"]\n', "contact.0.bodies"),
        ('on = ["bottom", "top"]\n', "contact.upper-lower.on"),
        (TEXT, "body"),
    ],
)
def test_missing_key_is_named(removed, key):
    """A required key or table that is missing is named with its table."""
    assert removed in TEXT
    assert (
        message(text=TEXT.replace(removed, "", 1))
        == f"case.toml: {key}: this key is required and missing"
    )


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("punch.inp", 'an Abaqus or CalculiX deck, and no scene; .* mesh = { file = "punch.inp" }'),
        ("part.step", 'a STEP file, and no scene; .* mesh = { geometry = "part.step" }'),
    ],
)
@pytest.mark.parametrize("content", [b"*HEADING\n", b"\xff\xfe"])
def test_a_mesh_or_a_drawing_is_no_scene(tmp_path, name, words, content):
    """It is called what it is, with the key that names it in a scene."""
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=words):
        read_scene_file(tmp_path / name)


@pytest.mark.parametrize(
    ("line", "right"),
    [
        ("clamp = [left]", "words stand in quotation marks"),
        ("name = upper # a", "words stand in quotation marks"),
        ("material = { young = 2,1e11, poisson = 0.3 }", "a number is written like 2.1e11"),
        ("material = { young = 210*1e9, poisson = 0.3 }", "a number is written like 2.1e11"),
        ("young = 2.1d11", "a number is written like 2.1e11"),
        ("poisson = .3", "a number has digits before and after"),
        ("x = [1., 2.0]", "a number has digits before and after"),
        ("inside = True", "write true or false"),
        ('name = "a', None),
        ("material = { young = 1.0,", "a table { … } stands on one line"),
        ("material = { young = 1.0, }", "a table { … } stands on one line"),
    ],
)
def test_what_is_often_not_toml_is_explained(line, right):
    """The message shows the line and, of what is often wrong in a first scene, what would be right."""
    said = message(text=f'title = "a [b, c] .5 True"\n{line}\n')
    assert (
        said.startswith("case.toml: not valid TOML: ")
        and "at line 2" in said
        and said.endswith(f": {line}")
    )
    assert (f"; {right}" if right else "") in said
    assert right or ";" not in said


def test_a_law_by_setting_takes_the_keys_of_the_other_one_away():
    """`--set …law=none` needs no more; a law by setting keeps what it shares with the one before."""
    key = "contact.upper-lower.friction"
    assert isinstance(scene(f"{key}.law=none").contact[0].friction, NoFriction)
    for settings in (
        [f"{key}.law=tresca", f"{key}.slip_bound=2.0"],
        [f"{key}.slip_bound=2.0", f"{key}.law=tresca"],
    ):
        assert scene(*settings).contact[0].friction == Tresca(slip_bound=2.0)
    both = scene(f"{key}.coefficient=0.7", f"{key}.law=coulomb").contact[0].friction
    assert both == Coulomb(coefficient=0.7)


def test_unreadable_files_are_refused(tmp_path):
    """A scene file that cannot be read is named with the reason."""
    with pytest.raises(InputError, match=r"absent\.toml: cannot be read: No such file"):
        read_scene_file(tmp_path / "absent.toml")
    with pytest.raises(InputError, match="cannot be read: Is a directory"):
        read_scene_file(tmp_path)
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"binary\.toml: not a text file in UTF-8"):
        read_scene_file(binary)


def test_overrides_reach_every_part():
    """`--set` changes any key, entries of lists by name or number; the last setting wins; absent tables are made."""
    changed = scene(
        "method.theta=0.4",
        "body.upper.material.young=1e9",
        "body.1.material.poisson=0.1",
        "body.upper.mesh.divisions=[12, 4]",
        "body.upper.mesh.size.0=4.0",
        "body.upper.traction.0.value=[1.0, 2.0]",
        "body.upper.clamp.0=top",
        'contact.0.on=["a", "b"]',
        "method.theta = 0.3",
        "petsc.qp_tao_type=gpcg",
        "petsc.body_ksp_max_it=3",
        "petsc.log_view=true",
        "title=a new = title",
    )
    upper, lower = changed.body
    assert (upper.material.young, lower.material.poisson) == (1e9, 0.1)
    assert (upper.mesh.divisions, upper.mesh.size) == ((12, 4), (4.0, 1.0))
    assert upper.traction[0].value == (1.0, 2.0)
    assert upper.clamps[0] == Clamp(on="top", x=0.0, y=0.0, z=0.0)
    assert changed.contact[0].on == ("a", "b") and changed.method.theta == 0.3
    assert changed.petsc == {
        "body_ksp_rtol": 1e-9,
        "body_ksp_max_it": 3,
        "qp_tao_type": "gpcg",
        "log_view": True,
    }
    assert changed.title == "a new = title"
    bare = scene("petsc.a=1", "checkpoint.iterations=3", text=TEXT.partition("[method]")[0])
    assert (bare.petsc, bare.checkpoint.iterations) == ({"a": 1}, 3)
    data = {"body": [{"mesh": {}}, {"name": "lower"}]}  # one without a name counts, too
    override(data, "body.lower.x", 1)
    assert data["body"] == [{"mesh": {}}, {"name": "lower", "x": 1}]


def test_values_of_a_program_become_those_of_a_scene():
    """Also of types that are based on words and numbers; what is none is refused."""

    class Law(StrEnum):
        COULOMB = "coulomb"

    class Coefficient(float):
        pass

    found = as_data(
        {
            "friction": {"law": Law.COULOMB, "coefficient": Coefficient(0.5)},
            "on": (np.str_("a"), Path("b")),
            "steps": np.int32(3),
            "name": None,
        },
        "scene",
    )
    assert found == {
        "friction": {"law": "coulomb", "coefficient": 0.5},
        "on": ["a", "b"],
        "steps": 3,
    }
    assert [type(each) for each in (*found["friction"].values(), *found["on"], found["steps"])] == [
        str,
        float,
        str,
        str,
        int,
    ]
    assert as_data([np.longdouble(1.5), np.array([[True], [False]])], "scene") == [
        1.5,
        [[True], [False]],
    ]


@pytest.mark.parametrize(
    "value",
    [
        1j,
        np.complex64(1j),
        {1.0},
        b"a",
        bytearray(b"a"),
        datetime.date(2020, 1, 1),
        datetime.time(1),
        np.ma.masked,
        len,
        datetime.timedelta(1),
        np.datetime64("2020-01-01", "ns"),
        Decimal("1.5"),
        range(2),
        iter([1.0]),
        object(),
    ],
    ids=lambda value: type(value).__name__,
)
def test_other_values_of_a_program_are_refused_by_their_key(value):
    with pytest.raises(
        InputError, match=r"^scene: body\.upper\.material\.young: .* is no value of a scene"
    ):
        as_data({"body": [{"name": "upper", "material": {"young": value}}]}, "scene")
    with pytest.raises(InputError, match=r"^scene: time\.points\.1: .* is no value of a scene"):
        as_data({"time": {"points": [1.0, value]}}, "scene")


@pytest.mark.parametrize("value", ["2020-01-01", "10:00:00", "2020-01-01T10:00:00Z"])
def test_dates_are_refused_by_their_key(value):
    """By what may stand there, also in a sweep."""
    assert re.match(
        r"case.toml: body.upper.material.young: expected a number .*\(got datetime",
        message(f"body.upper.material.young={value}"),
    )
    data = read_data("case.toml", TEXT, [f"body.upper.material.young={value}"])
    with pytest.raises(
        InputError, match=r"case\.toml: body\.upper\.material\.young: datetime.* is no value"
    ):
        build_cases("case.toml", data, ["title=a,b"])


SECOND = """
[[contact]]
bodies = ["upper", "lower"]
on = ["left", "left"]
"""


def test_names_are_given_once():
    """Names of bodies are unique, and so are those of contacts; default names count."""
    text = WITHOUT_METHOD + SECOND
    second = (
        "contact.1: a second contact between 'upper' and 'lower' must be named; add name = \"…\""
    )
    assert second in message(text=text)
    assert second.replace("'upper' and 'lower'", "'lower' and 'upper'") in message(
        'contact.1.bodies=["lower", "upper"]', text=text
    )
    assert (
        'contact.upper-lower: 2 [[contact]] tables have this name; give each name = "…" of its own'
        in message("contact.1.name=upper-lower", text=text)
    )
    assert [contact.name for contact in scene("contact.1.name=edge", text=text).contact] == [
        "upper-lower",
        "edge",
    ]


@pytest.mark.parametrize(
    "name",
    ["a.b", "a=b", "a/b", "a b", " a", "a\t", "a\n", "\u00a0", "a\u0001", "\u009b2J", "a\u202eb"],
)
@pytest.mark.parametrize("table", ["body", "contact"])
def test_names_are_parts_of_keys_and_files(table, name):
    """Names of bodies and contacts have no dot, equals sign, slash, blank or control character."""
    problem = "a name has no '.', '=', '/', blank or control character"
    assert f".name: {problem}" in message(f"{table}.0.name={json.dumps(name)}")


def test_contacts_have_names():
    """A contact without a name is called after its bodies; keys find it by either, and by number."""
    key = "friction.coefficient=0.5"
    assert scene().contact[0].name == "upper-lower"
    assert scene("contact.0.name=joint").contact[0].name == "joint"
    for settings in (
        [f"contact.upper-lower.{key}"],
        [f"contact.0.{key}"],
        ["contact.0.name=joint", f"contact.joint.{key}"],
        ['contact.0.bodies=["lower", "upper"]', f"contact.lower-upper.{key}"],
    ):
        assert scene(*settings).contact[0].friction == Coulomb(coefficient=0.5)
    assert "there is no entry 'upper-lower'" in message(
        "contact.0.name=joint", f"contact.upper-lower.{key}"
    )


def test_differences_are_named_by_key():
    """What differs between two scenes is named by keys as after --set, entries of lists by name or number."""
    ours, theirs = tomllib.loads(TEXT), tomllib.loads(TEXT)
    assert differences(ours, theirs) == ""
    override(theirs, "body.lower.material.young", 3)
    override(theirs, "petsc.new", 1)
    assert differences(ours, theirs) == (
        "body.lower.material.young is 100000000000.0 here, 3 there; "
        "petsc.new is not set here, 1 there"
    )
    assert differences({k: 1 for k in "abcd"}, {}).endswith(
        "c is 1 here, not set there, and 1 more"
    )


@pytest.mark.parametrize(
    "settings",
    [
        [],
        ['contact.0.friction={law="none"}'],
        ["contact.0.name=joint", "method.preset=accurate"],
        [
            'contact.0.friction={law="tresca", slip_bound={along="arc", points=[0, 1, 1], values=[1, 2, 3]}}'
        ],
        [
            "body.lower.volume_force={constant=[1.0, 2.0], y_slope=[0.0, 3.0]}",
            "method.target_error=0.1",
        ],
        [
            'body.lower.volume_force=[0, "-7.8e4*(1 + x/3)"]',
            'body.upper.traction=[{on="top", pressure="1e6*sin(pi*x)"}]',
            "body.upper.clamp.1.x=1e-3*y",
            'body.lower.material=[{on="core", young=1.0, poisson=0.3}, {young=2.0, poisson=0.3}]',
        ],
    ],
)
def test_resolved_scene_round_trips(settings):
    """The scene in summary.json, written as TOML without the keys that are null, is the same scene again."""
    for original in (scene(*settings), scene(*settings, text=WITHOUT_METHOD)):
        for data in (original.resolved(), json.loads(json.dumps(original.resolved()))):
            again = scene(text=write_toml(data))
            assert not again.aimed and again == msgspec.structs.replace(original, aimed="")


@pytest.mark.parametrize(
    "path", sorted((ROOT / "configs").rglob("*.toml")), ids=lambda path: path.stem
)
def test_shipped_scenes_are_valid(path):
    """Every shipped scene has a title, and is read as the same scene when it is written as TOML."""
    shipped = read_scene_file(path)
    assert shipped.title
    assert read_scene("written", write_toml(json.loads(json.dumps(shipped.resolved())))) == shipped


def test_all_that_a_scene_can_hold_is_written():
    """Strange strings and keys, empty tables, lists of tables within tables, and numbers of all sizes."""
    odd = 'quotes " \\ \n\t\x00\x7f é 🙂'
    data = {
        "title": odd,
        "body": [
            {"name": "a b", "clamp": ["left", {"on": odd, "x": 1e-300}], "none": None},
            {"traction": [{"on": "x", "value": [-0.0, 2.119e11]}, {"on": "y"}], "empty": []},
        ],
        "rigid": [],
        "history": {"é.1": {"times": [0.0, 1], "factors": [True, False]}},
        "time": None,
        "petsc": {"body_ksp_rtol": 1e-05},
        "checkpoint": {},
    }
    written = tomllib.loads(write_toml(data))
    for gone in (
        data["body"][0].pop("none"),
        data["body"][1].pop("empty"),
        data.pop("rigid"),
        data.pop("time"),
        data.pop("checkpoint"),
    ):
        assert not gone
    assert written == data


def test_resolved_scene_has_all_defaults():
    """The scene in summary.json says what was left out."""
    data = scene().resolved()
    method = data["method"]
    assert (method["outer"], method["algorithm"], method["splitting"]) == (
        "relaxation",
        "original",
        "none",
    )
    assert (method["theta"], method["tolerance"], method["max_iterations"]) == (0.25, 1e-4, 500)
    assert data["contact"][0]["friction"] == {"law": "coulomb", "coefficient": 0.3}
    assert data["body"][0]["material"] == {
        "young": 2e11,
        "poisson": 0.3,
        "plane": "strain",
        "thickness": 1.0,
        "shear": None,
        "angle": None,
        "axes": None,
        "expansion": None,
    }
    assert data["body"][1]["traction"] == []
    assert data["contact"][0]["name"] == "upper-lower"
    assert [body["mesh"]["order"] for body in data["body"]] == [1, 1]


def orders(*settings: str, **of_files: int) -> list[int]:
    """The orders of the bodies' elements; the lower body's mesh is a file, the upper's if `of_files` has its order."""
    shape = 'shape = "rectangle", origin = [0.0, 1.0], size = [3.0, 1.0], divisions = [6, 2]'
    text = TEXT.replace(shape, 'file = "upper.msh"') if "upper" in of_files else TEXT
    settled = read_scene("case.toml", text, list(settings), lambda body: (2, of_files[body.name]))
    return [body.mesh.order for body in settled.body]


def test_elements_have_the_order_of_the_files():
    """Shapes follow the files; an order that the scene or its preset names comes first."""
    assert orders(lower=2) == orders(upper=2, lower=2) == [2, 2]
    assert orders(lower=1) == orders(upper=1, lower=1) == [1, 1]
    assert (
        orders("body.lower.mesh.order=1", lower=2)
        == orders("method.preset=fast", lower=2)
        == [1, 1]
    )
    assert orders("body.lower.mesh.order=2", upper=1, lower=2) == [2, 2]
    with pytest.raises(
        InputError,
        match=r"^case\.toml: body\.upper\.mesh\.file = upper\.msh is of order 2, "
        r"body\.lower\.mesh\.file = lower\.msh is of order 1; say which one to use by mesh\.order = 1 or 2",
    ):
        orders(upper=2, lower=1)


@pytest.mark.parametrize("title", ["Gr\udcf6\udcdfe", "Größe"], ids=["bytes", "letters"])
def test_words_from_python_are_text(title):
    """A file name that is none may have bytes that stand for no letters."""
    scene = {"title": title}
    if title.isprintable():
        assert as_data(scene, "scene") == scene
    else:
        with pytest.raises(InputError, match=r"^scene: title: '.*' is not text in UTF-8"):
            as_data(scene, "scene")


def within(node: object) -> Iterator[dict]:
    """All objects of a JSON schema."""
    if isinstance(node, dict):
        yield node
    for inner in (
        node.values() if isinstance(node, dict) else node if isinstance(node, list) else ()
    ):
        yield from within(inner)


def test_numbers_are_finite():
    """No key of a scene takes inf or nan: all numbers have limits."""
    numbers = [node for node in within(msgspec.json.schema(Scene)) if node.get("type") == "number"]
    assert len(numbers) > 40
    for number in numbers:
        for limit in ("minimum", "maximum"):
            assert {limit, f"exclusive{limit.capitalize()}"} & number.keys(), number


def test_method_without_parameters_by_default():
    """A scene without parameters of the published iteration is solved by Newton."""
    method = scene(text=WITHOUT_METHOD).method
    assert (method.outer, method.tolerance) == ("newton", 1e-8)
    assert (method.algorithm, method.splitting, method.theta) == (None, None, None)
    assert (
        scene("method.outer=newton", "method.tolerance=1e-5", text=WITHOUT_METHOD).method.tolerance
        == 1e-5
    )


@pytest.mark.parametrize(
    "setting",
    [
        "method.outer=relaxation",
        "method.theta=0.2",
        "method.algorithm=original",
        "method.splitting=none",
    ],
)
def test_any_parameter_of_the_published_iteration_asks_for_it(setting):
    """A scene that names a parameter of the published iteration is solved by it."""
    method = scene(setting, text=WITHOUT_METHOD).method
    assert (method.outer, method.algorithm, method.splitting) == ("relaxation", "original", "none")
    assert (method.theta, method.tolerance) == (0.2, 1e-4)
    assert isinstance(method, Published)


@pytest.mark.parametrize("outer", ["newton", "anderson"])
def test_parameters_of_the_published_iteration_do_not_go_with_others(outer):
    """Parameters that the method would ignore are refused."""
    text = message(f"method.outer={outer}", "method.splitting=step1")
    assert (
        text.startswith("case.toml: method: splitting, theta belong to outer")
        and f'not to "{outer}"' in text
    )


def test_lame_constants():
    """Lamé's constants are those of plane strain or plane stress."""
    strain = Material(young=2.6, poisson=0.3)
    assert strain.lame == pytest.approx((2.6 * 0.3 / (1.3 * 0.4), 1.0), rel=1e-15)
    stress = Material(young=2.6, poisson=0.3, plane="stress")
    assert stress.lame == pytest.approx((2.6 * 0.3 / 0.91, 1.0), rel=1e-15)


def test_evaluate_keeps_shape():
    """Constants and affine functions take points of any shape."""
    x, y = np.arange(6.0).reshape(2, 3), np.ones((2, 3))
    assert np.array_equal(evaluate(2.5, x, y), np.full((2, 3), 2.5))
    assert np.array_equal(
        evaluate((1.0, -2.0), x, y), np.stack([np.ones((2, 3)), np.full((2, 3), -2.0)])
    )
    assert np.array_equal(
        evaluate(AffineScalar(constant=1.0, x_slope=2.0, y_slope=3.0), x, y), 4 + 2 * x
    )
    vector = evaluate(
        AffineVector(constant=(1.0, 0.0), x_slope=(0.0, 2.0), y_slope=(5.0, 0.0)), x, y
    )
    assert np.array_equal(vector, np.stack([np.full((2, 3), 6.0), 2 * x]))


FORMULAS = {
    "-6e7 * (1 + x/3)": lambda x, y: -6e7 * (1 + x / 3),
    "x**2 - y**0.5": lambda x, y: x**2 - np.sqrt(y),
    "2e3*sin(pi*x) + exp(-y)": lambda x, y: 2e3 * np.sin(np.pi * x) + np.exp(-y),
    "7": lambda x, y: 7 + 0 * x,
    "where(x < 1, y, -y)": lambda x, y: np.where(x < 1, y, -y),
    "max(0, 1 - x)": lambda x, y: np.fmax(0, 1 - x),
    "(0 < y) * (y <= 0.5)": lambda x, y: 1.0 * ((y > 0) & (y <= 0.5)),
    "atan2(y, x)": lambda x, y: np.arctan2(y, x),
}


@pytest.mark.parametrize("formula", FORMULAS)
def test_formulas_are_what_they_say(formula):
    """A formula has the values of calculus at all points; whether it varies is known."""
    x, y = np.random.default_rng(0).uniform(0, 2, (2, 3, 4))
    assert evaluate(formula, x, y) == pytest.approx(FORMULAS[formula](x, y), rel=1e-14)
    assert varies(formula) == (formula != "7")
    both = evaluate((formula, 2.5), x, y)
    assert np.array_equal(both, [evaluate(formula, x, y), np.full((3, 4), 2.5)])


@pytest.mark.parametrize(
    "formula",
    [
        "__import__('os').getcwd()",
        "x.real",
        "x.__class__",
        "x[0]",
        "[1][0]",
        "(lambda: 1)()",
        "[z for z in x]",
        "x if y else 1",
        "'a' * 9",
        "f'{x}'",
        "x = 3",
        "x; y",
        "(z := 3)",
        "sin(x, y)",
        "sin(x, out=y)",
        "sin(*x)",
        "sin",
        "eval('1')",
        "x @ y",
        "x and y",
        "x << 99",
        "True",
        "1j",
        "None",
        "0 < x < 1",
        "9**9**9**9",
        "-" * 900 + "x",
        "(" * 300 + "x" + ")" * 300,
        "x" + "+x" * 400,
        "\0",
        " ",
    ],
)
def test_formulas_can_do_nothing_else(formula):
    """What is not arithmetic of numbers, x, y and the known functions is refused before anything is run."""
    with pytest.raises(ValueError, match=r"^value: the formula"):
        check_formulas("value", formula)


@pytest.mark.parametrize(
    "arguments",
    [
        "*x",
        "x, *y",
        "*x, y",
        "x",
        "x, y, z",
        "a=x, b=y",
        "x, out=y",
        "x, y, out=z",
        "**x",
        "",
        "z for z in x",
    ],
)
def test_functions_of_formulas_take_values_alone(arguments):
    """Whatever else stands between their brackets, the message says what should."""
    with pytest.raises(ValueError, match=r": max takes 2 values, as in max\(x, y\)$"):
        check_formulas("value", f"max({arguments})")


def test_formulas_leave_the_points_alone():
    """Evaluating a formula never writes into the coordinates."""
    x = y = np.linspace(0.0, 1.0, 5)
    evaluate("x", x, y)[:] = 7.0
    assert np.array_equal(x, np.linspace(0.0, 1.0, 5))


def test_profile_is_linear_between_points_with_jumps_and_constant_ends():
    """A profile is linear between its points, jumps at repeated ones and is constant beyond."""
    xy = np.array([[-1.0, 7.0], [0.5, 7.0], [0.99, 7.0], [1.01, 7.0], [9.0, 7.0]])
    profile = Profile(along="x", points=[0.0, 1.0, 1.0, 2.0], values=[0.0, 2.0, 10.0, 10.0])
    arc = np.zeros(5)
    assert profile.at(xy, arc) == pytest.approx([0.0, 1.0, 1.98, 10.0, 10.0])
    assert Profile(along="y", points=[6.0, 8.0], values=[0.0, 1.0]).at(xy, arc) == pytest.approx(
        [0.5] * 5
    )
    arc = np.linspace(0.0, 10.0, 5)
    assert Profile(along="arc", points=[0.0, 10.0], values=[0.0, 1.0]).at(xy, arc) == pytest.approx(
        arc / 10.0
    )


def test_every_outer_method_says_what_is_asked_of_it():
    """Titles, labels, plan and advice, by the name that a scene has for it."""
    for name, kind in METHODS.items():
        method = Method(outer=name).settled()
        assert type(method) is kind and (method.outer, bool(Method(outer=name).for_two)) == (
            name,
            method.by_body,
        )
        assert f"{method.criterion} below {method.tolerance:g}" in method.plan
        assert method.title and all(method.curves) and method.diverging
        assert method.advice("max_iterations", np.nan, 3, 0.1, {"iterations"})
