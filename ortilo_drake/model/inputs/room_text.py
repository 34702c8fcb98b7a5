"""The text of a room file as plain data; anchors by name, as cfclient stores them, become a list of positions.

A user's room may leave out the sizes of landmark classes that the room of the paper's authors has.
"""

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.input_files import read_text
from ortilo_drake.model.typed_yaml import parse_yaml

ORTILO_ROOM = Path(__file__).parents[1] / "ortilo_room.yaml"
_AXES = ("x", "y", "z")
_WANTED = "must be [[x, y, z], ...] in m, or by name {0: {x: , y: , z: }, ...}"


def parse_room(text: str, source: str) -> Any:
    """Return the plain data of a room file's YAML.

    InputError, which begins with the source, as in parse_yaml, or if anchors have other keys than x, y and z.
    """
    data = parse_yaml(text, source, _names_of_anchors)
    if not isinstance(data, dict):
        return data
    if data and all(_is_by_axes(value) for value in data.values()):
        raise InputError(f"{source}: holds anchors alone; a room has them under 'anchors:', beside its 'interior:'")
    if "anchors" in data:
        data = data | {"anchors": _listed(data["anchors"], source)}
    return with_known_classes(data)


def _listed(anchors: Any, source: str) -> Any:
    """Return anchors as a list of [x, y, z], in the order of the file; data of other types is returned unchanged."""
    named = anchors.items() if isinstance(anchors, dict) else enumerate(anchors) if isinstance(anchors, list) else ()
    found = []
    for name, value in named:
        if isinstance(value, dict):
            if not _is_by_axes(value):
                raise InputError(f"{source}: anchors.{name}: {str(value)[:60]}: {_WANTED}")
            value = [value[axis] for axis in _AXES]
        elif isinstance(anchors, dict) and not isinstance(value, list):
            raise InputError(f"{source}: anchors.{name}: {str(value)[:60]}: {_WANTED}")
        found.append(value)
    return found if isinstance(anchors, dict | list) else anchors


def _is_by_axes(value: Any) -> bool:
    return isinstance(value, dict) and set(value) == set(_AXES)


def _names_of_anchors(document: yaml.Node) -> Iterator[yaml.Node]:
    """Yield the keys that name anchors, mostly numbers: keys under 'anchors', and keys of a file with only anchors."""
    for key, value in document.value if isinstance(document, yaml.MappingNode) else ():
        if isinstance(key, yaml.ScalarNode) and isinstance(value, yaml.MappingNode):
            yield key
            if key.value == "anchors":
                yield from (name for name, _ in value.value if isinstance(name, yaml.ScalarNode))


@cache
def _known_classes() -> tuple[dict[str, Any], dict[str, Any]]:
    known = parse_yaml(read_text(ORTILO_ROOM), str(ORTILO_ROOM))
    return known["landmark_size"], known["landmark_outline"]


def with_known_classes(data: Any) -> Any:
    """Return a room's plain data; each class without a size gets the size and outline of ortilo_room.yaml."""
    if not isinstance(data, dict) or not isinstance(data.get("landmarks"), list):
        return data
    sizes, outlines = data.get("landmark_size", {}), data.get("landmark_outline", {})
    if not (isinstance(sizes, dict) and isinstance(outlines, dict)):
        return data
    labels = [item.get("label") for item in data["landmarks"] if isinstance(item, dict)]
    missing = [label for label in labels if isinstance(label, str) and label not in sizes]
    if not missing:
        return data
    known_sizes, known_outlines = _known_classes()
    missing = [label for label in dict.fromkeys(missing) if label in known_sizes]
    return data | {
        "landmark_size": sizes | {label: known_sizes[label] for label in missing},
        "landmark_outline": {label: known_outlines[label] for label in missing} | outlines,
    }
