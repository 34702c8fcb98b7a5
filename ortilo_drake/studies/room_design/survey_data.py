"""Ranges for the survey of anchors: from flights, logs and tables.

A table is CSV whose first line names its columns: from, to and range [m], and, if the vehicle's place is known, x, y, z
and sd [m]. Anchors are named a0, a1, ... in the room's order; any other name in `from` is a place of the vehicle, and
the same name is the same place. Empty x, y, z are unknown; with an empty sd they only start the search.

A saved flight keeps no ranges. As its noise is a function of seed and tick, the world's own function repeats the ranges
that reached the vehicle. A log holds the messages themselves.
"""

import csv
import io
import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from ortilo_drake.floor.cramer_rao import arrived
from ortilo_drake.interop.log.reader import log_scenario, read_log, read_messages
from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.input_files import read_text
from ortilo_drake.model.signals import ARRIVED, uwb_size
from ortilo_drake.model.typed_yaml import LARGEST
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.described import measuring
from ortilo_drake.sensors.uwb import messages_again
from ortilo_drake.studies.room_design.network import Ranges

COLUMNS, PLACE_COLUMNS = ("from", "to", "range"), ("x", "y", "z", "sd")
MAX_ROWS = 200_000
_ANCHOR = re.compile(r"a(\d{1,4})")


def flown_messages(scenario: Scenario, truth: np.ndarray) -> np.ndarray:
    """Return the uwb messages that reached the vehicle in a flight (m, 2 + 2 a), in the order in which they were taken.

    The scenario is the one flown, its seed included, with true states x_k (n, 12). InputError if the messages cannot be
    repeated, see messages_again.
    """
    return messages_again(scenario, scenario.load_room(), truth, arrived(scenario, measuring("anchors"), truth))


def logged_messages(path: Path) -> np.ndarray:
    """Return the uwb messages that a log holds (m, 2 + 2 a).

    InputError if it is no log, or has messages of several samples or of differences.
    """
    scenario, sensor = log_scenario(path), measuring("anchors")
    if scenario.uwb.kind == "differences":
        raise InputError(f"{path}: {sensor}.kind: differences: must be ranges: a survey takes single ranges")
    size = uwb_size(len(scenario.load_room().anchors))
    found = [messages[sensor] for _, messages, _ in read_messages(path) if sensor in messages]
    if any(message.shape != (size,) for message in found):
        raise InputError(f"{path}: {sensor}: its messages must have {size} numbers")
    return np.array([message for message in found if message[ARRIVED] != 0.0]).reshape(-1, size)


def ranges_of_flight(flight: xr.Dataset, scenario: Scenario, messages: np.ndarray, most: int) -> Ranges:
    """Return the ranges of a flight's messages (m, 2 + 2 a), of at most `most` messages, evenly spaced.

    The estimated positions start the search.
    """
    chosen = messages[np.unique(np.linspace(0, len(messages) - 1, min(most, len(messages))).round().astype(int))]
    n = (messages.shape[1] - 2) // 2
    place, anchor = np.nonzero(chosen[:, 2 + n :])
    ticks = np.clip(np.round(chosen[:, 1] / scenario.h).astype(int), 0, flight.sizes["tick"] - 1)
    p = flight["estimate"].values[ticks, :3]
    nothing = np.empty((0, 2), dtype=int), np.empty(0)
    return Ranges(place, anchor, chosen[place, 2 + anchor], *nothing, p, np.full(len(p), np.inf))


def ranges_of_log(path: Path, most: int) -> Ranges:
    """Return the ranges of a log; arguments and errors as ranges_of_flight and logged_messages."""
    return ranges_of_flight(read_log(path), log_scenario(path), logged_messages(path), most)


