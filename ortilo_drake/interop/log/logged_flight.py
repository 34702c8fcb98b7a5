"""A flight in this process whose ticks are recorded, in a log or by a function of the caller."""

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
    """Fly a scenario with the same result as flight.fly, bit for bit, and write all signals between the halves.

    `log` is a folder, see interop/log/writer.py; None writes no log. After an interruption the ticks written so far are
    readable. `progress` is called with the number of ticks flown. `also` is called with the same arguments as
    LogWriter.write_tick. InputError if the log already exists or cannot be written, and as in fly.
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
