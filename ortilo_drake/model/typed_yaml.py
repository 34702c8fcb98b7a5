"""Safe, strict reading of YAML into frozen pydantic models, with one clear line for each error."""

import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import yaml
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.input_files import read_text
from ortilo_drake.model.inputs.nearest_key import nearest as nearest
from ortilo_drake.model.inputs.problems import SHOWN, Place, emptied, first_problem, problem_lines, shown, without

M = TypeVar("M", bound=BaseModel)
V = TypeVar("V")

LARGEST = 1e12  # no quantity of a room in SI units is larger, and the square of a larger number may overflow
DEEPEST = 32  # deepest nesting of groups; our own files have five levels
SMALLEST = 1e-12  # smallest positive number: the square of a smaller one may underflow, and we divide by it


def _not_tiny(value: float) -> float:
    if value < SMALLEST:
        raise ValueError(f"{value}: must be at least {SMALLEST:g}")
    return value


Positive = Annotated[float, Field(gt=0.0), AfterValidator(_not_tiny)]
FileName = Annotated[str, Field(min_length=1, max_length=1024, pattern=r"^[^\x00]*$")]

_Loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # libyaml's is eight times as fast, and nearly always there


def as_pairs(mapping: dict[str, V]) -> tuple[tuple[str, V], ...]:
    """Return a mapping as pairs sorted by name, which can be hashed; dict(pairs) gives the mapping again."""
    return tuple(sorted(mapping.items(), key=lambda item: item[0]))


class Frozen(BaseModel):
    """Base of every typed input: immutable, strict, no unknown keys, no inf or NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    if not TYPE_CHECKING:  # type checkers use pydantic's own __init__

        def __init__(self, /, **data):
            """Make the model from its fields; InputError naming the field, its value and the allowed values."""
            try:
                super().__init__(**data)
            except ValidationError as error:
                raise InputError(f"{type(self).__name__}: {first_problem(error, type(self))}") from None

        __init__.__pydantic_base_init__ = True  # pydantic does not call it for groups within a model


def _line(part: Any) -> str:
    """Return 'line N' of a node or event; the types of libyaml and PyYAML have no common base class."""
    return f"line {part.start_mark.line + 1}"


class _UniqueKeyLoader(_Loader):  # type: ignore[misc, valid-type]  # one of two classes
    """A safe loader that refuses duplicate keys."""


def _mapping_of_unique_keys(loader: yaml.SafeLoader, node: yaml.MappingNode) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key_node, value_node in node.value:
        key = loader.construct_object(key_node, deep=True)
        if not isinstance(key, str):
            raise InputError(f"{_line(node)}: key {shown(key)} is not a name")
        if key in found:
            raise InputError(f"{_line(key_node)}: key '{key}' stands twice")
        found[key] = loader.construct_object(value_node, deep=True)
    return found


def _number(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> int | float:
    """Return a number; InputError if YAML reads it differently from a person: 010 is 8, 1:30 is 90."""
    construct = loader.construct_yaml_int if node.tag.endswith("int") else loader.construct_yaml_float
    value, text = construct(node), node.value.lstrip("+-")
    if ":" in text or (text[:1] == "0" and text.isdigit() and value):
        raise InputError(f"{_line(node)}: {node.value} is {value} to YAML: write the number without leading 0 or :")
    return value


_UniqueKeyLoader.add_constructor("tag:yaml.org,2002:int", _number)
_UniqueKeyLoader.add_constructor("tag:yaml.org,2002:float", _number)
_UniqueKeyLoader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping_of_unique_keys)


def _refuse_bombs(text: str) -> None:
    """Raise InputError for aliases, with which a small file may expand without end, and for too deep nesting."""
    depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        if isinstance(event, yaml.AliasEvent):
            raise InputError(f"{_line(event)}: aliases are not allowed (*{event.anchor}): write the values out")
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > DEEPEST:
            raise InputError(f"{_line(event)}: nested more than {DEEPEST} deep")


Names = Callable[[yaml.Node], Iterable[yaml.Node]]  # returns the scalars of a document that are names


def parse_yaml(text: str, source: str, names: Names | None = None) -> Any:
    """Return the plain data of a YAML text.

    The scalars that `names` returns stay text as written, also if YAML would read a number or a boolean, as in 0715,
    1516 or no. InputError, which begins with the source, if the text is not YAML, repeats a key, has aliases, is nested
    too deeply or uses a tag that is not plain data.
    """
    try:
        _refuse_bombs(text)
        loader = _UniqueKeyLoader(text)
        try:
            document = loader.get_single_node()
            for scalar in () if names is None or document is None else names(document):
                scalar.tag = yaml.resolver.BaseResolver.DEFAULT_SCALAR_TAG
            return None if document is None else loader.construct_document(document)
        finally:
            loader.dispose()
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    except (yaml.YAMLError, ValueError) as error:
        raise InputError(f"{source}: not valid YAML: {_what_and_where(error, text)}") from None


def _what_and_where(error: Exception, text: str) -> str:
    """Return a YAML error as text: its place and the problem, without the parser's name of the text."""
    mark, problem = getattr(error, "problem_mark", None), getattr(error, "problem", None)
    if mark is None or not problem:
        return " ".join(str(error).split())
    line = text.split("\n")[mark.line] if mark.line < text.count("\n") + 1 else ""
    if line[mark.column : mark.column + 1] == "\t":
        problem = "a tab, but YAML indents by spaces"
    return f"line {mark.line + 1}, column {mark.column + 1}: {' '.join(problem.split())}"


