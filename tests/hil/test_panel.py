"""The panel of a flight in real time, drawn as text."""

import io
import sys

from rich.console import Console, RenderableType

from ortilo_drake.hil.real_time.panel import live_panel, panel, profile_table
from ortilo_drake.hil.real_time.profile import ProfileRow
from ortilo_drake.hil.real_time.real_time_world import FlightSoFar
from ortilo_drake.hil.real_time.tick_timing import TickTiming
from ortilo_drake.hil.wire.inbox import PacketCounts

PACKETS = PacketCounts(accepted=90, late=2, duplicates=0, lost=5, rejected=7, refused={"old": 7})
H = 0.01


def drawn(what: RenderableType) -> list[str]:
    """Return what a terminal of 100 columns shows, line by line, each as its words joined by one blank."""
    console = Console(file=io.StringIO(), width=100)
    with console.capture() as capture:
        console.print(what)
    return [" ".join(line.strip("│ ").split()) for line in capture.get().splitlines()]


def watched() -> TickTiming:
    """Return the timing of 4 ticks on time, answered after 1, 2 and 13 ms, the last not yet."""
    timing = TickTiming(H)
    for k in range(4):
        timing.sent(k * H, k * H)
    for k, latency in enumerate((1e-3, 2e-3, 13e-3)):
        timing.answered(k, k * H + latency)
    return timing


def figures() -> FlightSoFar:
    return FlightSoFar(watched().summary(3), 3 * H, PACKETS, "hold")


def test_the_panel_shows_every_figure() -> None:
    lines = drawn(panel(figures()))
    assert "ticks 3, 0.0 s" in lines
    assert "real-time factor 1.0000" in lines
    assert "sense to command (ms) median 2.00 p99 12.78 max 13.00" in lines  # 2 + 0.98 (13 - 2)
    assert "jitter (ms) median 0.00 p99 0.00 max 0.00" in lines
    assert "missed deadlines 1" in lines
    assert "commands 2 late 5 lost 7 packets refused" in lines
    assert "flown by hold" in lines


def test_before_the_first_tick_it_shows_dashes() -> None:
    lines = drawn(panel(FlightSoFar(TickTiming(H).summary(0), 0.0, PACKETS, None)))
    assert "real-time factor -" in lines
    assert "sense to command (ms) median - p99 - max -" in lines
    assert "flown by -" in lines


def test_the_tick_under_way_is_no_miss_yet() -> None:
    timing = watched()
    assert timing.summary(3).unanswered == 0
    assert timing.summary().unanswered == 1
    assert timing.summary(2).missed_deadlines == 0


def shown_live(watched_too: bool) -> str:
    """Return what a terminal got of the live panel, which draws itself at the latest when it ends."""
    file, before = io.StringIO(), sys.getswitchinterval()
    with live_panel(Console(file=file, force_terminal=True, width=100)) as show_statistics:
        assert sys.getswitchinterval() < before
        if watched_too:
            show_statistics(figures)
    assert sys.getswitchinterval() == before
    return file.getvalue()


def test_a_terminal_shows_it_live_and_python_is_left_as_it_was() -> None:
    assert "missed deadlines" in shown_live(True)
    assert "waiting for the onboard half" in shown_live(False)


def test_elsewhere_nothing_is_written() -> None:
    file = io.StringIO()
    with live_panel(Console(file=file)) as show_statistics:
        show_statistics(figures)
    assert file.getvalue() == ""


def test_the_table_of_a_profile_names_every_block() -> None:
    rows = [
        ProfileRow("kalman_filter", 12.34, 56.78, 0.25),
        ProfileRow("whole tick", 40.0, 90.0, 1.0),
    ]
    lines = drawn(profile_table(rows, "mine"))
    assert lines[0] == "mine: the onboard half's tick"
    assert "block median [us] p99 [us] share [%]" in lines
    assert "kalman filter 12.3 56.8 25.0" in lines
    assert "whole tick 40.0 90.0 100.0" in lines
