"""The error of the heading, by whether the imu accelerates in the direction that the ranges tell.

This Kalman filter runs beside the main one. No wrong heading misleads it, because it is linear in cos and sin of the
heading error psi. R_0 is the attitude by the body rates alone, from the main filter's start on, levelled slowly by the
force; J is a quarter turn about z. With a_0 = R_0 f - g e_z, (c, s) = (cos psi, sin psi), h the horizontal part,

    p' = v,   v' = c a_0h + s J a_0h + b,   b' = r,   v_z' = a_0z + b_z
    range to anchor i = |p + c (R_0 l)_h + s J (R_0 l)_h + (R_0 l)_z e_z - a_i| + white

b is the acceleration error of a wrong level and of the accelerometer's bias; its rate r comes from the gyro's bias and
turns with the body. (c, s) is free and begins at (0, 0). Its length is a check of its own: 1 if all else is right. Its
direction is known only if the vehicle accelerates sideways or, by the lever, turns.
"""

from typing import Final, NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.onboard.estimator.tight.inertial import matrix_of, turn
from ortilo_drake.onboard.estimator.tight.layout import ADDITIVE, Q, V
from ortilo_drake.studies.recorded.filter_types import FORCE, RANGE, RATES, Events, EventValues, State

CS, B, R = 6, 8, 11  # indices of (c, s), b and r in the state, after p and v
SIZE: Final = 13
LEVELS: Final = 20.0  # time constant of levelling R_0 by the force: no room is long enough to accelerate so long [s]
GAP: Final = 0.5  # after a longer time without the imu, R_0 is unknown [s]
SILENT: Final = 1.5  # after a longer time without ranges, the position is unknown [s]
# Standard deviations at the start, and random walks [their units / √s].
FIRST: Final = np.array([0.5, 0.5, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0, 0.5, 0.5, 0.3, 0.05, 0.05])
WALKS: Final = np.array([0.0, 0.0, 0.0, 0.1, 0.1, 0.1, 0.01, 0.01, 0.03, 0.03, 0.03, 0.003, 0.003])
EYE: Final = np.eye(3)
HUBER: Final = 2.0  # innovations beyond so many standard deviations have less weight
MOST: Final = 9.0  # bound of an e²/S in its mean
MEMORY: Final = 300.0  # ranges over which the mean of e²/S is taken
T, FORCE_AT, RATES_AT, SQUARE, SEEN, RANGE_AT, LIKELY = range(7)  # indices into `marks`


class Ranging(NamedTuple):
    """Anchors (n, 3), biases of their ranges (n), the tags' levers (1 + m, 3), a range's standard deviation [m]."""

    anchors: np.ndarray
    biases: np.ndarray
    levers: np.ndarray
    sd: float


class TurnFilter(NamedTuple):
    """The turn filter; its arrays change.

    State z (13) and covariance C (13, 13); R_0 as a quaternion q (4); held: the imu's samples that hold (6); the gyro's
    bias (3); marks (7): the stamp, the stamps of the last force and rates [s], the mean of e²/S, the number of ranges,
    the last range's stamp [s], and the ranges' log-likelihood; axes (3, 3) by which the rates are turned.
    """

    z: np.ndarray
    C: np.ndarray
    q: np.ndarray
    held: np.ndarray
    bias: np.ndarray
    marks: np.ndarray
    axes: np.ndarray


class Turn(NamedTuple):
    """The turn of R_0 about z [rad], its standard deviation [rad], and the length of (c, s)."""

    angle: float
    sd: float
    length: float


def turn_filter(start: State, axes: np.ndarray = EYE) -> TurnFilter:
    """Return a turn filter that begins at a main filter's state; `axes` (3, 3) turns, and may scale, the body rates."""
    z = np.concatenate((start.x[: V + 3], np.zeros(SIZE - V - 3)))
    marks = np.array([start.t, start.t, start.t, 1.0, 0.0, start.t, 0.0])
    held, bias = start.held.copy(), start.x[ADDITIVE : ADDITIVE + 3].copy()
    return TurnFilter(z, np.diag(FIRST**2), start.x[Q:ADDITIVE].copy(), held, bias, marks, axes)


