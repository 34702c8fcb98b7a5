"""Faults of what is not there: a scenario held against its room and its vehicle."""

from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario


def check_room(scenario: Scenario, room: Room) -> None:
    """Refuse faults of anchors, landmarks and rotors that are not there.

    Raises:
        InputError: naming the fault, the number and what is allowed.
    """
    counts = {"anchor": len(room.anchors), "landmark": len(room.landmarks), "rotor": scenario.vehicle.rotor_count}
    for i, fault in enumerate(scenario.faults):
        for name, count in counts.items():
            for index in (*getattr(fault, f"{name}s", ()), getattr(fault, name, 0)):
                if index >= count:
                    raise InputError(f"faults.{i}: {fault.kind}: {name} {index}: must be below {count}, their number")
