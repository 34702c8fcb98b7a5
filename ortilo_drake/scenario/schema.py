"""The settings of a scenario as a JSON schema and as a table, with the meaning of each setting."""

import ast
import inspect
import json
import re
import sys
from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from typing import Any, Final, Literal, NamedTuple, get_args, get_origin

from pydantic import BaseModel

from ortilo_drake.scenario.own_parts import model_of_all
from ortilo_drake.scenario.scenario import Scenario

_UNIT: Final = re.compile(r"\[(1|(?:1/)?[A-Za-z(][A-Za-z0-9 ^/()]*)\]")
_SECTION: Final = "\nAttributes:\n"


class Key(NamedTuple):
    """One setting: its dotted key as `--set` takes it ('[]' marks the entries of a list), and its meaning.

    `kind` is the kind of the groups that have the setting, '' if all have it. `allowed` is the type and range. `unit`
    is '' for a setting without one. `default` is the default in YAML, 'needed' if there is none.
    """

    key: str
    kind: str
    allowed: str
    unit: str
    default: str
    meaning: str


def meanings(model: type[BaseModel]) -> dict[str, str]:
    """Return the description of each field as one line: the model's own, or the inherited one.

    The description stands below the field, or under Attributes in the docstring; a `kind` of one value needs none.
    """
    found: dict[str, str] = {}
    for its in model.__mro__[model.__mro__.index(BaseModel) - 1 :: -1]:
        _, _, section = inspect.cleandoc(its.__doc__ or "").partition(_SECTION)
        entries = re.split(r"^    (?=\w+: )", section, flags=re.MULTILINE)[1:]
        found |= {name: " ".join(text.split()) for name, _, text in (entry.partition(": ") for entry in entries)}
        found |= _below_fields(its)
    kind = model.model_fields.get("kind")
    if kind and "kind" not in found and get_origin(kind.annotation) is Literal and len(get_args(kind.annotation)) == 1:
        found["kind"] = f"{get_args(kind.annotation)[0]!r}."
    return {name: found.pop(name) for name in model.model_fields if name in found} | found


def _below_fields(model: type[BaseModel]) -> dict[str, str]:
    """Return the text that stands below each field of a class."""
    written = _classes_in(model.__module__).get(model.__name__)
    return {
        field.target.id: " ".join(text.value.value.split())
        for field, text in pairwise(written.body if written else ())
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant) and isinstance(text.value.value, str)
    }


@cache
def _classes_in(module: str) -> dict[str, ast.ClassDef]:
    """Return the classes in a module's source by name, the outermost of equal names; none if there is no source."""
    try:
        nodes = list(ast.walk(ast.parse(inspect.getsource(sys.modules[module]))))
    except (OSError, TypeError, KeyError):
        return {}
    return {node.name: node for node in reversed(nodes) if isinstance(node, ast.ClassDef)}


def models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models in an annotation and, recursively, in the models' fields; a model may come more than once."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
        for field in annotation.model_fields.values():
            yield from models_in(field.annotation)
    for part in get_args(annotation):
        yield from models_in(part)


def scenario_schema() -> dict[str, Any]:
    """Return the JSON schema of a scenario, with the meaning of each setting and the docstring of each group.

    The schema includes the settings of registered parts.
    """
    model = model_of_all(Scenario)
    schema = model.model_json_schema()
    groups = {**schema["$defs"], model.__name__: schema}
    for its in models_in(model):
        # pydantic's name where two models have the same name:
        in_full = re.sub(r"[^A-Za-z0-9_.-]", "_", f"{its.__module__}.{its.__qualname__}").replace(".", "__")
        group, described = groups[its.__name__ if its.__name__ in groups else in_full], meanings(its)
        group["description"] = (inspect.getdoc(its) or "").partition(_SECTION)[0].strip()
        for name, field in group["properties"].items():
            field.pop("title", None)
            if name in described:
                field["description"] = described[name]
    # A file may name its base, see load.py.
    base = {"type": "string", "description": "a ready-made scenario's name or a .yaml file that this one is laid over"}
    return schema | {"properties": {"base": base} | schema["properties"]}


def scenario_keys(prefix: str = "") -> list[Key]:
    """Return in order all settings of all kinds whose key is the prefix, or begins with the prefix and a dot."""
    schema = scenario_schema()
    del schema["properties"]["base"]
    found = _keys(schema, schema, "", model_of_all(Scenario)().model_dump(mode="json"))
    return [key for key in found if not prefix or f"{key.key}.".replace("[]", "").startswith(f"{prefix}.")]


def _keys(schema: dict[str, Any], group: dict[str, Any], above: str, defaults: Any, kind: str = "") -> Iterator[Key]:
    for name, field in group["properties"].items():
        if name == "kind" and kind:
            continue  # the key of the union lists all kinds
        key, meaning = f"{above}{name}", field.get("description", "")
        default = defaults[name] if isinstance(defaults, dict) and name in defaults else field.get("default")
        shown = default if isinstance(default, str) else json.dumps(default)
        shown = "needed" if name in group.get("required", ()) else shown
        outer, choices = _group_in(field)
        suffix = "[]." if outer is not choices else "."
        groups = [_resolved(schema, part) for part in choices.get("oneOf", [choices])]
        empty = " or null" if {"type": "null"} in field.get("anyOf", ()) else ""
        if "properties" not in groups[0]:
            units = dict.fromkeys(_UNIT.findall(meaning))
            yield Key(key, kind, _allowed(schema, field), ", ".join(units), shown, meaning)
            continue
        if suffix == "[]." or empty:
            yield Key(key, kind, f"{'list of groups' if suffix == '[].' else 'group'}{empty}", "", shown, meaning)
        if len(groups) == 1:
            yield from _keys(schema, groups[0], key + suffix, default, kind)
            continue
        kinds = [part["properties"]["kind"]["const"] for part in groups]
        chosen = default.get("kind") if isinstance(default, dict) else None
        yield Key(f"{key}{suffix}kind", kind, " | ".join(kinds), "", chosen or "needed", meaning)
        for its, part in zip(kinds, groups, strict=True):
            yield from _keys(schema, part, key + suffix, default if its == chosen else None, its)


def _group_in(field: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the part of a field's schema that holds groups or a list, and the part with the choices of groups."""
    parts = field.get("anyOf", [field])
    outer = next((part for part in parts if not part.keys().isdisjoint({"oneOf", "$ref", "items"})), field)
    inner = outer.get("items", outer)
    return outer, next((part for part in inner.get("anyOf", ()) if "oneOf" in part), inner)


def _resolved(schema: dict[str, Any], part: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = schema["$defs"][part["$ref"].rpartition("/")[2]] if "$ref" in part else part
    return found


def _allowed(schema: dict[str, Any], field: dict[str, Any]) -> str:
    """Return the type of a field and its range in words."""
    if "anyOf" in field:
        return " or ".join(_allowed(schema, part) for part in field["anyOf"])
    if "enum" in field or "const" in field:
        return " | ".join(map(str, field.get("enum", [field.get("const")])))
    kind = field.get("type", "")
    if kind == "array":
        entries = field.get("prefixItems") or [field["items"]]
        inner = ", ".join(dict.fromkeys(_allowed(schema, entry) for entry in entries))
        return f"{len(entries)} x {inner}" if "prefixItems" in field else f"list of {inner}"
    if kind == "object":
        return f"mapping to {_allowed(schema, field['additionalProperties'])}"
    signs = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}
    limits = [f"{sign} {field[name]:g}" for name, sign in signs.items() if name in field]
    return f"{ ({'string': 'text'}.get(kind, kind)) } {', '.join(limits)}".strip()
