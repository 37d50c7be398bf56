"""The cases of a sweep: what --vary means, and what it refuses before anything runs. No MPI."""

from types import SimpleNamespace

import pytest
import scenes

from ddmpi.errors import InputError
from ddmpi.scene.reader import read_data
from ddmpi.sweep.cases import build_cases, choose, cut, parse_axis

TEXT = scenes.to_toml(scenes.pinched_blocks(2, outer="relaxation"))


def build(*varied: str, settings: tuple[str, ...] = ()) -> list:
    return build_cases("scene.toml", read_data("scene.toml", TEXT, settings), list(varied))


VALUES = {
    "method.theta=0.1:0.5:5": ["0.1", "0.2", "0.3", "0.4", "0.5"],
    "method.max_iterations=10:40:4": ["10", "20", "30", "40"],
    "method.max_iterations=1:1000:4:log": ["1", "10", "100", "1000"],
    "body.upper.material.young=1e9:1e12:4:log": ["1e9", "10000000000", "100000000000", "1e12"],
    "k=-1:1:3": ["-1", "0", "1"],
    "k=none, step1": ["none", "step1"],
    "k=[66,22],[132, 44]": ["[66,22]", "[132, 44]"],
    'k="a,b",c': ['"a,b"', "c"],
    'k={law="none"},{law="tresca", slip_bound=1e7}': [
        '{law="none"}',
        '{law="tresca", slip_bound=1e7}',
    ],
    "k=meshes/a:b.msh": ["meshes/a:b.msh"],
    "k=true": ["true"],
}


@pytest.mark.parametrize("text", VALUES)
def test_values(text):
    assert parse_axis(text)[1] == VALUES[text]


MALFORMED = [
    "method.theta",
    "=1,2",
    "a,=3",
    "k=",
    "k=1,,2",
    "k=1:2",
    "k=1:2:3:4",
    "k=1:x:3",
    "k=1:2:1",
    "k=1:2:2.5",
    "k=-1:1:3:log",
    "k=1:2:100000000000",
]
REFUSED = [
    ((), ["--vary"]),
    *(((text,), [f"--vary {text}: expected KEY=first:last:number"]) for text in MALFORMED),
    (
        ("method.thetta=0.1,0.2",),
        ["--vary method.thetta=0.1", "scene.toml", "unknown key", "'theta'"],
    ),
    (
        ("body.uper.material.young=1e9,2e9",),
        ["--vary body.uper.material.young=1e9", "'uper'", "'upper'"],
    ),
    (("method.theta=0.1,-1",), ["--vary method.theta=-1", "method.theta", "> 0"]),
    (
        ("method.max_iterations=1:10:3",),
        ["--vary method.max_iterations=5.5", "method.max_iterations"],
    ),
    (("method.theta=0.1:1:1000", "contact.0.friction.coefficient=0:1:1000"), ["1000000 cases"]),
    # a value given twice, or a key that another --vary sets, makes two equal cases
    (
        ("method.theta=0.1,0.10",),
        ["--vary: the cases method.theta=0.1 and method.theta=0.10 are the same"],
    ),
    (("method.theta=1:1.0:3",), ["are the same"]),
    (("method.theta=0.1,0.2", "method.theta=0.3"), ["are the same"]),
    (("body.0.material.young=1e9,2e9", "body.upper.material.young=3e9"), ["are the same"]),
    (
        ("contact.0.friction.coefficient=0.1,0.2", 'contact.0.friction={law="none"}'),
        ["are the same"],
    ),
]


@pytest.mark.parametrize(("varied", "words"), REFUSED)
def test_refused(varied, words):
    with pytest.raises(InputError) as caught:
        build(*varied)
    assert all(word in str(caught.value) for word in words) and "--set" not in str(caught.value)


def test_bolts_without_a_force_are_refused_before_any_case_runs():
    """As import leaves them; a force may be among the values."""
    bolt = ['contact.0={bodies=["upper","lower"], on=["bottom","top"], name="bolt", kind="bonded"']
    bolt += ["pretension={along=[0,1]}}"]
    one = ('method.outer="newton"', ", ".join(bolt))
    with pytest.raises(InputError, match=r"contact\.bolt\.pretension: force is missing"):
        build(*one)
    assert len(build(*one, "contact.bolt.pretension.force=1e3,2e3")) == 2


