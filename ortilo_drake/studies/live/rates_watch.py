"""Whether the body rates are in another unit, or have other signs, than the map says.

Force and rates alone hardly tell: a rotor's force keeps its direction in the body however the body turns. So a bank of
turn filters (turn_filter.py) follows the same ranges and forces. One filter takes the rates as the map says, one leaves
the heading free, and the others take another unit or other signs. A wrong filter's log-likelihood exceeds the right
one's by BEATS with a probability below exp(-BEATS) if the noise is right (A. Wald, Sequential Analysis, 1947). A filter
whose log-likelihood falls below the map's by BEATS is refuted for good.
"""

from itertools import product
from typing import Final

import numpy as np

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import Imu
from ortilo_drake.interop.recorded.units import RATE_UNITS, axes_matrix, axes_names, size_of
from ortilo_drake.onboard.estimator.tight.layout import ADDITIVE, THETA
from ortilo_drake.studies.recorded.filter_types import Events, EventValues, State
from ortilo_drake.studies.recorded.imu_watch import RESTS, SINCE
from ortilo_drake.studies.recorded.turn_filter import CS, LIKELY, SEEN, SQUARE, Ranging, TurnFilter, follow, turn_filter

BEATS: Final = 15.0  # least difference of log-likelihood to the map's
CLEARLY: Final = 5.0  # least difference of log-likelihood to the filter with a free heading
FITS, FEWEST = 2.0, 30  # largest mean e²/S of a reading that is told; ranges before it counts
ANEW: Final = 20.0  # the bank begins anew after this time, with the main filter's state [s]
HEADING: Final = 0.2  # least standard deviation of the heading [rad]
AT_REST: Final = 0.2  # no gyro has a larger bias [rad/s]
FREE, UNIT, SIGNS = 1, 2, 3  # first indices in the bank; 0 is the map's reading
REVERSED: Final = [np.diag(signs) for signs in product((1.0, -1.0), repeat=3)][1:]
ABOUT_Z: Final = np.diag([-1.0, -1.0, 1.0])


class RatesWatch:
    """The bank of turn filters for a map.

    Attributes:
        doubt: the sentence on another reading of the rates that fits the ranges better; empty if there is none.
        mirrors: whether mirrored anchors would explain the ranges as well as the doubt's reading.
    """

    def __init__(self, map_: Map):
        assert map_.imu is not None
        self._source, self._bank = map_.imu, list[TurnFilter]()
        unit, self._other = _units(map_)
        self._axes = [np.eye(3), np.eye(3), np.eye(3) * unit, *REVERSED]
        self._refuted, self._worst = np.zeros(len(self._axes), dtype=bool), np.zeros(len(self._axes))
        self._begun, self.doubt, self.mirrors = -np.inf, "", False

    def advance(self, events: Events, heard: EventValues, state: State, ranging: Ranging, excused: bool) -> None:
        """Take events in, and the main filter's state after them; `excused`: wrong anchors explain the error better."""
        fails = np.isfinite(state.watched[SINCE : SINCE + 2]).any()  # a failed accelerometer tells nothing
        if self.doubt or self._refuted[UNIT:].all() or fails or state.watched[RESTS] > 0.0:
            return
        for one in self._bank:
            one.bias[:] = state.x[ADDITIVE : ADDITIVE + 3]
        left = [one for one, refuted in zip(self._bank, self._refuted, strict=False) if not refuted]
        followed = [follow(one, events, heard, ranging) for one in left]
        if state.t > self._begun + ANEW or not all(followed):
            self._begin(state)
            return
        marks = np.array([one.marks for one in self._bank])
        if marks[0, SEEN] > FEWEST:
            self._worst = np.maximum(self._worst, marks[:, SQUARE])
        likely = np.where(self._refuted, -np.inf, marks[:, LIKELY] - marks[0, LIKELY])
        self._refuted[UNIT:] |= likely[UNIT:] < -BEATS
        best = UNIT + int(np.argmax(likely[UNIT:]))
        turns = np.array_equal(self._axes[best], ABOUT_Z)  # with a force along z this equals another heading
        clearly = likely[best] > max(BEATS, likely[FREE] + (0.0 if turns else CLEARLY))
        if clearly and self._worst[best] < FITS and not excused:
            self.mirrors = best > UNIT and self._axes[best][0, 0] * self._axes[best][1, 1] < 0.0
            self.doubt = f"imu: the ranges contradict the body rates: imu: {self._key(best)} fits"

    def _begin(self, state: State) -> None:
        self._bank, self._begun = [turn_filter(state, axes) for axes in self._axes], state.t
        self._worst[:] = 0.0
        sd = np.hypot(HEADING, np.sqrt(state.C[THETA + 2, THETA + 2]))
        for i, one in enumerate(self._bank):
            if i != FREE:
                one.z[CS], one.C[CS, CS], one.C[CS + 1, CS + 1] = 1.0, sd**2, sd**2

    def _key(self, best: int) -> str:
        """Return the map's key of the reading `best`, and other causes that would look alike."""
        if best == UNIT:
            return f"{{rate_unit: {self._other}}}"
        D = self._axes[best]
        key = f"{{rate_axes: {axes_names(D @ axes_matrix(self._source.rate_axes or self._source.axes, 'axes', True))}}}"
        if np.array_equal(D, ABOUT_Z):
            return f"{key} or a `heading`, or `axes`, turned by 180°"
        return f"{key} or anchors that are mirrored (x and y exchanged)" if self.mirrors else key


def _units(map_: Map) -> tuple[float, str]:
    """Return the size of the other usual unit of rates in the map's unit, and its name."""
    assert map_.imu is not None
    other = "rad/s" if map_.imu.rate_unit == "deg/s" else "deg/s"
    return RATE_UNITS[other] / abs(size_of(map_.imu.rate_unit, RATE_UNITS)), other


def rest_doubts(imu: Imu, map_: Map) -> list[str]:
    """Return a doubt if, at the map's start, the body turns by its rates but not by its force."""
    assert map_.imu is not None
    if map_.start is None or map_.imu.standstill > 0.0:
        return []
    since = imu.t - imu.t[0]
    first, last = imu.force[since <= 0.5], imu.force[(since > 0.5) & (since <= 1.0)]
    if not len(first) or not len(last):
        return []
    rates = imu.rates[since <= 1.0].mean(axis=0)
    begin, end = (mean / max(float(np.linalg.norm(mean)), 1e-9) for mean in (first.mean(axis=0), last.mean(axis=0)))
    by_rates, by_force = np.linalg.norm(np.cross(rates, begin)), 2.0 * np.arccos(np.clip(begin @ end, -1.0, 1.0))
    if not by_rates > max(AT_REST, 4.0 * by_force):
        return []
    size, (unit, other) = float(np.linalg.norm(rates)), _units(map_)
    fits = f"imu: {{rate_unit: {other}}} makes them {size * unit:.2g}, or " if unit < 1.0 else ""
    return [
        f"imu: at the start the body rates are {size:.2g} rad/s, but the force does not turn: {fits}a gyro with such a "
        "bias needs `imu: standstill`"
    ]
