"""Safe, strict YAML into frozen pydantic models, with one clear line for whatever is wrong."""

import json
import math
from collections.abc import Iterable
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import Annotated, Any, TypeVar

import yaml
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.input_files import read_text

__all__ = [
    "DEEPEST",
    "LARGEST",
    "SMALLEST",
    "FileName",
    "Frozen",
    "InputError",
    "Positive",
    "load_yaml",
    "nearest",
    "parse_yaml",
    "validate",
]

M = TypeVar("M", bound=BaseModel)

LARGEST = 1e12  # larger numbers are no quantity of a room in SI units, and their squares may overflow
DEEPEST = 32  # groups within groups; ours go to five
SMALLEST = 1e-12  # of what must be positive: the square of a smaller number, by which we divide, may underflow


def _not_tiny(value: float) -> float:
    if value < SMALLEST:
        raise ValueError(f"{value}: must be at least {SMALLEST:g}")
    return value


Positive = Annotated[float, Field(gt=0.0), AfterValidator(_not_tiny)]
FileName = Annotated[str, Field(min_length=1, max_length=1024, pattern=r"^[^\x00]*$")]
_SHOWN = 60  # characters of a value in an error

_Loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # libyaml's is eight times as fast, and nearly always there


class Frozen(BaseModel):
    """Base of every typed input: immutable, strict, no unknown keys, no inf or NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


def _line(part: Any) -> str:
    """Return 'line N' of a node or event; libyaml's and PyYAML's own have no common type."""
    return f"line {part.start_mark.line + 1}"


class _UniqueKeyLoader(_Loader):  # type: ignore[misc, valid-type]  # one of two classes
    """A safe loader that refuses duplicate keys."""


def _mapping_of_unique_keys(loader: yaml.SafeLoader, node: yaml.MappingNode) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key_node, value_node in node.value:
        key = loader.construct_object(key_node, deep=True)
        if not isinstance(key, str):
            raise InputError(f"{_line(node)}: key {_shown(key)} is not a name")
        if key in found:
            raise InputError(f"{_line(key_node)}: key '{key}' stands twice")
        found[key] = loader.construct_object(value_node, deep=True)
    return found


_UniqueKeyLoader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping_of_unique_keys)


def _refuse_bombs(text: str) -> None:
    """Refuse aliases, which can make a small file endless, and groups nested so deeply that a parser gives up."""
    depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        if isinstance(event, yaml.AliasEvent):
            raise InputError(f"{_line(event)}: aliases are not allowed")
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > DEEPEST:
            raise InputError(f"{_line(event)}: nested more than {DEEPEST} deep")


def parse_yaml(text: str, source: str) -> Any:
    """Return the plain data of a YAML text.

    Args:
        text: the YAML.
        source: what to call it in an error.

    Raises:
        InputError: if the text is not YAML, repeats a key, has aliases, is nested too deeply or uses a tag that is
            not plain data.
    """
    try:
        _refuse_bombs(text)
        return yaml.load(text, Loader=_UniqueKeyLoader)
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    except (yaml.YAMLError, ValueError) as error:
        raise InputError(f"{source}: not valid YAML: {' '.join(str(error).split())}") from None


def nearest(word: str, known: Iterable[str]) -> str:
    """Return ", did you mean 'x'?" for the known word nearest to one that is unknown, or nothing if none is near."""
    by_lower = {name.lower(): name for name in known}
    found = get_close_matches(word.lower(), by_lower, n=1)
    return f", did you mean '{by_lower[found[0]]}'?" if found else ""


def _place(schema: dict[str, Any], loc: tuple[int | str, ...]) -> tuple[str, dict[str, Any]]:
    """Return the field that pydantic's loc names, without the kinds of unions in it, and the schema of that place."""
    names = schema.get("$defs", {})

    def resolved(part: dict[str, Any]) -> dict[str, Any]:
        if "$ref" in part:
            return resolved(names[part["$ref"].rpartition("/")[2]])
        groups = [resolved(m) for m in part.get("anyOf", ()) if m.get("type") != "null"]
        return groups[0] if groups else part

    here, field = resolved(schema), []
    for step in loc:
        kinds = here.get("discriminator", {}).get("mapping", {})
        if step in kinds:
            here = resolved({"$ref": kinds[step]})
            continue
        field.append(str(step))
        first = here.get("prefixItems", [])
        if isinstance(step, int):
            inner = first[step] if step < len(first) else here.get("items")
        else:
            inner = here.get("properties", {}).get(step, here.get("additionalProperties"))
        here = resolved(inner) if isinstance(inner, dict) else {}
    return ".".join(field), here


