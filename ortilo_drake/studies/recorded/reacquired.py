"""The filter's start, and its restart where it is lost, by the ranges of a short time alone.

After an outage the position's deviation is metres and more. A range's row, linearised at the filter's position, then
points the wrong way: the filter becomes certain of a wrong place and refuses every range for ever. So position and
velocity are found anew before the first range after such an outage, and where most anchors were refused for a second.
This fix enters as a measurement; variances in P that contradict it are widened first. The fix is not used if fewer
ranges agree with it than with the filter: then the ranges are wrong, not the filter.

A fix is the antenna's p and v at the first stamp t_0, robust against single ranges that are far too long:

    minimise  Σ rho((|p + v (t_k - t_0) - a_i| + c_i - r_k) / 0.1 m) + |v|² / (2 m/s)²,   rho = soft L1, then Cauchy

and, where the height is known or constant, (z - height)² / sd² and v_z² / sd². A vehicle may move at the first stamp.
Three anchors, or anchors in one plane, leave a mirror image. Then the place near the last estimate is taken, or at the
start the place near z = 0.5 m: no vehicle is under the floor, and few are above the ceiling. Anchors almost in one
plane leave a local minimum on its wrong side: the search starts near the plane and far from it, on both sides.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from ortilo_drake.interop.recorded.recording import Ranges
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.tight.inertial import matrix_of
from ortilo_drake.onboard.estimator.tight.layout import Q
from ortilo_drake.studies.recorded.anchor_trust import ASTRAY, REFUSED
from ortilo_drake.studies.recorded.event_filter import initial_carried, run_filter
from ortilo_drake.studies.recorded.filter_types import (
    BIASES,
    RANGE,
    UNKNOWN_LEVEL,
    Events,
    EventValues,
    Level,
    Restart,
    Run,
    Setup,
    State,
    nominal,
)
from ortilo_drake.studies.recorded.truth_path import modelled

AGAIN = 1.0  # time before the next trial [s]
SURPRISE = 3.0  # standard deviations beyond which a fix contradicts the filter
TILT, HEADING, GYRO, ACCELEROMETER = 0.1, 0.3, 0.01, 0.1  # deviations added then [rad, rad, rad/s, m/s²]
FIRST_RANGES = 1.0  # duration of the ranges in a fix [s]
LONGEST = 3.0  # duration with slow ranges, until enough anchors are heard, at most [s]
ENOUGH, LEAST = 4, 3  # anchors that are enough, and that a fix needs
SPREAD, SPEED = 0.1, 2.0  # standard deviations of a range's error [m] and of a velocity [m/s]
CHANGE = 1.0  # change of the velocity within a second [m/s]
SURE = 0.3  # least standard deviation of a fix: its ranges are also filtered afterwards [m], [m/s]
UNSEEN = 1.0  # largest deviation by the fit: the vehicle is in the room, even if no range tells its height [m], [m/s]
FITS = 0.3  # a range agrees if its error is smaller [m]
FLOOR = 0.5  # of two mirror images, the one near this height is taken at the start [m]
STARTS = (-1.5, -0.5, 0.5, 1.5)  # starts of the search, from the anchors' mean along the normal of their plane [m]
MIRROR = 3.0  # two positions whose costs differ by less cannot be told apart

Arms = np.ndarray | float


class Innovations(NamedTuple):
    """The innovation of each range [m], its variance [m²], and whether the range was taken (n each)."""

    innovation: np.ndarray
    variance: np.ndarray
    taken: np.ndarray


class Lost(NamedTuple):
    """The times at which the filter was lost and found again [s]; `found` is None if it stayed lost."""

    since: float
    found: float | None


def opening_of(state: State, x: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """Return the addition to P's diagonal (N) with which position and velocity x (6) do not contradict the state."""
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
    """Return whether the position's deviation is so large that ranges can no longer correct it."""
    return bool(np.trace(state.C[:3, :3]) > ASTRAY**2)


def run_on(
    events: Events, heard_all: EventValues, start: State, setup: Setup, wait: float, whole: bool
) -> tuple[list[Run], list[Lost], State]:
    """Run the filter over all events; return the runs between its starts, the times it was lost, and its last state.

    Arguments as in `run_filter`; an infinite wait prevents restarts.
    """
    heard = events.kind == RANGE
    ranges = Ranges(*(part[heard] for part in (events.t, events.which, events.r, events.other, events.tag)))
    before = np.concatenate([[0], np.cumsum(heard)])  # ranges before each event
    n, nothing = len(setup.anchors), no_restart(len(start.C))
    parts: list[Run] = []
    lost: list[Lost] = []
    state, anew, done, since = start, nothing, 0, None
    last = float(events.t[0])  # stamp of the last range that was taken
    while True:
        rest = Events(*(part[done:] for part in events))
        first = before[done]
        carried = initial_carried(n, len(state.C), state.t)
        run, state, taken_in = run_filter(rest, heard_all, state, carried, anew, setup, wait, whole)
        parts.append(run)
        done += taken_in
        if since is not None and run.taken[-n:].mean() > 0.5:
            since = None  # wrong ranges have passed, and the filter was right
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


