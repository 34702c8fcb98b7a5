"""Surveyed anchors in their usual formats: lists, cfclient's YAML, JSON, CSV, and the console output of a DWM1001.

A list has the anchors in the order of the ranges. The other formats have anchors by name; a name is text.
"""

import json
import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ortilo_drake.interop.recorded.csv_columns import SIGNS, cells_of, lines_of, mark_of, plain
from ortilo_drake.interop.recorded.lec_console import is_console, lec_ranges
from ortilo_drake.interop.recorded.rejected import Rejections
from ortilo_drake.interop.recorded.sources import MOST
from ortilo_drake.interop.recorded.tables import number
from ortilo_drake.model.input_files import MIB
from ortilo_drake.model.typed_yaml import InputError, parse_yaml

Vector = tuple[float, float, float]
NAMED_BY = ("id", "name", "anchor", "address", "addr")  # column or key of an anchor's name in files
FARTHEST = 1e6  # limit of a coordinate [m]; no room is larger
CONSOLE_LIMIT = 64 * MIB  # largest file with anchors; a console prints as much in ten hours
FEWEST = 3  # smallest number of anchors


def _position(value: Any, of: str) -> Vector:
    """Return a position (3) [m]; ValueError if the value, the entry `of` of a map, is no position."""
    found = value.get("position", value) if isinstance(value, dict) else value
    if isinstance(found, dict) and {"x", "y", "z"} <= set(found):
        found = [found["x"], found["y"], found["z"]]
    if not isinstance(found, list | tuple) or len(found) != 3 or not all(map(_is_length, found)):
        raise ValueError(f".{of}: {str(value)[:60]}: must be [x, y, z] or {{x: , y: , z: }}, numbers in m")
    x, y, z = (float(axis) for axis in found)
    return x, y, z


