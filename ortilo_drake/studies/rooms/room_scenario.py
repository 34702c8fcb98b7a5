"""The scenario in which a room is judged if the user gives none."""

from pathlib import Path

from ortilo_drake.model.input_files import exists, read_text
from ortilo_drake.model.inputs.room_text import parse_room
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.scenario.load import PROJECTED, Setting

BASE = "imu_uwb_yolo"  # a scenario with every sensor of the paper
OF_A_ROOM = "room"  # the scenario's name
_KEYS = {"interior", "anchors", "landmarks"}  # no scenario has these keys


def is_room(path: Path) -> bool:
    """Return whether a file describes a room rather than a scenario."""
    if not exists(path):
        return False
    data = parse_room(read_text(path), str(path))
    return isinstance(data, dict) and bool(_KEYS & data.keys())


def room_scenario(room: Path, settings: tuple[str, ...] = ()) -> Scenario:
    """Return the scenario in which a room is judged: imu, UWB that walls block, projected camera, from start to goal.

    InputError, naming the room's file, if the file or a change by the settings is wrong.
    """
    if not exists(room):
        raise InputError(f"room: {room}: no such room file")
    of_room: tuple[Setting, ...] = (
        ("name", OF_A_ROOM),
        ("room", str(room.absolute())),
        PROJECTED,
        ("uwb.link.blackouts", []),
        ("uwb.walls", {"kind": "block"}),
    )
    try:
        return load_scenario(BASE, (*of_room, *settings))
    except InputError as wrong:
        text = str(wrong)
        own = f"{BASE}: "  # a name that the user did not give
        raise InputError(f"{room}: {text.removeprefix(own)}" if text.startswith(own) else text) from None


def without_camera(scenario: Scenario) -> str | None:
    """Return a line on how to judge a room for a vehicle without a camera; None for a scenario that the user named."""
    if scenario.name != OF_A_ROOM or "camera" not in scenario.sensors:
        return None
    return f"with {', '.join(scenario.sensors)}; for a vehicle that has UWB alone: --set sensors=[uwb,imu]"


def scenario_of(name_or_file: str, settings: tuple[str, ...] = ()) -> Scenario:
    """Return the scenario by name or from a file, or for a room's file; InputError as in `load_scenario`."""
    path = Path(name_or_file)
    if path.suffix in (".yaml", ".yml") and (is_room(path) or not exists(path)):
        return room_scenario(path, settings)
    return load_scenario(name_or_file, settings)
