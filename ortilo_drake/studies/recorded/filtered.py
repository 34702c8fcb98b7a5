"""A recorded motion through the filter: the start, the events in order, and the estimate at the stamps asked for."""

from functools import reduce
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.map_file import FilterSettings
from ortilo_drake.interop.recorded.recording import GRAVITY, Imu, Ranges
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.tight.inertial import matrix_of
from ortilo_drake.onboard.estimator.tight.layout import ADDITIVE, Q
from ortilo_drake.studies.recorded.at_rest import BIAS, correct_by_rest, first_tilt, tilt_deviation
from ortilo_drake.studies.recorded.filter_types import (
    BIASES,
    BOXES,
    FINDER,
    FLOW,
    FORCE,
    LANDED,
    QUERY,
    RANGE,
    RATES,
    Events,
    EventValues,
    FilterSetup,
    Setup,
    State,
    nominal,
    setup_of,
    states,
)
from ortilo_drake.studies.recorded.imu_watch import watched_from
from ortilo_drake.studies.recorded.landing import Landing, landings
from ortilo_drake.studies.recorded.reacquired import (
    Fix,
    Innovations,
    Lost,
    innovation_score,
    joined,
    ranges_for_a_fix,
    run_on,
    solve_first_fix,
)
from ortilo_drake.studies.recorded.run_tape import smooth

LEVEL, STANDS = 0.03, 0.1  # standard deviations of a tilt on the floor [rad] and of the velocity at a known start [m/s]
ANY_TILT = 1.0  # standard deviation of a tilt that only the force at rest tells [rad]
HEADINGS = 8  # headings tried where none is known
AGREES = 0.35  # two trials agree if their headings, carried back to the start, differ by less [rad]
TRIAL = 30.0  # duration of each trial [s]


class Begin(NamedTuple):
    """The filter's start: heading [rad], and the fix of the antenna if the ranges alone give one."""

    heading: float
    fix: Fix | None


class Estimate(NamedTuple):
    """The filter's position p (m, 3), its covariance P (m, 3, 3) and attitude R (m, 3, 3) at the stamps t (m) [s].

    run, range_stamps: the ranges' innovations and stamps; lost: when the filter was lost; failed: since when the
    accelerometer's x and y are not used [s], inf if they are; drag: k at the end and its standard deviation [1/s];
    begin: the filter's start.
    """

    t: np.ndarray
    p: np.ndarray
    P: np.ndarray
    R: np.ndarray
    run: Innovations
    range_stamps: np.ndarray
    lost: list[Lost]
    failed: tuple[float, float] = (np.inf, np.inf)
    drag: tuple[float, float] = (0.0, 0.0)
    begin: Begin = Begin(0.0, None)


def events_of(
    ranges: Ranges, imu: Imu | None, known: FilterSetup, queries: np.ndarray, begin: float
) -> tuple[Events, EventValues]:
    """Return the events from `begin` [s] on, in order; the imu's last sample before `begin` is stamped `begin`."""
    looks, start = known.looks, known.start
    rates = force = np.zeros((0, 3))
    parts = [
        _events(RANGE, ranges.t, ranges.anchor, ranges.other, ranges.r, ranges.tag),
        _events(FINDER, looks.finder_t, r=looks.distance),
        _events(FLOW, looks.flow_t, np.arange(len(looks.flow_t))),
        _events(BOXES, looks.boxes_t, np.arange(len(looks.boxes_t))),
        _events(QUERY, queries),
    ]
    if start is not None:
        parts.append(_events(LANDED, np.array([one.rests for one in _landings(imu, known)]), r=start.position[2]))
    if imu is not None:
        rates, (t_force, force) = imu.rates, imu.accelerometer or (imu.t, imu.force)
        for kind, stamps in ((RATES, imu.t), (FORCE, t_force)):
            first = max(0, int(np.searchsorted(stamps, begin, side="right")) - 1)
            parts.append(_events(kind, np.maximum(stamps[first:], begin), np.arange(first, len(stamps))))
    kinds, t, which, other, r, tag = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.lexsort((which, kinds, t))
    order = order[t[order] >= begin]
    which, other, tag = (part.astype(np.int64) for part in (which, other, tag))
    events = Events(*(part[order] for part in (t, kinds, which, other, r, tag)))
    heard = (np.ascontiguousarray(part) for part in (rates, force, looks.flow, looks.boxes))  # compiled once for all
    return events, EventValues(*heard)


