"""A recorded motion through the filter: the start, the events in order, and the estimate at the stamps asked for."""

from typing import NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.map_file import FilterSettings
from ortilo_drake.interop.recorded.recording import GRAVITY, Imu, Ranges
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.recorded.filter_types import (
    FIXED,
    IMU,
    QUERY,
    RANGE,
    UNKNOWN_LEVEL,
    Events,
    Level,
    Noise,
    Run,
    State,
)
from ortilo_drake.studies.recorded.first_fix import fix_of, ranges_for_a_fix
from ortilo_drake.studies.recorded.propagation import turn
from ortilo_drake.studies.recorded.reacquired import NEVER, WATCH, Lost, run_on
from ortilo_drake.studies.recorded.smoother import smooth

TILT, BIAS = 0.05, 0.3  # standard deviations of a tilt [rad] and of the accelerometer's bias [m/s²]
AT_REST = 1.0  # the first samples tell how the body is tilted [s]
HEADINGS = 8  # tried, where none is known
TRIAL = 30.0  # how long each is tried [s]


class Known(NamedTuple):
    """What the filter is told.

    anchors (n, 3), biases (n) or None (online), lever (3), heading [rad] or None, and what is known of the height.
    """

    anchors: np.ndarray
    biases: np.ndarray | None
    lever: np.ndarray
    heading: float | None
    level: Level = UNKNOWN_LEVEL


class Estimate(NamedTuple):
    """At the stamps asked for: position (m, 3), covariance (m, 3, 3), attitude (m, 3, 3).

    Then the run behind it, the stamps of its ranges, and when the filter was lost.
    """

    t: np.ndarray
    p: np.ndarray
    P: np.ndarray
    R: np.ndarray
    run: Run
    range_stamps: np.ndarray
    lost: list[Lost]


def noise_of(settings: FilterSettings, imu: bool) -> Noise:
    """Return the filter's noise; without an IMU that of the constant-velocity filter."""
    s = settings
    if imu:
        white = (s.acceleration, s.rotation, s.acceleration_bias, s.rotation_bias, s.range_white, s.range_correlated)
        return Noise(*white, s.correlation_time, s.bias_walk, s.gate)
    return Noise(s.baseline_acceleration, 0.0, 0.0, 0.0, s.baseline_range, 0.0, 1.0, 0.0, s.baseline_gate)


def first_tilt(imu: Imu) -> np.ndarray:
    """Return the attitude with heading 0 (3, 3): the unit's own tilt if it computes one, else the specific force's."""
    early = imu.t <= imu.t[0] + AT_REST
    up_B = imu.force[early].mean(axis=0) if imu.attitude is None else imu.attitude[early][:, 2, :].mean(axis=0)
    up_B = up_B / np.linalg.norm(up_B)
    forward = np.array([1.0, 0.0, 0.0]) - up_B[0] * up_B
    forward = forward / np.linalg.norm(forward)
    return np.vstack([forward, np.cross(up_B, forward), up_B])


def tilt_deviation(imu: Imu) -> float:
    """Return the standard deviation of that tilt [rad]: larger where the body accelerates meanwhile.

    A horizontal acceleration a turns the specific force by a / G and makes it sqrt(G² + a²), which a bias may do too.
    """
    if imu.attitude is not None:
        return TILT
    force = float(np.linalg.norm(imu.force[imu.t <= imu.t[0] + AT_REST].mean(axis=0)))
    return max(TILT, float(np.sqrt(max(0.0, force**2 - (GRAVITY + BIAS) ** 2))) / GRAVITY)


def tilt_disagreement(imu: Imu) -> float | None:
    """Return the angle between the unit's own up and the specific force at the start [rad]; None if it has none."""
    if imu.attitude is None:
        return None
    force = imu.force[imu.t <= imu.t[0] + AT_REST].mean(axis=0)
    return float(np.arccos(np.clip(first_tilt(imu)[2] @ force / np.linalg.norm(force), -1.0, 1.0)))


def _since(imu: Imu, begin: float) -> Imu:
    """Return the samples from the first range on; the one before it is still held then."""
    held = max(0, int(np.searchsorted(imu.t, begin, side="right")) - 1)
    attitude = None if imu.attitude is None else imu.attitude[held:]
    return Imu(np.maximum(imu.t[held:], begin), imu.rates[held:], imu.force[held:], attitude)


