"""Room files that are written; model/room.py reads them."""

import yaml

from ortilo_drake.model.room import Room


def room_text(room: Room, about: str) -> str:
    """Return a room as the text of a file, with a line about it at the top."""
    data = room.model_dump(mode="json")
    return f"# {about}\n" + yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=120)
