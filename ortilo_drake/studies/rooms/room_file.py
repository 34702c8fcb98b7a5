"""Everything that is wrong with a room file, at once."""

from pathlib import Path

from ortilo_drake.model.input_error import one_line
from ortilo_drake.model.input_files import read_text
from ortilo_drake.model.inputs.room_text import parse_room
from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import all_problems

# Right values of what every room needs, for looking at the rest of a file where these are wrong.
_ANY_ROOM = {
    "interior": {"min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 1.0]},
    "anchors": [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
}


def room_problems(path: Path) -> list[str]:
    """Return a line for each thing that is wrong with a room file: file, field, value and what is allowed.

    Raises:
        InputError: if the file cannot be read or is no YAML.
    """
    data = parse_room(read_text(path), str(path))
    return [one_line(f"{path}: {line}") for line in all_problems(Room, data, _ANY_ROOM)]
