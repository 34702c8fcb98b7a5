"""Make the box of a part of one's own, or raise one line that says why this fails."""

from typing import Any

from ortilo_drake.loop.element import Box
from ortilo_drake.model.parts import Part
from ortilo_drake.model.typed_yaml import InputError


def box_of(part: Part, whose: str, *arguments: Any) -> Box:
    """Return the box that a part makes of its arguments; InputError, which begins with `whose`, if it makes none."""
    assert part.box is not None  # register_part ensures it
    try:
        made = part.box(*arguments)
    except Exception as error:  # a user's function may raise anything; a ValueError of od.box names the value itself
        said = f"{error}" if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
        raise InputError(f"{whose}: {said}") from error
    if not isinstance(made, Box):
        raise InputError(f"{whose}: its box returns {made!r}: must return an od.box")
    return made