def _shown(value: Any) -> str:
    """Return a value as an error shows it: a long one by its beginning, a large group by its type."""
    if isinstance(value, int) and value.bit_length() > 200:
        return f"an integer of {value.bit_length()} bits"
    text = repr(value)
    if len(text) <= _SHOWN:
        return text
    return type(value).__name__ if isinstance(value, dict | list) else f"{text[:_SHOWN]}..."


@cache
def _schema(model: type[BaseModel]) -> dict[str, Any]:
    return model.model_json_schema()


def _first_problem(error: ValidationError, model: type[BaseModel]) -> str:
    problems = error.errors()
    # A misspelt key explains more than the errors that follow from it.
    problem = next((p for p in problems if p["type"] == "extra_forbidden"), problems[0])
    loc, schema = problem["loc"], _schema(model)
    field, here = _place(schema, loc)
    shown = _shown(problem["input"])
    match problem["type"]:
        case "extra_forbidden":
            known = _place(schema, loc[:-1])[1].get("properties", {})
            hint = nearest(str(loc[-1]), known) or f", known are {', '.join(known)}"
            return f"{field}: unknown key (value {shown}){hint}"
        case "missing":
            return f"{field}: is missing"
        case "value_error":
            text = str(problem["ctx"]["error"])
            return f"{field}{text}" if text.startswith(".") or not field else f"{field}: {text}"
        case "union_tag_invalid":
            tag, kinds = problem["ctx"]["tag"], here.get("discriminator", {}).get("mapping", {})
            return f"{field}.kind: {_shown(tag)} is not one of {', '.join(map(repr, kinds))}{nearest(tag, kinds)}"
        case "union_tag_not_found":
            kinds = here.get("discriminator", {}).get("mapping", {})
            return f"{field}: needs a 'kind', one of {', '.join(map(repr, kinds))}"
        case "literal_error":
            known = [str(word) for word in here.get("enum", [here.get("const")])]
            return (
                f"{field}: {shown} is not one of {', '.join(map(repr, known))}{nearest(str(problem['input']), known)}"
            )
        case "float_type" | "int_type" if _is_number(problem["input"]):
            return f"{field}: {shown}: is text to YAML; a number has a point and a signed exponent, as 1.0e-3"
    message = problem["msg"][:1].lower() + problem["msg"][1:]
    return f"{field or 'the file'}: {shown}: {message}"


def _is_number(text: Any) -> bool:
    try:
        return isinstance(text, str) and "e" in text.lower() and math.isfinite(float(text))
    except ValueError:
        return False


def _find_not_plain(data: Any, field: str = "") -> str | None:
    if isinstance(data, float) and not math.isfinite(data):
        return f"{field}: {data}: must be a finite number"
    # Seeds alone are larger; an integer may be for a float.
    largest = 2**64 if isinstance(data, int) and "seed" in field else LARGEST
    if isinstance(data, int | float) and abs(data) > largest:
        return f"{field}: {_shown(data)}: must not exceed {largest:g} in size"
    if isinstance(data, str):
        return None if _is_unicode(data) else f"{field}: {_shown(data)}: half a character, must be Unicode text"
    if not isinstance(data, None | bool | int | float | list | tuple | dict):
        name = type(data).__name__
        return f"{field}: {str(data)[:_SHOWN]}: must be a number (integer or not), text, list or group, not a {name}"
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list | tuple) else ()
    for key, value in items:
        name = f"{field}.{key}" if field else str(key)
        problem = _find_not_plain(value, name)
        if problem or not _is_unicode(str(key)):
            return problem or f"{name}: half a character, must be Unicode text"
    return None


def _is_unicode(text: str) -> bool:
    """Return whether a text has no lone surrogates, which YAML lets through and no file can hold."""
    return text.isascii() or not any("\ud800" <= c <= "\udfff" for c in text)


def validate(model: type[M], data: Any, source: str) -> M:
    """Return plain data as a typed model.

    Args:
        model: the pydantic model; its classmethod model_for, where it has one, says which model the data is of.
        data: what parse_yaml returned.
        source: what to call the data in an error.

    Raises:
        InputError: naming source, field, value and what is allowed.
    """
    problem = _find_not_plain(data)
    if problem:
        raise InputError(f"{source}: {problem}")
    model = getattr(model, "model_for", lambda _: model)(data)
    try:
        # Through JSON, pydantic's strict mode takes YAML's lists for tuples and still refuses '1' for 1.
        return model.model_validate_json(json.dumps({} if data is None else data))
    except ValidationError as error:
        raise InputError(f"{source}: {_first_problem(error, model)}") from None


def load_yaml(model: type[M], path: Path) -> M:
    """Read a YAML file into a typed model; InputError if anything is wrong."""
    return validate(model, parse_yaml(read_text(path), str(path)), str(path))
