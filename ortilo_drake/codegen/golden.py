"""Golden vectors: what came in and what went out in the first ticks of a flight, to the last bit, as a C header."""

from functools import lru_cache
from typing import Final

import numpy as np

from ortilo_drake.codegen.c_header import c_name
from ortilo_drake.codegen.half import Half, onboard_half
from ortilo_drake.flight.signals import Signals
from ortilo_drake.flight.stepped_halves import OnboardHalf, WorldHalf
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.described import port_of

COMPARED: Final = ("control", "estimate", "covariance")
FNV: Final = (1469598103934665603, 1099511628211)  # offset and prime of the 64-bit hash of Fowler, Noll and Vo


def hash_of(words: np.ndarray) -> int:
    """Return the hash FNV-1a of whole numbers of 64 bits, taken as one number each."""
    found = FNV[0]
    for word in words:
        found = ((found ^ int(word)) * FNV[1]) & (2**64 - 1)
    return found


def inputs_of(half: Half, messages: Signals) -> np.ndarray:
    """Return a tick's inputs as they lie in C, one after the other, of its messages."""
    found, at = np.zeros(sum(half.inputs.values())), 0
    for box, size in half.inputs.items():
        said = messages.get(c_name(box), messages.get(port_of(box)))
        if said is not None:
            found[at : at + size] = said
        at += size
    return found


@lru_cache(maxsize=1)
def flown_ticks(scenario: Scenario, ticks: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return the inputs of each tick, one after the other (ticks, i), and each output (ticks, n), as Drake flies it.

    The last flight, of the scenario's seed, is kept: it is that of all processors. InputError as onboard_half.
    """
    half, world, onboard = onboard_half(scenario), WorldHalf(scenario), OnboardHalf(scenario)
    came = np.zeros((ticks, sum(half.inputs.values())))
    went = {name: np.zeros((ticks, half.outputs[name].size)) for name in COMPARED}
    for k in range(ticks):
        messages = world.sample()
        came[k] = inputs_of(half, messages)
        onboard.receive(messages)
        outputs = onboard.outputs()
        for name in COMPARED:
            went[name][k] = outputs[name].ravel()
        world.advance(outputs["control"])
        onboard.advance()
    return came, went


def words_text(name: str, values: np.ndarray) -> str:
    """Return an array of C of floats' bits, a row a tick."""
    kind = np.dtype(f"u{values.itemsize}")
    rows = np.ascontiguousarray(values).view(kind)
    text = ",\n".join("{" + ",".join(f"0x{word:x}u" for word in row) + "}" for row in rows)
    return f"static const {kind}_t {name}[{rows.shape[0]}][{rows.shape[1]}] = {{\n{text}}};\n"


def golden_text(came: np.ndarray, went: dict[str, np.ndarray], single: bool = False) -> str:
    """Return golden.h: the inputs' bits, the control's and the estimate's, and a hash of the covariance.

    In single precision, the bits of the doubles' nearest floats, and no hash.
    """
    kind = np.float32 if single else np.float64
    bits = f"the bits of {'floats' if single else 'doubles'}"
    text = f"/* What came in and what must go out, as {bits}. */\n#include <stdint.h>\n#define TICKS {len(came)}\n"
    for name, values in {"inputs": came, "control": went["control"], "estimate": went["estimate"]}.items():
        text += words_text(f"golden_{name}", values.astype(kind))
    if single:
        return text
    hashes = ",\n".join(f"0x{hash_of(row):x}u" for row in went["covariance"].view(np.uint64))
    return text + f"static const uint64_t golden_covariance[TICKS] = {{\n{hashes}}};\n"
