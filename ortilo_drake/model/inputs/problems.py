"""Problems in a user's data, one line each: field, value, allowed values."""

import math
import re
from collections.abc import Iterable, Mapping
from copy import deepcopy
from functools import cache
from itertools import zip_longest
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from ortilo_drake.model.inputs.nearest_key import Known, did_you_mean, keys_of, nearest, words_of

KEYS = 6  # number of a group's keys in the error for a value in place of the group
SHOWN = 60  # number of a value's characters in an error
_PLAIN = {  # pydantic's words and our replacements
    "a valid integer": "an integer",
    "a valid number": "a number",
    "a valid boolean": "true or false",
    "a valid string": "text",
    "a valid array": "a list",
    "an object": "a group of settings",
    "greater than or equal to": "at least",
    "less than or equal to": "at most",
    "greater than": "above",
    "less than": "below",
    ", unable to parse string as an integer": "",
    ", unable to parse string as a number": "",
    ", got a number with a fractional part": "",
    " after validation": "",
    ", unable to interpret input": "",
}
TAGS = ("plain", "group")  # tags of the two forms of a field that may be one value or a group of values
Place = tuple[int | str, ...]  # the path of keys and indices to a field, as pydantic gives it


class SeveralProblems(ValueError):
    """Problems that a model's own check found: lines that begin with the field; the error's text is the first line."""

    def __init__(self, lines: list[str]) -> None:
        super().__init__(lines[0])
        self.lines = lines


def _place(schema: dict[str, Any], loc: Place) -> tuple[str, dict[str, Any]]:
    """Return the dotted field that pydantic's loc names, without the kinds of unions, and the schema of the field.

    If the loc ends with one of several forms of a value, the schema returned holds all of them as "forms".
    """
    names = schema.get("$defs", {})

    def resolved(part: dict[str, Any]) -> dict[str, Any]:
        if "$ref" in part:
            return resolved(names[part["$ref"].rpartition("/")[2]])
        forms = [resolved(m) for m in part.get("anyOf", ()) if m.get("type") != "null"]
        return forms[0] if len(forms) == 1 else {"of": forms} if forms else part

    here, field = resolved(schema), []
    for step, after in zip_longest(loc, loc[1:]):
        if forms := here.get("of"):
            here = next((form for form in forms if _leads_on(form, step)), {})
            if not here:  # the step is pydantic's name of a form; the next step shows which one
                kind = {int: "array", str: "object"}.get(type(after))
                here = {"forms": forms} if kind is None else next((f for f in forms if f.get("type") == kind), {})
                continue
        kinds = here.get("discriminator", {}).get("mapping", {})
        if step in kinds:
            here = resolved({"$ref": kinds[step]})
            continue
        if step in TAGS and "oneOf" in here:
            here = next(form for form in map(resolved, here["oneOf"]) if ("properties" in form) == (step == TAGS[1]))
            continue
        field.append(str(step))
        first = here.get("prefixItems", [])
        if isinstance(step, int):
            inner = first[step] if step < len(first) else here.get("items")
        else:
            any_key = next(iter(here.get("patternProperties", {}).values()), here.get("additionalProperties"))
            inner = here.get("properties", {}).get(step, any_key)
        here = resolved(inner) if isinstance(inner, dict) else {}
    return ".".join(field), here["of"][0] if "of" in here else here


def _leads_on(form: dict[str, Any], step: int | str) -> bool:
    """Return whether a form of a value has the part `step`."""
    if isinstance(step, int):
        return form.get("type") == "array"
    return step in form.get("properties", {}) or step in form.get("discriminator", {}).get("mapping", {})


def _either(forms: list[dict[str, Any]]) -> str:
    """Return the allowed forms of a value as text, for example `text or an integer from 1 to 9`."""
    words = list(dict.fromkeys(map(_form, forms)))
    return ", ".join(words[:-1]) + (" or " if words[1:] else "") + words[-1]


def _form(form: dict[str, Any]) -> str:
    if "of" in form:
        return _either(form["of"])
    if "enum" in form or "const" in form:
        return " or ".join(map(repr, form.get("enum", [form.get("const")])))
    if "prefixItems" in form:
        return f"a list of {len(form['prefixItems'])}"
    word = {"string": "text", "integer": "an integer", "number": "a number", "boolean": "true or false"}.get(
        form.get("type", ""), "a list" if form.get("type") == "array" else "a group of settings"
    )
    if "minimum" in form and "maximum" in form:
        return f"{word} from {form['minimum']:g} to {form['maximum']:g}"
    return word + (" that is not empty" if form.get("minLength") else "")


def plainly(message: str) -> str:
    """Return a message of pydantic in our words, which say what the input must be."""
    message = message.removeprefix("Value error, ")
    message = re.sub("^(Input|String|List|Tuple|Dictionary|Value) should ", "must ", message)
    message = message[:1].lower() + message[1:]
    for said, plain in _PLAIN.items():
        message = message.replace(said, plain)
    return message


def shown(value: Any) -> str:
    """Return a value as text for an error: only the beginning of a long value, only the type of a large group."""
    if isinstance(value, int) and value.bit_length() > 200:
        return f"an integer of {value.bit_length()} bits"
    text = repr(value)
    if len(text) <= SHOWN:
        return text
    return type(value).__name__ if isinstance(value, dict | list) else f"{text[:SHOWN]}..."


@cache
def _schema(model: type[BaseModel]) -> dict[str, Any]:
    return model.model_json_schema()