def _is_length(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(abs(value) < FARTHEST)


def as_anchors(value: Any) -> Any:
    """Return a map's anchors as a tuple of positions [m] or as positions by name; any other value unchanged.

    ValueError if a position is invalid, a name stands twice, or there are fewer than 3 or more than 256 anchors.
    """
    found: Any = value
    if isinstance(value, dict) and "find" in value:
        if not isinstance(value["find"], int) or len(value) > 1 or not FEWEST <= value["find"] <= MOST:
            raise ValueError(
                f".find: {value['find']}: must be a whole number from {FEWEST} to {MOST}, and the only key"
            )
        return value
    if isinstance(value, list | tuple):
        entries = [entry if isinstance(entry, dict) else {} for entry in value]
        called = [next((str(entry[key]) for key in NAMED_BY if key in entry), None) for entry in entries]
        found = tuple(_position(entry, str(i)) for i, entry in enumerate(value))
        names = [name for name in called if name is not None]
        if names and len(names) == len(called):
            if len(set(map(key_of, names))) < len(names):
                raise ValueError(f"{', '.join(names)}: a name stands twice")
            found = dict(zip(names, found, strict=True))
    elif isinstance(value, dict):
        found = {str(name): _position(entry, str(name)) for name, entry in value.items()}
    if isinstance(found, tuple | dict) and not FEWEST <= len(found) <= MOST:
        raise ValueError(f"{len(found)} of them, must be {FEWEST} to {MOST}")
    return found


def _keys(node: yaml.Node) -> Iterator[yaml.Node]:
    """Yield the names of anchors in a node: the keys of a mapping, or the name fields of a list's entries."""
    if isinstance(node, yaml.MappingNode):
        for key, _ in node.value:
            yield key
    elif isinstance(node, yaml.SequenceNode):
        for entry in node.value:
            for key, value in entry.value if isinstance(entry, yaml.MappingNode) else ():
                if key.value in (*NAMED_BY, "tag"):
                    yield value


def names_in_map(document: yaml.Node) -> Iterator[yaml.Node]:
    """Yield the scalars of MAP.yaml that name anchors or tags; they are read as text, unchanged."""
    for key, value in document.value if isinstance(document, yaml.MappingNode) else ():
        if key.value in ("anchors", "tags"):
            yield from _keys(value)
        for entry, inner in value.value if key.value == "ranges" and isinstance(value, yaml.MappingNode) else ():
            if entry.value == "names" and isinstance(inner, yaml.SequenceNode):
                yield from (name for name in inner.value if isinstance(name, yaml.ScalarNode))
            elif entry.value == "file":
                yield from _keys(inner) if isinstance(inner, yaml.SequenceNode) else ()


def _names_in_file(document: yaml.Node) -> Iterator[yaml.Node]:
    yield from _keys(document)
    for key, value in document.value if isinstance(document, yaml.MappingNode) else ():
        if key.value == "anchors":
            yield from _keys(value)


def _of_json(path: Path, text: str) -> Any:
    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        if len({key for key, _ in pairs}) < len(pairs):
            raise ValueError(f"{', '.join(key for key, _ in pairs)}: a name stands twice")
        return dict(pairs)

    try:
        return json.loads(text, object_pairs_hook=once)
    except ValueError as error:
        raise InputError(f"{path}: not valid JSON: {error}") from None


def _of_yaml(path: Path, text: str) -> dict[str, Vector]:
    data = _of_json(path, text) if path.suffix == ".json" else parse_yaml(text, str(path), _names_in_file)
    if isinstance(data, dict) and "anchors" in data:
        data = data["anchors"]
    try:
        found = as_anchors(data)
    except ValueError as error:
        raise InputError(f"{path}: anchors{'' if str(error).startswith('.') else ': '}{error}") from None
    if isinstance(found, tuple):
        found = {str(i): position for i, position in enumerate(found)}
    if not isinstance(found, dict) or "find" in found:
        raise InputError(f"{path}: must hold anchors by name, {{0: {{x: , y: , z: }}, ...}}")
    return found


def _of_table(path: Path, told: Rejections) -> dict[str, Vector]:
    """Return the anchors of rows `id, x, y, z` or `x, y, z` [m], with or without a header, by name."""
    lines = list(lines_of(path, told, CONSOLE_LIMIT))
    rows = [(k, text) for k, text in lines if text.lstrip()[0] not in SIGNS] or lines
    mark = mark_of(rows[-1][1])
    body = [(k, cells_of(text, mark)) for k, text in rows]
    width = len(body[-1][1])
    own, where = (0, (1, 2, 3)) if width > 3 else (None, (0, 1, 2))
    above = [
        [plain(cell).casefold().split(" ")[0].split("[")[0] for cell in cells_of(plain(t), mark)] for _, t in lines
    ]
    head = next((names for names in above if {"x", "y", "z"} <= set(names)), None)
    if head is not None:
        where = (head.index("x"), head.index("y"), head.index("z"))
        own = next((head.index(name) for name in NAMED_BY if name in head), None if len(head) == 3 else 0)
        own = None if own in where else own
    found: dict[str, Vector] = {}
    for k, cells in body:
        try:
            position = _position([number(cells[i]) if i < len(cells) else None for i in where], "")
        except ValueError:
            if found or k != body[0][0]:
                raise InputError(f"{path}: line {k}: {', '.join(cells)[:60]}: must be id, x, y, z in m") from None
            continue
        name = str(len(found)) if own is None else cells[own]
        if key_of(name) in {key_of(other) for other in found}:
            raise InputError(f"{path}: line {k}: anchor '{name}' stands twice")
        found[name] = position
    return found


def read_anchors(path: Path) -> dict[str, Vector]:
    """Return the positions p_W [m] of a file's anchors by name.

    The file is YAML of cfclient, JSON, a table `id, x, y, z`, or the console output of a DWM1001, from which the
    medians are taken. InputError if the file cannot be read, or has fewer than 3 or more than 256 anchors.
    """
    told = Rejections(f"{path.name} (anchors)")
    text = "\n".join(line for _, line in lines_of(path, told, CONSOLE_LIMIT))
    if is_console(text):
        said: dict[str, list[Vector]] = {}
        for heard in lec_ranges(path, told):
            said.setdefault(heard.anchor, []).append(heard.position)
        found = {name: _position(np.median(at, axis=0).tolist(), name) for name, at in said.items()}
    else:
        found = _of_yaml(path, text) if path.suffix in (".yaml", ".yml", ".json") else _of_table(path, told)
    if not FEWEST <= len(found) <= MOST:
        raise InputError(f"{path}: {len(found)} anchors, must be {FEWEST} to {MOST}")
    return found


def in_order(anchors: dict[str, Vector], names: tuple[str, ...], what: str) -> tuple[tuple[str, ...], np.ndarray]:
    """Return the names and positions (n, 3) [m] of the anchors in `names`, in that order, or of all if it is empty.

    InputError if a name belongs to no anchor.
    """
    known = tuple(anchors)
    if not names:
        return known, np.array(list(anchors.values()))
    where = anchors_of(names, known)
    if (where < 0).any():
        missing = names[int(np.argmin(where))]
        raise InputError(f"{what}: '{missing}' is none of the anchors, which are {', '.join(known)}")
    return names, np.array([anchors[known[i]] for i in where])


def key_of(name: str) -> str:
    """Return the form in which names of anchors are compared: lower case, no 0x, no leading zeros, 3 for 3.0.

    The addresses 00:1A:2B:3C and 00-1A-2B-3C become 1a2b3c.
    """
    text = name.strip().casefold().removeprefix("0x")
    text = re.sub(r"[:-]", "", text) if re.fullmatch(r"[0-9a-f]{2}([:-][0-9a-f]{2})+", text) else text
    text = re.sub(r"^(\d+)\.0*$", r"\1", text)
    return text.lstrip("0") or "0"


def _number(name: str, base: int = 10) -> int | None:
    text = name.strip().casefold()
    try:
        return int(text, 16) if text.startswith("0x") else int(re.sub(r"^(\d+)\.0*$", r"\1", text), base)
    except ValueError:
        return None


def anchors_of(rows: Sequence[str], names: Sequence[str]) -> np.ndarray:
    """Return the index (n) of each row's name in `names`, -1 for an unknown name.

    Names are compared as text; as numbers; or as numbers where the rows have hex digits without 0x, for a map and a
    recording may differ in the form of an address. The comparison that finds the most rows counts, the first of equals.
    """
    said, of_row = np.unique(np.asarray(rows, dtype=str), return_inverse=True)
    readings: list[list[Callable[[str], Any]]] = [[key_of] * 2, [_number] * 2, [_number, partial(_number, base=16)]]
    best = np.full(len(of_row), -1)
    for of_map, of_file in readings:
        index = {of_map(name): i for i, name in reversed(list(enumerate(names)))}
        index.pop(None, None)
        found = np.array([index.get(of_file(text), -1) for text in said], dtype=np.int64)[of_row]
        if (found >= 0).sum() > (best >= 0).sum():
            best = found
    return best
