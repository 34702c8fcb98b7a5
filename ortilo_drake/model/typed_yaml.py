"""Safe, strict YAML into frozen pydantic models, with one clear line for whatever is wrong."""

import copy
import json
import math
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

M = TypeVar("M", bound=BaseModel)

LARGEST = 1e12  # larger numbers are no quantity of a room in SI units, and their squares may overflow


class InputError(ValueError):
    """Bad input from a user: one line that names the file, the field, the value and what is allowed."""


class Frozen(BaseModel):
    """Base of every typed input: immutable, strict, no unknown keys, no inf or NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class _UniqueKeyLoader(yaml.SafeLoader):
    """A safe loader that refuses duplicate keys, and aliases, which can make a small file endless."""

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Return the next node (PyYAML's hook)."""
        if self.check_event(yaml.AliasEvent):
            raise InputError(f"line {self.peek_event().start_mark.line + 1}: aliases are not allowed")
        return super().compose_node(parent, index)


def _mapping_of_unique_keys(loader: yaml.SafeLoader, node: yaml.MappingNode) -> dict[Any, Any]:
    keys = [loader.construct_object(key, deep=True) for key, _ in node.value]
    for i, key in enumerate(keys):
        if not isinstance(key, str):
            raise InputError(f"line {node.start_mark.line + 1}: key {key!r} is not a name")
        if key in keys[:i]:
            raise InputError(f"line {node.value[i][0].start_mark.line + 1}: key '{key}' stands twice")
    return dict(loader.construct_pairs(node, deep=True))


_UniqueKeyLoader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping_of_unique_keys)


def parse_yaml(text: str, source: str) -> Any:
    """Return the plain data of a YAML text.

    Args:
        text: the YAML.
        source: what to call it in an error.

    Raises:
        InputError: if the text is not YAML, repeats a key or uses a tag that is not plain data.
    """
    try:
        return yaml.load(text, Loader=_UniqueKeyLoader)
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    except RecursionError:
        raise InputError(f"{source}: nested too deeply") from None
    except (yaml.YAMLError, ValueError) as error:
        raise InputError(f"{source}: not valid YAML: {' '.join(str(error).split())}") from None


def read_text(path: Path) -> str:
    """Return the text of a UTF-8 file.

    Raises:
        InputError: if the file cannot be read.
    """
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not UTF-8 text"
        raise InputError(f"{path}: cannot be read: {reason}") from None


def _kinds(model: type[BaseModel], data: Any, place: tuple[int | str, ...]) -> str:
    """Return the kinds allowed at a place of the data, by asking for one that no model has."""
    data = group = copy.deepcopy(data)
    for part in place:
        group = group[part]
    group["kind"] = ""
    try:
        model.model_validate_json(json.dumps(data))
    except ValidationError as error:
        problem = next((p for p in error.errors() if p["loc"] == place and "expected_tags" in p.get("ctx", {})), None)
        return str(problem["ctx"]["expected_tags"]) if problem else "none"
    return "none"


def _first_problem(error: ValidationError, model: type[BaseModel], data: Any) -> str:
    problems = error.errors()
    # A misspelt key explains more than the errors that follow from it.
    problem = next((p for p in problems if p["type"] == "extra_forbidden"), problems[0])
    field = ".".join(str(part) for part in problem["loc"]) or "the file"
    value = problem["input"]
    shown = repr(value) if not isinstance(value, dict | list) or len(repr(value)) <= 60 else type(value).__name__
    match problem["type"]:
        case "extra_forbidden":
            return f"{field}: unknown key (value {shown})"
        case "missing":
            return f"{field}: is missing"
        case "value_error":
            text = str(problem["ctx"]["error"])
            return f"{field}{text}" if text.startswith(".") else f"{field}: {text}"
        case "union_tag_invalid":
            allowed = problem["ctx"]["expected_tags"]
            return f"{field}.kind: {problem['ctx']['tag']!r} is not one of {allowed}"
        case "union_tag_not_found":
            return f"{field}: needs a 'kind', one of {_kinds(model, data, problem['loc'])}"
    message = problem["msg"][:1].lower() + problem["msg"][1:]
    return f"{field}: {shown}: {message}"


def _find_not_plain(data: Any, field: str = "") -> str | None:
    if isinstance(data, float) and not math.isfinite(data):
        return f"{field}: {data}: must be a finite number"
    if isinstance(data, float) and abs(data) > LARGEST:
        return f"{field}: {data}: must not exceed {LARGEST:g} in size"
    if not isinstance(data, None | bool | int | float | str | list | tuple | dict):
        return f"{field}: {data}: must be a number (integer or not), text, list or group, not a {type(data).__name__}"
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list | tuple) else ()
    found = (_find_not_plain(value, f"{field}.{key}" if field else str(key)) for key, value in items)
    return next((problem for problem in found if problem), None)


def validate(model: type[M], data: Any, source: str) -> M:
    """Return plain data as a typed model.

    Args:
        model: the pydantic model.
        data: what parse_yaml returned.
        source: what to call the data in an error.

    Raises:
        InputError: naming source, field, value and what is allowed.
    """
    problem = _find_not_plain(data)
    if problem:
        raise InputError(f"{source}: {problem}")
    try:
        # Through JSON, pydantic's strict mode takes YAML's lists for tuples and still refuses '1' for 1.
        return model.model_validate_json(json.dumps({} if data is None else data))
    except ValidationError as error:
        raise InputError(f"{source}: {_first_problem(error, model, data)}") from None


def load_yaml(model: type[M], path: Path) -> M:
    """Read a YAML file into a typed model; InputError if anything is wrong."""
    return validate(model, parse_yaml(read_text(path), str(path)), str(path))
