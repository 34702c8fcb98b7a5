"""Doubts about heading and handedness, live and in replay: the accelerations do not point where the ranges say.

The filter of turn_filter.py judges two turns. One is the error of the start's heading; its standard deviation includes
the start's own, and the drift that the gyro's bias may have caused since. The other is the error of the main filter's
present heading, with the filter's own deviation. The turn filter begins anew after imu or ranges were silent or the
main filter was lost; then only the present heading is judged.

Anchors whose x and y are exchanged, or with one axis of the wrong sign, are a mirror image of the room. The ranges fit
the mirror image, but no turn takes the accelerations to a mirrored path. So a second filter runs with anchors and start
mirrored in y: if the map is mirrored, a turn of length 1 fits there, and none fits among the map's anchors.
"""

from typing import Final, NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.map_file import FilterSettings
from ortilo_drake.interop.recorded.recording import NO_AID_ROWS, Recording
from ortilo_drake.onboard.estimator.tight.attitude_rows import wrapped
from ortilo_drake.onboard.estimator.tight.inertial import matrix_of
from ortilo_drake.onboard.estimator.tight.layout import ADDITIVE, GYRO, THETA, Q
from ortilo_drake.studies.recorded.event_filter import initial_carried, run_filter
from ortilo_drake.studies.recorded.filter_types import (
    BIASES,
    Events,
    EventValues,
    FilterSetup,
    Setup,
    State,
    nominal,
    setup_of,
)
from ortilo_drake.studies.recorded.filtered import Begin, events_of, start_of
from ortilo_drake.studies.recorded.imu_watch import RESTS, SINCE
from ortilo_drake.studies.recorded.reacquired import no_restart
from ortilo_drake.studies.recorded.turn_filter import SQUARE, Ranging, TurnFilter, follow, turn_filter, turn_found

OFF: Final = 3.0  # a turn is told from so many standard deviations
LEAST: Final = np.radians(15.0)  # and from this angle: the anchors' errors turn the ranges' path a little
SURE: Final = np.radians(15.0)  # largest standard deviation of a turn that is told
LENGTH: Final = (0.5, 1.5)  # bounds of the length of (c, s): outside them more than the heading is wrong
ASTRAY: Final = 0.5  # no turn filter begins while the main filter's position deviates by more [m]
MIRRORED: Final = (0.7, 1.3)  # bounds of the length of (c, s) among mirrored anchors that tell a mirror image
OTHERWISE: Final = 0.75  # largest length among the map's anchors then
APART: Final = 4.0  # least distance of the two lengths [standard deviations]
TIMES: Final = (1.1, 2.0)  # ratio of mean e²/S, map's anchors to mirrored: above 1.1 tell no heading, above 2 a mirror
Y: Final = np.array([1.0, -1.0, 1.0])
MIRRORS: Final = (  # the turn among anchors mirrored in y [rad] and its cause, if the start's heading is right
    (0.0, "the sign of y wrong"),
    (-0.5 * np.pi, "x and y exchanged"),
    (np.pi, "the sign of x wrong"),
    (0.5 * np.pi, "x and y exchanged, and both signs wrong"),
)
HOLDS: Final = 2.0  # a doubt must last so long [s]
EVERY: Final = 0.5  # time between two judgements in a replay [s]
RANGE_SD: Final = 0.1  # least standard deviation of a range: the anchors' biases are not states of the turn filter [m]


class HeadingDoubt(NamedTuple):
    """The time of the doubt [s], the error of the heading and its deviation [rad], and the right heading at the start.

    `start` is None if the present heading is wrong, not the start's.
    """

    t: float
    off: float
    sd: float
    start: float | None

    def text(self) -> str:
        """Return the doubt as part of a sentence."""
        of = f"{np.degrees(self.off):+.0f}° (sd {np.degrees(self.sd):.0f}°)"
        if self.start is None:
            return f"the heading now is off by {of}: ranges and accelerations disagree on the direction"
        return (
            f"the heading at the start is off by {of}, {self.start:.2f} rad fits: `start: heading`, or an imu mounted "
            "turned about z (`imu: axes`)?"
        )


class MirrorDoubt(NamedTuple):
    """The time of the doubt [s], the turn among anchors mirrored in y [rad], and whether it counts from the start."""

    t: float
    turn: float
    started: bool

    def text(self) -> str:
        """Return the doubt as part of a sentence."""
        near = [of for turn, of in MIRRORS if self.started and abs(wrapped(self.turn - turn)) < np.radians(30.0)]
        which = "".join(near) or "x and y exchanged, or one axis's sign wrong"
        return (
            "the anchors are a mirror image of the room: the imu turns the other way round than the path that the "
            f"ranges give: of all anchors {which}?"
        )