def joined(runs: list[Run]) -> Innovations:
    """Return the innovations of all runs, in one record and in order."""
    return Innovations(*(np.concatenate(part) for part in zip(*(run[2:5] for run in runs), strict=True)))


def innovation_score(run: Innovations, gate: float) -> float:
    """Return the log-likelihood of the innovations, each counted at most as if it lay on the gate."""
    if not (run.variance > 0.0).all():  # the filter diverged
        return -np.inf
    return float(-0.5 * np.sum(np.log(run.variance) + np.minimum(run.innovation**2 / run.variance, gate**2)))


def restart_from(ranges: Ranges, setup: Setup, state: State, astray: bool) -> Restart | None:
    """Return a restart by the ranges from now on; None if no restart fits them better than the filter's state does.

    An `astray` state is not compared.
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


class Fix(NamedTuple):
    """Position and velocity of the antenna (6), their variances (6), and the share of ranges that agree."""

    x: np.ndarray
    variances: np.ndarray
    agreeing: float


def ranges_for_a_fix(ranges: Ranges) -> Ranges:
    """Return the first ranges, which a fix uses: one second of them, or up to three seconds if they are slow.

    Raises:
        InputError: if fewer than three anchors are heard in that time.
    """
    t = ranges.t[: np.searchsorted(ranges.t, ranges.t[0] + LONGEST, side="right")]
    _, at = np.unique(ranges.anchor[: len(t)], return_index=True)
    if len(at) < LEAST:
        raise InputError(f"ranges: {len(at)} anchors heard in the first {LONGEST:g} s, at least {LEAST} are needed")
    enough = t[np.sort(at)[min(ENOUGH, len(at)) - 1]]
    last = int(np.searchsorted(t, max(t[0] + FIRST_RANGES, enough), side="right"))
    return Ranges(*(part[:last] for part in ranges))


def fix_known_at(ranges: Ranges) -> float:
    """Return the end of ranges_for_a_fix [s], by the ranges received so far."""
    first = float(ranges.t[0])
    near = ranges.t <= first + LONGEST
    _, at = np.unique(ranges.anchor[near], return_index=True)
    if len(at) < ENOUGH:
        return first + LONGEST
    return max(first + FIRST_RANGES, float(ranges.t[np.sort(at)[ENOUGH - 1]]))


def agreeing(ranges: Ranges, anchors: np.ndarray, c: np.ndarray, x: np.ndarray, arms: Arms = 0.0) -> float:
    """Return the share of ranges that agree with position and velocity x (6) at the first stamp."""
    return float(np.mean(np.abs(_errors(ranges, anchors, c, x, arms)) < FITS))


def _errors(ranges: Ranges, anchors: np.ndarray, c: np.ndarray, x: np.ndarray, arms: Arms) -> np.ndarray:
    return modelled(x[:3] + (ranges.t - ranges.t[0])[:, None] * x[3:] + arms, anchors, c, ranges) - ranges.r


def solve_first_fix(
    ranges: Ranges,
    anchors: np.ndarray,
    c: np.ndarray,
    level: Level = UNKNOWN_LEVEL,
    near: np.ndarray | None = None,
    arms: Arms = 0.0,
) -> Fix:
    """Return position and velocity of the antenna at the first stamp.

    Args:
        ranges: of a short time (m).
        anchors: positions (n, 3).
        c: biases of the ranges (n) [m].
        level: the known height.
        near: the last known position (3); None at the start.
        arms: from the antenna to the tag of each range, in W (m, 3); 0 with a single tag.
    """

    def residuals(x: np.ndarray) -> np.ndarray:
        known = [(x[2] - level.height) / level.deviation, x[5] / level.climb]
        return np.concatenate([_errors(ranges, anchors, c, x, arms) / SPREAD, x[3:] / SPEED, known])

    def solved(start: np.ndarray, loss: str) -> tuple[float, np.ndarray, np.ndarray]:
        found = least_squares(residuals, start, loss=loss)
        return float(found.cost), found.x, found.jac

    heard = anchors[np.unique(ranges.anchor)]
    middle = heard.mean(axis=0)
    normal = np.linalg.svd(heard - middle)[2][2]
    fits = [solved(np.append(middle + step * normal, np.zeros(3)), "soft_l1") for step in STARTS]
    best = min(fits, key=lambda found: found[0])
    near = np.array([*middle[:2], FLOOR]) if near is None else near
    nearest = min(fits, key=lambda found: float(np.linalg.norm(found[1][:3] - near)))
    best = nearest if nearest[0] < best[0] + MIRROR else best
    _, x, jacobian = solved(best[1], "cauchy")
    span = ranges.t[-1] - ranges.t[0]
    variances = np.minimum(np.diag(np.linalg.pinv(jacobian.T @ jacobian)), UNSEEN**2) + SURE**2
    variances[3:] += (CHANGE * span / 2.0) ** 2
    return Fix(x, variances, agreeing(ranges, anchors, c, x, arms))
