"""The filter kept going: where it is lost it starts anew from the ranges alone, as the paper's robust form does.

After an outage the position's deviation is metres and more, so that a range's row, taken where the filter believes to
be, points the wrong way: the filter then believes a wrong place firmly and refuses every range for ever. So before the
first range that finds it so far astray, and where most anchors were refused for a second, position and velocity are
found by least squares (first_fix.py). The fix enters as a measurement; what of P contradicts it is opened first. It is
left out if fewer ranges agree with it than with the filter: then the ranges are wrong, not the filter.
"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.recording import Ranges
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.tight.inertial import matrix_of
from ortilo_drake.onboard.estimator.tight.layout import Q
from ortilo_drake.studies.recorded.anchor_trust import ASTRAY, REFUSED
from ortilo_drake.studies.recorded.event_filter import initial_carried, run_filter
from ortilo_drake.studies.recorded.filter_types import (
    BIASES,
    RANGE,
    Events,
    EventValues,
    Restart,
    Run,
    Setup,
    State,
    nominal,
)
from ortilo_drake.studies.recorded.first_fix import agreeing, ranges_for_a_fix, solve_first_fix

AGAIN = 1.0  # before the next trial [s]
SURPRISE = 3.0  # standard deviations beyond which a fix contradicts the filter
TILT, HEADING, GYRO, ACCELEROMETER = 0.1, 0.3, 0.01, 0.1  # opened then [rad, rad, rad/s, m/s²]


class Lost(NamedTuple):
    """The times at which the filter was lost and found again [s]; `found` is None if it was not."""

    since: float
    found: float | None


def opening_of(state: State, x: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """Return the addition to P's diagonal after which position and velocity x (6) do not contradict the state."""
    off = np.square(x - state.x[:6])
    P = np.diag(state.C)
    beyond = off > SURPRISE**2 * (P[:6] + variances)
    opening = np.zeros(len(P))
    opening[:6][beyond] = off[beyond]
    if beyond.any():
        opening[6:9], opening[9:12], opening[12:15] = [TILT**2, TILT**2, HEADING**2], GYRO**2, ACCELEROMETER**2
        opening[6:][P[6:] == 0.0] = 0.0  # not estimated
    return opening


def no_restart(N: int) -> Restart:
    """Return a Restart without any measurement, for N error states."""
    return Restart(np.zeros(6), np.full(6, np.inf), np.zeros(N))


def is_astray(state: State) -> bool:
    """Return whether the position's deviation is so large that ranges no longer correct it."""
    return bool(np.trace(state.C[:3, :3]) > ASTRAY**2)


def run_on(
    events: Events, heard_all: EventValues, start: State, setup: Setup, wait: float, whole: bool
) -> tuple[list[Run], list[Lost], State]:
    """Run the filter over all events, and return the runs between its starts, when it was lost, and how it ended.

    Arguments as run_filter; an infinite wait keeps it from starting anew.
    """
    heard = events.kind == RANGE
    ranges = Ranges(*(part[heard] for part in (events.t, events.which, events.r, events.other, events.tag)))
    before = np.concatenate([[0], np.cumsum(heard)])  # ranges before each event
    n, nothing = len(setup.anchors), no_restart(len(start.C))
    parts: list[Run] = []
    lost: list[Lost] = []
    state, anew, done, since = start, nothing, 0, None
    last = float(events.t[0])  # range that was taken
    while True:
        rest = Events(*(part[done:] for part in events))
        first = before[done]
        carried = initial_carried(n, len(state.C), state.t)
        run, state, taken_in = run_filter(rest, heard_all, state, carried, anew, setup, wait, whole)
        parts.append(run)
        done += taken_in
        if since is not None and run.taken[-n:].mean() > 0.5:
            since = None  # what was refused has passed, and the filter was right
        if run.taken.any():
            last = float(ranges.t[first + np.flatnonzero(run.taken)[-1]])
        if done == len(events.t):
            break
        t = float(events.t[done])
        astray = is_astray(state)
        since = since if since is not None else last if astray else min(last, t - REFUSED)
        window = ranges.only(np.arange(before[done], len(ranges.t)))
        anew = restart_from(window, setup, state, astray) or nothing
        wait = t + AGAIN
        if anew is not nothing:
            lost.append(Lost(since, t))
            since = None
    if since is not None:
        lost.append(Lost(since, None))
    return parts, lost, state


def restart_from(ranges: Ranges, setup: Setup, state: State, astray: bool) -> Restart | None:
    """Return a restart by the ranges from now on; None if none suits them better than the filter's state.

    The opinion of one that is `astray` does not count.
    """
    anchors, levers, level = setup.anchors, setup.levers, setup.level
    R, c = matrix_of(state.x[Q : Q + 4]), state.x[nominal(BIASES) : nominal(BIASES) + len(anchors)]
    arm = R @ levers[0]
    p, v = state.x[:3], state.x[3:6]
    try:
        window = ranges_for_a_fix(ranges)
    except InputError:
        return None
    x, arms = np.concatenate((p + arm, v)), (levers[1:] - levers[0])[window.tag] @ R.T
    fix = solve_first_fix(window, anchors, c, level, p + arm, arms)
    if fix.agreeing < 0.5 or (not astray and fix.agreeing <= agreeing(window, anchors, c, x, arms)):
        return None
    found = fix.x - np.append(arm, np.zeros(3))
    return Restart(found, fix.variances, opening_of(state, found, fix.variances))
