"""A flight in this process, logged tick by tick."""

import time
from collections.abc import Callable
from pathlib import Path

import xarray as xr

from ortilo_drake.flight.lockstep import fly_lockstep, in_this_process
from ortilo_drake.flight.stepped_halves import WorldHalf
from ortilo_drake.interop.log.writer import LogWriter
from ortilo_drake.scenario import Scenario


def fly_logged(scenario: Scenario, log: Path, progress: Callable[[int], None] | None = None) -> xr.Dataset:
    """Fly a scenario as flight.fly does, bit for bit, and write all that crosses between its halves.

    Args:
        scenario: the scenario.
        log: the log's folder, see interop/log/writer.py; what was written before an interruption is readable.
        progress: called with the number of ticks flown.

    Raises:
        InputError: if the log is there already or cannot be written, or as fly.
    """
    ask, world = in_this_process(scenario), WorldHalf(scenario)
    with LogWriter(log, scenario) as writer:
        started = time.perf_counter()
        flight = fly_lockstep(scenario, ask, progress, writer.write_tick, world)
        wall = time.perf_counter() - started
    flight.attrs["real_time_factor"] = float(flight["time"][-1]) / wall
    return flight
