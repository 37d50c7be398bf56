"""Keys of a scene as users write them: KEY=VALUE after ``--set``, entries of lists by name or number, in messages, and
as a JSON schema for editors.

A message about a mistake names the key, and what would have been right. The schema describes keys by docstrings.
"""

from __future__ import annotations

import difflib
import itertools
import math
import re
import tomllib
from collections.abc import Iterator, Sequence
from inspect import cleandoc
from typing import Any, get_args, get_type_hints

import msgspec
from msgspec import inspect

from ddmpi.errors import InputError
from ddmpi.scene.contacts import LAWS, default_name
from ddmpi.scene.values import LARGEST, Formula, Group, Name, Table

DIALECT = "http://json-schema.org/draft-07/schema#"
"""Draft of the schema; editors support later ones poorly."""

TITLES = {"name": Name, "group": Group, "formula": Formula}
"""Titles of the words that a scene's author chooses."""

SIMILAR = 0.65
"""Least similarity of a word to a misspelling of it."""

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
    "stiffness": "there is no contact stiffness to choose",
    "penalty": "there is no contact stiffness to choose",
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

WHOLE = (
    r"body\.[^.]+\.(?:(?:traction|clamp)\.\d+|volume_force|temperature)"
    r"|rigid\.[^.]+\.(?:displacement|force|moment)|contact\.[^.]+\.(?:gap|friction\.(?:coefficient|slip_bound))"
)
"""What the derivatives of an answer take as a whole, by a factor on it, unless it is one number."""

NUMBER = (
    r"body\.[^.]+\.(?:material(?:\.\d+)?\.young|volume_force\.\d"
    r"|traction\.\d+\.(?:pressure|moment|(?:value|force|moment)\.\d)|clamp\.\d+\.(?:x|y|z|normal))"
    r"|rigid\.[^.]+\.(?:displacement|force|moment)\.\d|contact\.[^.]+\.(?:gap\.value|pretension\.force)"
)
"""Other numbers by which an answer can be differentiated."""


def override(data: dict, key: str, value: Any, where: str = "--set ") -> None:
    """Set one key of `data`, as after ``--set``. Raises InputError, which begins with `where` and the key."""
    (*parents, last), key = key.strip().split("."), f"{where}{key}"
    table: Any = data
    for depth, part in enumerate(parents):
        table = (
            table[_index(table, part, key)]
            if isinstance(table, list)
            else table.setdefault(part, {})
        )
        if not isinstance(table, dict | list):
            raise InputError(f"{key}: {'.'.join(parents[: depth + 1])} is a value, not a table")
    table[_index(table, last, key) if isinstance(table, list) else last] = value
    if last == "law" and isinstance(value, str) and value in LAWS:  # what other laws need goes
        for name in set(table) - LAWS[value]:
            del table[name]


