"""A recorded world, flown again by the onboard half."""

from pathlib import Path
from typing import Any

import numpy as np
from pydrake.polynomial import Polynomial
from pydrake.trajectories import PiecewisePolynomial

from ortilo_drake.hil.halves import OUTPUTS, OnboardHalf
from ortilo_drake.logs.reader import log_scenario, read_messages


def path_about(t: float, reference: np.ndarray) -> PiecewisePolynomial:
    """Return the path that is at t [s] where a reference [r, r_dot, r_ddot] (9) says, to the last bit."""
    coefficients = np.column_stack((reference[0:3], reference[3:6], reference[6:9] / 2.0))
    return PiecewisePolynomial([np.array([[Polynomial(c)] for c in coefficients])], [t, t + 1.0])


def replay_log(log: Path) -> dict[str, Any]:
    """Drive an onboard half from a log's messages; compare what it makes of them with what the log says.

    A way to a goal that came in flight was there when its planning had ended, so it is a matter of wall time: from the
    first goal on the reference is the log's own. A log that begins in flight is taken for that of a half that knew
    nothing when it joined: a checkpoint's state is not in it.

    Returns:
        ticks, identical (every output of every tick bit for bit), the first tick that differs or None, the largest
        difference of the estimate, and in how many ticks the reference was taken from the log.

    Raises:
        InputError: if the log cannot be read or its scenario does not fly.
    """
    # In real time the detector runs beside the half that is logged: its boxes are what came, not the pictures.
    detects = not any("detections" in messages for _, messages, _ in read_messages(log))
    onboard = OnboardHalf(log_scenario(log), detects=detects)
    ticks, first, largest, given, had_goal = 0, None, 0.0, 0, False
    for k, messages, recorded in read_messages(log):
        if ticks == 0 and k > 0:
            onboard.resume(k, None, np.inf)
        had_goal |= "goal" in messages
        if had_goal and "reference" in recorded:
            onboard.fly_path(path_about(onboard.context.get_time(), recorded["reference"]))
            given += 1
        onboard.take(messages)
        outputs = onboard.outputs()
        if not all(np.array_equal(outputs[name], recorded[name]) for name in OUTPUTS if name in recorded):
            first = k if first is None else first
        if "estimate" in recorded:
            largest = max(largest, float(np.max(np.abs(outputs["estimate"] - recorded["estimate"]))))
        onboard.advance()
        ticks += 1
    return {
        "ticks": ticks,
        "identical": first is None,
        "first_difference": first,
        "largest_difference": largest,
        "references_from_log": given,
    }
