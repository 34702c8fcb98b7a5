"""The text of a room file as plain data: anchors by name, as cfclient keeps them, become a list of positions."""

from collections.abc import Iterator
from typing import Any

import yaml

from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.inputs.known_classes import with_known_classes
from ortilo_drake.model.typed_yaml import parse_yaml

_AXES = ("x", "y", "z")
_WANTED = "must be [[x, y, z], ...] in m, or by name {0: {x: , y: , z: }, ...}"


def parse_room(text: str, source: str) -> Any:
    """Return the plain data of a room file.

    Args:
        text: the YAML.
        source: what to call it in an error.

    Raises:
        InputError: as parse_yaml, or if anchors have other keys than x, y and z.
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
    """Return anchors as a list of [x, y, z], in the order of the file; what is no mapping stays as it is."""
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
    """Yield the keys that name anchors, numbers most often: those under 'anchors', and of a file of anchors alone."""
    for key, value in document.value if isinstance(document, yaml.MappingNode) else ():
        if isinstance(key, yaml.ScalarNode) and isinstance(value, yaml.MappingNode):
            yield key
            if key.value == "anchors":
                yield from (name for name, _ in value.value if isinstance(name, yaml.ScalarNode))
