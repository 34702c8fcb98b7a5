"""Sensors beside uwb, camera and imu in a compiled flight: any whose description has a compiled share.

What it measures and how it is solved are functions of that description (model/parts.py, Compiled); numba takes them by
the class of the numbers that they are given. Sensors and what they keep stand in tuples of the same order.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numba.extending import overload, register_jitable

from ortilo_drake.flight.compiled.constants import OtherConstants
from ortilo_drake.flight.compiled.faults import is_read_anyway, spoil
from ortilo_drake.flight.compiled.kept import SensorMemory, first_of_sensor
from ortilo_drake.flight.compiled.links import delay_through, deliver, step_chain
from ortilo_drake.flight.compiled.past import belief_about
from ortilo_drake.flight.compiled.robust import RobustConstants, hear
from ortilo_drake.flight.compiled.slow import add_errors, seen_by, step_slow
from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.parts import Compiled
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import ARRIVED, N_XBAR, PAYLOAD, STAMP
from ortilo_drake.onboard.estimator.late_measurements import Slot
from ortilo_drake.world.noise import put_normals
from ortilo_drake.world.radio.link import NOT_SENT

_SHARES: dict[type, Compiled] = {}  # by the class of their numbers


def remember(numbers: Any, share: Compiled) -> None:
    """Have numbers of that class measured and solved by a share's functions."""
    _SHARES[type(numbers)] = share


def measured(numbers: Any, x: np.ndarray, v: np.ndarray, t: float) -> np.ndarray:
    """Return Compiled.measure of the numbers' sensor; for compiled functions alone."""
    raise TypeError("measured: for compiled functions alone")


def solved(numbers: Any, payload: np.ndarray, xhat: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Return Compiled.solve of the numbers' sensor, its payload where it has none; for compiled functions alone."""
    raise TypeError("solved: for compiled functions alone")


def _choose_measure(numbers: Any, x: Any, v: Any, t: Any) -> Callable[..., Any]:
    measure = _SHARES[numbers.instance_class].measure
    return lambda numbers, x, v, t: measure(numbers, x, v, t)


def _choose_solve(numbers: Any, payload: Any, xhat: Any, P: Any) -> Callable[..., Any]:
    solve = _SHARES[numbers.instance_class].solve
    if solve is None:
        return lambda numbers, payload, xhat, P: payload
    return lambda numbers, payload, xhat, P: solve(numbers, payload, xhat, P)


overload(measured, strict=False)(_choose_measure)
overload(solved, strict=False)(_choose_solve)


@register_jitable
def first_of_other(other: OtherConstants) -> SensorMemory:
    """Return what is kept of a sensor at first."""
    size = PAYLOAD + other.payload
    return first_of_sensor(other.link, other.faults, other.errors.start, size, other.noises, other.payload)


def first_others(others: tuple[OtherConstants, ...]) -> tuple[SensorMemory, ...]:
    """Return what is kept of all sensors at first; for compiled functions alone."""
    raise TypeError("first_others: for compiled functions alone")


def _choose_first(others: Any) -> Callable[..., Any]:
    if len(others) == 0:
        return lambda others: ()
    return lambda others: (first_of_other(others[0]), *first_others(others[1:]))


overload(first_others, strict=False)(_choose_first)


def _for_each(do: Callable[..., None]) -> Callable[..., None]:
    """Return a function, for compiled functions alone, that does something with each sensor, its memory and more."""

    def for_each(others: Any, memories: Any, more: Any) -> None:
        raise TypeError("for compiled functions alone")

    def choose(others: Any, memories: Any, more: Any) -> Callable[..., Any]:
        if len(others) == 0:
            return lambda others, memories, more: None

        def each(others: Any, memories: Any, more: Any) -> None:
            do(others[0], memories[0], *more)
            for_each(others[1:], memories[1:], more)

        return each

    overload(for_each, strict=False)(choose)
    return for_each


@register_jitable
def read_other(
    other: OtherConstants, kept: SensorMemory, x: np.ndarray, k: int, h: float, seed: int, anchors: np.ndarray
) -> None:
    """Set the message that lands at tick k; arguments as uwb_of_tick's in loop.py."""
    time, delay, message = k * h, delay_through(other.link, k, x, kept.bad[0], seed), kept.message
    fill(message, 0.0)
    if delay != NOT_SENT or is_read_anyway(other.faults, time):
        seen = seen_by(other.clock, x, time)
        put_normals(kept.noise, seed, other.stream, tick_of(time, h))
        payload = measured(other.numbers, seen, kept.noise, time)
        if payload.size > 0:
            message[ARRIVED], message[STAMP] = 1.0, time
            put(payload, message, PAYLOAD)
        add_errors(message, other.errors, kept.slow, False)
        spoil(message, other.faults, kept.held, seen, time, anchors, seed, h)
        if message[ARRIVED] == 0.0:
            delay = NOT_SENT  # nothing to send
    deliver(message, delay, kept.flying, k)


@register_jitable
def solve_other(
    other: OtherConstants,
    kept: SensorMemory,
    robust: RobustConstants | None,
    slot: Slot | None,
    history: np.ndarray,
    n: int,
    known: np.ndarray,
    h: float,
    handed: np.ndarray,
    seen: np.ndarray,
) -> None:
    """Write the fix of the message that landed to the vector that the handler takes.

    Args:
        other: the sensor.
        kept: of it.
        robust: what refuses a sensor that is stuck.
        slot: of the filter's history.
        history: of the filter.
        n: states of the filter.
        known: belief of [x; i] (240).
        h: tick [s].
        handed: that vector.
        seen: arrived and stamp of each sensor that is judged by the belief of its stamp (s, 2).
    """
    message = kept.message
    hear(robust, message, kept.said)
    if message[ARRIVED] == 0.0:
        return
    about = belief_about(slot, history, n, message, known, h)
    P = about[N_XBAR:].copy().reshape((N_XBAR, N_XBAR))
    fix = solved(other.numbers, message[PAYLOAD:].copy(), about[:N_XBAR].copy(), P)
    if fix.size > 0:
        at = other.first
        handed[at], handed[at + STAMP] = 1.0, message[STAMP]
        handed[at + PAYLOAD : at + PAYLOAD + fix.size] = fix
    if other.about:
        seen[other.number] = message[:PAYLOAD]


@register_jitable
def step_other(other: OtherConstants, kept: SensorMemory, k: int, h: float, seed: int) -> None:
    """Go on to the next tick."""
    step_chain(other.link, k, kept.bad, seed)
    step_slow(kept.slow, other.errors, k, h, seed)


read_others = _for_each(read_other)
solve_others = _for_each(solve_other)
step_others = _for_each(step_other)
