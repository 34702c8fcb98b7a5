"""Valid input, spoilt at random by a model's JSON schema from pydantic: every field, every member of a union.

A case is a pure function of its seed. If the schema has a bound, values at the bound and one step beyond are tried. All
other changes are like those seen in real files: wrong types, huge and tiny numbers, control characters, lists of wrong
length, misspelt, missing and unknown keys, and invalid YAML.
"""

import copy
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import yaml
from pydantic import BaseModel

Where = tuple[str | int, ...]
Schema = dict[str, Any]

TEXTS = (
    "",
    " ",
    "null",
    "1",
    "a" * 300,
    "ä" * 70_000,
    "nul\0",
    "two\nlines",
    "\x1b[31mred\x1b[0m",
    "back\b\rspace",
    "\x9b2J",
    "\u2028\u202eleft",
    "[/red]",
    "[bold",
    "../../etc/passwd",
    "/",
    ".",
    "%s %n {0}",
    "🛸" * 70,
    "x/" * 3000,
)
NUMBERS: tuple[Any, ...] = (
    0,
    0.0,
    -0.0,
    1,
    -1,
    5e-324,
    -5e-324,
    2.3e-308,
    1e-200,
    1e-30,
    1e-12,
    1e-6,
    1e3,
    1e6,
    1e9,
    1e12,
    math.nextafter(1e12, 2e12),
    -1e12,
    1e13,
    1e154,
    1.7e308,
    math.inf,
    -math.inf,
    math.nan,
    2**31,
    2**53 + 1,
    2**63 - 1,
    2**63,
    2**64,
    -(2**63) - 1,
    10**30,
    10**400,
    -(10**400),
    10**4000,
)
KEYS = (
    "frobs",
    "",
    " ",
    "two\nlines",
    "\x1b[2J",
    "nul\0",
    "a.b",
    "k" * 5000,
    "Kind",
    "[/red]",
    "😀",
    "__class__",
    "<<",
)
RAW = (
    "1e400",
    "1.0e+400",
    "-1.0e+400",
    "0x" + "f" * 40,
    "1:30:00.5",
    "2020-01-01",
    "2020-13-45",
    "0o17",
    "1_000",
    "~",
    "yes",
    "!!binary aGk=",
    "!!set {a, b}",
    "!!omap [a: 1]",
    "!!float 1",
    "!!int 99999999999999999999999",
    "!!python/name:os.system",
    "!mine 3",
    "*nowhere",
    "&a [*a]",
    "&a {b: *a}",
    "{<<: {a: 1}}",
    "? [1, 2]",
    "{[1]: 2}",
    "{1: 2}",
    "{a: 1, a: 2}",
    "'open",
    '"\\x00"',
    '"\\ud800"',
    "[" * 300 + "]" * 300,
    "[" * 30_000,
    "{a: " * 2000 + "1" + "}" * 2000,
    "|\n  two\n  lines",
    "9" * 5000,
    "@",
    "`",
    "%YAML 9.9",
    "\t",
)


@dataclass(frozen=True)
class Place:
    """A place in the data: its path, the schema at this place, and the value there."""

    path: Where
    schema: Schema
    value: Any


def resolve(schema: Schema, root: Schema) -> Schema:
    """Return the schema to which a reference leads, or the schema itself if it is no reference."""
    while "$ref" in schema:
        schema = root["$defs"][schema["$ref"].rpartition("/")[2]]
    return schema


def member_for(schema: Schema, value: Any, root: Schema) -> Schema:
    """Return the member of a union to which a valid value belongs, or the schema itself if it is no union."""
    schema = resolve(schema, root)
    for member in (resolve(m, root) for m in schema.get("oneOf", schema.get("anyOf", ()))):
        if isinstance(value, dict) and "kind" in member.get("properties", {}):
            if member["properties"]["kind"].get("const") == value.get("kind"):
                return member
        elif (member.get("type") == "null") == (value is None):
            return member
    return schema


