"""Mistakes in scenes, in words: a message names the key, and what would have been right."""

import functools
import math
import re
import tomllib
from collections.abc import Sequence
from typing import Any, NamedTuple, get_args, get_type_hints

import msgspec
from msgspec import inspect

from ddmpi.errors import nearest
from ddmpi.scene.keys import name_of

MEANT = {
    "E": "young",
    "youngs_modulus": "young",
    "modulus": "young",
    "nu": "poisson",
    "poissons_ratio": "poisson",
    "mu": "coefficient",
    "ux": "x",
    "uy": "y",
    "group": "on",
    "centre": "center",
    "elements": "divisions",
    "uz": "z",
    "tied": "bonded",
    "glued": "bonded",
    "welded": "bonded",
    "contact": "unilateral",
    "frictionless": "unilateral",
    "sliding": "guided",
    "no separation": "guided",
    "roller": "guided",
    "fix": "clamp",
    "fixed": "clamp",
    "support": "clamp",
    "boundary": "clamp",
    "dirichlet": "clamp",
    "springs": "foundation",
    "spring": "foundation",
    "winkler": "foundation",
    "bed": "foundation",
    "load": "traction",
    "loads": "traction",
    "BodySpec.force": "traction",
    "BodySpec.pressure": "traction",
    "gravity": "volume_force",
    "body_force": "volume_force",
    "weight": "volume_force",
    "plane stress": "stress",
    "plane strain": "strain",
    "solver": "outer",
    "interference": "a negative gap is an interference",
    "alpha": "expansion",
    "thermal_expansion": "expansion",
    "temp": "temperature",
    "heat": "temperature",
    "density": "weight is the body's volume_force = [0, -density * gravity], in space [0, 0, …]",
    "rho": "weight is the body's volume_force = [0, -density * gravity], in space [0, 0, …]",
    "thickness": "forces in the plane are those on a unit of depth",
    "yield_stress": "materials are linear elastic",
    "plasticity": "materials are linear elastic",
    "stiffness": "contact is hard; a soft joint has a softness, its closure per pressure",
    "penalty": "contact is hard; a soft joint has a softness, its closure per pressure",
    "gasket": "softness",
    "master": "it is the body that slave does not name",
    "symmetry": "clamp = [{ on = …, normal = 0.0 }] lets the group slide along itself",
    "rotation": "nothing is turned by an angle",
    "units": "any units that fit together do; [output] has labels",
    "axisymmetric": "axisymmetric = true stands at the top of the scene",
    "steps": "load steps stand in [time]",
    "dimension": "meshes and lists say it: [x, y] in the plane, [x, y, z] in space",
}
"""Engineers' usual words, anywhere or as a key of one table, and those of scenes: a key, a word, or an explanation."""

WRITTEN = {
    "friction": 'friction = { law = "coulomb", coefficient = 0.3 }',
    "material": "material = { young = …, poisson = … }",
    "mesh": 'mesh = { file = "….msh" }, { geometry = "….geo", size = … } or { shape = "rectangle", … }',
    "bodies": 'bodies = ["…", "…"]',
    "divisions": "divisions = [nx, ny], in space [nx, ny, nz]",
    "size": "size = [width, height], of a box [length, depth, height], of a geometry h",
    **{
        key: f"{key} = [x, y], in space [x, y, z]"
        for key in (
            "value",
            "volume_force",
            "force",
            "origin",
            "center",
            "point",
            "normal",
            "axis",
            "displacement",
        )
    },
    "method": '[method], and below it a line for each key, such as preset = "accurate"',
}
"""Examples of tables and pairs."""

SLIPS = {
    r"[=\[,] *[+-]?(\.\d|\d+\.(?!\d))": "a number has digits before and after its point, as in 0.5",
    r"\d,\d+[eE]|\d *[dD] *[+-]?\d|\d *[*/^]": "a number is written like 2.1e11",
    r"\b(True|False)\b": "write true or false",
    r"[=\[,] *(?!(true|false|inf|nan)\b|[\w.-]+ *=)[A-Za-z_]": "words stand in quotation marks",
    r"[{,][^}]*$|, *\}": "a table { … } stands on one line, without a comma at its end",
}
"""Frequent mistakes in lines that are not TOML, with remedies."""


def explain_syntax(error: tomllib.TOMLDecodeError, text: str) -> str:
    """The mistake in `text`, which is not TOML: the line, and a remedy."""
    place = re.search(r"line (\d+)", str(error))
    line = text.splitlines()[int(place[1]) - 1].strip() if place else ""
    bare = re.sub(r"'[^']*'|\"[^\"]*\"|#.*", '""', line)
    right = next((f"; {right}" for slip, right in SLIPS.items() if re.search(slip, bare)), "")
    return f"{error}{right}" + f": {line}" * bool(line)


