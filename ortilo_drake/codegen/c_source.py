"""The C source of an exported half: its numbers, its first state, and a tick.

The tick is the one of loop/source.py in C, with a line for each call of an element's function. The user's own compiler
compiles this source; the object file has the functions.
"""

import math
import textwrap
from pathlib import Path
from typing import Final

import numpy as np

from ortilo_drake.codegen.c_header import c_name, computed_boxes, constants_of
from ortilo_drake.codegen.half import Half
from ortilo_drake.codegen.ir import symbol_of
from ortilo_drake.codegen.single import NARROW, with_floats
from ortilo_drake.loop.element import Box
from ortilo_drake.loop.native import parameters
from ortilo_drake.loop.player import Memory
from ortilo_drake.loop.source import Places, places_of

TEMPLATES: Final = Path(__file__).with_name("templates")
ROOM_TEXT: Final = (TEMPLATES / "room.c").read_text()
SUM_TEXT: Final = (TEMPLATES / "sum.c").read_text()


def number_text(value: float) -> str:
    """Return a number in C; floats are exact to the last bit."""
    if not isinstance(value, float):
        return f"{int(value)}"
    if math.isfinite(value):
        return value.hex().replace(".0000000000000", "")
    return "NAN" if math.isnan(value) else "INFINITY" if value > 0 else "-INFINITY"


def values_text(values: np.ndarray) -> str:
    """Return values as an initializer in C; an empty array has one number that is never read."""
    if values.size == 0:
        return f"{'{' * values.ndim}0{'}' * values.ndim}"
    if values.ndim == 0:
        return number_text(values.item())
    if values.ndim == 1:
        text = ", ".join(number_text(value) for value in values.tolist())
        return "{" + textwrap.fill(text, 110, subsequent_indent="     ", break_on_hyphens=False) + "}"
    return "{" + ",\n     ".join(values_text(row) for row in values) + "}"


def numbers_text(half: Half, single: bool) -> str:
    """Return the C definition of the default numbers, rounded to floats in single precision."""
    kinds = NARROW if single else {}
    lines = ["const ortilo_numbers ortilo_default_numbers = {"]
    for box in computed_boxes(half):
        if constants := constants_of(box):
            given = [
                f"    .{name} = {values_text(np.asarray(values, kind).astype(kinds.get(kind, kind)))},"
                for name, kind, values in constants
            ]
            lines += [f"  .{box.name} = {{", *given, "  },"]
    return "\n".join([*lines, "};\n"])


def declaration(box: Box, what: str) -> str:
    """Return the C declaration of a box's function in the object file."""
    said = ["void *"]
    for name, dimensions, _ in parameters(box.element, box.element.functions[what]):
        said += ["int64_t"] if name == "k" else ["const void *"] + ["int64_t"] * max(dimensions, 0)
    return f"int32_t {symbol_of(box.name, what)}({', '.join(said)});"


def call(places: Places, box: Box, what: str) -> str:
    """Return the C line that calls a box's `out` or `step`."""
    element, said = box.element, ["ROOM"]
    for name, _, _ in parameters(element, element.functions[what]):
        if name == "n":
            said.append(f"&n->{box.name}" if element.constants else "n")
        elif name == "k":
            said.append("k")
        else:
            letter, at, shape = places.arrays[box.name, name]
            said += [f"n->{box.name}.{name}" if letter == "T" else f"{letter} + {at}", *map(str, shape)]
    return f"    stopped += {symbol_of(box.name, what)}({', '.join(said)}) != 0;"


def source_text(half: Half, makes_arrays: bool, own_sums: bool, single: bool = False) -> tuple[str, dict[str, int]]:
    """Return the text of ortilo.c, with floats if `single`, and the sizes of states, work arrays and outputs."""
    wiring, places = half.wiring, places_of(half.wiring)
    declared = [declaration(box, what) for box in computed_boxes(half) for what in box.element.functions]
    first = np.append(Memory(wiring, places).S, [] if places.sizes["S"] else [0.0])  # C has no empty arrays
    first = first.astype(np.float32 if single else float)
    came = [
        f"    memcpy(Y + {places.said[name].at}, &inputs->{c_name(name)}, {size} * sizeof(double));"
        for name, size in half.inputs.items()
    ]
    sources = {name: places.of(wire) for name, wire in half.outputs.items()}
    went = [
        f"    memcpy(outputs->{name}, {place.letter} + {place.at}, sizeof outputs->{name});"
        for name, place in sources.items()
    ]
    lines = [
        '#include "ortilo.h"',
        "#include <math.h>",
        "#include <stddef.h>",
        "#include <string.h>\n",
        *([ROOM_TEXT] if makes_arrays else []),
        *([SUM_TEXT] if own_sums else []),
        f"#define ROOM {'room_of(self)' if makes_arrays else 'NULL'}",
        *declared,
        "",
        numbers_text(half, single),
        f"static const double first_state[{len(first)}] =",
        f"    {values_text(first)};\n",
        "void ortilo_init(ortilo *self, const ortilo_numbers *numbers) {",
        "    memset(self, 0, sizeof *self);",
        "    self->numbers = numbers != NULL ? numbers : &ortilo_default_numbers;",
        "    memcpy(self->state.values, first_state, sizeof first_state);",
        "}\n",
        "int ortilo_tick(ortilo *self, const ortilo_inputs *inputs, ortilo_outputs *outputs) {",
        "    const ortilo_numbers *const n = self->numbers;",
        "    double *const S = self->state.values, *const W = self->work, *const Y = self->said;",
        "    const int64_t k = self->state.tick;",
        "    int stopped = 0;",
        "    (void)n, (void)W, (void)k;",
        *came,
        *(call(places, box, "out") for box in wiring.out_order),
        *went,
        *(call(places, box, "step") for box in wiring.step_order),
        "    self->state.tick = k + 1;",
        "    return stopped;",
        "}\n",
    ]
    text, sizes = "\n".join(lines), places.sizes
    return with_floats(text) if single else text, {"state": sizes["S"], "said": sizes["Y"], "work": sizes["W"]}
