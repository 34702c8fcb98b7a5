"""The C header of an exported half: inputs, outputs, numbers, and the state that lasts from tick to tick."""

from typing import Final

import numpy as np

from ortilo_drake.codegen.half import Half
from ortilo_drake.diagrams.wiring.onboard import INPUTS_NAMED
from ortilo_drake.loop.element import Box
from ortilo_drake.model.parts import known_sensors
from ortilo_drake.model.signals import ACT_SIZE, ACTS, CONTROL_NAMES, PAYLOAD, XBAR_NAMES
from ortilo_drake.scenario import Belief, Scenario
from ortilo_drake.sensors.described import described, port_of

KINDS: Final = {"f8": "double", "i8": "int64_t", "u8": "uint64_t", "b1": "uint8_t"}
HEAD: Final = (
    ("double arrived;", "1 in the tick in which the message is there, else 0"),
    ("double stamp;", "when its content was true [s], tick 0 at 0 s"),
)
PAYLOADS: Final = {
    "velocity": (("double v_WB[3];", "[m/s]"), ("double angle_rates[3];", "of roll, pitch, yaw [rad/s]")),
    "acted": (
        (f"double acts[{ACTS}][{ACT_SIZE}];",
         "since [s] (-1: unused), stamp of the tick that sent it [s], u (4); newest first"),
    ),
}  # fmt: skip
OUTPUTS: Final = {
    "control": f"u: {', '.join(CONTROL_NAMES)} [N, N m in B], f_T along z_B",
    "estimate": f"predicted for this tick: {', '.join(XBAR_NAMES)}",
    "covariance": "of the estimate, row by row",
    "reference": "r, its velocity and its acceleration in W",
    "y": "the measurement as the filter takes it",
    "delta": "1 for each sensor of which the filter takes a value",
    "V2": "the values' covariances, one after the other",
    "force": "disturbance force in W as estimated [N]",
}


def c_name(name: str) -> str:
    """Return the C name of a box or a message."""
    return INPUTS_NAMED.get(name, name)


def fields_of(scenario: Belief, name: str, size: int) -> tuple[tuple[str, str], ...]:
    """Return the members of an input's struct: the declaration of each, and its meaning."""
    name = c_name(name)
    sensor = next((its for its in map(described, known_sensors()) if port_of(its.name) == name), None)
    members = PAYLOADS.get(name) or (sensor.members(scenario, size - PAYLOAD) if sensor else ())
    plain = (f"double payload[{size - PAYLOAD}];", "several samples, or the values of a registered sensor")
    return (*HEAD, *(members or (plain,)))


def aligned(members: list[tuple[str, str]]) -> list[str]:
    """Return the lines of a struct's members, with the comments aligned in a column."""
    width = max(len(member) for member, _ in members)
    return [f"    {member:{width}} /* {what} */" if what else f"    {member}" for member, what in members]


def struct(name: str, members: list[tuple[str, str]]) -> str:
    """Return a struct's definition."""
    return "\n".join(["typedef struct {", *aligned(members), f"}} {name};\n"])


def dimensions(shape: tuple[int, ...]) -> str:
    """Return an array's dimensions in C; an empty array gets one number that is never read."""
    return "".join(f"[{max(d, 1)}]" for d in shape)


def computed_boxes(half: Half) -> list[Box]:
    """Return all boxes: those with functions in the order of a tick, then the others."""
    order = {box.name: box for box in (*half.wiring.out_order, *half.wiring.step_order)}
    return [*order.values(), *(box for name, box in half.wiring.boxes.items() if name not in order)]


def constants_of(box: Box) -> list[tuple[str, str, np.ndarray]]:
    """Return name, kind and values of each constant of a box, numbers before tables; none changes in flight."""
    found = list[tuple[str, str, np.ndarray]]()
    for number in box.element.constants:
        found.append((number.name, number.kind, np.asarray(box.given.numbers[number.name])))
    for table in box.element.arrays:
        found.append((table.name, table.kind, np.asarray(box.given.tables[table.name])))
    return found


ROOM_BYTES: Final = 131072  # memory for arrays; `datasheet_tight` needs most of the ready-made scenarios, 75,016 bytes
ROOM: Final = f"""#ifndef ORTILO_ROOM
#define ORTILO_ROOM {ROOM_BYTES} /* bytes; define it where ortilo.c is compiled and where ortilo.h is read */
#endif
typedef struct {{
    int64_t top, last;               /* of a call */
    int64_t most;                    /* bytes that any call has taken so far: ORTILO_ROOM should be twice that */
    int64_t bytes[ORTILO_ROOM / 8];  /* arrays that are made within a call */
}} ortilo_room;
"""


def header_text(half: Half, scenario: Scenario, sizes: dict[str, int], makes_arrays: bool) -> str:
    """Return the text of ortilo.h, with memory for arrays if functions make arrays; source_text returns the sizes."""
    inputs = [(f"ortilo_{c_name(box)} {c_name(box)};", "") for box in half.inputs]
    outputs = [(f"double {signal}[{wire.size}];", OUTPUTS[signal]) for signal, wire in half.outputs.items()]
    parts = [
        f"/* The onboard half of {scenario.name}: see README.md. Units are SI, angles in radians. */",
        '#ifndef ORTILO_H\n#define ORTILO_H\n#include <stdint.h>\n#ifdef __cplusplus\nextern "C" {\n#endif\n',
        *(struct(f"ortilo_{c_name(box)}", [*fields_of(scenario, box, size)]) for box, size in half.inputs.items()),
        struct("ortilo_inputs", inputs),
        struct("ortilo_outputs", outputs),
        "/* Numbers that may be changed without exporting again: noise, gains, anchors, limits. */",
    ]
    held = []
    for box in computed_boxes(half):
        constants = constants_of(box)
        if constants:
            members = [(f"{KINDS[kind]} {what}{dimensions(values.shape)};", "") for what, kind, values in constants]
            parts.append(struct(f"ortilo_{box.name}_numbers", members))
            held.append((f"ortilo_{box.name}_numbers {box.name};", ""))
    parts += [
        struct("ortilo_numbers", held),
        "extern const ortilo_numbers ortilo_default_numbers;\n",
        struct("ortilo_state", [
            (f"double values[{max(sizes['state'], 1)}];", "all that one tick leaves to the next"),
            ("int64_t tick;", "the next one"),
        ]),
        *([ROOM] if makes_arrays else []),
        struct("ortilo", [
            ("const ortilo_numbers *numbers;", ""),
            ("ortilo_state state;", ""),
            (f"double said[{max(sizes['said'], 1)}];", "within a tick"),
            (f"double work[{max(sizes['work'], 1)}];", "within a call"),
            *([("ortilo_room room;", "within a call")] if makes_arrays else []),
        ]),
        "/* Begin at tick 0 with the first estimate; numbers NULL are the scenario's. */",
        "void ortilo_init(ortilo *self, const ortilo_numbers *numbers);",
        "/* Fly one tick: what arrived since the one before comes in, the command for the next goes out.\n"
        "   Returns 0, or how many functions had to stop: the room was too small for them, or the inputs senseless. */",
        "int ortilo_tick(ortilo *self, const ortilo_inputs *inputs, ortilo_outputs *outputs);",
        "/* All that a tick leaves to the next is self->state: copy it to save it, copy it back to resume. */\n",
        "#ifdef __cplusplus\n}\n#endif\n#endif",
    ]  # fmt: skip
    return "\n".join(parts) + "\n"