described = functools.cache(inspect.type_info)
"""What msgspec says of a type; for a scene it takes 5 ms."""


class Place(NamedTuple):
    """What stands at a key of a scene's data: the key's parts, the value, and the types that it may have."""

    named: list[str]
    given: Any
    kinds: list[inspect.Type]

    @property
    def key(self) -> str:
        return ".".join(self.named)

    @property
    def tables(self) -> list[inspect.StructType]:
        return [kind for kind in self.kinds if isinstance(kind, inspect.StructType)]


def explain(message: str, data: dict, root: type) -> str:
    """Reword msgspec's `message` about `data` as a `root`: the user's key, and what would have been right."""
    problem, _, path = message.replace("`key` in `$", "`$").partition(" - at `$")
    place = _locate(re.findall(r"\w+|\.\.\.", path), data, root)
    if found := re.search(r"(missing required|unknown) field `(.*?)`", problem):
        wrong = _unknown if found[1] == "unknown" else _missing
        return wrong(place, found[2])
    place, problem = _own_check(place, problem)
    before = f"{place.key}: " if place.named else ""
    allowed = _allowed(place.kinds, problem)
    if allowed and ("matching regex" in problem or problem.startswith("Invalid")):
        return before + _expected(place, allowed)
    problem = _reworded(place, problem)
    return before + problem[:1].lower() + problem[1:] + _remedy(place)


def _missing(place: Place, field: str) -> str:
    """What is said of a required key that is missing."""
    words = ", ".join(str(kind.tag) for kind in place.tables if kind.tag_field == field)
    one_of = f" (one of {words})" if words else ""
    return f"{'.'.join([*place.named, field])}: this key is required and missing{one_of}"


def _unknown(place: Place, field: str) -> str:
    """What is said of a key that a table does not have."""
    fields = list[str]()
    names = list[str]()
    for kind in place.tables:
        if kind.tag_field:
            fields.append(kind.tag_field)
        fields += [entry.encode_name for entry in kind.fields]
        names += [base.__name__ for base in kind.cls.__mro__]
    meant = _meant(field, fields, names)
    key = ".".join([*place.named, field])
    return f"{key}: unknown key{meant} (valid here: {', '.join(fields)})"


def _own_check(place: Place, problem: str) -> tuple[Place, str]:
    """The key that a table's own check names at the beginning of its `problem`, and the rest of it."""
    field, _, rest = problem.partition(": ")
    own = {entry.encode_name for kind in place.tables for entry in kind.fields}
    if rest and field.partition(".")[0] in own:
        return place._replace(named=[*place.named, field]), rest
    return place, problem


def _allowed(kinds: Sequence[inspect.Type], problem: str) -> list[str]:
    """The words that may stand at a place."""
    words = list[str]()
    for kind in kinds:
        if isinstance(kind, inspect.LiteralType):
            words += map(str, kind.values)
        # where a "package:Class" may stand as well, the words are the beginning of a pattern
        if isinstance(kind, inspect.StrType) and "matching regex" in problem:
            words += re.findall(r"\w+(?=\|)", kind.pattern or "")
    return words


def _expected(place: Place, allowed: list[str]) -> str:
    """What is said of a value that is none of the `allowed` words."""
    beside = {
        "a number": any(
            isinstance(kind, inspect.IntType | inspect.FloatType) for kind in place.kinds
        ),
        "a list": any(isinstance(kind, inspect.ListType) for kind in place.kinds),
    }
    words = f"{'one of ' * (len(allowed) > 1)}{', '.join(allowed)}"
    kinds = " or ".join([*(kind for kind, may in beside.items() if may), words])
    return f"{place.given!r} is not valid; expected {kinds}{_meant(str(place.given), allowed)}"


TYPES = {
    "object": "a table",
    "array": "a list",
    "float": "a number",
    "int": "a whole number",
    "str": "words in quotes",
    "bool": "true or false",
    " | null": "",
    "|": "or",
}
"""Types in msgspec's messages, in words."""


def _type_in_words(found: re.Match) -> str:
    word = found[1]
    for name, meaning in TYPES.items():
        word = word.replace(name, meaning)
    return word


def _reworded(place: Place, problem: str) -> str:
    """A problem in the words of a scene's author."""
    given = place.given
    if isinstance(given, float) and not math.isfinite(given):
        problem = "must be a finite number"
    if "matching regex" in problem:  # only names have a pattern
        problem = "a name has no '.', '=', '/', blank or control character"
    rows = [
        kind for kind in place.kinds if isinstance(kind, inspect.VarTupleType) and kind.max_length
    ]
    if rows and isinstance(given, list):
        lengths = dict.fromkeys((rows[0].min_length, rows[0].max_length))
        problem = f"expected a list of length {' or '.join(map(str, lengths))}, got {len(given)}"
    if not isinstance(given, dict | list):
        problem = re.sub(r", got `.*?`$", "", problem) + f" (got {given!r})"
    return re.sub(r"`(.*?)`", _type_in_words, problem)


