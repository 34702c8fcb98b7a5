"""The fix of ranges as an element of the loop."""

from typing import Any

import numpy as np

from ortilo_drake.loop.element import Array, Box, Element, Given, Number
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import ARRIVED, FIX_SIZE, N_XBAR
from ortilo_drake.onboard.ranging.fault_exclusion import Consistency, consistency_of
from ortilo_drake.onboard.ranging.multilateration import believed_noise, put_fix_message, tested_fix_message
from ortilo_drake.scenario import Multilateration as MultilaterationSettings


def fix_out(
    n: Any, message: np.ndarray, belief: np.ndarray, anchors: np.ndarray, used: np.ndarray, out: np.ndarray
) -> None:
    """Say the fix message (14) of the ranges that landed, zeros if there is none."""
    if message[ARRIVED] == 0.0:
        fill(out, 0.0)
    else:
        put_fix_message(message, anchors, n.noise, belief, n.three != 0, used, out)


FIX = Element(
    "multilateration",
    out=fix_out,
    numbers=(Number("noise", (3,)), Number("three", kind="i8")),
    tables=(Array("anchors", 2),),
    work=(Array("used"),),
)


def tested_out(
    n: Any,
    message: np.ndarray,
    belief: np.ndarray,
    anchors: np.ndarray,
    quantiles: np.ndarray,
    clock: np.ndarray,
    out: np.ndarray,
) -> None:
    """Say the fix message (14) of those ranges that fit each other, zeros if there is none, and the clock after it."""
    fill(out, 0.0)
    put(clock, out, FIX_SIZE)
    if message[ARRIVED] != 0.0:
        consistency = Consistency(quantiles, n.least, n.share, n.clock != 0)
        fix, after = tested_fix_message(message, anchors, n.noise, belief[:N_XBAR], clock, consistency)
        put(fix, out)
        put(after, out, FIX_SIZE)


def tested_step(clock: np.ndarray, out: np.ndarray) -> None:
    """Keep what is known of the clock."""
    put(out[FIX_SIZE:], clock)


TESTED = Element(
    "tested_multilateration",
    allocates=True,
    out=tested_out,
    step=tested_step,
    numbers=(Number("noise", (3,)), Number("least", kind="i8"), Number("share"), Number("clock", kind="i8")),
    tables=(Array("anchors", 2), Array("quantiles")),
    state=(Array("clock"),),
)


def fix_box(settings: MultilaterationSettings, anchors: np.ndarray) -> Box:
    """Return the solver: it reads the uwb message as it lands and the belief about which it is solved (240)."""
    numbers, tables = {"noise": believed_noise(settings)}, {"anchors": anchors}
    if settings.exclude is None:
        three = {"three": settings.method == "nearest_three"}
        return Box("uwb_fix", FIX, FIX_SIZE, Given(numbers | three, tables=tables), {"used": (len(anchors),)})
    demands = consistency_of(settings.exclude, len(anchors))._asdict()
    tables["quantiles"] = demands.pop("quantiles")
    return Box("uwb_fix", TESTED, FIX_SIZE + 3, Given(numbers | demands, {"clock": np.zeros(3)}, tables))
