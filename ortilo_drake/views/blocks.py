"""The paper's block diagram of a wiring: the boxes of each block, and the signals between blocks.

    planner -> servo -> [command link] -> vehicle -> sensors -> fixes -> handler -> filter -> servo

A sensor's block also holds its clock, errors, faults and link. The handler's block holds all gates and weights.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from ortilo_drake.loop.wiring import Wire, Wiring

COLUMNS = ("planner", "servo", "command link", "vehicle", "sensor", "fix", "handler", "filter")  # in signal order
WORLD = ("command link", "vehicle", "sensor")
_COLUMN_OF = {
    "reference": "planner",
    **dict.fromkeys(("servo", "true_velocity", "command_log", "state_ahead"), "servo"),
    "command_link": "command link",
    **dict.fromkeys(("handler", "robust_gate", "imu_rows", "beliefs_at_stamp"), "handler"),
    **dict.fromkeys(("filter", "own_filter", "estimator", "vehicle_belief", "belief_parts"), "filter"),
}
_ONBOARD_OF_SENSOR = ("stuck_gate", "mean", "belief_at_stamp", "vehicle_at_stamp", "prior", "sighted", "bank", "fix")
_OWN_PARTS = ("servo", "reference")  # boxes named after these select their inputs from a belief
_SIGNALS = {
    "plant": "x", "servo": "u", "command_link.applied": "u", "reference": "r", "filter": "x̂, P",
    "vehicle_belief": "x̂, P",
    "belief": "x̂, P", "delta": "Δ", "V2": "V₂", "rotors_felt": "felt", "felt.control": "felt",
    "felt.disturbance": "felt", "vehicle.passed": "felt", "acceleration": "v̇",
    "velocity": "v",
}  # fmt: skip


@dataclass(frozen=True)
class Block:
    """A block of the paper's diagram: its name, its column (one of COLUMNS), and the names of its boxes."""

    name: str
    column: str
    boxes: tuple[str, ...]


@dataclass(frozen=True)
class Arrow:
    """An input of a box, or a box that a bundle holds: `signal` is "box" or "box.part", `wire` the source."""

    reader: str
    port: str
    signal: str
    wire: Wire


def arrows_of(wiring: Wiring) -> Iterator[Arrow]:
    """Yield an arrow for every wire of a wiring, then one for every box in its bundles."""
    for (reader, port), wire in wiring.wires.items():
        yield Arrow(reader, port, wiring.boxes[reader].reads.get(port, port), wire)
    for held, holder in wiring.holders.items():
        yield Arrow(holder, held, held, Wire(held, 0, wiring.boxes[held].size))


def blocks_of(wiring: Wiring) -> dict[str, Block]:
    """Return the blocks of a scenario's wiring by name, in the order of COLUMNS."""
    acts = (name for name, box in wiring.boxes.items() if box.element.functions or box.system or name in _COLUMN_OF)
    places = {name: _place(wiring, name) for name in acts}
    for name in wiring.boxes:  # constants and bundles belong to the block that reads them
        if name not in places:
            readers = (arrow.reader for arrow in arrows_of(wiring) if arrow.wire.box == name)
            places[name] = next((places[reader] for reader in readers if reader in places), ("filter", "filter"))
    if not any(places[a.wire.box][1] == "handler" and places[a.reader][1] == "filter" for a in arrows_of(wiring)):
        places = {name: ("filter", "filter") if place[1] == "handler" else place for name, place in places.items()}
    found = {}
    for column in COLUMNS:
        for block in dict.fromkeys(place[0] for place in places.values() if place[1] == column):
            found[block] = Block(block, column, tuple(name for name, place in places.items() if place[0] == block))
    return found


def signals_between(wiring: Wiring, blocks: dict[str, Block]) -> dict[tuple[str, str], list[str]]:
    """Return the names of the signals between blocks, by the names of source and reader block."""
    home = {box: block for block in blocks.values() for box in block.boxes}
    found: dict[tuple[str, str], list[str]] = {}
    for arrow in arrows_of(wiring):
        source, reader = home[arrow.wire.box], home[arrow.reader]
        if source is not reader:
            names, name = found.setdefault((source.name, reader.name), []), _signal(arrow, source)
            if name not in names:
                names.append(name)
    return found


def _place(wiring: Wiring, name: str) -> tuple[str, str]:
    """Return the names of a box's block and of the block's column."""
    if name in _COLUMN_OF:
        return _COLUMN_OF[name], _COLUMN_OF[name]
    if name == "detector":  # the detector reads the camera's pictures
        name = "camera_fix"
    sensors = [box.removesuffix("_link") for box in wiring.boxes if box.endswith("_link") and box != "command_link"]
    its = [sensor for sensor in sensors if name == sensor or name.startswith(f"{sensor}_")]
    if name == "now":  # the time of a report that says which commands acted
        return "acted", "sensor"
    if not its:
        own = next((part for part in _OWN_PARTS if name.startswith(f"{part}_")), None)
        return ("vehicle", "vehicle") if own is None else (_COLUMN_OF[own], _COLUMN_OF[own])
    sensor = max(its, key=len)
    if name.removeprefix(f"{sensor}_") not in _ONBOARD_OF_SENSOR:
        return sensor, "sensor"
    return (f"{sensor} fix", "fix") if f"{sensor}_fix" in wiring.boxes else ("handler", "handler")


def _signal(arrow: Arrow, source: Block) -> str:
    box, _, part = arrow.signal.partition(".")
    if source.column in ("sensor", "fix"):
        return {"sensor": "message", "fix": "fix"}[source.column]
    return _SIGNALS.get(arrow.signal) or _SIGNALS.get(part) or part or _SIGNALS.get(box) or box.replace("_", " ")