def parse_value(text: str) -> Any:
    """The meaning of the text after ``KEY=``: a TOML value, or else a plain string."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text.strip()


def explain_syntax(error: tomllib.TOMLDecodeError, text: str) -> str:
    """The mistake in `text`, which is not TOML: the line, and a remedy."""
    place = re.search(r"line (\d+)", str(error))
    line = text.splitlines()[int(place[1]) - 1].strip() if place else ""
    bare = re.sub(r"'[^']*'|\"[^\"]*\"|#.*", '""', line)
    right = next((f"; {right}" for slip, right in SLIPS.items() if re.search(slip, bare)), "")
    return f"{error}{right}" + f": {line}" * bool(line)


def flatten(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """The leaves of nested tables with their keys."""
    if (
        isinstance(value, list | tuple)
        and value
        and all(isinstance(entry, dict) for entry in value)
    ):
        value = {name_of(entry) or str(k): entry for k, entry in enumerate(value)}
    if isinstance(value, dict):
        for name, entry in value.items():
            yield from flatten(entry, f"{key}.{name}" if key else name)
    else:
        yield key, value


def derivable(scene: dict) -> list[str]:
    """The keys of a resolved scene by which its answer can be differentiated: numbers, and what stands for a factor."""
    keys: dict[str, None] = {}
    bodies = [
        body
        | {"clamp": [{"on": entry} if isinstance(entry, str) else entry for entry in body["clamp"]]}
        for body in scene["body"]
    ]
    fixed = {
        f"rigid.{rigid['name']}.{'displacement' if force else 'force'}.{axis}"
        for rigid in scene["rigid"]
        for axis, force in enumerate(rigid.get("force") or ())
    }  # an axis is pushed or moved
    for leaf, value in flatten(
        {"body": bodies, "contact": scene["contact"], "rigid": scene["rigid"]}
    ):
        whole = re.match(WHOLE, leaf)
        if whole and value is not None:
            keys[whole[0]] = None
        vector = isinstance(value, list | tuple)
        entries = [(f".{k}", entry) for k, entry in enumerate(value)] if vector else [("", value)]
        keys |= dict.fromkeys(
            leaf + at
            for at, entry in entries
            if type(entry) in (int, float)
            and re.fullmatch(NUMBER, leaf + at)
            and leaf + at not in fixed
        )
    return list(keys)


def refuse_underivable(scene: dict) -> None:
    """ValueError where ``output.derivatives`` names a key by which nothing can be differentiated."""
    wanted = scene["output"]["derivatives"]
    if wanted and scene["method"]["outer"] != "newton":
        raise ValueError(
            f'output.derivatives: need outer = "newton", not "{scene["method"]["outer"]}"'
        )
    able = derivable(scene) if wanted else []
    for key in wanted:
        if key not in able:
            raise ValueError(
                f"output.derivatives: {key!r} is no number, load, clamp or displacement of this scene by "
                f"which its answer can be differentiated; the nearest ones are "
                f"{', '.join(difflib.get_close_matches(key, able, n=3, cutoff=0.0))}"
            )
        if wanted.count(key) > 1:
            raise ValueError(f"output.derivatives: {key!r} stands there {wanted.count(key)} times")


def differences(ours: dict, theirs: dict) -> str:
    """The differences of two nested tables, in words: the first three keys with both values. Empty for equal ones."""

    def word(table: dict, key: str) -> str:
        return repr(table[key]) if key in table else "not set"

    mine, others = dict(flatten(ours)), dict(flatten(theirs))
    differing = [key for key in mine | others if mine.get(key) != others.get(key)]
    words = [f"{key} is {word(mine, key)} here, {word(others, key)} there" for key in differing[:3]]
    return "; ".join(words) + (f", and {len(differing) - 3} more" if len(differing) > 3 else "")


def _index(table: list, part: str, key: str) -> int:
    """Position of an entry of a list, given by name or number."""
    names = [name_of(entry) for entry in table]
    if part in names:
        return names.index(part)
    if part.isdecimal() and int(part) < len(table):
        return int(part)
    named = [name for name in names if name]
    known = ", ".join(named) or (f"0 to {len(table) - 1}" if table else "none, the list is empty")
    raise InputError(f"{key}: there is no entry {part!r}{nearest(part, named)} (entries: {known})")


def nearest(word: str, words: list[str]) -> str:
    """The end of a message that proposes the most similar of `words`; empty if none is similar."""
    close = difflib.get_close_matches(word, words, n=1, cutoff=SIMILAR)
    return f"; did you mean {close[0]!r}?" if close else ""


def _meant(word: str, words: list[str], tables: Sequence[str] = ()) -> str:
    """`nearest`, or what `word` means elsewhere, as a key of one of the `tables` or in general."""
    meant = next(
        (MEANT[each] for each in (*(f"{table}.{word}" for table in tables), word) if each in MEANT),
        "",
    )
    if meant in words:
        return f"; did you mean {meant!r}?"
    return f"; {meant}" if " " in meant else nearest(word, words)


def name_of(entry: Any) -> str | None:
    """The name that keys may use for an entry of a list in a scene's data; None if it has no name."""
    name, bodies = (
        (entry.get("name"), entry.get("bodies")) if isinstance(entry, dict) else (None, None)
    )
    if name is None and isinstance(bodies, list) and all(isinstance(body, str) for body in bodies):
        name = default_name(bodies)
    return name if isinstance(name, str) and name else None


