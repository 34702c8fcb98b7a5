"""What the onboard half of a compiled flight is made of: plain numbers and arrays, prepared from a scenario."""

from typing import Any, NamedTuple

import numpy as np

from ortilo_drake.flight.compiled.robust import RobustConstants
from ortilo_drake.model.measurement import Layout
from ortilo_drake.onboard.estimator.intermittent_filter import FilterModel
from ortilo_drake.onboard.estimator.late_measurements import Slot
from ortilo_drake.onboard.estimator.measurement_handler import Incoming
from ortilo_drake.onboard.estimator.tight.aids import Aids
from ortilo_drake.onboard.estimator.tight.layout import Layout as TightLayout
from ortilo_drake.onboard.estimator.tight.tick import Motion
from ortilo_drake.onboard.ranging.fault_exclusion import Consistency


class FilterConstants(NamedTuple):
    """Handler and filter.

    Attributes:
        incoming: how the messages and fixes of a tick stand in one vector.
        size: of that vector.
        first: where the fix of ranges begins in it, then the imu's message, then the fix of boxes; -1 of what does
            not fly (3).
        handled: the layout of what the handler hands over.
        drops: whether late values are dropped.
        model: what the filter believes of the vehicle.
        layout: of its measurement, with the rows made of the imu's message.
        imu_number: of the imu among the sensors.
        imu_variances: of those rows (0, 3 or 6).
        belief_0: [xhat_0, P_0 row by row] (n + n^2).
        knows_force: whether the servo is told the force.
        slot: where everything is in a row of the history; None where late measurements are not put into it.
        history: how many ticks are kept in it.
        consistency: what ranges must fulfil to make a fix; None where they need not.
        robust: what refuses and weighs values; None where nothing does.
    """

    incoming: Incoming
    size: int
    first: tuple[int, int, int]
    handled: Layout
    drops: bool
    model: FilterModel
    layout: Layout
    imu_number: int
    imu_variances: np.ndarray
    belief_0: np.ndarray
    knows_force: bool
    slot: Slot | None
    history: int
    consistency: Consistency | None
    robust: RobustConstants | None


class TightConstants(NamedTuple):
    """The tight filter, see onboard/estimator/tight.

    Attributes:
        handled: the layout of y, delta and V2.
        numbers: of uwb, imu and camera among the sensors; -1 of what does not fly (3).
        samples: of the imu in a message.
        layout: of the states.
        motion: imu and vehicle.
        aids: the other sensors.
        x_0: first nominal state.
        C_0: first covariance (n, n).
        kept_0: what is kept of imu and control at first.
        ahead_0: prediction for t_0 (156).
        watched: how many numbers the watch keeps.
    """

    handled: Layout
    numbers: tuple[int, int, int]
    samples: int
    layout: TightLayout
    motion: Motion
    aids: Aids
    x_0: np.ndarray
    C_0: np.ndarray
    kept_0: np.ndarray
    ahead_0: np.ndarray
    watched: int


class OwnConstants(NamedTuple):
    """An estimator of one's own, see own.py.

    Attributes:
        handled: the layout of y, delta and V2.
        numbers: what its functions take.
        first: its state at first.
    """

    handled: Layout
    numbers: Any
    first: np.ndarray


class ServoConstants(NamedTuple):
    """The LQ servo, see onboard/servo/lq_servo.py.

    Attributes:
        L: its gain (4, 15).
        mass: m [kg] of its model.
        yaw: that is held [rad].
        error_form: whether it flies the error form.
        lent: whether it is lent the true velocities.
    """

    L: np.ndarray
    mass: float
    yaw: float
    error_form: bool
    lent: bool
