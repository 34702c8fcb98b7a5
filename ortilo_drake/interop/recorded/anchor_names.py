"""Names of anchors as files and maps write them: text, whatever it looks like; 0E15 is an address and no zero."""

import re
from collections.abc import Callable, Sequence

import numpy as np


def key_of(name: str) -> str:
    """Return the form in which anchors' names are compared: lower case, no 0x, no leading zeros, 3 for 3.0.

    An address 00:1A:2B:3C is 1a2b3c, whatever is between its bytes.
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


def _as_hex(name: str) -> int | None:
    return _number(name, 16)


def anchors_of(rows: Sequence[str], names: Sequence[str]) -> np.ndarray:
    """Return the index of each row's name among the names (n), -1 for none of them.

    Names are compared as text. Where a map has an address in hex and the rows have its number, or the other way round,
    they are compared as numbers: of the three readings the one that knows the most rows counts, the first of equals.
    """
    said, of_row = np.unique(np.asarray(rows, dtype=str), return_inverse=True)
    readings: tuple[tuple[Callable[[str], str | int | None], Callable[[str], str | int | None]], ...] = (
        (key_of, key_of),
        (_number, _number),
        (_number, _as_hex),
    )
    best = np.full(len(of_row), -1)
    for of_map, of_file in readings:
        index = {of_map(name): i for i, name in reversed(list(enumerate(names)))}
        index.pop(None, None)
        found = np.array([index.get(of_file(text), -1) for text in said], dtype=np.int64)[of_row]
        if (found >= 0).sum() > (best >= 0).sum():
            best = found
    return best