def _not_plain(data: Any, place: Place = ()) -> Iterator[tuple[Place, str]]:
    """Yield place and error line of each value that no model could hold, whatever its fields are."""
    field, largest = ".".join(map(str, place)), LARGEST
    if isinstance(data, int) and "seed" in field:
        largest = 2**64  # only seeds may be larger; an integer may stand for a float
    if isinstance(data, float) and not math.isfinite(data):
        yield place, f"{field}: {data}: must be a finite number"
    elif isinstance(data, int | float) and abs(data) > largest:
        yield place, f"{field}: {shown(data)}: must not exceed {largest:g} in size"
    elif isinstance(data, str) and not _is_unicode(data):
        yield place, f"{field}: {shown(data)}: half a character, must be Unicode text"
    elif not isinstance(data, None | bool | int | float | str | list | tuple | dict):
        allowed = f"must be a number (integer or not), text, list or group, not a {type(data).__name__}"
        yield place, f"{field}: {str(data)[:SHOWN]}: {allowed}"
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list | tuple) else ()
    for key, value in items:
        inner = (*place, key)
        yield from _not_plain(value, inner)
        if not _is_unicode(str(key)):
            yield inner, f"{'.'.join(map(str, inner))}: half a character, must be Unicode text"


def _is_unicode(text: str) -> bool:
    """Return whether a text has no lone surrogates, which YAML accepts but no file can hold."""
    return text.isascii() or not any("\ud800" <= c <= "\udfff" for c in text)


def validate(model: type[M], data: Any, source: str) -> M:
    """Return plain data as a typed model; InputError names source, field, value and the allowed values.

    If the pydantic model has a classmethod model_for, this method chooses the model for the data.
    """
    for _, problem in _not_plain(data):
        raise InputError(f"{source}: {problem}")
    model = getattr(model, "model_for", lambda _: model)(data)
    try:
        # From JSON, pydantic's strict mode accepts YAML's lists as tuples, and still refuses '1' for 1.
        return model.model_validate_json(json.dumps({} if data is None else data))
    except ValidationError as error:
        raise InputError(f"{source}: {first_problem(error, model)}") from None


def all_problems(model: type[BaseModel], data: Any, stand_in: Mapping[str, Any]) -> list[str]:
    """Return a line for each problem in plain data of a model; an empty list if the data is valid.

    A model checks its fields together only if each field is valid. So wrong fields are left out and the rest is
    checked, with the valid values of `stand_in` for fields that the model needs. A field reported before is not
    reported again, because its second problem may follow from the first.
    """
    if not isinstance(data, dict):
        return [f"the file: {shown(data)}: must hold fields by name, not {type(data).__name__}"]
    found = list(_not_plain(data))
    data = emptied(data, (place for place, _ in found))
    while True:
        try:
            model.model_validate_json(json.dumps(data))
            return [line for _, line in found]
        except ValidationError as error:
            places, told = {place for place, _ in found}, {_name(*problem) for problem in found}
            new = [
                (place, line)
                for place, line in problem_lines(error, model)
                if place not in places and (place or _name(place, line) not in told)
            ]
        found += new
        left = without(data, (place for place, _ in found), stand_in)
        if not new or left == data:
            return [line for _, line in found]
        data = left


def _name(place: Place, line: str) -> str:
    """Return the top-level field of a problem; the line of a problem across fields begins with the field."""
    return str(place[0]) if place else re.split("[.:]", line)[0]


def load_yaml(model: type[M], path: Path) -> M:
    """Return the typed model of a YAML file; InputError if anything is wrong."""
    return validate(model, parse_yaml(read_text(path), str(path)), str(path))
