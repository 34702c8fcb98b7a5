"""The sliders and buttons of a page, and the decoding of a page's messages about them.

Anyone who reaches the page's socket can send messages. They are decoded here, within narrow limits, and never reach
Drake, whose own decoder ends the process at the first malformed message.
"""

import math
from typing import Any, Final

import msgpack

LARGEST: Final = 4096  # largest message [bytes]; a slider's has about 60, a gamepad's some hundred
IGNORED: Final = ("camera_pose", "gamepad")  # types that Drake's page sends by itself and that are not needed


class BadMessage(ValueError):
    """The error of a message that none of our pages sends; its text is one line with the reason."""


class Panel:
    """The slider values that users of a page have set, and the clicks on its buttons.

    One thread takes messages and another reads. Only the last value of each slider and the number of clicks on each
    button are kept, so many messages between two reads cost the reader nothing.
    """

    def __init__(self) -> None:
        self._ranges: dict[str, tuple[float, float]] = {}  # ranges of the sliders
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
        """Take a page's message; return the name of the slider that moved, None if no slider did.

        A message is msgpack: {type: button, name} or {type: slider, name, value}; messages of IGNORED types are
        dropped. A value outside the slider's range becomes the nearer end of the range. BadMessage if the message is
        anything else, names no slider or button of this page, or has a value that is no finite number.
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
