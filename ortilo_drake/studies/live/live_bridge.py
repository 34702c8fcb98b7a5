"""The bridge between live sensors and their users: messages in, estimates and setpoints out.

The bridge knows neither ROS nor MAVLink. A source of messages feeds it, and targets take its estimates.
"""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ortilo_drake.interop.recorded.live_rows import AGAIN as HEARD_AGAIN
from ortilo_drake.interop.recorded.live_rows import LAG, LiveRows
from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.studies.live.kept_state import Kept, why_not
from ortilo_drake.studies.live.live_filter import RATE, LiveFilter
from ortilo_drake.studies.live.live_warnings import LiveWarnings, Say
from ortilo_drake.studies.live.sensor_records import AnchorFigures
from ortilo_drake.studies.live.setpoints import Holding, Setpoint
from ortilo_drake.studies.live.stamped_estimate import AGAIN, ALL, Limits, StampedEstimate, estimate_at
from ortilo_drake.studies.live.warm_up import warm_up
from ortilo_drake.studies.recorded.moved_anchors import names_of

WINDOW: Final = 30.0  # the least delay within the last one to two windows counts, so clocks may drift [s]


class SensorClock:
    """The sensors' clock, extrapolated between and after messages by a wall clock [s] that never goes back.

    The least delay of the recent messages gives the offset of the two clocks, as in the clock filter of D. L. Mills,
    RFC 5905. It shows a bridge that cannot keep up, or stands still, that its messages are old.
    """

    def __init__(self, wall: Callable[[], float]):
        self._wall = wall
        self._since, self._least, self._before = -np.inf, np.inf, np.inf

    def now(self, newest: float) -> float:
        """Return the sensors' time [s]; it is at least `newest`, the newest stamp received."""
        wall = self._wall()
        if wall - self._since > WINDOW:
            self._since, self._before, self._least = wall, self._least, np.inf
        self._least = min(self._least, wall - newest)
        return wall - min(self._least, self._before)


# Called with the estimate, the setpoint if there is one, and how often the filter has started anew.
Target = Callable[[StampedEstimate, Setpoint | None, int], None]
QUIET = 5.0  # after so long without any message, a line says so [s]
LONG: Final = 3.0  # if the filter has not begun by then, a line says why [s]


@dataclass(frozen=True)
class LiveReport:
    """The messages that a bridge received and sent.

    Attributes:
        messages: number of messages by topic.
        ranges: number of ranges that the filter saw.
        taken: number of ranges that the filter took.
        nis: mean e²/S of the ranges taken, 1 if the noise is right; None before the first.
        anchors: figures by anchor.
        estimates: number of estimates made.
        lost: how often the filter was lost and started anew.
        late_ms: median and largest age of an estimate against the newest stamp of a sensor [ms].
        old: number of estimates that were too old for a target.
        uncertain: number of estimates that were too uncertain for a target.
        refused: number of estimates for which the failsafe let no setpoint through; None if no place is held.
        rejected: number of rows that were not used, by topic and reason.
        failed: why targets failed, by target.
        not_begun: why there is no estimate; empty if there is one.
    """

    messages: dict[str, int]
    ranges: int
    taken: int
    nis: float | None
    anchors: dict[str, AnchorFigures]
    estimates: int
    lost: int
    late_ms: dict[str, float] | None
    old: int
    uncertain: int
    refused: int | None
    rejected: dict[str, int]
    failed: dict[str, str]
    not_begun: str


@dataclass
class _Output:
    """A target, the largest age of its estimates [s], its limits, and which limit keeps estimates back now."""

    send: Target
    oldest: float
    limits: Limits
    unsure: str = ""


