"""The sliders and buttons of a page, and the decoding of a page's messages about them.

Messages come from whoever reached the page's socket. They are decoded here, within narrow limits, and never reach
Drake, whose own decoder ends the process at the first one that is malformed.
"""

import math
from typing import Any, Final

import msgpack

LARGEST: Final = 4096  # of a message [bytes]; a slider's has about 60, a gamepad's some hundred
IGNORED: Final = ("camera_pose", "gamepad")  # what Drake's page may send by itself; nothing here needs it


class BadMessage(ValueError):
    """A message that none of our pages sends: one line that says why."""


class Panel:
    """The values that the user of a page has set, and the buttons clicked.

    One thread takes messages and another reads: of each slider only the last value is kept and of each button the
    number of clicks, so that any number of messages between two looks costs the reader nothing.
    """

    def __init__(self) -> None:
        self._ranges: dict[str, tuple[float, float]] = {}  # of the sliders
        self._values: dict[str, float] = {}
        self._clicks: dict[str, int] = {}

    def add_slider(self, name: str, least: float, most: float, first: float) -> None:
        """Add a slider with its range and first value."""
        self._ranges[name], self._values[name] = (least, most), first

    def add_button(self, name: str) -> None:
        """Add a button."""
        self._clicks[name] = 0

    def value(self, name: str) -> float:
        """Return the value of a slider."""
        return self._values[name]

    def clicks(self, name: str) -> int:
        """Return the number of clicks on a button so far."""
        return self._clicks[name]

    def receive(self, message: bytes | str) -> str | None:
        """Take a page's message; return the name of the slider that moved, if one did.

        It is msgpack: {type: button, name} or {type: slider, name, value}; of IGNORED types nothing is taken. A value
        outside of its slider's range becomes the range's nearer end. BadMessage if it is anything else, names no slider
        or button of this page, or its value is no finite number.
        """
        said = _decoded(message)
        kind, name = said.get("type"), said.get("name")
        if kind in IGNORED:
            return None
        if kind == "button" and isinstance(name, str) and name in self._clicks:
            self._clicks[name] += 1
            return None
        if kind == "slider" and isinstance(name, str) and name in self._ranges:
            (least, most), value = self._ranges[name], said.get("value")
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                raise BadMessage(f"slider {name!r}: {value!r}: must be a finite number")
            self._values[name] = min(max(float(value), least), most)
            return name
        raise BadMessage(f"{str(kind)[:40]!r} of {str(name)[:40]!r}: no slider or button of this page")


def _decoded(message: bytes | str) -> dict[str, Any]:
    if isinstance(message, str):
        raise BadMessage("text: pages send msgpack")
    if len(message) > LARGEST:
        raise BadMessage(f"{len(message)} bytes: at most {LARGEST}")
    try:
        said = msgpack.unpackb(
            message, max_str_len=200, max_bin_len=0, max_array_len=64, max_map_len=8, max_ext_len=0, strict_map_key=True
        )
    except (ValueError, TypeError, OverflowError, RecursionError, msgpack.UnpackException):
        raise BadMessage("no msgpack of a page") from None
    if not isinstance(said, dict):
        raise BadMessage(f"a {type(said).__name__}: must be a map")
    return said
