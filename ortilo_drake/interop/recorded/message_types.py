"""Message types that a recording defines itself; refused where a short message would take for ever to decode."""

from typing import Any, Final

from rosbags.interfaces import Nodetype

LONGEST: Final = 1000  # texts or messages in an array of fixed length: rosbags writes lines of code for each of them


def check_types(types: Any, name: str) -> None:
    """Refuse messages without fields inside others, and long arrays of fixed length whose entries are no numbers.

    `types` are as rosbags' get_types_from_msg returns them; those that `name` uses are checked with it. A message
    without fields takes no bytes, so one of 8 bytes may announce an array of 4 billion of them.

    Raises:
        ValueError: naming type and field.
    """
    checked, left = set(), {name}
    while left:
        name = left.pop()
        checked.add(name)
        for field, (kind, inner) in types[name][1] if name in types else ():
            item, of = (kind, inner) if kind in (Nodetype.BASE, Nodetype.NAME) else inner[0]
            if item == Nodetype.NAME:
                if of in types and not types[of][1]:
                    raise ValueError(f"{name}.{field}: {of} has no fields")
                left |= {of} - checked
            numbers = item == Nodetype.BASE and of[0] != "string"
            if kind == Nodetype.ARRAY and not numbers and inner[1] > LONGEST:
                raise ValueError(f"{name}.{field}: {inner[1]} items, at most {LONGEST}")