def places(schema: Schema, value: Any, root: Schema, path: Where = ()) -> Iterator[Place]:
    """Yield every place in valid data: groups, lists, numbers and texts."""
    yield Place(path, schema, value)
    member = member_for(schema, value, root)
    if isinstance(value, dict):
        for key, part in value.items():
            inner = member.get("properties", {}).get(key, member.get("additionalProperties") or {})
            yield from places(inner, part, root, (*path, key))
    elif isinstance(value, list):
        first = member.get("prefixItems", [])
        for i, part in enumerate(value):
            yield from places(first[i] if i < len(first) else member.get("items") or {}, part, root, (*path, i))


def bounds(schema: Schema, root: Schema) -> list[float]:
    """Return the bounds of a schema and their nearest neighbours, where valid becomes invalid."""
    schema = resolve(schema, root)
    found: list[float] = []
    for member in (schema, *(resolve(m, root) for m in schema.get("anyOf", ()))):
        for key in ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum"):
            if (bound := member.get(key)) is not None:
                if member["type"] == "integer":
                    found += [bound - 1, bound, bound + 1]
                else:
                    bound = float(bound)
                    found += [math.nextafter(bound, -math.inf), bound, math.nextafter(bound, math.inf)]
    return found


def misspelt(word: str, rng: np.random.Generator) -> str:
    """Return a word with one letter lost, one letter doubled, or two letters swapped."""
    i = int(rng.integers(max(1, len(word))))
    swapped = word[: i - 1] + word[i - 1 : i + 1][::-1] + word[i + 1 :] if i else word[::-1]
    return (word[:i] + word[i + 1 :], word[: i + 1] + word[i:], swapped)[int(rng.integers(3))] or "x"


def filled(schema: Schema, root: Schema, rng: np.random.Generator) -> Any:
    """Return data that a schema allows; the model's cross-checks may still refuse them."""
    schema = resolve(schema, root)
    if "const" in schema:
        return schema["const"]
    if "enum" in schema:
        return schema["enum"][rng.integers(len(schema["enum"]))]
    members = schema.get("oneOf", schema.get("anyOf"))
    if members:
        return filled(members[rng.integers(len(members))], root, rng)
    match schema.get("type"):
        case "object":
            given = schema.get("properties", {})
            wanted = [k for k in given if k in schema.get("required", ()) or k == "kind" or rng.random() < 0.3]
            return {key: filled(given[key], root, rng) for key in wanted}
        case "array":
            first = schema.get("prefixItems", ())
            return [filled(s, root, rng) for s in first] or [filled(schema["items"], root, rng)]
        case "number" | "integer":
            low = max(schema.get("minimum", -10), schema.get("exclusiveMinimum", -10))
            high = min(schema.get("maximum", 10), schema.get("exclusiveMaximum", 10))
            value = low + (high - low) * rng.random()
            return math.ceil(value) if schema["type"] == "integer" else float(value)
        case "string":
            return "a name"
        case "boolean":
            return True
    return None


def other_value(place: Place, root: Schema, rng: np.random.Generator) -> Any:
    """Return another value for a place, mostly a wrong one, sometimes a valid one."""
    schema, value = resolve(place.schema, root), place.value
    wrong: list[Any] = [None, True, "text", 3, 0.5, [], {}, [[]], [1, 2, 3], {"kind": "frobs"}, {"a": 1}]
    draw = rng.random()
    if isinstance(value, str) and draw < 0.8:
        kept = schema.get("enum", [])
        return (misspelt(value, rng), value.upper(), TEXTS[rng.integers(len(TEXTS))], *kept)[
            int(rng.integers(3 + len(kept)))
        ]
    if isinstance(value, int | float) and not isinstance(value, bool) and draw < 0.85:
        near = bounds(schema, root)
        if near and rng.random() < 0.5:
            return near[rng.integers(len(near))]
        number = NUMBERS[rng.integers(len(NUMBERS))]
        return number if rng.random() < 0.7 else value * float(rng.choice([0.5, 2.0, 10.0, -1.0]))
    if isinstance(value, list) and draw < 0.8:
        longer = [
            value * 2,
            value * 400,
            value[:-1],
            value[:1],
            [],
            value + [None],
            value[::-1],
            [value],
            value + value[:1],
        ]
        return longer[rng.integers(len(longer))]
    if (isinstance(value, dict) or value is None) and draw < 0.6:
        return filled(schema, root, rng)
    return wrong[rng.integers(len(wrong))]


