"""Replay: the onboard half flies again with the messages of a recorded world.

The log must hold the messages that the onboard half received in each tick. Such a log is the half's own log of any
flight, or the world's log of a flight in lockstep. If the half joined a flight from a checkpoint, the replay starts
from the estimate and covariance in the log. A filter that replays late measurements has more state; its log is refused.
"""

from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
from pydrake.polynomial import Polynomial
from pydrake.trajectories import PiecewisePolynomial

from ortilo_drake.flight.stepped_halves import OnboardHalf
from ortilo_drake.interop.log.reader import LoggedTick, holds_what_was_sent, log_scenario, read_messages, read_ticks
from ortilo_drake.model.signals import N_XBAR
from ortilo_drake.model.typed_yaml import InputError


@dataclass(frozen=True)
class ReplayReport:
    """A comparison of a replay with its log."""

    ticks: int
    """number of ticks replayed."""
    identical: bool
    """whether every output of every tick equals the logged one bit for bit."""
    first_difference: int | None
    """the first tick whose outputs differ; None if there is none."""
    largest_difference: float
    """largest absolute difference of an estimate's entry."""
    references_from_log: int
    """number of ticks whose reference came from the log."""
    state_from_log: bool
    """whether the state at the first tick came from the log."""


def path_through(t: float, reference: np.ndarray) -> PiecewisePolynomial:
    """Return a path p_WB that has exactly the values of a reference [r, r_dot, r_ddot] (9) at the time t [s]."""
    coefficients = np.column_stack((reference[0:3], reference[3:6], reference[6:9] / 2.0))
    return PiecewisePolynomial([np.array([[Polynomial(c)] for c in coefficients])], [t, t + 1.0])


def replay_log(log: Path) -> ReplayReport:
    """Drive an onboard half with the messages of a log; compare its outputs with the logged outputs.

    The time at which the path to a goal was ready depended on wall time. So the reference comes from the log from the
    first goal on, or from the first tick on if the half joined a flight on another path than the scenario's. Outputs
    that were not recorded are not compared. InputError if the log cannot be read or is empty, if its scenario does not
    fly, if it is a world's log of a flight in real time, or if it lacks the state of the half at its first tick.
    """
    if holds_what_was_sent(log):
        raise InputError(
            f"{log}: is the log of a world in real time: must be the onboard half's log, which "
            "ortilo hil onboard --log writes"
        )
    known = read_ticks(log, images=False)
    start = next(known, None)
    if start is None:
        raise InputError(f"{log}: cut off before its first tick")
    # In real time the detector runs in another process: the logged half received boxes, not pictures.
    scenario = log_scenario(log)
    beside = scenario.is_rendered and (
        start.k > 0 or any("detections" in tick.messages for tick in chain([start], known))
    )
    onboard = OnboardHalf(scenario, detects=not beside)
    state_from_log = start.k > 0 and _join(onboard, start, log)
    ticks, first, largest, given, own_way = 0, None, 0.0, 0, start.k > 0 and _is_elsewhere(onboard, start)
    for k, messages, recorded in read_messages(log):
        own_way |= "goal" in messages
        if own_way and "reference" in recorded:
            onboard.fly_path(path_through(onboard.context.get_time(), recorded["reference"]))
            given += 1
        onboard.receive(messages)
        outputs = onboard.outputs()
        if not all(np.array_equal(outputs[name], value, equal_nan=True) for name, value in recorded.items()):
            first = k if first is None else first
        if "estimate" in recorded:
            largest = max(largest, float(np.max(np.abs(outputs["estimate"] - recorded["estimate"]))))
        onboard.advance()
        ticks += 1
    return ReplayReport(
        ticks=ticks,
        identical=first is None,
        first_difference=first,
        largest_difference=largest,
        references_from_log=given,
        state_from_log=state_from_log,
    )


def _join(onboard: OnboardHalf, start: LoggedTick, log: Path) -> bool:
    """Have an onboard half join a flight at a tick; return whether the half's state had to come from the log."""
    onboard.resume(start.k, None, np.inf)
    found = onboard.outputs()
    state = [name for name in ("estimate", "covariance") if name in start.outputs]
    if all(np.array_equal(found[name], start.outputs[name]) for name in state):
        return False
    if onboard.diagram.has_history:
        raise InputError(
            f"{log}: joined its flight at tick {start.k} from a checkpoint, and what a filter with 'delay: replay' or "
            "a force, or a landmark_fix.joint, has in it beside estimate and covariance is in no log; replay the log "
            "of a half that flew from the start"
        )
    xbar, P = (start.outputs.get(name, found[name]) for name in ("estimate", "covariance"))
    onboard.set_belief(xbar, P.reshape(N_XBAR, N_XBAR))
    return True


def _is_elsewhere(onboard: OnboardHalf, start: LoggedTick) -> bool:
    """Return whether the recorded reference differs from the scenario's path."""
    planned = onboard.outputs()["reference"]
    return not np.array_equal(start.outputs.get("reference", planned), planned)
