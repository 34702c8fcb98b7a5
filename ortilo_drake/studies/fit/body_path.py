"""The truth as a smooth path of a body, and the samples of an ideal IMU on it.

Positions and quaternions are resampled evenly, passed forwards and backwards through a Butterworth filter, and joined
by cubic splines: the second derivative of a truth that is rounded to a millimetre would otherwise be noise alone.
"""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.recording import GRAVITY, Truth
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.recorded.calibrate import Calibration

RATE, CUT = 200.0, 8.0  # of the even stamps, and of the filter [Hz]
TURNS = 1e-3  # body rates are differences over this time to either side [s]


class BodyPath(NamedTuple):
    """Position and quaternion by the sensors' clock; beyond first and last [s] it stands still."""

    p: CubicSpline
    q: CubicSpline
    first: float
    last: float

    def within(self, t: np.ndarray) -> np.ndarray:
        """Return stamps, those outside at the ends."""
        return np.clip(t, self.first + TURNS, self.last - TURNS)

    def position(self, t: np.ndarray) -> np.ndarray:
        """Return p_WB (m, 3)."""
        return np.asarray(self.p(self.within(t)))

    def attitude(self, t: np.ndarray) -> Rotation:
        """Return R_WB."""
        return Rotation.from_quat(self.q(self.within(t)))

    def rates(self, t: np.ndarray) -> np.ndarray:
        """Return the body rates (m, 3) [rad/s]."""
        moves, t = self._moves(t), self.within(t)
        before, behind = Rotation.from_quat(self.q(t - TURNS)), Rotation.from_quat(self.q(t + TURNS))
        return np.asarray(moves * (before.inv() * behind).as_rotvec() / (2.0 * TURNS))

    def force(self, t: np.ndarray) -> np.ndarray:
        """Return the specific force in B (m, 3) [m/s²]."""
        moves, t = self._moves(t), self.within(t)
        return np.asarray(self.attitude(t).inv().apply(moves * self.p(t, 2) + [0.0, 0.0, GRAVITY]))

    def _moves(self, t: np.ndarray) -> np.ndarray:
        """Return a mask (m, 1) of the stamps that are not beyond the ends."""
        return ((t >= self.first) & (t <= self.last))[:, None]


def body_path(name: str, truth: Truth, by: Calibration) -> BodyPath:
    """Return the path of a truth in the anchors' frame, B as the truth has it.

    Raises:
        InputError: if it has no attitude.
    """
    if truth.R is None:
        raise InputError(f"{name}: truth.rotation: the map has none, and an IMU is flown along an attitude")
    t = np.arange(truth.t[0], truth.t[-1], 1.0 / RATE)
    q = (Rotation.from_matrix(by.F) * Rotation.from_matrix(truth.R)).as_quat()
    turned = np.sum(q[1:] * q[:-1], axis=1) < 0.0
    q[1:] *= np.where(np.cumsum(turned) % 2 == 1, -1.0, 1.0)[:, None]
    even = np.column_stack([np.interp(t, truth.t, axis) for axis in np.hstack([by.position(truth.p), q]).T])
    smooth = sosfiltfilt(butter(2, CUT, fs=RATE, output="sos"), even, axis=0)
    t = t - by.offset
    return BodyPath(CubicSpline(t, smooth[:, :3]), CubicSpline(t, smooth[:, 3:]), float(t[0]), float(t[-1]))
