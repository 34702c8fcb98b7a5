"""The landmark classes of the room that the paper's authors flew in: a room of a user need not give their sizes."""

from functools import cache
from pathlib import Path
from typing import Any

from ortilo_drake.model.input_files import read_text
from ortilo_drake.model.typed_yaml import parse_yaml

ORTILO_ROOM = Path(__file__).parents[1] / "ortilo_room.yaml"


@cache
def _known_classes() -> tuple[dict[str, Any], dict[str, Any]]:
    known = parse_yaml(read_text(ORTILO_ROOM), str(ORTILO_ROOM))
    return known["landmark_size"], known["landmark_outline"]


def with_known_classes(data: Any) -> Any:
    """Return a room's plain data with size and outline of ortilo_room.yaml for each class that has no size in it."""
    if not isinstance(data, dict) or not isinstance(data.get("landmarks"), list):
        return data
    sizes, outlines = data.get("landmark_size", {}), data.get("landmark_outline", {})
    if not (isinstance(sizes, dict) and isinstance(outlines, dict)):
        return data
    labels = [item.get("label") for item in data["landmarks"] if isinstance(item, dict)]
    missing = [label for label in labels if isinstance(label, str) and label not in sizes]
    if not missing:
        return data
    known_sizes, known_outlines = _known_classes()
    missing = [label for label in dict.fromkeys(missing) if label in known_sizes]
    return data | {
        "landmark_size": sizes | {label: known_sizes[label] for label in missing},
        "landmark_outline": {label: known_outlines[label] for label in missing} | outlines,
    }
