"""Inputs, state and outputs of the filter on recorded events.

Shapes: n anchors, N = 17 + 2 n error states [dp, dv, theta, db_g, db_a, dc, dg, ds, dk], and a nominal state of N + 1
numbers in the order of onboard/estimator/tight/layout.py; see event_filter.py.
"""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.interop.recorded.map_file import FilterSettings, Start
from ortilo_drake.interop.recorded.recording import NO_AID_ROWS, ONE_TAG, AidRows
from ortilo_drake.model.pinhole import Camera
from ortilo_drake.onboard.estimator.tight.layout import ADDITIVE, GYRO, N_INERTIAL
from ortilo_drake.studies.recorded.at_rest import AtRest

# Kinds of events; events of one stamp follow in this order.
RATES, FORCE, LANDED, RANGE, FINDER, FLOW, BOXES, QUERY = range(8)
BIASES = N_INERTIAL  # where the anchors' constant errors begin in the error state
ENTRIES = 16  # entries of a row, at most
TRANSITION = N_INERTIAL + 1  # columns of a step's transition: the inertial errors, and the error of drag's k


def states(anchors: int) -> int:
    """Return the number of error states."""
    return BIASES + 2 * anchors + 2


@register_jitable
def nominal(i: int) -> int:
    """Return the index of an additive error state in the nominal state."""
    return ADDITIVE + i - GYRO


class SparseRow(NamedTuple):
    """A sparse row of H: indices and values of its entries (16 each), and C H^T (N)."""

    where: np.ndarray
    of: np.ndarray
    PHt: np.ndarray


class Events(NamedTuple):
    """The events of a recording, in order of time.

    t: stamp [s]; kind; which: index of the sample, anchor, flow or picture; other: the other anchor of a difference, or
    -1; r: range, difference, distance to the floor, or z of the landing place [m]; tag: of a range (n each).
    """

    t: np.ndarray
    kind: np.ndarray
    which: np.ndarray
    other: np.ndarray
    r: np.ndarray
    tag: np.ndarray


class EventValues(NamedTuple):
    """Values of the events: body rates [rad/s] (k, 3), force [m/s²] (l, 3), flow [px] (m, 2), boxes (q, ...)."""

    rates: np.ndarray
    force: np.ndarray
    flow: np.ndarray
    boxes: np.ndarray


class Noise(NamedTuple):
    """Noise of the filter; interop/recorded/map_file.py gives the units in FilterSettings."""

    acceleration: float
    rotation: float
    acceleration_bias: float
    rotation_bias: float
    range_white: float
    range_correlated: float
    correlation_time: float
    bias_walk: float
    gate: float
    huber: float = np.inf
    near_floor: float = 0.0
    range_tail: float = 0.0
    reflected: float = 0.0


def noise_of(s: FilterSettings, imu: bool) -> Noise:
    """Return the filter's noise by the map's settings; without an IMU, the constant-velocity filter's noise."""
    last = (np.inf if s.huber is None else s.huber, s.near_floor, s.range_tail, s.reflected)
    if imu:
        white = (s.acceleration, s.rotation, s.acceleration_bias, s.rotation_bias, s.range_white, s.range_correlated)
        return Noise(*white, s.correlation_time, s.bias_walk, s.gate, *last)
    return Noise(s.baseline_acceleration, 0.0, 0.0, 0.0, s.baseline_range, 0.0, 1.0, 0.0, s.baseline_gate, *last)


class Level(NamedTuple):
    """The known height: the antenna's z and its standard deviation [m], and the standard deviation of v_z = 0 [m/s].

    An infinite deviation means that nothing is known.
    """

    height: float
    deviation: float
    climb: float


UNKNOWN_LEVEL = Level(0.0, np.inf, np.inf)


class Sight(NamedTuple):
    """Landmarks and camera: positions (n, 3) and outlines (n, m, 3) in W, classes (n), and the camera.

    noise: the noise of take_boxes (3); gates: the largest squared innovations at which a box is taken, and at which it
    is associated with a landmark (2).
    """

    positions: np.ndarray
    outlines: np.ndarray
    labels: np.ndarray
    camera: Camera
    noise: np.ndarray
    gates: np.ndarray


NO_SIGHT = Sight(
    np.zeros((0, 3)),
    np.zeros((0, 1, 3)),
    np.zeros(0),
    Camera(np.zeros(3), 1.0, np.zeros(2), np.zeros(2)),
    np.zeros(3),
    np.zeros(2),
)


class Aids(NamedTuple):
    """Range finder, flow, drag and boxes.

    Attributes:
        floor: z of the floor [m].
        finder: position of the range finder in B (3) [m].
        finder_sd: noise of the range finder [m].
        pixels: flow in one interval at 1 rad/s [px s/rad].
        flow_sd: noise of the flow [px].
        drag: first k of the specific force -k v_B along x and y [1/s]; negative where the accelerometer is not doubted.
        drag_sd: white noise of that force [m/s²/√Hz].
        doubted: an accelerometer's sample farther from drag's force is not used [m/s²].
        sight: landmarks and camera.
    """

    floor: float
    finder: np.ndarray
    finder_sd: float
    pixels: float
    flow_sd: float
    drag: float
    drag_sd: float
    doubted: float
    sight: Sight = NO_SIGHT


