"""The fix of ranges as an element of the loop."""

from dataclasses import replace
from typing import Any

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.loop.element import Array, Box, Element, Number, Values
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.scalars import values_of
from ortilo_drake.model.signals import ARRIVED, FIX_SIZE, N_XBAR, PAYLOAD
from ortilo_drake.onboard.ranging.fault_exclusion import Consistency, consistency_of
from ortilo_drake.onboard.ranging.lasting_error import KEPT, LASTING, N_KEPT, N_LASTING, SHARE, put_lasting
from ortilo_drake.onboard.ranging.multilateration import believed_noise, put_fix_message, tested_fix_message
from ortilo_drake.scenario import Multilateration as MultilaterationSettings


def fix_out(
    n: Any, message: np.ndarray, belief: np.ndarray, anchors: np.ndarray, used: np.ndarray, out: np.ndarray
) -> None:
    """Output the fix message (14) of the ranges that landed, zeros if there is none."""
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


@register_jitable
def put_learned_noise(noise: np.ndarray, believed: np.ndarray, learned: np.ndarray) -> None:
    """Write the ranges' noise (3) with that share of s_2 which has been learned, see survey_bank.py."""
    put(believed, noise)
    noise[2] *= learned[SHARE]


@register_jitable
def say_lasting(
    out: np.ndarray,
    message: np.ndarray,
    belief: np.ndarray,
    anchors: np.ndarray,
    noise: np.ndarray,
    learned: np.ndarray,
) -> None:
    """Write what lasts of a fix's error and its sensitivities; without a fix, that all of the last one's is kept."""
    n = anchors.shape[0]
    at, p = out.size - 6 * n - N_LASTING, values_of(belief[:3])
    if out[ARRIVED] == 0.0:
        put(learned[LASTING:KEPT], out, at)
        put((1.0, 1.0, 1.0), out, at + N_KEPT)
    else:
        there = values_of(message[PAYLOAD + n :])
        here = out[at + N_LASTING :]
        put_lasting(out[at : at + N_LASTING], p, there, anchors, noise, learned, here)


def learning_out(
    n: Any,
    message: np.ndarray,
    belief: np.ndarray,
    learned: np.ndarray,
    anchors: np.ndarray,
    used: np.ndarray,
    noise: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output the fix message of the ranges that landed, by noise with the learned survey, and its lasting error."""
    fill(out, 0.0)
    put_learned_noise(noise, n.noise, learned)
    if message[ARRIVED] != 0.0:
        put_fix_message(message, anchors, noise, belief, n.three != 0, used, out)
    say_lasting(out, message, belief, anchors, noise, learned)


LEARNING = replace(FIX, name="learning_multilateration", out=learning_out, work=(Array("used"), Array("noise")))


def scaled_out(
    n: Any,
    message: np.ndarray,
    belief: np.ndarray,
    noise: np.ndarray,
    anchors: np.ndarray,
    used: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output the fix message (14) of the ranges that landed, by the noise believed now; zeros if there is none."""
    fill(out, 0.0)
    if message[ARRIVED] != 0.0:
        put_fix_message(message, anchors, values_of(noise), belief, n.three != 0, used, out)


def scaled_learning_out(
    n: Any,
    message: np.ndarray,
    belief: np.ndarray,
    learned: np.ndarray,
    noise: np.ndarray,
    anchors: np.ndarray,
    used: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output what learning_out does, by the noise that is believed now."""
    fill(out, 0.0)
    if message[ARRIVED] != 0.0:
        put_fix_message(message, anchors, values_of(noise), belief, n.three != 0, used, out)
    say_lasting(out, message, belief, anchors, values_of(noise), learned)


THREE = (Number("three", kind="i8"),)
SCALED = replace(FIX, name="scaled_multilateration", out=scaled_out, numbers=THREE)
SCALED_LEARNING = replace(SCALED, name="scaled_learning_multilateration", out=scaled_learning_out)


def tested_out(
    n: Any,
    message: np.ndarray,
    belief: np.ndarray,
    anchors: np.ndarray,
    quantiles: np.ndarray,
    clock: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output the fix message (14) of those ranges that fit each other, else zeros, and the clock after it."""
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
    """Return the solver: it reads the uwb message as it lands and the belief about which it is solved (240).

    With a bank it reads what is `learned` of the survey too, see survey_bank.py, and says what is `lasting` (6). Where
    the noise's scale is learned it reads the `noise` (3) that is believed, see noise_scale.py.
    """
    numbers, tables, n = {"noise": believed_noise(settings)}, {"anchors": anchors}, len(anchors)
    if settings.exclude is not None:
        demands = consistency_of(settings.exclude, n)._asdict()
        tables["quantiles"] = demands.pop("quantiles")
        return Box("uwb_fix", TESTED, FIX_SIZE + 3, Values(numbers | demands, {"clock": np.zeros(3)}, tables))
    scaled = settings.noise_scale is not None
    three = {"three": settings.method == "nearest_three"}
    given = Values(three if scaled else numbers | three, tables=tables)
    work: dict[str, tuple[int, ...]] = {"used": (n,)} if scaled else {"used": (n,), "noise": (3,)}
    if settings.bias_bank is None:
        return Box("uwb_fix", SCALED if scaled else FIX, FIX_SIZE, given, {"used": (n,)})
    told = FIX_SIZE + N_LASTING
    parts = {"fix": (0, FIX_SIZE), "lasting": (FIX_SIZE, N_LASTING), "sensitivities": (told, 6 * n)}
    return Box("uwb_fix", SCALED_LEARNING if scaled else LEARNING, told + 6 * n, given, work, parts=parts)