def _events(ranges: Ranges, imu: Imu | None, queries: np.ndarray, begin: float) -> Events:
    parts = [(ranges.t, RANGE, ranges.anchor, ranges.r), (queries, QUERY, np.zeros(len(queries), int), 0.0 * queries)]
    if imu is not None:
        parts.append((imu.t, IMU, np.arange(len(imu.t)), 0.0 * imu.t))
    t = np.concatenate([part[0] for part in parts])
    kind = np.concatenate([np.full(len(part[0]), part[1]) for part in parts])
    index = np.concatenate([part[2] for part in parts]).astype(np.int64)
    r = np.concatenate([part[3] for part in parts])
    order = np.lexsort((index, kind, t))
    order = order[t[order] >= begin]
    return Events(t[order], kind[order], index[order], r[order])


def _start(
    ranges: Ranges, imu: Imu | None, known: Known, settings: FilterSettings, heading: float, sure: bool
) -> State:
    n = len(known.anchors)
    variances = np.zeros(FIXED + 2 * n)
    c = np.zeros(n) if known.biases is None else known.biases.copy()
    R = np.eye(3)
    if imu is not None:
        R = turn(np.array([0.0, 0.0, heading])) @ first_tilt(imu)
        variances[6:8], variances[8] = tilt_deviation(imu) ** 2, (0.1 if sure else 0.4) ** 2
        variances[9:12], variances[12:15] = 0.01**2, BIAS**2
        variances[FIXED : FIXED + n] = settings.bias_start**2 if known.biases is None else 0.0
        variances[FIXED + n :] = settings.range_correlated**2
    fix = fix_of(ranges_for_a_fix(ranges), known.anchors, c, known.level)
    variances[:6] = fix.variances
    zero, N = np.zeros(3), len(variances)
    at_rest = np.append(zero, R.T @ [0.0, 0.0, GRAVITY])  # holds until the first sample, and without any
    p, v, P = fix.x[:3] - R @ known.lever, fix.x[3:], np.diag(variances)
    return State(float(ranges.t[0]), p, v, R, zero, zero.copy(), c, np.zeros(n), P, at_rest, np.eye(N))


def innovation_score(run: Run, gate: float) -> float:
    """Return the log-likelihood of the innovations, each counted at most as if it lay on the gate."""
    return float(-0.5 * np.sum(np.log(run.variance) + np.minimum(run.innovation**2 / run.variance, gate**2)))


def estimate(
    ranges: Ranges,
    imu: Imu | None,
    known: Known,
    settings: FilterSettings,
    queries: np.ndarray,
    smoothed: bool = False,
    noise: Noise | None = None,
) -> Estimate:
    """Run the filter and return its estimates at the stamps asked for, those at or after the first range.

    Args:
        ranges: single ranges.
        imu: its samples; None flies the constant-velocity filter.
        known: what the filter is told.
        settings: noise and gate.
        queries: stamps, rising [s].
        smoothed: whether to smooth.
        noise: in place of the settings' noise.

    Raises:
        InputError: if fewer than three anchors are heard at the start.
    """
    if not len(ranges.t):
        raise InputError("ranges: none are left")
    begin = float(ranges.t[0])
    queries = queries[queries >= begin]
    noise = noise_of(settings, imu is not None) if noise is None else noise
    if known.biases is not None:  # calibrated ones are held: what wanders is the correlated error
        noise = noise._replace(bias_walk=0.0)
    imu = None if imu is None else _since(imu, begin)
    samples = np.zeros((0, 6)) if imu is None else np.column_stack([imu.rates, imu.force])

    def run(heading: float, sure: bool, until: float, whole: bool) -> tuple[Run, list[Lost]]:
        events = _events(ranges, imu, queries, begin)
        events = Events(*(part[events.t <= until] for part in events))
        start = _start(ranges, imu, known, settings, heading, sure)
        watch = WATCH if until == np.inf else NEVER  # a wrong heading must not be mended while it is tried
        return run_on(events, samples, known.anchors, known.lever, start, known.level, noise, watch, whole)

    heading = known.heading
    if heading is None:
        tried = np.arange(HEADINGS) * 2.0 * np.pi / HEADINGS if imu is not None else np.zeros(1)
        scores = [innovation_score(run(h, False, begin + TRIAL, False)[0], noise.gate) for h in tried]
        heading = float(tried[int(np.argmax(scores))])
    found, lost = run(heading, known.heading is not None, np.inf, smoothed)
    at = np.searchsorted(found.t, queries)
    p, R, P = (smooth(found)) if smoothed else (found.x[:, :3], found.R, found.P)
    return Estimate(queries, p[at], P[at], R[at], found, ranges.t, lost)
