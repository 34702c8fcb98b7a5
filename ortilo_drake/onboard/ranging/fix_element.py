"""The position fix from ranges, as an element of the loop."""

from typing import Any

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.scalars import values_of
from ortilo_drake.model.signals import ARRIVED, FIX_SIZE, N_XBAR, PAYLOAD
from ortilo_drake.onboard.ranging.fault_exclusion import Consistency, consistency_of
from ortilo_drake.onboard.ranging.lasting_error import KEPT, LASTING, N_KEPT, N_LASTING, put_lasting
from ortilo_drake.onboard.ranging.multilateration import believed_noise, put_fix_message, tested_fix_message
from ortilo_drake.scenario import Multilateration as MultilaterationSettings


@register_jitable
def fix_out(
    n: Any,
    message: np.ndarray,
    belief: np.ndarray,
    noise: np.ndarray,
    anchors: np.ndarray,
    used: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output the fix message (14) of the ranges that arrived; zeros if there is no fix."""
    fill(out, 0.0)
    if message[ARRIVED] != 0.0:
        put_fix_message(message, anchors, values_of(noise), belief, n.three, used, out)


def learning_out(
    n: Any,
    message: np.ndarray,
    belief: np.ndarray,
    learned: np.ndarray,
    noise: np.ndarray,
    anchors: np.ndarray,
    used: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output the fix message of the ranges that arrived, the fix's lasting error (6) and its sensitivities (6 n).

    Without a fix, the lasting error is the one of the last fix, kept in full.
    """
    fix_out(n, message, belief, noise, anchors, used, out)
    m = anchors.shape[0]
    at = out.size - 6 * m - N_LASTING
    if out[ARRIVED] == 0.0:
        put(learned[LASTING:KEPT], out, at)
        put((1.0, 1.0, 1.0), out, at + N_KEPT)
    else:
        p, there, here = values_of(belief[:3]), values_of(message[PAYLOAD + m :]), out[at + N_LASTING :]
        put_lasting(out[at : at + N_LASTING], p, there, anchors, values_of(noise), learned, here)


FIX = Element("multilateration", out=fix_out)
SCALED = Element("scaled_multilateration", out=fix_out)  # reads learned noise
LEARNING = Element("learning_multilateration", out=learning_out)


def tested_out(
    n: Any,
    message: np.ndarray,
    belief: np.ndarray,
    anchors: np.ndarray,
    quantiles: np.ndarray,
    clock: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output the fix message (14) of the ranges that agree, zeros if there is no fix, then the clock (3)."""
    fill(out, 0.0)
    put(clock, out, FIX_SIZE)
    if message[ARRIVED] != 0.0:
        consistency = Consistency(quantiles, n.least, n.share, n.clock)
        fix, after = tested_fix_message(message, anchors, n.noise, belief[:N_XBAR], clock, consistency)
        put(fix, out)
        put(after, out, FIX_SIZE)


def tested_step(clock: np.ndarray, out: np.ndarray) -> None:
    """Store the prior of the clock for the next tick."""
    put(out[FIX_SIZE:], clock)


TESTED = Element("tested_multilateration", allocates=True, out=tested_out, step=tested_step)


def fix_box(settings: MultilaterationSettings, anchors: np.ndarray) -> Box:
    """Return the solver's box; it reads the arrived uwb message and the belief (240), where the solver starts.

    With a bank it also reads what is `learned` of the survey, see bank_element.py, and outputs the lasting error
    `lasting` (6). With a bank, or if the noise's scale is learned, it reads the estimated `noise` (3).
    """
    noise, tables, n = believed_noise(settings), {"anchors": anchors}, len(anchors)
    if settings.exclude is not None:
        demands = consistency_of(settings.exclude, n)._asdict()
        tables["quantiles"] = demands.pop("quantiles")
        return Box("uwb_fix", TESTED, FIX_SIZE + 3, Values({"noise": noise} | demands, {"clock": np.zeros(3)}, tables))
    three = {"three": settings.method == "nearest_three"}
    work: dict[str, tuple[int, ...]] = {"used": (n,)}
    if settings.bias_bank is not None:
        told = FIX_SIZE + N_LASTING
        parts = {"fix": (0, FIX_SIZE), "lasting": (FIX_SIZE, N_LASTING), "sensitivities": (told, 6 * n)}
        return Box("uwb_fix", LEARNING, told + 6 * n, Values(three, tables=tables), work, parts=parts)
    if settings.noise_scale is not None:
        return Box("uwb_fix", SCALED, FIX_SIZE, Values(three, tables=tables), work)
    return Box("uwb_fix", FIX, FIX_SIZE, Values(three, tables=tables | {"noise": noise}), work)
