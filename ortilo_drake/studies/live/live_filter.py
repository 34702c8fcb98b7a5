"""The filter of `ortilo replay`, fed live.

It is replay's uncalibrated row: no truth is used, the anchors' biases are states, and the lever is the map's, else 0.
An estimate is made at each multiple of the period, counted from the first range, once no message before that stamp can
come any more. The events are replay's, in the same order. So the estimates equal replay's bit for bit, if replay is
asked at the same stamps and all rows came in time. Where replay looks ahead, the live filter waits:

    the start       for the ranges of one to three seconds unless the map gives a `start`; for the imu's first second,
                    or its time at rest; and for TRIAL seconds where no heading is given, as eight are tried
    a lost filter   for the ranges of one to three seconds from which it starts anew

Meanwhile no estimate is made; the estimates left out follow at once when the filter resumes. After the imu was silent
for LOST, replay goes on; the live filter begins anew in the air, since its heading may be wrong by any angle. A
BLACKOUT of the imu starts that wait over.
"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.live_rows import Block, behind_gap, joined, parted
from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.range_rows import Ranges
from ortilo_drake.interop.recorded.recording import NO_AID_ROWS, Recording, held_at
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.tight.inertial import matrix_of
from ortilo_drake.onboard.estimator.tight.layout import ADDITIVE, Q
from ortilo_drake.studies.live.agreement import Agreement
from ortilo_drake.studies.live.anchor_bank import AnchorWatch, stated_sd
from ortilo_drake.studies.live.rates_watch import RatesWatch
from ortilo_drake.studies.live.sensor_records import SILENT, AnchorRecord, ImuRecord
from ortilo_drake.studies.live.start_check import check_start, checked_force, settings_of
from ortilo_drake.studies.recorded.anchor_trust import ASTRAY
from ortilo_drake.studies.recorded.at_rest import AT_REST, at_rest
from ortilo_drake.studies.recorded.doubts import of_plane
from ortilo_drake.studies.recorded.event_filter import Carried, initial_carried, run_filter
from ortilo_drake.studies.recorded.filter_types import RANGE, Events, EventValues, FilterSetup, Restart, State, setup_of
from ortilo_drake.studies.recorded.filtered import TRIAL, begin_of, events_of, start_of
from ortilo_drake.studies.recorded.heading_doubts import HeadingWatch, ranging_of
from ortilo_drake.studies.recorded.imu_watch import RESTS
from ortilo_drake.studies.recorded.reacquired import AGAIN, LONGEST, fix_known_at, is_astray, no_restart, restart_from
from ortilo_drake.studies.recorded.setups import uncalibrated_setup

BLACKOUT = 1.0  # trials of headings across a longer silence of the imu do not agree [s]
RATE = 10.0  # default rate of the estimates, as in a replay without a truth [Hz]


class LiveEstimate(NamedTuple):
    """An estimate: its stamp [s] from the first range, and the filter's state at that stamp."""

    t: float
    state: State