def _locate(path: list[str], data: dict, root: type) -> Place:
    """What stands at a path in `data`; in the key, entries of lists are called by their names."""
    named = list[str]()
    given = data
    kinds = [described(root)]
    before = kinds
    for key in path:
        if key == "...":  # of a table of free names, msgspec does not say which one
            table = next(kind.cls for kind in before if isinstance(kind, inspect.StructType))
            entry = get_args(get_type_hints(table, include_extras=True)[named[-1]])[1]
            key = next(name for name, value in given.items() if not _fits(value, entry))
        before = kinds
        kinds = [inner for kind in kinds for inner in _inside(kind, key)]
        in_list = isinstance(given, list)
        given = given[int(key) if isinstance(given, list) else key]
        named.append((in_list and name_of(given)) or key)
        if isinstance(given, dict):  # its tag, as in law = "coulomb", tells unions apart
            kinds = [
                kind
                for kind in kinds
                if isinstance(kind, inspect.StructType)
                and kind.tag
                and kind.tag == given.get(kind.tag_field)
            ] or kinds
    return Place(named, given, kinds)


def _fits(value: Any, kind: Any) -> bool:
    """Whether a value can be read as one of a kind."""
    try:
        msgspec.convert(value, kind)
    except msgspec.ValidationError:
        return False
    return True


def _inside(kind: inspect.Type, part: str) -> list[inspect.Type]:
    """The types that may stand at key `part` of a `kind`."""
    inner: Sequence[inspect.Type]
    match kind:
        case inspect.StructType(tag_field=field, tag=tag) if field == part:
            inner = [inspect.LiteralType((tag,))]
        case inspect.StructType(fields=fields):
            inner = [field.type for field in fields if field.encode_name == part]
        case inspect.TupleType(item_types=items):
            inner = [items[int(part)]]
        case inspect.ListType(item_type=item) | inspect.VarTupleType(item_type=item):
            inner = [item]
        case inspect.DictType(value_type=value):
            inner = [value]
        case _:
            inner = []
    return [
        one
        for entry in inner
        for one in (entry.types if isinstance(entry, inspect.UnionType) else (entry,))
    ]


def _meant(word: str, words: list[str], tables: Sequence[str] = ()) -> str:
    """`nearest`, or what `word` means elsewhere, as a key of one of the `tables` or in general."""
    meant = next(
        (MEANT[each] for each in (*(f"{table}.{word}" for table in tables), word) if each in MEANT),
        "",
    )
    if meant in words:
        return f"; did you mean {meant!r}?"
    return f"; {meant}" if " " in meant else nearest(word, words)


def _remedy(place: Place) -> str:
    """The end of a message that shows how to write a value which only lacks quotation marks, brackets or braces."""
    named, value, kinds = place
    if isinstance(value, str) and value[:1] in ("[", "{"):  # from --set, after the shell has had it
        quoted = re.sub(r"([=\[,] *)([A-Za-z_][^][{},=\"']*?)(?= *[],}])", r'\1"\2"', value)
        return f"; the shell must leave quotation marks around words: '{place.key}={quoted}'"
    if isinstance(value, dict) and place.tables:
        return ""  # a table may stand here, and what is wrong is within
    for kind in kinds:
        if isinstance(kind, inspect.StructType) and kind.tag == value == "none":
            return f'; write {named[-1]} = {{ {kind.tag_field} = "{value}" }}'
        if _lists(kind, value):
            inner = f'"{value}"' if isinstance(value, str) else "{ … }"
            return f"; write {named[-1]} = [{inner}]" if named[1:] else f"; write [[{named[0]}]]"
    return _example(place)


def _example(place: Place) -> str:
    """The end of a message with an example of a table or a pair, where one should stand; empty elsewhere."""
    lists = inspect.TupleType, inspect.VarTupleType
    written = WRITTEN.get(place.named[-1]) if place.named else None
    fits = lists if written and "= [" in written else (inspect.StructType, *lists)
    compound = any(isinstance(kind, fits) for kind in place.kinds)
    if not written or not compound or isinstance(place.given, dict):
        return ""
    return f"; write {written}"


def _lists(kind: inspect.Type, value: Any) -> bool:
    """Whether a list of a `kind` may have `value`, words or a table, as its only entry."""
    if not isinstance(kind, inspect.ListType | inspect.VarTupleType) or (kind.min_length or 0) > 1:
        return False
    entries = _inside(kind, "0")
    if isinstance(value, str):
        return any(isinstance(entry, inspect.StrType) for entry in entries)
    return isinstance(value, dict) and any(isinstance(e, inspect.StructType) for e in entries)
