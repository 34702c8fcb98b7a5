"""A doubt about the heading, live and in replay: the accelerations do not point where the ranges say (turn_filter.py).

Two turns are judged: that from the start, whose deviation counts the start's own, and how far the gyro's bias may have
turned it since; and that of the main filter's heading now, with the filter's own deviation. It begins anew where imu or
ranges were silent or the main filter was lost; then only the heading now is judged.
"""

from typing import Final, NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.map_file import FilterSettings
from ortilo_drake.interop.recorded.recording import NO_AID_ROWS, Recording
from ortilo_drake.onboard.estimator.tight.inertial import matrix_of
from ortilo_drake.onboard.estimator.tight.layout import ADDITIVE, GYRO, THETA, Q
from ortilo_drake.studies.recorded.event_filter import initial_carried, run_filter
from ortilo_drake.studies.recorded.filter_types import BIASES, Events, EventValues, Setup, State, nominal
from ortilo_drake.studies.recorded.filtered import Begin, FilterSetup, events_of, levers_of, noise_of, start_of
from ortilo_drake.studies.recorded.imu_watch import RESTS, SINCE
from ortilo_drake.studies.recorded.landing import landings
from ortilo_drake.studies.recorded.reacquired import no_restart
from ortilo_drake.studies.recorded.turn_filter import Ranging, TurnFilter, follow, turn_filter, turn_found

OFF: Final = 3.0  # standard deviations that are told
LEAST: Final = np.radians(15.0)  # and no less: the anchors' errors turn the ranges' path a little
SURE: Final = np.radians(15.0)  # the turn's own deviation, at most
LENGTH: Final = (0.5, 1.5)  # of (c, s): else more than the heading is wrong
ASTRAY: Final = 0.5  # with a larger deviation the main filter's position is nothing to begin with [m]
HOLDS: Final = 2.0  # it must last so long [s]
EVERY: Final = 0.5  # it is judged in a replay [s]
RANGE_SD: Final = 0.1  # of a range, at least: the anchors' biases are none of its states [m]


class HeadingDoubt(NamedTuple):
    """When it was found [s], by how much the heading is wrong and its deviation [rad], and the right one at the start.

    The last is None if it is the heading now that is wrong, not that of the start.
    """

    t: float
    off: float
    sd: float
    start: float | None

    def text(self) -> str:
        """Return it as part of a sentence."""
        of = f"{np.degrees(self.off):+.0f}° (sd {np.degrees(self.sd):.0f}°)"
        if self.start is None:
            return f"the heading now is off by {of}: ranges and accelerations disagree on the direction"
        return (
            f"the heading at the start is off by {of}, {self.start:.2f} rad fits: `start: heading`, or an imu mounted "
            "turned about z (`imu: axes`)?"
        )


class HeadingWatch:
    """The filter of the turn beside the main one.

    Attributes:
        doubt: the first one, None if there is none.
    """

    def __init__(self, setup: Setup):
        self._setup = setup
        self._beside: TurnFilter | None = None
        self._start: State | None = None
        self._wrong_since, self._anew = np.inf, False
        self.doubt: HeadingDoubt | None = None

    def advance(self, events: Events, heard: EventValues, state: State, excused: bool = False) -> None:
        """Take events in, and the main filter's state behind them; `excused`: anchors explain what is wrong better."""
        if self.doubt is not None or np.isfinite(state.watched[SINCE : SINCE + 2]).any():
            return  # of an accelerometer that fails nothing follows
        resting, beside = state.watched[RESTS] > 0.0, self._beside
        astray = np.trace(state.C[:3, :3]) > ASTRAY**2
        if beside is None or resting or not follow(beside, events, heard, ranging_of(self._setup, state)):
            self._anew |= beside is not None and not resting
            self._beside, self._start, self._wrong_since = None if astray else turn_filter(state), state, np.inf
            return
        found = None if excused else self._judged(state)
        if found is None:
            self._wrong_since = np.inf
        else:
            self._wrong_since = min(self._wrong_since, state.t)
            self.doubt = found if state.t - self._wrong_since >= HOLDS else None

    def _judged(self, state: State) -> HeadingDoubt | None:
        assert self._beside is not None
        assert self._start is not None
        turn, start = turn_found(self._beside), self._start
        if turn.sd > SURE or not LENGTH[0] < turn.length < LENGTH[1]:
            return None
        drift = np.sqrt(start.C[GYRO + 2, GYRO + 2]) * (state.t - start.t)
        if not self._anew and _is_off(turn.angle, turn.sd, np.sqrt(start.C[THETA + 2, THETA + 2]), drift):
            return HeadingDoubt(state.t, -turn.angle, turn.sd, _wrapped(_yaw(start.x[Q:ADDITIVE]) + turn.angle))
        now = _wrapped(turn.angle + _yaw(self._beside.q) - _yaw(state.x[Q:ADDITIVE]))
        if _is_off(now, turn.sd, np.sqrt(state.C[THETA + 2, THETA + 2])):
            return HeadingDoubt(state.t, -now, turn.sd, None)
        return None


def heading_doubts(
    recording: Recording, known: FilterSetup, settings: FilterSettings, begin: Begin
) -> list[HeadingDoubt]:
    """Return the doubt about the heading of a filter with imu that begins there, if there is one."""
    ranges, imu = recording.ranges, recording.imu
    assert imu is not None
    if known.rest is not None:
        ranges = ranges.only(np.flatnonzero(ranges.t >= known.rest.end))
    first, noise = float(ranges.t[0]), noise_of(settings, True)
    landed = landings(imu) if known.start is not None and known.start.lands else []
    events, heard = events_of(ranges, imu, known._replace(looks=NO_AID_ROWS), landed, np.zeros(0), first)
    state = start_of(ranges, imu, known, settings, begin, known.heading is not None)
    setup = Setup(known.anchors, levers_of(known, imu), known.level, noise, known.aids)
    carried, anew = initial_carried(len(known.anchors), len(state.C), state.t), no_restart(len(state.C))
    watch, done = HeadingWatch(setup), 0
    for t in np.arange(first, events.t[-1] + EVERY, EVERY):
        end = int(np.searchsorted(events.t, t, side="right"))
        part, done = Events(*(column[done:end] for column in events)), end
        _, state, _ = run_filter(part, heard, state, carried, anew, setup, np.inf, False)
        watch.advance(part, heard, state)
        if watch.doubt is not None:
            return [watch.doubt]
    return []


def ranging_of(setup: Setup, state: State) -> Ranging:
    """Return what a filter of the turn knows of the ranges, with the main filter's biases of the anchors."""
    n, noise = len(setup.anchors), setup.noise
    sd = max(RANGE_SD, float(np.hypot(noise.range_white, noise.range_correlated)))
    return Ranging(setup.anchors, state.x[nominal(BIASES) : nominal(BIASES) + n].copy(), setup.levers, sd)


def _is_off(angle: float, *deviations: float) -> bool:
    return abs(angle) > max(LEAST, OFF * float(np.linalg.norm(deviations)))


def _wrapped(angle: float) -> float:
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)


def _yaw(q: np.ndarray) -> float:
    R = matrix_of(q)
    return float(np.arctan2(R[1, 0], R[0, 0]))