class LiveFilter:
    """The filter by replay's map, without its truth, and the events that wait for the filter.

    The anchors have positions (n, 3); estimates are made at `rate` [Hz]. InputError if the map asks for a quantity that
    only a whole recording tells.

    Attributes:
        ranges: number of ranges that the filter has seen.
        taken: number of ranges taken: neither rejected by the gate nor of a refused anchor.
        lost: how often the filter was lost and started anew.
        begins_at: stamp of the filter's first range [s].
        why_not_begun: what the filter waits for.
        agreement: whether the last ranges agree with the estimate.
        anchors: figures by anchor.
        places: whether an anchor is elsewhere, or two are exchanged.
        force_doubt: doubt about the imu's force at the start; empty if there is none.
        imu: the stamps of the imu received; None without an imu.
        mirror: why ranges and start leave a mirror image of the path; empty if they do not.
        rates: whether the body rates fit the ranges; None without an imu.
        heading: whether the heading fits ranges and accelerations; None without an imu, and before the filter begins.
        start_doubt: how the first ranges contradict the map's `start`; empty if they do not.
        state: the state of a filter that has begun.
    """

    state: State

    def __init__(self, map_: Map, anchors: np.ndarray, rate: float = RATE):
        if map_.start is not None and map_.start.lands:
            raise InputError("start.lands: a landing is looked for afterwards: leave it out of a live map")
        for key in ("tags", "boxes"):
            if getattr(map_, key) is not None:
                raise InputError(f"{key}: are not heard live yet: leave them out of a live map")
        self._map, self._anchors, self._period = map_, anchors, 1.0 / rate
        self._setup = setup_of(settings_of(map_, anchors), map_.filter, map_.imu is not None)
        self._kept: Block | None = None  # rows that the filter has not taken in
        self._known: FilterSetup | None = None
        self._next = 0  # number of the next estimate
        self._events: tuple[Events, EventValues] | None = None  # events that a lost filter has not taken in
        self._waits = self._again = False  # waits for ranges to start anew; has begun anew after a silent imu
        self.ranges = self.taken = self.lost = 0
        self.begins_at, self.why_not_begun = 0.0, "no range was heard"
        self.agreement = Agreement()
        self.anchors = AnchorRecord(len(anchors))
        self.places = AnchorWatch(anchors, map_.filter, stated_sd(self._setup.noise))
        self.force_doubt = self.mirror = self.start_doubt = ""
        self.imu = None if map_.imu is None else ImuRecord()
        self.rates = None if map_.imu is None else RatesWatch(map_)
        self.heading: HeadingWatch | None = None

    @property
    def due(self) -> float:
        """The stamp of the next estimate [s], before which there is nothing to do."""
        return self._next * self._period

    @property
    def begun(self) -> bool:
        """Whether the filter has started."""
        return self._known is not None

    def why_unfit(self, before: bool) -> str:
        """Return why nobody should fly by the estimates now, whatever variance they claim; empty without a reason.

        If there was a reason `before`, the ranges must agree better, so that the reason does not come and go.
        """
        if self.imu is not None and self.imu.is_silent(self.state.t):
            return f"the imu has been silent for {SILENT:g} s"
        return self.wrong or ("the ranges contradict it" if self.agreement.is_unfit(before, self.gate) else "")

    @property
    def wrong(self) -> str:
        """The lasting error of the map that makes estimates unfit for flight, in words; empty if none was found."""
        heading, places = self.heading, self.places
        causes = {
            "the body rates are not those that the map says": self.rates is not None and self.rates.doubt,
            "the heading is wrong": heading is not None and heading.doubt,
            "the anchors are a mirror image": heading is not None and heading.mirror,
            "two anchors are exchanged": places.wrong is not None and places.wrong.place is None,
        }
        return next((cause for cause, found in causes.items() if found), "")

    @property
    def gate(self) -> float:
        """The e²/S up to which ranges are no outliers if they scatter more than the map says; else 0."""
        return 0.0 if self.places.scatter is None else self._setup.noise.gate**2 * self.places.widened

    def advance(self, horizon: float, block: Block, ended: bool = False) -> list[LiveEstimate]:
        """Take in the rows since the last call, and return the estimates that are due.

        No row before the horizon [s] is still to come; with `ended` no row at all. InputError if the imu is silent
        during its standstill, if its force shows a body upside down or another unit, or if the first ranges contradict
        the start.
        """
        self._kept = block if self._kept is None else joined(self._kept, block)
        again = None if self.imu is None or block.imu is None else self.imu.heard_again(block.imu)
        if again is not None and (self.begun or self._map.start is None):
            self._begin_anew(parted(self._kept, np.nextafter(again, -np.inf))[1])
        if ended:
            horizon = float(self._kept.ranges.t[-1]) if len(self._kept.ranges.t) else -np.inf
        if not self.begun and not self._begin(horizon, ended):
            self._next = int(horizon / self._period) + 1 if np.isfinite(horizon) else 0  # tried again then
            return []
        found: list[LiveEstimate] = []
        while (t := self._next * self._period) < horizon and self._reach(t, horizon, ended):
            found.append(LiveEstimate(t, self.state))
            self._next += 1
        return found

    def _begin_anew(self, kept: Block) -> None:
        """Forget all rows but these, and the map's start and standstill, which are past."""
        self._kept, self._map = kept, self._map.in_the_air()
        self.imu, self.agreement = ImuRecord(), Agreement()
        self.lost, self._waits, self._again = self.lost + self.begun, False, True
        self._known = self._events = self.heading = None

    def _begin(self, horizon: float, ended: bool) -> bool:
        """Start the filter if all that it needs has come; return whether it started."""
        assert self._kept is not None
        self._kept = behind_gap(self._kept, BLACKOUT) if self._again else self._kept
        map_, (ranges, imu, looks) = self._map, self._kept
        if imu is not None:
            levels = AT_REST if map_.imu is None else max(AT_REST, map_.imu.standstill)
            if not len(imu.t) or (not ended and horizon <= imu.t[0] + levels):
                self.why_not_begun = f"the first {levels:g} s of the imu level the body"
                return False
            if imu.accelerometer is not None:
                if not len(imu.accelerometer[0]):
                    self.why_not_begun = "the accelerometer is silent"
                    return False
                imu = imu._replace(force=held_at(imu.t, *imu.accelerometer))
            self.force_doubt = checked_force(imu, map_)
        origin = Recording("live", ranges, imu, None, self._anchors, 0.0, 0.0, [], {}, looks)
        rest = at_rest(origin, map_)
        if imu is not None and rest is not None:
            ranges = ranges.only(np.flatnonzero(ranges.t >= rest.end))
        if not len(ranges.t):
            self.why_not_begun = "no range has come since the imu stood still"
            return False
        begin, known = float(ranges.t[0]), uncalibrated_setup(origin, map_, rest)
        if not ended:
            tries = known.heading is None and imu is not None
            whole = max(fix_known_at(ranges) if known.start is None else begin, begin + TRIAL if tries else begin)
            if horizon <= whole:
                self.why_not_begun = f"it needs ranges until {whole:.1f} s after the first"
                return False
        first = int(np.ceil(begin / self._period - 1e-6))
        first += first * self._period < begin
        queries = np.arange(first, int(horizon / self._period) + 2) * self._period
        queries = queries[queries < horizon]
        try:
            events = events_of(ranges, imu, known, queries, begin)
            found = begin_of(ranges, imu, known, map_.filter, self._setup, *events)
            self.state = start_of(ranges, imu, known, map_.filter, found, known.heading is not None)
        except InputError as error:
            self.why_not_begun = str(error)
            late = self._kept.ranges
            self._kept = self._kept._replace(ranges=late.only(np.flatnonzero(late.t > begin + LONGEST)))
            return False
        self._set_out(known, begin, first)
        self.start_doubt = check_start(ranges, self._antenna(), self._anchors, map_) if known.start is not None else ""
        if map_.height is None:
            self.mirror = next(iter(of_plane(self._anchors, self.state.x[None, :3], None, map_.planar)), "")
        return True

    def _set_out(self, known: FilterSetup, begin: float, first: int) -> None:
        """Start at the state, with the events from the stamp `begin` [s] on, and the estimate of number `first`."""
        self._known = known._replace(looks=NO_AID_ROWS)
        self.heading = None if self.imu is None else HeadingWatch(self._setup)
        self._begin_at, self._next, self.begins_at = begin, first, begin
        self._carried: Carried = initial_carried(len(self._anchors), len(self.state.C), self.state.t)
        self._anew: Restart = no_restart(len(self.state.C))
        self._wait = -np.inf

    def resume(self, state: State) -> None:
        """Go on from another process's state, as after a silence of all sensors since its stamp."""
        state.C[:3, :3] += ASTRAY**2 * np.eye(3)  # so a second of ranges finds the position, not one that may be wrong
        self._map, self.state = self._map.in_the_air(), state
        self._set_out(settings_of(self._map, self._anchors), state.t, int(state.t / self._period) + 1)
        if self.imu is not None:
            self.imu.resume(state.t)

    def _antenna(self) -> np.ndarray:
        place: np.ndarray = self.state.x[:3] + matrix_of(self.state.x[Q:ADDITIVE]) @ self._setup.levers[0]
        return place

    def _reach(self, t: float, horizon: float, ended: bool) -> bool:
        """Bring the filter to a stamp [s], and return whether it got there: a lost filter may have to wait."""
        events, heard = self._events_until(t) if self._events is None else self._events
        while True:
            if self._waits:
                window = self._ranges_from(events)
                if not ended and horizon <= fix_known_at(window):
                    self._events = events, heard
                    return False
                self._start_anew(window)
            run, self.state, done = run_filter(
                events, heard, self.state, self._carried, self._anew, self._setup, self._wait, False
            )
            self.ranges, self.taken = self.ranges + len(run.taken), self.taken + int(run.taken.sum())
            past = Events(*(part[:done] for part in events))
            of = past.kind == RANGE
            self.agreement.add(past.t[of], past.which[of], run)
            self.anchors.add(past.which[of], run, self.state)
            if self.state.watched[RESTS] == 0.0:
                sd = float(np.sqrt(np.trace(self.state.C[:3, :3])))
                self.places.advance(past, self._antenna(), self.state.t, sd)
            if self.heading is not None:
                self.heading.advance(past, heard, self.state, self.places.suspected)
            if self.rates is not None:
                self.rates.advance(past, heard, self.state, ranging_of(self._setup, self.state), self.places.suspected)
            if done == len(events.t):
                self._events = None
                return True
            events, self._waits = Events(*(part[done:] for part in events)), True

    def _events_until(self, t: float) -> tuple[Events, EventValues]:
        """Return the events up to a stamp [s], with a query there at the end; keep the later rows."""
        assert self._kept is not None
        assert self._known is not None
        now, self._kept = parted(self._kept, t)
        if self.imu is not None and now.imu is not None:
            self.imu.add(now.imu)
        begin, self._begin_at = self._begin_at, -np.inf
        return events_of(now.ranges, now.imu, self._known._replace(looks=now.looks), np.array([t]), begin)

    def _ranges_from(self, events: Events) -> Ranges:
        """Return the ranges among events, and the ranges kept for later."""
        assert self._kept is not None
        of = events.kind == RANGE
        left = Ranges(*(part[of] for part in (events.t, events.which, events.r, events.other, events.tag)))
        both: Ranges = joined(left, self._kept.ranges)
        return both

    def _start_anew(self, window: Ranges) -> None:
        found = restart_from(window, self._setup, self.state, is_astray(self.state))
        self.lost += found is not None
        self._anew = found or no_restart(len(self.state.C))
        self._wait = float(window.t[0]) + AGAIN
        self._carried = initial_carried(len(self._anchors), len(self.state.C), self.state.t)
        self._waits = False