def _landings(imu: Imu | None, known: FilterSetup) -> list[Landing]:
    return landings(imu) if imu is not None and known.start is not None and known.start.lands else []


def _events(kind: int, t: np.ndarray, *columns: np.ndarray, r: np.ndarray | float = 0.0) -> list[np.ndarray]:
    """Return kind, stamp, index, other anchor, number r and tag of the events of one kind (n each)."""
    whole = columns if len(columns) == 4 else (*(columns or (0,)), -1, r, 0)
    return [np.broadcast_to(column, len(t)) for column in (kind, t, *whole)]


def start_of(
    ranges: Ranges, imu: Imu | None, known: FilterSetup, settings: FilterSettings, begin: Begin, sure: bool
) -> State:
    """Return the state at the first range; `sure` says that the heading was given and not tried.

    Raises:
        InputError: if no start is known and fewer than three anchors are heard.
    """
    n = len(known.anchors)
    variances = np.zeros(states(n))
    c = np.zeros(n) if known.biases is None else known.biases.copy()
    R, rests = np.eye(3), known.start is not None and known.start.rests and imu is not None
    if imu is not None:
        level = np.eye(3) if rests else first_tilt(imu, known.rest)
        R = Rotation.from_rotvec([0.0, 0.0, begin.heading]).as_matrix() @ level
        up = known.start.heading_sd if known.start is not None else 0.1 if sure else 0.4
        by_force = known.rest is not None and imu.attitude is None
        tilt = LEVEL if rests else ANY_TILT if by_force else tilt_deviation(imu)
        tilts = R.T @ np.diag([tilt**2] * 2 + [up**2]) @ R  # theta is in B
        variances[6:9] = np.diag(tilts)
        variances[9:12], variances[12:15] = 0.01**2, BIAS**2
        variances[BIASES : BIASES + n] = settings.bias_start**2 if known.biases is None else 0.0
        variances[BIASES + n : -2] = settings.range_correlated**2
    variances[-2:] = known.scale_sd**2, known.k_sd**2 if imu is not None else 0.0
    if known.start is None:
        fix = begin.fix or _fix_of(ranges, known, R if imu is not None else np.zeros((3, 3)))
        place, variances[:6] = fix.x.copy(), fix.variances
        place[:3] -= R @ known.lever
    else:
        place = np.append(known.start.position, np.zeros(3))
        variances[:3], variances[3:6] = known.start.position_sd**2, 0.0 if known.start.rests else STANDS**2
    x = np.zeros(len(variances) + 1)
    x[:6] = place
    x[Q:ADDITIVE] = Rotation.from_matrix(R).as_quat(scalar_first=True)
    x[nominal(BIASES) : nominal(BIASES) + n], x[-1] = c, known.aids.drag
    C = np.diag(variances)
    if imu is not None:
        C[6:9, 6:9] = tilts
        if known.rest is not None:
            correct_by_rest(known.rest, x, C)
            R = matrix_of(x[Q:ADDITIVE])
    at_rest = np.append(np.zeros(3), R.T @ [0.0, 0.0, GRAVITY])  # holds until the first sample, and without any
    return State(float(ranges.t[0]), x, C, at_rest, watched_from(rests))


def _fix_of(ranges: Ranges, known: FilterSetup, R: np.ndarray) -> Fix:
    """Return position and velocity at the first range; R turns the tags' positions into W, 0 if it is unknown."""
    window = ranges_for_a_fix(ranges)
    c = np.zeros(len(known.anchors)) if known.biases is None else known.biases
    return solve_first_fix(window, known.anchors, c, known.level, arms=known.tags[window.tag] @ R.T)