def ranges_of_table(path: Path, n: int) -> Ranges:
    """Return the ranges of a table to n anchors; InputError naming file, line, column, value and what is allowed."""
    rows = csv.DictReader(io.StringIO(read_text(path)), skipinitialspace=True)
    names = [name.strip() for name in rows.fieldnames or ()]
    rows.fieldnames = names
    for name in COLUMNS:
        if name not in names:
            raise InputError(f"{path}: column {name}: is missing, the first line must name {', '.join(COLUMNS)}")
    for name in names:
        if name not in COLUMNS + PLACE_COLUMNS or names.count(name) > 1:
            known = ", ".join(COLUMNS + PLACE_COLUMNS)
            raise InputError(f"{path}: column {name!r}: must be one of {known}, each once")
    places: dict[str, int] = {}
    p: list[list[float]] = []
    to_anchor: list[tuple[int, int, float]] = []
    between: list[tuple[int, int, float]] = []
    try:
        for row in rows:
            where = f"{path}: line {rows.line_num}"
            if rows.line_num > MAX_ROWS:
                raise InputError(f"{where}: must not have more than {MAX_ROWS} lines")
            if None in row or None in row.values():
                raise InputError(f"{where}: must have {len(names)} values")
            distance, to = _number(row["range"], f"{where}: range", 0.0), _anchor(row["to"], n, f"{where}: to")
            if to is None:
                raise InputError(f"{where}: to: {row['to']!r}: must be an anchor, a0 to a{n - 1}")
            start = _anchor(row["from"], n, f"{where}: from")
            if start == to:
                raise InputError(f"{where}: from: {row['from']!r}: must not be the anchor in to")
            if start is not None:
                between.append((start, to, distance))
                continue
            name = row["from"].strip()
            if name not in places:
                places[name] = len(p)
                p.append(_place(row, where))
            to_anchor.append((places[name], to, distance))
    except csv.Error as error:
        raise InputError(f"{path}: line {rows.line_num}: {error}") from None
    a, b = (np.array(found, dtype=float).reshape(-1, 3) for found in (to_anchor, between))
    where_was = np.array(p).reshape(-1, 4)
    ints = a[:, :2].astype(int), b[:, :2].astype(int)
    return Ranges(ints[0][:, 0], ints[0][:, 1], a[:, 2], ints[1], b[:, 2], where_was[:, :3], where_was[:, 3])


def together(parts: Sequence[Ranges]) -> Ranges:
    """Return the ranges of several sources, whose places differ."""
    first = np.cumsum([0, *(len(part.p) for part in parts)])
    moved = [part._replace(place=part.place + shift) for part, shift in zip(parts, first, strict=False)]
    return Ranges(*(np.concatenate([getattr(part, name) for part in moved]) for name in Ranges._fields))


def _number(text: str, where: str, least: float = -LARGEST) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not least <= value <= LARGEST:
        raise InputError(f"{where}: {text.strip()[:40]!r}: must be a number from {least:g} to {LARGEST:g}")
    return value


def _anchor(text: str, n: int, where: str) -> int | None:
    """Return the number of an anchor, None for another name."""
    found = _ANCHOR.fullmatch(text.strip())
    if found is None:
        return None
    if int(found[1]) >= n:
        raise InputError(f"{where}: {text.strip()!r}: the room has anchors a0 to a{n - 1}")
    return int(found[1])


def _place(row: dict[str, str], where: str) -> list[float]:
    """Return x, y, z (NaN if empty) and sd (inf if empty)."""
    texts = [row.get(axis, "").strip() for axis in "xyz"]
    if any(texts) and not all(texts):
        raise InputError(f"{where}: x, y, z: must be three numbers or all empty")
    p = [_number(text, f"{where}: {axis}") if text else math.nan for axis, text in zip("xyz", texts, strict=True)]
    sd = row.get("sd", "").strip()
    if sd and not texts[0]:
        raise InputError(f"{where}: sd: {sd!r}: must be empty where x, y, z are")
    return [*p, _number(sd, f"{where}: sd", 1e-6) if sd else math.inf]
