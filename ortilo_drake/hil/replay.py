"""A recorded world, flown again by the onboard half."""

from pathlib import Path
from typing import Any

import numpy as np

from ortilo_drake.hil.halves import OUTPUTS, OnboardHalf
from ortilo_drake.logs.reader import log_scenario, read_messages


def replay_log(log: Path) -> dict[str, Any]:
    """Drive an onboard half from a log's messages; compare what it makes of them with what the log says.

    Returns:
        ticks, identical (every output of every tick bit for bit), the first tick that differs or None, and the largest
        difference of the estimate.

    Raises:
        InputError: if the log cannot be read or its scenario does not fly.
    """
    # In real time the detector runs beside the half that is logged: its boxes are what came, not the pictures.
    detects = not any("detections" in messages for _, messages, _ in read_messages(log))
    onboard = OnboardHalf(log_scenario(log), detects=detects)
    ticks, first, largest = 0, None, 0.0
    for k, messages, recorded in read_messages(log):
        onboard.take(messages)
        outputs = onboard.outputs()
        if not all(np.array_equal(outputs[name], recorded[name]) for name in OUTPUTS if name in recorded):
            first = k if first is None else first
        if "estimate" in recorded:
            largest = max(largest, float(np.max(np.abs(outputs["estimate"] - recorded["estimate"]))))
        onboard.advance()
        ticks += 1
    return {"ticks": ticks, "identical": first is None, "first_difference": first, "largest_difference": largest}