def begin_of(
    ranges: Ranges,
    imu: Imu | None,
    known: FilterSetup,
    settings: FilterSettings,
    setup: Setup,
    events: Events,
    heard: EventValues,
) -> Begin:
    """Return the filter's start: its heading is 0 without an IMU, else the known one, else found by eight trials.

    A trial runs over the first TRIAL seconds. Most trials end with the right heading, whatever heading they began with.
    So the final headings are carried back by the body rates, and the one that more than half of the trials agree on is
    taken; else the heading of the likeliest innovations. Arguments as in `estimate`; events from the first range on.
    """
    by_ranges = known.start is None and not known.tags.any()  # else the fix depends on the heading, or none is needed
    fix = _fix_of(ranges, known, np.eye(3)) if by_ranges else None
    if known.heading is not None or imu is None:
        return Begin(known.heading or 0.0, fix)
    events = Events(*(part[events.t <= ranges.t[0] + TRIAL] for part in events))

    def tried(heading: float) -> tuple[float, float]:
        """Return the score of a heading, and the trial's final heading carried back to the start by the body rates."""
        start = start_of(ranges, imu, known, settings, Begin(heading, fix), False)
        runs, _, end = run_on(events, heard, start, setup, np.inf, False)  # a restart would mend a wrong heading
        score = innovation_score(joined(runs), setup.noise.gate)
        if not np.isfinite(end.x).all() or not end.x[Q:ADDITIVE].any():
            return -np.inf, heading
        R = matrix_of(end.x[Q:ADDITIVE]) @ turned_by(events, heard, end.x[Q + 4 : Q + 7]).T
        return score, float(np.arctan2(R[1, 0], R[0, 0]))

    headings = np.arange(HEADINGS) * 2.0 * np.pi / HEADINGS
    scores, ends = np.transpose([tried(heading) for heading in headings])
    apart = np.abs(np.angle(np.exp(1j * (ends[:, None] - ends))))
    middle = int(np.argmin(apart.sum(axis=0)))  # the circle's median
    if np.sum(apart[middle] < AGREES) > HEADINGS / 2:
        return Begin(float(ends[middle]), fix)
    return Begin(float(headings[int(np.argmax(scores))]), fix)


def turned_by(events: Events, heard: EventValues, bias: np.ndarray) -> np.ndarray:
    """Return the rotation from the last body axes to the first (3, 3), integrated from the rates less their bias."""
    at = np.flatnonzero(events.kind == RATES)
    steps = (heard.rates[events.which[at]] - bias) * np.diff(events.t[at], append=events.t[-1])[:, None]
    return reduce(np.matmul, Rotation.from_rotvec(steps).as_matrix(), np.eye(3))


def estimate(
    ranges: Ranges,
    imu: Imu | None,
    known: FilterSetup,
    settings: FilterSettings,
    queries: np.ndarray,
    smoothed: bool = False,
    begin: Begin | None = None,
) -> Estimate:
    """Run the filter and return its estimates at the stamps `queries` [s], which increase, from the first range on.

    With an IMU that stood still, the filter begins with the first range after the standstill. Without an IMU it is the
    constant-velocity filter. `begin`, if given, is the start of an earlier run, which is then not searched again.

    Raises:
        InputError: if fewer than three anchors are heard at the start, or the filter diverges.
    """
    if imu is not None and known.rest is not None:
        ranges = ranges.only(np.flatnonzero(ranges.t >= known.rest.end))
    if not len(ranges.t):
        raise InputError("ranges: none are left")
    first = float(ranges.t[0])
    queries = queries[queries >= first]
    if smoothed:  # between touching and rest the filter does not know that it has landed
        for one in _landings(imu, known):
            ranges = ranges.only((ranges.t <= one.touched) | (ranges.t > one.rests))
    setup = setup_of(known, settings, imu is not None)
    events, heard = events_of(ranges, imu, known, queries, first)
    begin = begin or begin_of(ranges, imu, known, settings, setup, events, heard)
    start = start_of(ranges, imu, known, settings, begin, known.heading is not None)
    runs, lost, end = run_on(events, heard, start, setup, -np.inf, smoothed)
    x, P = smooth(runs) if smoothed else map(np.concatenate, zip(*(run[:2] for run in runs), strict=True))
    if not (np.isfinite(x).all() and (np.einsum("kii->ki", P) >= 0.0).all() and x[:, Q:ADDITIVE].any(axis=1).all()):
        raise InputError("the filter diverged: its numbers are none any more")
    R = Rotation.from_quat(x[:, Q:ADDITIVE], scalar_first=True).as_matrix() if len(x) else np.zeros((0, 3, 3))
    failed = (float(end.watched[4]), float(end.watched[5]))
    drag = (float(end.x[-1]), float(np.sqrt(end.C[-1, -1])))
    return Estimate(queries, x[:, :3], P, R, joined(runs), ranges.t, lost, failed, drag, begin)
