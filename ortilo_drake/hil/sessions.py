"""Sessions of the two halves, a function for each: the tasks of `ortilo hil world` and `ortilo hil onboard`."""

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import xarray as xr

from ortilo_drake.flight.lockstep import fly_lockstep
from ortilo_drake.flight.signals import Record
from ortilo_drake.flight.stepped_halves import OnboardHalf, WorldHalf
from ortilo_drake.hil.goals.goals import GoalPlanner, Goals
from ortilo_drake.hil.lockstep_link import StepsTicks, answer_over_link, ask_over_link
from ortilo_drake.hil.real_time.camera_process import CameraProcess, DetectorThread
from ortilo_drake.hil.real_time.real_time_onboard import answer_in_real_time
from ortilo_drake.hil.real_time.real_time_world import COMMAND_PERIOD, Statistics, fly_in_real_time
from ortilo_drake.hil.real_time.warm_up import no_collecting
from ortilo_drake.hil.reports import OnboardReport, WorldReport
from ortilo_drake.hil.restart.checkpoint import session_of
from ortilo_drake.hil.wire.bus import Bus
from ortilo_drake.hil.wire.handshake import Greeter, flight_of, meet_onboard, meet_world
from ortilo_drake.hil.wire.inbox import Inbox
from ortilo_drake.hil.wire.packets import FINISHED, Outbox, ports
from ortilo_drake.hil.wire.unpack import largest_to_world
from ortilo_drake.scenario import InputError, Scenario

FAREWELLS = 5  # how often the world says that it has finished, because a relay may lose any hello
FAREWELL_EVERY = 0.02  # time between them, so that one burst of losses does not take all [s]


def run_world(
    scenario: Scenario,
    url: str,
    key: bytes,
    lockstep: bool,
    wait: float,
    seconds: float | None = None,
    progress: Callable[[int], None] | None = None,
    record: Record | None = None,
    show_statistics: Callable[[Statistics], None] | None = None,
    check_alive: Callable[[], None] = lambda: None,
) -> tuple[xr.Dataset, WorldReport]:
    """Fly a scenario's world against an onboard half over a link.

    InputError if the bus does not work or the onboard half is missing, silent or flies another scenario.

    Args:
        scenario: the scenario.
        url: the bus, tcp://HOST:PORT, which this process serves.
        key: the key that the halves share, see key_file.py.
        lockstep: whether the world waits for each answer.
        wait: longest search for the onboard half [s].
        seconds: in real time, end after this time of the flight [s].
        progress: called with the number of ticks flown.
        record: called with state, messages and outputs of each tick.
        show_statistics: in real time, see fly_in_real_time.
        check_alive: called while the world searches for the onboard half; it raises if the onboard half will not come.

    Returns:
        The flight and a report.
    """
    with contextlib.ExitStack() as stack:
        bus = stack.enter_context(Bus(url, key, serves=True, largest=largest_to_world(flight_of(scenario, 0))))
        inbox, greeter = Inbox(bus, ("hello", "command", "telemetry")), Greeter(bus, scenario, lockstep)
        camera = CameraProcess(scenario, url, key) if scenario.is_rendered and not lockstep else None
        if camera:
            stack.enter_context(camera)
        # Built before the halves meet, so that neither waits while the other builds.
        world = WorldHalf(scenario, None if lockstep else COMMAND_PERIOD, draws=lockstep)
        if camera:
            camera.wait_until_ready()
        outbox = Outbox(bus, meet_onboard(greeter, inbox, scenario, wait, check_alive).session)
        stack.enter_context(_saying_farewell(greeter))
        if lockstep:
            flight = fly_lockstep(scenario, ask_over_link(outbox, inbox, greeter), progress, record, world)
            timing = None
        else:
            stack.enter_context(no_collecting())
            flight, timing = fly_in_real_time(
                scenario, world, outbox, inbox, greeter, camera, seconds, progress, record, show_statistics
            )
    figures = timing.summary() if timing else None
    return flight, WorldReport(
        ticks=figures.ticks if figures else flight.sizes["tick"],
        packets=inbox.counts("command"),
        timing=figures,
        latencies_ms=timing.latencies_ms() if timing else None,
        pictures_skipped=camera.skipped if camera else None,
    )


@contextlib.contextmanager
def _saying_farewell(greeter: Greeter) -> Iterator[None]:
    try:
        yield
    finally:
        for _ in range(FAREWELLS):
            greeter.say(state=FINISHED)
            time.sleep(FAREWELL_EVERY)


def run_onboard(
    scenario: Scenario,
    url: str,
    key: bytes,
    wait: float,
    progress: Callable[[int], None] | None = None,
    record: Record | None = None,
    checkpoint: Path | None = None,
    say: Callable[[str], None] = print,
    planner: GoalPlanner | None = None,
    exported: StepsTicks | None = None,
) -> OnboardReport:
    """Fly one flight as the onboard half of a scenario; return a report. Call warm_up before.

    Arguments and errors are those of run_world; `checkpoint` and `say` are those of answer_in_real_time. Without a
    planner goals are not answered in real time. `exported` flies in lockstep in place of this process's onboard half.
    """
    with no_collecting(), Bus(url, key) as bus:
        inbox = Inbox(bus, ("hello", "goal", "tick", *ports()))
        detector = DetectorThread(scenario) if scenario.is_rendered else None
        onboard = OnboardHalf(scenario, detects=detector is None)
        in_lockstep = OnboardHalf(scenario) if detector else onboard  # detects landmarks in pictures itself
        met = meet_world(bus, inbox, scenario, wait, session_of(checkpoint) if checkpoint else 0)
        outbox = Outbox(bus, met.flight.session)
        if met.lockstep:
            ticks, real_time = answer_over_link(exported or in_lockstep, outbox, inbox, progress, record), None
        elif exported:
            raise InputError("--exported: flies in lockstep; start the world with --lockstep")
        else:
            goals = Goals(scenario, planner) if planner else None
            ticks, real_time = answer_in_real_time(
                scenario, onboard, outbox, inbox, detector, progress, record, checkpoint, goals, say
            )
        skipped = detector.skipped if detector and not met.lockstep else None
        return OnboardReport(ticks, inbox.counts("tick"), real_time, skipped)