@cache
def _keys(model: type[BaseModel]) -> frozenset[Known]:
    """Return the keys of a model, or of its `model_of_all`, if it has one, with all groups that it may hold."""
    return keys_of(getattr(model, "model_of_all", lambda: model)().model_json_schema())


def first_problem(error: ValidationError, model: type[BaseModel]) -> str:
    """Return the line of the problem that explains most of pydantic's errors."""
    problems = error.errors()
    # A misspelt key explains the errors that follow from it. For a value that may have several forms, a problem within
    # the form that the value has explains most.
    problem = next((p for p in problems if p["type"] == "extra_forbidden"), problems[0])
    if "forms" in _place(_schema(model), problem["loc"])[1]:
        whole = problem["loc"][:-1]
        within = (p for p in problems if p["loc"][: len(whole)] == whole and len(p["loc"]) > len(whole) + 1)
        problem = next(within, problem)
    return _lines(problem, model)[0]


def _lines(problem: ErrorDetails, model: type[BaseModel]) -> list[str]:
    several = problem.get("ctx", {}).get("error")
    if isinstance(several, SeveralProblems):
        return several.lines
    return [_line(problem, model)]


def _line(problem: ErrorDetails, model: type[BaseModel]) -> str:
    loc, schema = tuple(step for step in problem["loc"] if step != "[key]"), _schema(model)  # "[key]" marks a wrong key
    field, here = _place(schema, loc)
    value = shown(problem["input"])
    if "forms" in here and problem["type"] != "value_error":
        return f"{field}: {value}: must be {_either(here['forms'])}"
    match problem["type"]:
        case "extra_forbidden":
            whole = _place(schema, loc[:-1])[1]
            siblings = dict.fromkeys(key for form in whole.get("forms", [whole]) for key in form.get("properties", {}))
            group, words = tuple(field.split(".")[:-1]), words_of(str(loc[-1]), problem["input"])
            hint = did_you_mean(_keys(model), group, words, siblings)
            hint = hint or f", known are {', '.join(siblings)}"
            return f"{field}: unknown key (value {value}){hint}"
        case "missing":
            return f"{field}: is missing"
        case "value_error":
            text = str(problem["ctx"]["error"])
            return f"{field}{text}" if text.startswith(".") or not field else f"{field}: {text}"
        case "union_tag_invalid":
            tag, kinds = problem["ctx"]["tag"], here.get("discriminator", {}).get("mapping", {})
            return f"{field}.kind: {shown(tag)} is not one of {', '.join(map(repr, kinds))}{nearest(tag, kinds)}"
        case "union_tag_not_found":
            kinds = here.get("discriminator", {}).get("mapping", {})
            return f"{field}: needs a 'kind', one of {', '.join(map(repr, kinds))}"
        case "literal_error":
            known = [str(word) for word in here.get("enum", [here.get("const")])]
            return (
                f"{field}: {value} is not one of {', '.join(map(repr, known))}{nearest(str(problem['input']), known)}"
            )
        case "float_type" | "int_type" if _is_number(problem["input"]):
            return f"{field}: {value}: is text to YAML; a number has a point and a signed exponent, as 1.0e-3"
    return f"{field or 'the file'}: {value}: {plainly(problem['msg'])}{_of_group(here, problem['msg'])}"


def _of_group(here: dict[str, Any], message: str) -> str:
    """Return the kinds or the first keys of a group, for the error of a value in place of the group."""
    if "an object" not in message:
        return ""
    kinds, keys = here.get("discriminator", {}).get("mapping", {}), list(here.get("properties", {}))
    if kinds:
        return f", its kind one of {', '.join(kinds)}"
    return f": {{{', '.join(f'{key}: ' for key in keys[:KEYS])}{', ...' if len(keys) > KEYS else ''}}}" if keys else ""


def _is_number(text: Any) -> bool:
    try:
        return isinstance(text, str) and "e" in text.lower() and math.isfinite(float(text))
    except ValueError:
        return False


def problem_lines(error: ValidationError, model: type[BaseModel]) -> list[tuple[Place, str]]:
    """Return the place and a line of text for each of pydantic's errors, in pydantic's order."""
    return [(problem["loc"], line) for problem in error.errors() for line in _lines(problem, model)]


def emptied(data: dict[str, Any], places: Iterable[Place]) -> dict[str, Any]:
    """Return a copy of plain data where list items at `places` are None and keys of groups at `places` are removed."""
    copied = deepcopy(data)
    for place in places:
        inner: Any = copied
        for step in place[:-1]:
            inner = inner[step]
        if isinstance(inner, list):
            inner[int(place[-1])] = None
        else:
            inner.pop(place[-1], None)
    return copied


def without(data: dict[str, Any], places: Iterable[Place], stand_in: Mapping[str, Any]) -> dict[str, Any]:
    """Return plain data without the wrong parts at `places`: items of a list of lists or groups, or else whole fields.

    The fields of `stand_in` replace those left out or missing.
    """
    items: dict[str, set[int]] = {}
    left = dict(data)
    for place in places:
        name = str(place[0]) if place else ""
        if len(place) > 2 and isinstance(left.get(name), list) and isinstance(place[1], int):
            items.setdefault(name, set()).add(place[1])
        elif place:
            left.pop(name, None)
    for name, wrong in items.items():
        if isinstance(left.get(name), list):
            left[name] = [item for i, item in enumerate(left[name]) if i not in wrong]
    return dict(stand_in) | left