NO_AIDS = Aids(0.0, np.zeros(3), np.inf, 0.0, np.inf, -1.0, 0.0, np.inf)


class Setup(NamedTuple):
    """The settings that hold throughout a run.

    Attributes:
        anchors: positions (n, 3).
        levers: from the estimated point to the tags' origin, and to each tag, body axes (1 + m, 3) [m].
        level: the known height.
        noise: the filter's noise.
        aids: range finder, flow, drag and boxes.
    """

    anchors: np.ndarray
    levers: np.ndarray
    level: Level
    noise: Noise
    aids: Aids


class FilterSetup(NamedTuple):
    """The filter's settings for one motion.

    Attributes:
        anchors: positions (n, 3) [m].
        biases: of the ranges by anchor (n) [m]; None estimates them online.
        lever: from the body's point to the antenna, body axes (3) [m].
        heading: at the start [rad], None if unknown.
        level: the known height.
        start: the vehicle's start, None if unknown.
        looks: rows of range finder, flow and camera.
        aids: parameters of these sensors and of drag.
        scale_sd: standard deviation of the flow's scale.
        k_sd: standard deviation of drag's k [1/s].
        rest: the imu's means at rest, after which the filter begins.
        tags: positions from the lever's end, body axes (m, 3) [m]; taken as 0 without an imu.
    """

    anchors: np.ndarray
    biases: np.ndarray | None
    lever: np.ndarray
    heading: float | None
    level: Level = UNKNOWN_LEVEL
    start: Start | None = None
    looks: AidRows = NO_AID_ROWS
    aids: Aids = NO_AIDS
    scale_sd: float = 0.0
    k_sd: float = 0.0
    rest: AtRest | None = None
    tags: np.ndarray = ONE_TAG


def setup_of(known: FilterSetup, settings: FilterSettings, imu: bool) -> Setup:
    """Return the settings that hold throughout a run, with or without an imu.

    Without an imu the attitude is not known, and all tags are taken to be at their origin.
    """
    noise, levers = noise_of(settings, imu), known.lever + np.vstack([np.zeros(3), known.tags * imu])
    if known.biases is not None:  # calibrated biases are held; only the correlated error wanders
        noise = noise._replace(bias_walk=0.0)
    return Setup(known.anchors, levers, known.level, noise, known.aids if imu else NO_AIDS)


class State(NamedTuple):
    """The filter between two events.

    t [s]; nominal x (N + 1); covariance C (N, N); held: the imu's samples that hold (6); watched (17), see imu_watch:
    whether the vehicle rests; the upward speed by its summed force [m/s]; the share of doubted samples, and the stamp
    since when the accelerometer is not used, inf if it is (2 each, x and y); how long that speed has been above 0 [s];
    the sum of force less drag [m/s], its duration [s], and the mean misfit of both (2 each); how much ranges change at
    rest; the last upward force at rest [m/s²], and its variance at first and lately [m²/s⁴].
    """

    t: float
    x: np.ndarray
    C: np.ndarray
    held: np.ndarray
    watched: np.ndarray


class Restart(NamedTuple):
    """Position and velocity (6) with variances (6) for a filter to start anew; `opening` is added to C's diagonal (N).

    They enter as measurements at the first epoch. An infinite variance means that there is no restart.
    """

    x: np.ndarray
    variances: np.ndarray
    opening: np.ndarray


class Tape(NamedTuple):
    """The record that a smoother goes back through: steps in time, rows and queries, in order.

    Attributes:
        what: kind of each entry: 0 a step, 1 a row, 2 a query (k).
        A: transition of each step, from the first fifteen errors and dk to the first nine errors (s, 9, 16).
        keeps: factor of each further error over the step (s, N - 9).
        where: indices of a row's entries (r, 16).
        row: values of the entries, 0 where there is none (r, 16).
        gain: K (r, N).
        e: innovation (r).
        S: variance of the innovation (r).
        C: first nine rows of the covariance at each query (q, 9, N).
    """

    what: np.ndarray
    A: np.ndarray
    keeps: np.ndarray
    where: np.ndarray
    row: np.ndarray
    gain: np.ndarray
    e: np.ndarray
    S: np.ndarray
    C: np.ndarray


class Run(NamedTuple):
    """The result of a run of the filter.

    x, P: nominal state (q, N + 1) and position's covariance (q, 3, 3) at each query; innovation, variance, taken: of
    each range, the innovation, its variance and whether the range was taken; tape: empty if nothing is to be smoothed.
    """

    x: np.ndarray
    P: np.ndarray
    innovation: np.ndarray
    variance: np.ndarray
    taken: np.ndarray
    tape: Tape
