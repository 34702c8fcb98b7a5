"""A live panel of a flight in real time, in a terminal, and the table of a profile.

Rich draws the panel in its own thread, four times a second. While the panel is shown, Python switches threads a hundred
times as often as by default (every 5 ms), so that a tick never waits for the drawing.
"""

import contextlib
import sys
from collections.abc import Callable, Iterator
from typing import Final

from rich import box
from rich.console import Console, RenderableType
from rich.live import Live
from rich.markup import escape
from rich.panel import Panel
from rich.table import Table

from ortilo_drake.hil.real_time.profile import ProfileRow
from ortilo_drake.hil.real_time.real_time_world import FlightSoFar, Statistics
from ortilo_drake.hil.real_time.tick_timing import Quantiles

DRAWINGS_PER_SECOND: Final = 4
SWITCH_INTERVAL: Final = 5e-5  # longest time for which a thread may delay another [s]
_COLOURS = {"command": "green", "hold": "yellow", "descend": "red"}


def _milliseconds(quantiles: Quantiles) -> str:
    return "  ".join(
        f"{name} {value:.2f}" if value is not None else f"{name} -" for name, value in vars(quantiles).items()
    )


def _alarm(count: int) -> str:
    return f"[{'red' if count else 'green'}]{count}[/]"


def panel(figures: FlightSoFar) -> Panel:
    """Return the panel of a flight under way."""
    timing, mode, packets = figures.timing, figures.failsafe, figures.packets
    factor = timing.real_time_factor
    table = Table.grid(padding=(0, 2))
    table.add_row("ticks", f"{timing.ticks}, {figures.simulated_s:.1f} s")
    table.add_row("real-time factor", "-" if factor is None else f"{factor:.4f}")
    table.add_row("sense to command [dim](ms)[/]", _milliseconds(timing.latency_ms))
    table.add_row("jitter [dim](ms)[/]", _milliseconds(timing.jitter_ms))
    table.add_row("missed deadlines", _alarm(timing.missed_deadlines))
    counts = (f"{_alarm(count)} {key}" for key, count in (("late", packets.late), ("lost", packets.lost)))
    table.add_row("commands", "  ".join([*counts, f"{_alarm(packets.rejected)} packets refused"]))
    table.add_row("flown by", "-" if mode is None else f"[{_COLOURS[mode]}]{mode}[/]")
    return Panel(table, title="in real time", title_align="left", expand=False)


def profile_table(rows: list[ProfileRow], name: str) -> Table:
    """Return the table of a profile's rows (hil/real_time/profile.py), titled with the scenario's name."""
    table = Table(title=f"{escape(name)}: the onboard half's tick", title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("block")
    for title in ("median [us]", "p99 [us]", "share [%]"):
        table.add_column(escape(title), justify="right")
    for row in rows:
        figures = row.median_us, row.p99_us, 100.0 * row.share
        table.add_row(row.block.replace("_", " "), *(f"{figure:.1f}" for figure in figures))
    return table


@contextlib.contextmanager
def live_panel(console: Console) -> Iterator[Callable[[Statistics], None]]:
    """Show the panel within the context, if the console is a terminal; yield the function show_statistics of run_world.

    Until this function is called the panel says that the world waits.
    """
    figures: Statistics | None = None

    def draw() -> RenderableType:
        return panel(figures()) if figures else Panel("waiting for the onboard half", expand=False)

    def show_statistics(function: Statistics) -> None:
        nonlocal figures
        figures = function

    if not console.is_terminal:
        yield show_statistics
        return
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL)
    try:
        with Live(get_renderable=draw, console=console, refresh_per_second=DRAWINGS_PER_SECOND, transient=True):
            yield show_statistics
    finally:
        sys.setswitchinterval(before)