class LiveBridge:
    """The filter between topics and targets, by a map that describes the topics.

    say: takes a line about an error; note: takes a line about a change for the better, `say` by default; rate: of the
    estimates [Hz]; lag: longest time for which a silent topic holds the others back [s]; holding: makes setpoints;
    wall: clock that passes as the sensors' [s]; `topics` are those to listen to. InputError if the map cannot be used
    live, or the place to hold is far.
    """

    def __init__(
        self,
        map_: Map,
        say: Say,
        rate: float = RATE,
        lag: float = LAG,
        holding: Holding | None = None,
        note: Say | None = None,
        wall: Callable[[], float] = time.monotonic,
    ):
        self._map, self._rows = map_, LiveRows(map_, lag)
        self.topics = self._rows.topics
        if holding is not None:
            holding.check_within(self._rows.anchors)
        self._filter = LiveFilter(map_, self._rows.anchors, rate)
        self._outputs: dict[str, _Output] = {}
        self._clock = SensorClock(wall)
        self._say, self._note = say, note or say
        self._imu, self._holding = map_.imu is not None, holding
        self._failed: dict[str, str] = {}
        self._warnings, self._waits = LiveWarnings(map_, self._say, self._note), False
        self._ages: list[float] = []
        self._old, self._uncertain, self._refused = 0, 0, 0
        self._received = self._resets = 0
        self._resumes: tuple[Kept, str] | None = None
        self._from = -np.inf  # estimates before this stamp are of a silence that is past [s]
        self._why: str | None = None  # why the last setpoint was refused, empty if it was sent; None before the first

    @property
    def newest(self) -> float:
        """The newest stamp of the sensors [s], -inf before the first."""
        return self._rows.newest

    def warm_up(self) -> None:
        """Compile or load all code that the filter needs, before messages come: this takes seconds."""
        warm_up(self._map, self._rows.anchors)

    @property
    def kept(self) -> Kept | None:
        """The state from which another process can go on after the last estimate; None once the map is found wrong."""
        resets = self._resets + self._filter.lost
        kept = Kept(self._rows.origin or 0.0, self._rows.newest, self._received, resets, self._filter.state)
        return None if self._filter.wrong else kept

    def resume(self, kept: Kept, name: str) -> None:
        """Go on from a state that another process kept under `name`, if the first messages fit it; else say why not."""
        self._resumes, self._resets = (kept, name), kept.resets + 1

    def add_target(self, name: str, target: Target, oldest: float = np.inf, limits: Limits = ALL) -> None:
        """Give a target all estimates from now on that are at most `oldest` [s] old, by the sensors' clock.

        Estimates beyond the limits of uncertainty are left out; a warning tells when this begins, a line when it ends.
        The heading's limit does not count without an imu. A target that raises is dropped, with a warning.
        """
        self._outputs[name] = _Output(target, oldest, limits if self._imu else limits._replace(yaw=np.inf))

    def receive(self, topic: str, received: int, message: Any) -> list[StampedEstimate]:
        """Take a message received at `received` [ns], and return the estimates that are now due.

        Raises:
            InputError: if the first ranges contradict the map's start, or if by the force the body is upside down.
        """
        self._received = received
        for line in self._rows.add(topic, received, message):
            (self._note if line.endswith(HEARD_AGAIN) else self._say)(line)
        if self._resumes is not None and self._rows.newest > -np.inf:
            self._go_on_from(*self._resumes)
        return self._go_on(False)

    def _go_on_from(self, kept: Kept, name: str) -> None:
        self._resumes, newest = None, self._rows.newest
        if why := why_not(kept, newest, self._received):
            self._say(f"warning  {name}: is not used: {why}")
            return
        self._rows.origin, self._from = kept.origin, newest
        self._filter.resume(kept.state)
        self._note(f"goes on from {name}, {newest - kept.origin - kept.state.t:.1f} s later")

    def end(self) -> list[StampedEstimate]:
        """Process the messages that still wait, and return the last estimates."""
        return self._go_on(True)

    def _go_on(self, ended: bool) -> list[StampedEstimate]:
        due = self._rows.before(self._filter.due, ended)
        if due is None:
            return []
        if self._rows.newest > -np.inf:
            self._clock.now(self._rows.newest)
        found = self._filter.advance(*due, ended=ended)
        self._warnings.look_at(self._filter)
        origin, newest = self._rows.origin or 0.0, self._rows.newest
        if not self._filter.begun and not self._waits and not ended and due[0] > LONG:
            self._waits = True
            begins = "the filter begins anew" if self._filter.lost else f"not begun after {LONG:g} s"
            self._note(f"{begins}: {self._filter.why_not_begun}")
        found = [one for one in found if origin + one.t >= self._from]
        made = [estimate_at(origin + one.t, one.state, self._imu) for one in found]
        for one in made:
            self._ages.append(newest - one.t)
            self._hand_on(one, newest)
        return made

    def _hand_on(self, one: StampedEstimate, newest: float) -> None:
        one = one._replace(covariance=self._filter.places.widened * one.covariance)
        now = self._clock.now(newest)
        wanted = None if self._holding is None else self._holding.setpoint(one, now)
        if self._holding is not None and wanted is not None:
            self._refused += bool(wanted.refused)
            if wanted.refused != self._why:
                self._why = wanted.refused
                if self._why:
                    self._say(f"failsafe: no setpoints: {self._why}")
                else:
                    self._note(f"setpoints: to hold {self._holding.aim}")
        of_age = {name: now - one.t <= output.oldest for name, output in self._outputs.items()}
        sure = {name: self._is_sure(name, output, one) for name, output in self._outputs.items()}
        self._old += not all(of_age.values())
        self._uncertain += not all(sure.values())
        for name, output in list(self._outputs.items()):
            if not of_age[name] or not sure[name]:
                continue
            try:
                output.send(one, wanted, self._resets + self._filter.lost)
            except Exception as error:  # whatever a library raises, the other targets go on
                del self._outputs[name]
                self._failed[name] = " ".join(str(error).split()) or type(error).__name__
                self._say(f"{name}: failed and gets no more: {self._failed[name]}")

    def _is_sure(self, name: str, output: _Output, one: StampedEstimate) -> bool:
        """Return whether an estimate is within an output's limits; say when this changes."""
        before, limits = output.unsure, output.limits
        output.unsure = limits.why_not(one) or (limits.why_not(one, AGAIN) if before else "")
        if limits.deviation < np.inf and not output.unsure:
            output.unsure = self._filter.why_unfit(bool(before))
        if bool(output.unsure) != bool(before):
            if output.unsure:
                self._say(f"warning  {name}: no estimates: {output.unsure}")
            else:
                self._note(f"{name}: estimates again")
        return not output.unsure

    def report(self) -> LiveReport:
        """Return the report of the messages received and sent so far."""
        ages, figures = 1e3 * np.array(self._ages), self._filter.anchors.figures()
        names = [name.strip("'") for name in names_of(self._map, len(figures))]
        return LiveReport(
            self._rows.message_counts(),
            self._filter.ranges,
            self._filter.taken,
            self._filter.anchors.nis,
            {name: one for name, one in zip(names, figures, strict=True) if one is not None},
            len(ages),
            self._filter.lost,
            {"median": round(float(np.median(ages)), 1), "largest": round(float(ages.max()), 1)} if len(ages) else None,
            self._old,
            self._uncertain,
            None if self._holding is None else self._refused,
            self._rows.counts(),
            self._failed,
            "" if self._filter.begun else self._filter.why_not_begun,
        )


def run_live(
    bridge: LiveBridge, messages: Iterable[tuple[str, int, Any] | None], say: Say, seconds: float | None = None
) -> LiveReport:
    """Feed a bridge until its messages end, `seconds` have passed by the wall clock, or Ctrl-C is pressed.

    A message is a tuple of topic, time of receipt [ns] and the message itself; None comes now and then without one.
    """
    began = heard = time.monotonic()
    quiet = False
    try:
        for message in messages:
            now = time.monotonic()
            if message is not None:
                bridge.receive(*message)
                heard, quiet = now, False
            elif now - heard > QUIET and not quiet:
                quiet = True
                say(f"nothing heard for {QUIET:g} s on {', '.join(bridge.topics)}")
            if seconds is not None and now - began > seconds:
                break
        bridge.end()
    except KeyboardInterrupt:
        say("stopped")
    return bridge.report()