def explain(message: str, data: dict, root: type) -> str:
    """Reword msgspec's `message` about `data` as a `root`: the user's key, and what would have been right."""
    problem, _, path = message.replace("`key` in `$", "`$").partition(" - at `$")
    named, given, kinds = _locate(re.findall(r"\w+|\.\.\.", path), data, root)
    if found := re.search(r"(missing required|unknown) field `(.*?)`", problem):
        key = ".".join([*named, found[2]])
        tables = [kind for kind in kinds if isinstance(kind, inspect.StructType)]
        if found[1] != "unknown":
            words = ", ".join(str(kind.tag) for kind in tables if kind.tag_field == found[2])
            return f"{key}: this key is required and missing" + f" (one of {words})" * bool(words)
        fields = [
            name
            for kind in tables
            for name in (kind.tag_field, *(field.encode_name for field in kind.fields))
            if name
        ]
        meant = _meant(
            found[2], fields, [base.__name__ for kind in tables for base in kind.cls.__mro__]
        )
        return f"{key}: unknown key{meant} (valid here: {', '.join(fields)})"
    field, _, rest = problem.partition(": ")
    if rest and any(
        field.partition(".")[0] == entry.encode_name
        for kind in kinds
        if isinstance(kind, inspect.StructType)
        for entry in kind.fields
    ):  # its own check names a key
        named, problem = [*named, field], rest
    key = ".".join(named) + ": " * bool(named)
    allowed = [
        str(value)
        for kind in kinds
        if isinstance(kind, inspect.LiteralType)
        for value in kind.values
    ]
    # where a "package:Class" may stand as well, the words are the beginning of a pattern
    allowed += [
        word
        for kind in kinds
        if isinstance(kind, inspect.StrType) and "matching regex" in problem
        for word in re.findall(r"\w+(?=\|)", kind.pattern or "")
    ]
    if allowed and ("matching regex" in problem or problem.startswith("Invalid")):
        number = "a number or " * any(
            isinstance(kind, inspect.IntType | inspect.FloatType) for kind in kinds
        )
        return f"{key}{given!r} is not valid; expected {number}one of {', '.join(allowed)}{_meant(str(given), allowed)}"
    if isinstance(given, float) and not math.isfinite(given):
        problem = "must be a finite number"
    if "matching regex" in problem:  # only names have a pattern
        problem = "a name has no '.', '=', '/', blank or control character"
    rows = [kind for kind in kinds if isinstance(kind, inspect.VarTupleType) and kind.max_length]
    if rows and isinstance(given, list):
        lengths = dict.fromkeys((rows[0].min_length, rows[0].max_length))
        problem = f"expected a list of length {' or '.join(map(str, lengths))}, got {len(given)}"
    if not isinstance(given, dict | list):
        problem = re.sub(r", got `.*?`$", "", problem) + f" (got {given!r})"
    problem = re.sub(
        r"`(.*?)`",
        lambda kind: (
            kind[1]
            .replace("object", "a table")
            .replace("array", "a list")
            .replace("float", "a number")
            .replace("int", "a whole number")
            .replace("str", "words in quotes")
            .replace("bool", "true or false")
            .replace(" | null", "")
            .replace("|", "or")
        ),
        problem,
    )
    return key + problem[:1].lower() + problem[1:] + _remedy(named, kinds, given)


def _locate(path: list[str], data: dict, root: type) -> tuple[list[str], Any, list[inspect.Type]]:
    """What stands at a path in `data`: the key, entries of lists by name; the value; the types that it may have."""
    named, given, kinds = list[str](), data, [inspect.type_info(root)]
    before = kinds
    for key in path:
        if key == "...":  # of a table of free names, msgspec does not say which one
            table = next(kind.cls for kind in before if isinstance(kind, inspect.StructType))
            entry = get_args(get_type_hints(table, include_extras=True)[named[-1]])[1]
            key = next(name for name, value in given.items() if not _fits(value, entry))
        before, kinds = kinds, [inner for kind in kinds for inner in _inside(kind, key)]
        in_list, given = (
            isinstance(given, list),
            given[int(key) if isinstance(given, list) else key],
        )
        named.append((in_list and name_of(given)) or key)
        if isinstance(given, dict):  # its tag, as in law = "coulomb", tells unions apart
            kinds = [
                kind
                for kind in kinds
                if isinstance(kind, inspect.StructType)
                and kind.tag
                and kind.tag == given.get(kind.tag_field)
            ] or kinds
    return named, given, kinds


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


def _remedy(named: list[str], kinds: list[inspect.Type], value: Any) -> str:
    """The end of a message that shows how to write `here`, if it only lacks quotation marks, brackets or braces."""
    if isinstance(value, str) and value[:1] in ("[", "{"):  # from --set, after the shell has had it
        quoted = re.sub(r"([=\[,] *)([A-Za-z_][^][{},=\"']*?)(?= *[],}])", r'\1"\2"', value)
        return f"; the shell must leave quotation marks around words: '{'.'.join(named)}={quoted}'"
    if isinstance(value, dict) and any(isinstance(kind, inspect.StructType) for kind in kinds):
        return ""  # a table may stand here, and what is wrong is within
    for kind in kinds:
        if isinstance(kind, inspect.StructType) and kind.tag == value == "none":
            return f'; write {named[-1]} = {{ {kind.tag_field} = "{value}" }}'
        wanted = (
            inspect.StrType
            if isinstance(value, str)
            else inspect.StructType
            if isinstance(value, dict)
            else ()
        )
        is_list = (
            isinstance(kind, inspect.ListType | inspect.VarTupleType) and (kind.min_length or 0) < 2
        )
        if is_list and any(isinstance(item, wanted) for item in _inside(kind, "0")):
            inner = f'"{value}"' if isinstance(value, str) else "{ … }"
            return f"; write {named[-1]} = [{inner}]" if named[1:] else f"; write [[{named[0]}]]"
    compound = any(
        isinstance(kind, inspect.StructType | inspect.TupleType | inspect.VarTupleType)
        for kind in kinds
    )
    written = WRITTEN.get(named[-1]) if named and compound and not isinstance(value, dict) else None
    return f"; write {written}" if written else ""


