"""Lines of a DWM1001 console, as the commands `lec` and `les` print them, with the host's stamp before each line.

    100.2,DIST,2,AN0,0E15,3.40,0.90,0.30,3.62,AN1,1516,3.10,-3.20,2.60,4.58,POS,0.02,0.01,1.29,87
    100.2 0E15[3.40,0.90,0.30]=3.62 1516[3.10,-3.20,2.60]=4.58 est[0.02,0.01,1.29,87]

Numbers are in metres: the position of an anchor, and the range to the anchor.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from ortilo_drake.interop.recorded.csv_columns import lines_of
from ortilo_drake.interop.recorded.rejected import Rejections
from ortilo_drake.interop.recorded.stamps import clock_period, stamp, unrolled
from ortilo_drake.interop.recorded.tables import Rows, Table
from ortilo_drake.model.typed_yaml import InputError

_N = r"(-?\d+(?:\.\d+)?|nan)"
_LEC = re.compile(rf"AN\d+,([0-9A-F]{{2,16}}),{_N},{_N},{_N},{_N}(?![\d.])", re.IGNORECASE)
_LES = re.compile(rf"\b([0-9A-F]{{4,16}})\[{_N},{_N},{_N}\]={_N}(?![\d.])", re.IGNORECASE)
_DIST = re.compile(r"\bDIST,(\d+)\b")


class LecRange(NamedTuple):
    """One range of a line: number of the line, text before its ranges, anchor's address and position, range [m]."""

    line: int
    before: str
    anchor: str
    position: tuple[float, float, float]
    range: float


def is_console(text: str) -> bool:
    """Return whether a text holds ranges as `lec` or `les` prints them."""
    return _LEC.search(text) is not None or _LES.search(text) is not None


def ranges_in(line: str) -> tuple[str, list[tuple[str, tuple[float, float, float], float]]]:
    """Return the text before the ranges of a line, and for each range the anchor's address, position (3) and range [m].

    ValueError if the line holds fewer or more ranges than it announces, as where it was cut short.
    """
    said = _DIST.search(line)
    groups = list((_LES if said is None else _LEC).finditer(line))
    if said is not None and len(groups) != int(said[1]):
        raise ValueError("lines of DIST that do not hold the ranges they announce")
    if not groups:
        return line, []
    before = line[: groups[0].start() if said is None else said.start()].lstrip(" [").rstrip(" \t,;:]>-")
    numbers = [tuple(float(number) for number in group.groups()[1:]) for group in groups]
    return before, [(group[1], (x, y, z), r) for group, (x, y, z, r) in zip(groups, numbers, strict=True)]


def lec_ranges(path: Path, rejected: Rejections) -> Iterator[LecRange]:
    """Yield the ranges of a console's log; other lines and lines that were cut short are counted as rejected."""
    for k, line in lines_of(path, rejected):
        try:
            before, found = ranges_in(line)
        except ValueError as error:
            rejected.add(str(error), f"in line {k}")
            continue
        if not found:
            kind = "lines of POS without ranges" if "POS," in line else "lines that are none of lec or les"
            rejected.add(kind, f"in line {k}")
        for one in found:
            yield LecRange(k, before, *one)


def read_lec(path: Path, rejected: Rejections) -> Table:
    """Return the ranges of a console's log [m], each named by the address of its anchor.

    InputError if fewer than half of the ranges have a stamp before their line.
    """
    rows, count, first_stamp = Rows(path), 0, ""
    for heard in lec_ranges(path, rejected):
        count += 1
        t = stamp(heard.before) if heard.before else None
        if t is None:
            rejected.add("ranges without a stamp before their line", f"in line {heard.line}")
        else:
            first_stamp = first_stamp or heard.before
            rows.add(heard.line, t, [heard.range], (heard.anchor,))
    if len(rows) < max(2, count / 2):
        why = rejected.most() or "it holds none of lec or les"
        raise InputError(f"{path}: {len(rows)} ranges with a stamp before their line ({why})")
    table = rows.table()
    return table._replace(t=unrolled(table.t, clock_period(first_stamp)))
