"""An estimator of one's own in a compiled flight: one that was registered with a compiled share."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload, register_jitable

from ortilo_drake.flight.compiled.constants import CameraConstants, OtherConstants, UwbConstants
from ortilo_drake.flight.compiled.constants_onboard import OwnConstants
from ortilo_drake.flight.compiled.kept import Sensed, SensorMemory
from ortilo_drake.model.parts import CompiledEstimator
from ortilo_drake.model.signals import N_X, N_XBAR
from ortilo_drake.model.triples import Triple

_SHARES: dict[type, CompiledEstimator] = {}  # by the class of their numbers


class OwnMemory(NamedTuple):
    """What the estimator keeps from tick to tick, changed in place.

    Attributes:
        state: its own.
        i: integral of the position error (3), which diagrams/onboard.py adds.
    """

    state: np.ndarray
    i: np.ndarray


def remember_estimator(numbers: Any, share: CompiledEstimator) -> None:
    """Have numbers of that class belong to a share."""
    _SHARES[type(numbers)] = share


def said_by(numbers: Any, state: np.ndarray) -> np.ndarray:
    """Return CompiledEstimator.known of the numbers' estimator; for compiled functions alone."""
    raise TypeError("said_by: for compiled functions alone")


def state_after(numbers: Any, state: Any, uwb: Any, detections: Any, imu: Any, u: Any, r: Any) -> np.ndarray:
    """Return CompiledEstimator.step of the numbers' estimator; for compiled functions alone."""
    raise TypeError("state_after: for compiled functions alone")


def _choose_known(numbers: Any, state: Any) -> Callable[..., Any]:
    known = _SHARES[numbers.instance_class].known
    return lambda numbers, state: known(numbers, state)


def _choose_step(numbers: Any, state: Any, uwb: Any, detections: Any, imu: Any, u: Any, r: Any) -> Callable[..., Any]:
    step = _SHARES[numbers.instance_class].step
    return lambda numbers, state, uwb, detections, imu, u, r: step(numbers, state, uwb, detections, imu, u, r)


overload(said_by, strict=False)(_choose_known)
overload(state_after, strict=False)(_choose_step)


@register_jitable
def first_own_memory(estimator: OwnConstants) -> OwnMemory:
    """Return what is kept at first."""
    return OwnMemory(estimator.first.copy(), np.zeros(3))


@register_jitable
def own_known_of(estimator: OwnConstants, memory: OwnMemory) -> np.ndarray:
    """Return the belief of [x; i] (240); i is known."""
    said, known = said_by(estimator.numbers, memory.state), np.zeros(N_XBAR + N_XBAR * N_XBAR)
    known[:N_X], known[N_X:N_XBAR] = said[:N_X], memory.i
    for row in range(N_X):
        at = N_XBAR * (row + 1)
        known[at : at + N_X] = said[N_X * (row + 1) : N_X * (row + 2)]
    return known


@register_jitable
def own_force_of(estimator: OwnConstants, memory: OwnMemory) -> Triple:
    """Return zeros: the force is not estimated."""
    return 0.0, 0.0, 0.0


@register_jitable
def own_handed_of(
    estimator: OwnConstants,
    memory: OwnMemory,
    uwb: UwbConstants,
    camera: CameraConstants | None,
    sensed: Sensed,
    known: np.ndarray,
    k: int,
    h: float,
    others: tuple[OtherConstants, ...],
    kept: tuple[SensorMemory, ...],
) -> np.ndarray:
    """Return [y, delta, V2], zeros: it does not tell. Arguments as handed_of's."""
    first, block = estimator.handled.first, estimator.handled.block
    return np.zeros(first[-1] + first.size - 1 + block[-1])


@register_jitable
def own_take(
    estimator: OwnConstants,
    memory: OwnMemory,
    handed: np.ndarray,
    sensed: Sensed,
    k: int,
    h: float,
    u: np.ndarray,
    hover: float,
    r: np.ndarray,
) -> None:
    """Go on to the belief of the next tick; arguments as take's."""
    memory.i[:] += r[:3] - said_by(estimator.numbers, memory.state)[:3]
    # Copies: a user's function may change what it is given.
    ranges, boxes, imu = sensed.uwb.message.copy(), sensed.camera.message.copy(), sensed.imu.message.copy()
    memory.state[:] = state_after(estimator.numbers, memory.state.copy(), ranges, boxes, imu, u.copy(), r)