def turn_found(one: TurnFilter) -> Turn:
    """Return the turn that the filter has found; a mean of e²/S above 1 widens its deviation."""
    c, s = one.z[CS : CS + 2]
    length = max(float(np.hypot(c, s)), 1e-9)
    across = np.array([-s, c]) / length
    variance = across @ one.C[CS : CS + 2, CS : CS + 2] @ across * max(1.0, one.marks[SQUARE])
    return Turn(float(np.arctan2(s, c)), float(np.sqrt(variance)) / length, length)


@register_jitable
def _propagate(one: TurnFilter, F: np.ndarray, h: float) -> None:
    """Propagate by h [s]; F (13, 13) is the unit matrix or an earlier step's transition; changed."""
    z, held = one.z, one.held
    R_0 = matrix_of(one.q)
    a = R_0 @ held[3:]
    a[2] -= GRAVITY
    w = one.axes @ (held[:3] - one.bias)
    spin = h * (R_0[2] @ w)
    by = h * (w + np.cross(held[3:], R_0[2]) / (GRAVITY * LEVELS))
    turn(one.q, by[0], by[1], by[2])
    for i in range(3):
        F[i, 3 + i], F[i, B + i], F[3 + i, B + i] = h, 0.5 * h * h, h
    for i in range(2):
        along, across = a[i], -a[1] if i == 0 else a[0]
        F[i, CS], F[i, CS + 1] = 0.5 * h * h * along, 0.5 * h * h * across
        F[3 + i, CS], F[3 + i, CS + 1] = h * along, h * across
        F[B + i, R + i] = h
    F[R, R + 1], F[R + 1, R] = -spin, spin
    z[:] = F @ z
    z[2] += 0.5 * h * h * a[2]
    z[5] += h * a[2]
    one.C[:] = F @ one.C @ F.T
    for i in range(SIZE):
        one.C[i, i] += WALKS[i] ** 2 * h


@register_jitable
def _take_range(one: TurnFilter, ranging: Ranging, r: float, b: int, a: int, tag: int) -> None:
    """Take a range r_b to anchor b, or the difference r_b - r_a if a >= 0 [m]."""
    z, C, marks = one.z, one.C, one.marks
    arm = matrix_of(one.q) @ ranging.levers[1 + tag]
    c, s = z[CS], z[CS + 1]
    p = z[:3] + np.array([c * arm[0] - s * arm[1], c * arm[1] + s * arm[0], arm[2]])
    H, e = np.zeros(SIZE), r
    for sign, i in ((1.0, b), (-1.0, a)):
        if i >= 0:
            d = p - ranging.anchors[i]
            size = max(np.sqrt(d @ d), 1e-6)
            e -= sign * (size + ranging.biases[i])
            H[:3] += sign * d / size
    H[CS], H[CS + 1] = H[0] * arm[0] + H[1] * arm[1], H[1] * arm[0] - H[0] * arm[1]
    CH, variance = C @ H, ranging.sd**2
    S = H @ CH + variance
    squared = e * e / S
    marks[SQUARE] += (min(squared, MOST) - marks[SQUARE]) / min(MEMORY, 1.0 + marks[SEEN])
    marks[SEEN] += 1.0
    marks[LIKELY] -= 0.5 * (np.log(S) + min(squared, MOST))
    if squared > HUBER**2:
        S += variance * (np.sqrt(squared) / HUBER - 1.0)
    z += CH * (e / S)
    C -= np.outer(CH, CH) / S


@cached_njit
def follow(one: TurnFilter, events: Events, heard: EventValues, ranging: Ranging) -> bool:
    """Take events in, in order; stop and return False if imu or ranges were silent for too long."""
    marks, F = one.marks, np.eye(SIZE)
    for k in range(len(events.t)):
        kind, t = events.kind[k], events.t[k]
        if kind != RATES and kind != FORCE and kind != RANGE:
            continue
        if t > marks[T]:
            if t - min(marks[FORCE_AT], marks[RATES_AT]) > GAP:
                return False
            _propagate(one, F, t - marks[T])
            marks[T] = t
        if kind == RATES:
            one.held[:3], marks[RATES_AT] = heard.rates[events.which[k]], t
        elif kind == FORCE:
            one.held[3:], marks[FORCE_AT] = heard.force[events.which[k]], t
        else:
            if t - marks[RANGE_AT] > SILENT:
                return False
            marks[RANGE_AT] = t
            _take_range(one, ranging, events.r[k], events.which[k], events.other[k], events.tag[k])
    return True
