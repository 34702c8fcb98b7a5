"""A flight in this process whose ticks are recorded: in a log, or by a function of the caller's."""

import time
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import xarray as xr

from ortilo_drake.flight.lockstep import fly_lockstep, in_this_process
from ortilo_drake.flight.signals import Record, Signals
from ortilo_drake.flight.stepped_halves import WorldHalf
from ortilo_drake.interop.log.writer import LogWriter
from ortilo_drake.scenario import Scenario


def fly_logged(
    scenario: Scenario, log: Path | None, progress: Callable[[int], None] | None = None, also: Record | None = None
) -> xr.Dataset:
    """Fly a scenario as flight.fly does, bit for bit, and write all that crosses between its halves.

    The log is a folder, see interop/log/writer.py, of which all that was written before an interruption is readable;
    None writes none. The progress is told as ticks flown; `also` is called with everything of a tick, as the log's
    writer is. InputError if the log is there already or cannot be written, or as fly.
    """
    ask, world = in_this_process(scenario), WorldHalf(scenario)
    with LogWriter(log, scenario) if log else nullcontext() as writer:
        records = [record for record in (writer and writer.write_tick, also) if record]

        def record_tick(k: int, state: np.ndarray | None, messages: Signals, outputs: Signals) -> None:
            for record in records:
                record(k, state, messages, outputs)

        started = time.perf_counter()
        flight = fly_lockstep(scenario, ask, progress, record_tick, world)
        wall = time.perf_counter() - started
    flight.attrs["real_time_factor"] = float(flight["time"][-1]) / wall
    return flight