class HeadingWatch:
    """The two turn filters beside the main filter, among the map's anchors and among mirrored ones.

    Attributes:
        doubt: the first doubt about the heading, None if there is none.
        mirror: the doubt that the anchors are a mirror image of the room, None if there is none.
    """

    def __init__(self, setup: Setup):
        self._setup = setup
        self._pair: tuple[TurnFilter, TurnFilter] | None = None  # among the map's anchors, and among mirrored ones
        self._start: State | None = None
        self._wrong_since, self._mirrored_since, self._anew = np.inf, np.inf, False
        self.doubt: HeadingDoubt | None = None
        self.mirror: MirrorDoubt | None = None

    def advance(self, events: Events, heard: EventValues, state: State, excused: bool = False) -> None:
        """Take events in, and the main filter's state after them; `excused`: wrong anchors explain the error better."""
        if self.doubt is not None or self.mirror is not None or np.isfinite(state.watched[SINCE : SINCE + 2]).any():
            return  # an accelerometer that failed tells nothing
        resting, pair = state.watched[RESTS] > 0.0, self._pair
        astray = np.trace(state.C[:3, :3]) > ASTRAY**2
        ranging = ranging_of(self._setup, state)
        if pair is None or resting or not follow(pair[0], events, heard, ranging):
            self._anew |= pair is not None and not resting
            self._start, self._pair = state, None if astray else (turn_filter(state), turn_filter(state))
            if self._pair is not None:
                self._pair[1].z[:6] *= np.tile(Y, 2)  # position and velocity
            self._wrong_since = self._mirrored_since = np.inf
            return
        follow(pair[1], events, heard, ranging._replace(anchors=ranging.anchors * Y))
        self._mirrored_since = min(self._mirrored_since, state.t) if _is_mirrored(*pair) and not excused else np.inf
        if state.t - self._mirrored_since >= HOLDS:
            self.mirror = MirrorDoubt(state.t, turn_found(pair[1]).angle, not self._anew)
            return
        found = None if excused or _is_worse(*pair, TIMES[0]) else self._judged(pair[0], state)
        if found is None:
            self._wrong_since = np.inf
        else:
            self._wrong_since = min(self._wrong_since, state.t)
            self.doubt = found if state.t - self._wrong_since >= HOLDS else None

    def _judged(self, beside: TurnFilter, state: State) -> HeadingDoubt | None:
        assert self._start is not None
        turn, start = turn_found(beside), self._start
        if turn.sd > SURE or not LENGTH[0] < turn.length < LENGTH[1]:
            return None
        drift = np.sqrt(start.C[GYRO + 2, GYRO + 2]) * (state.t - start.t)
        if not self._anew and _is_off(turn.angle, turn.sd, np.sqrt(start.C[THETA + 2, THETA + 2]), drift):
            return HeadingDoubt(state.t, -turn.angle, turn.sd, wrapped(_yaw(start.x[Q:ADDITIVE]) + turn.angle))
        now = wrapped(turn.angle + _yaw(beside.q) - _yaw(state.x[Q:ADDITIVE]))
        if _is_off(now, turn.sd, np.sqrt(state.C[THETA + 2, THETA + 2])):
            return HeadingDoubt(state.t, -now, turn.sd, None)
        return None


def heading_doubts(
    recording: Recording, known: FilterSetup, settings: FilterSettings, begin: Begin
) -> list[HeadingDoubt | MirrorDoubt]:
    """Return the doubt about heading or handedness of a filter with imu and this start, if there is one."""
    ranges, imu = recording.ranges, recording.imu
    assert imu is not None
    if known.rest is not None:
        ranges = ranges.only(np.flatnonzero(ranges.t >= known.rest.end))
    first, setup = float(ranges.t[0]), setup_of(known, settings, True)
    events, heard = events_of(ranges, imu, known._replace(looks=NO_AID_ROWS), np.zeros(0), first)
    state = start_of(ranges, imu, known, settings, begin, known.heading is not None)
    carried, anew = initial_carried(len(known.anchors), len(state.C), state.t), no_restart(len(state.C))
    watch, done = HeadingWatch(setup), 0
    for t in np.arange(first, events.t[-1] + EVERY, EVERY):
        end = int(np.searchsorted(events.t, t, side="right"))
        part, done = Events(*(column[done:end] for column in events)), end
        _, state, _ = run_filter(part, heard, state, carried, anew, setup, np.inf, False)
        watch.advance(part, heard, state)
        if (doubt := watch.mirror or watch.doubt) is not None:
            return [doubt]
    return []


def ranging_of(setup: Setup, state: State) -> Ranging:
    """Return the anchors, biases, levers and range noise for a turn filter; the main filter's state has the biases."""
    n, noise = len(setup.anchors), setup.noise
    sd = max(RANGE_SD, float(np.hypot(noise.range_white, noise.range_correlated)))
    return Ranging(setup.anchors, state.x[nominal(BIASES) : nominal(BIASES) + n].copy(), setup.levers, sd)


def _is_mirrored(beside: TurnFilter, mirrored: TurnFilter) -> bool:
    """Return whether a turn fits among the mirrored anchors, and no turn, or a much worse one, among the map's."""
    own, other = turn_found(beside), turn_found(mirrored)
    apart = APART * float(np.hypot(own.sd * own.length, other.sd * other.length))
    fits = MIRRORED[0] < other.length < MIRRORED[1] and other.sd < SURE
    less = own.length < OTHERWISE and other.length - own.length > apart
    return fits and (less or _is_worse(beside, mirrored, TIMES[1]))


def _is_worse(beside: TurnFilter, mirrored: TurnFilter, times: float) -> bool:
    """Return whether the mean e²/S among the map's anchors exceeds `times` that among the mirrored ones."""
    return bool(beside.marks[SQUARE] > times * mirrored.marks[SQUARE])


def _is_off(angle: float, *deviations: float) -> bool:
    return abs(angle) > max(LEAST, OFF * float(np.linalg.norm(deviations)))


def _yaw(q: np.ndarray) -> float:
    R = matrix_of(q)
    return float(np.arctan2(R[1, 0], R[0, 0]))