def test_a_table_and_then_an_entry_of_it():
    assert len(build("petsc.a=true,1")) == 2
    cases = build(
        "petsc={-a=1},{a=2, b=3}", "petsc.c=true,false", "body.0.material={young=1e9, poisson=0}"
    )
    assert [case.scene.petsc for case in cases] == [
        {"-a": 1, "c": True},
        {"-a": 1, "c": False},
        {"a": 2, "b": 3, "c": True},
        {"a": 2, "b": 3, "c": False},
    ]


def test_all_combinations_the_last_key_fastest():
    cases = build("contact.0.friction.coefficient=0.1,0.2", "method.theta=0.1:0.3:3")
    assert [case.number for case in cases] == list(range(6))
    assert [tuple(case.values.values()) for case in cases] == [
        (f, t) for f in (0.1, 0.2) for t in (0.1, 0.2, 0.3)
    ]
    assert [
        (case.scene.contact[0].friction.coefficient, case.scene.method.theta) for case in cases
    ] == [tuple(case.values.values()) for case in cases]


def test_keys_that_vary_together():
    cases = build("body.upper.mesh.divisions,body.lower.mesh.divisions=[6,2],[12,4]")
    assert [[body.mesh.divisions for body in case.scene.body] for case in cases] == [
        [(6, 2)] * 2,
        [(12, 4)] * 2,
    ]


def test_integers_stay_integers_and_settings_come_first():
    case = build(
        "method.max_iterations=3:5:3", settings=("method.max_iterations=7", "method.theta=0.5")
    )[1]
    assert case.scene.method.max_iterations == 4 and isinstance(
        case.values["method.max_iterations"], int
    )
    assert case.scene.method.theta == 0.5


def test_folders_tell_cases_apart_and_stay_when_the_sweep_grows():
    """They are readable, and contain nothing that a file system would refuse."""
    (case,) = build("method.theta=0.1", "body.upper.mesh.divisions,body.lower.mesh.divisions=[6,2]")
    assert case.folder == "method.theta=0.1,body.upper.mesh.divisions=6x2"
    long = [f'"{"x" * 200}{k}"' for k in range(2)]
    few = build("method.theta=0.1,0.2", f"title=a b,a_b,[a b],{','.join(long)}")
    folders = [case.folder for case in few]
    assert len(set(folders)) == len(few)
    for folder in folders:
        assert (
            all(c.isascii() and (c.isalnum() or c in ".,=+-_") for c in folder)
            and len(folder) < 200
        )
    assert build("method.theta=0.1,0.2,0.3", "title=a_b,c")[2].folder == next(
        case.folder for case in few if tuple(case.values.values()) == (0.2, "a_b")
    )


def test_long_names_of_plots_are_cut():
    """Whatever the lengths of names in keys; what is cut differs as the whole does."""
    names = [
        f"contacts.{'é' * length}.pressure_max-{key}"
        for length in (9, 99)
        for key in ("x" * 80, "y" * 80)
    ]
    found = [cut(name, name) for name in names]
    assert (
        found[:2] == names[:2]
        and len(set(found)) == 4
        and all(len(name.encode()) < 200 for name in found)
    )


def test_cases_that_would_share_a_folder(monkeypatch):
    """Names that are cut are told apart by a short digest, which two cases of many may have in common."""
    monkeypatch.setattr("hashlib.sha256", lambda data: SimpleNamespace(hexdigest=lambda: "0" * 64))
    with pytest.raises(InputError, match=r"title=x+0 and title=x+1 are the same"):
        build(f"title={'x' * 200}0,{'x' * 200}1")


@pytest.mark.parametrize(
    ("index", "numbers"),
    [(None, range(7)), ("0", [0]), ("6", [6]), ("1/3", [1, 4]), ("0/1", range(7)), ("8/9", [])],
)
def test_index(index, numbers):
    cases = build("method.theta=0.1:0.7:7")
    assert [case.number for case in choose(cases, index)] == list(numbers)


@pytest.mark.parametrize("index", ["7", "-1", "x", "3/3", "1/0", "0/0", "1/2/3", "1.5", "²"])
def test_index_out_of_range(index):
    with pytest.raises(InputError, match=f"--index {index}"):
        choose(build("method.theta=0.1:0.7:7"), index)