def changed(data: Any, path: Where, value: Any) -> Any:
    """Return a copy of the data with another value at a path."""
    if not path:
        return value
    data = copy.deepcopy(data)
    inner = data
    for part in path[:-1]:
        inner = inner[part]
    inner[path[-1]] = value
    return data


@cache
def schema_of(model: type[BaseModel]) -> Schema:
    """Return a model's JSON schema."""
    return model.model_json_schema()


def spoil(data: Any, model: type[BaseModel], rng: np.random.Generator) -> tuple[Any, list[Where]]:
    """Return valid data with one to three changes, and the paths of the changes (of an unknown key, the key's path)."""
    root = schema_of(model)
    touched: list[Where] = []
    for _ in range(int(rng.choice([1, 1, 1, 2, 3]))):
        there = [p for p in places(root, data, root) if not any(p.path[: len(t)] == t for t in touched)]
        if len(there) < 2:
            break
        fields = list(dict.fromkeys(p.path[0] for p in there[1:]))  # equally likely: most of a room is landmarks
        field = fields[rng.integers(len(fields))]
        inside = [p for p in there[1:] if p.path[0] == field]
        place = inside[rng.integers(len(inside))]
        if isinstance(place.value, dict) and rng.random() < 0.5:
            group, keys = dict(place.value), list(place.value)
            match int(rng.integers(3)) if keys else 2:
                case 0:
                    key = keys[rng.integers(len(keys))]
                    del group[key]
                case 1:
                    old = keys[rng.integers(len(keys))]
                    key = misspelt(old, rng)
                    group[key] = group.pop(old)
                case _:
                    key = KEYS[rng.integers(len(KEYS))]
                    group[key] = 1
            data, where = changed(data, place.path, group), (*place.path, key)
        else:
            data, where = changed(data, place.path, other_value(place, root, rng)), place.path
        touched.append(where)
    return data, touched


def as_yaml(data: Any, rng: np.random.Generator) -> str:
    """Return the data as YAML; in one case of five, a line is repeated, cut, shifted or changed, or the rest is cut."""
    text = yaml.dump(data, Dumper=getattr(yaml, "CSafeDumper", yaml.SafeDumper), allow_unicode=True, sort_keys=False)
    if rng.random() < 0.8:
        return text
    lines = text.splitlines(keepends=True)
    i = int(rng.integers(len(lines)))
    match int(rng.integers(6)):
        case 0:
            lines.insert(i, lines[i])
        case 1:
            del lines[i:]
        case 2:
            lines[i] = " " * int(rng.integers(4)) + lines[i]
        case 3:
            at = int(rng.integers(len(lines[i])))
            lines[i] = (
                lines[i][:at] + str(rng.choice(["\0", "\x1b", ":", "{", "]", "'", '"', "#", "&", "\t"])) + lines[i][at:]
            )
        case _:
            key = lines[i].partition(":")[0]
            lines[i] = f"{key}: {RAW[rng.integers(len(RAW))]}\n"
    return "".join(lines)


def as_settings(touched: list[Where], data: Any) -> list[str]:
    """Return changes as settings `key.key=value`."""
    found = []
    for path in touched:
        # A list is set as a whole.
        keys = path[: next((i for i, part in enumerate(path) if isinstance(part, int)), len(path))]
        value = data
        for part in keys:
            value = value.get(part) if isinstance(value, dict) else None
        text = (
            yaml.safe_dump(value, default_flow_style=True, width=10**9)
            if not isinstance(value, str)
            else json.dumps(value)
        )
        found.append(".".join(map(str, keys)) + "=" + text.removesuffix("\n...\n").removesuffix("\n"))
    return found