def read_docstring(text: str | None) -> tuple[str, dict[str, dict[str, str]]]:
    """The words of a numpydoc docstring, and by title its sections: what each name, or row of names, means."""
    words, *parts = re.split(r"^(\w+)\n-{3,}\n", cleandoc(text or ""), flags=re.MULTILINE)
    entry = re.compile(r"^(\S.*?)(?: : |\n[ ]+|\n|\Z)((?:.*\n?(?:[ ]+.*\n?)*))", re.MULTILINE)
    return words.strip(), {
        title: {names: " ".join(meaning.split()) for names, meaning in entry.findall(part)}
        for title, part in zip(parts[::2], parts[1::2], strict=True)
    }


def meanings(kind: type) -> dict[str, str]:
    """The meanings of attributes by name, from the docstrings of a class and of its bases."""
    words: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        for names, meaning in (
            read_docstring(vars(base).get("__doc__"))[1].get("Attributes", {}).items()
        ):
            words |= dict.fromkeys(names.split(", "), meaning)
    return words


def json_schema(root: type) -> dict[str, Any]:
    """The JSON schema of `root`, as a user writes it: keys, types, limits, defaults and, by docstrings, meanings."""
    schema = msgspec.json.schema(root)
    titles = [
        (msgspec.json.schema(kind), {"type": "string", "title": title})
        for title, kind in TITLES.items()
    ]
    tables = {kind.__name__: kind for kind in _below(Table)}
    definitions = {}
    for name, definition in schema["$defs"].items():
        definitions[name] = table = _tidy(definition, titles)
        table.pop("title")
        table["description"] = _plain(read_docstring(tables[name].__doc__)[0])
        for key, meaning in meanings(tables[name]).items():
            # beside a reference, other entries would not be looked at
            value = table["properties"][key]
            table["properties"][key] = ({"allOf": [value]} if "$ref" in value else value) | {
                "description": _plain(meaning)
            }
    return {"$schema": DIALECT, "title": "scene of ddmpi", **schema, "$defs": definitions}


def _below(kind: type) -> list[type]:
    return [kind, *itertools.chain.from_iterable(map(_below, kind.__subclasses__()))]


def _plain(text: str) -> str:
    """The text without the marks of code."""
    return " ".join(text.replace("``", "").split())


def _tidy(node: Any, titles: list[tuple[dict, dict]]) -> Any:
    """A part of the schema in terms of DIALECT, without what TOML cannot write: null, numbers that are not finite."""
    if isinstance(node, list | tuple):
        return [_tidy(entry, titles) for entry in node]
    if not isinstance(node, dict):
        return node
    for wanted, title in titles:
        if node == wanted:
            return _tidy(node, []) | title
    kept = {
        key: _tidy(value, titles)
        for key, value in node.items()
        if not (
            key == "default" and (value is None or value in ([], {}) or isinstance(value, dict))
        )
        and value not in (LARGEST, -LARGEST)
        and key != "discriminator"
    }
    if "prefixItems" in kept:  # all entries of a row are alike
        kept["items"] = kept.pop("prefixItems")[0]
    if "pattern" in kept:
        kept["pattern"] = kept["pattern"].replace(r"\Z", "$")
    if "anyOf" in kept:
        kinds = [kind for kind in kept.pop("anyOf") if kind != {"type": "null"}]
        kept |= kinds[0] if len(kinds) == 1 else {"anyOf": kinds}
    return kept


def check_heat(bodies: list[Any]) -> None:
    """ValueError if materials of `BodySpec` bodies expand, and none has a temperature. Bodies without one keep that of
    the state free of stress."""
    expanding = [
        body.name
        for body in bodies
        if any(material.expansions.any() for material in body.materials)
    ]
    if expanding and all(body.temperature is None for body in bodies):
        raise ValueError(
            f"body.{expanding[0]}.material.expansion: no body has a temperature, so nothing expands; "
            "write temperature = 80.0 (K over the state free of stress) into a [[body]], or leave "
            "expansion out"
        )


def check_thickness(bodies: list[Any], touched: set[str]) -> None:
    """ValueError if a part of a `BodySpec` body with foundations, or with contacts, has a thickness of its own."""
    for body in bodies:
        if (body.foundation or body.name in touched) and any(
            one.thickness != 1.0 for one in body.materials
        ):
            raise ValueError(
                f"body.{body.name}.material.thickness: bodies with contacts or foundations have the depth "
                "alone; leave it out"
            )
