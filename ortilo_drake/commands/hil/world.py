"""The command `ortilo hil world`: plant, sensors, link and camera in a process."""

import contextlib
import json
from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands.hil.options import (
    InsecureOption,
    KeyOption,
    LockstepOption,
    SecondsOption,
    ServesOption,
    WaitOption,
    showing_flight,
)
from ortilo_drake.commands.options import (
    DEFAULT_SCENARIO,
    JsonOption,
    ScenarioArgument,
    SeedOption,
    SetOption,
)
from ortilo_drake.commands.terminal import check_writable, say_error, say_heading, say_written, show_report, write_json
from ortilo_drake.hil.wire.urls import DEFAULT_URL
from ortilo_drake.scenario import InputError, load_scenario


def world(
    scenario: ScenarioArgument = DEFAULT_SCENARIO,
    seed: SeedOption = None,
    settings: SetOption = None,
    lockstep: LockstepOption = False,
    url: ServesOption = DEFAULT_URL,
    key: KeyOption = None,
    insecure: InsecureOption = False,
    wait: WaitOption = 60.0,
    seconds: SecondsOption = None,
    out_file: Annotated[Path | None, typer.Option("--out", help="Write the flight's data as netCDF.")] = None,
    log: Annotated[Path | None, typer.Option(help="Write the flight as MCAP to this new folder.")] = None,
    json_file: JsonOption = None,
) -> None:
    """Run plant, sensors, link and camera; wait for an onboard half and follow its commands."""
    chosen = load_scenario(scenario, tuple(settings or ()), seed)
    if seconds is not None and lockstep:
        raise InputError("--seconds: is for real time: leave --lockstep out")
    check_writable(out_file)
    from ortilo_drake.flight.flyable import flight_ticks
    from ortilo_drake.flight.saved_flight import save_flight
    from ortilo_drake.hil.restart.until_it_fails import UntilItFails
    from ortilo_drake.hil.sessions import run_world
    from ortilo_drake.hil.wire.key_file import choose_key
    from ortilo_drake.interop.log.writer import LogWriter
    from ortilo_drake.interop.ros.ros_messages import SENT, TAKEN

    secret = choose_key(url, key, insecure)
    with contextlib.ExitStack() as stack:
        writer = stack.enter_context(LogWriter(log, chosen, TAKEN if lockstep else SENT)) if log else None
        record = UntilItFails(writer.write_tick, say_error) if writer else None
        shown = stack.enter_context(showing_flight("world", flight_ticks(chosen), lockstep))
        flight, report = run_world(chosen, url, secret, lockstep, wait, seconds, record=record, **shown)
        if out_file:
            save_flight(flight, out_file)
        lines = report.lines() | {"lost": json.loads(flight.attrs["lost"])}
        write_json(json_file, lines)
        say_heading(chosen.name, f", seed {chosen.seed}, {'lockstep' if lockstep else 'real time'}")
        show_report(lines)
    if record and record.error:
        raise record.error
    say_written(out_file, log, json_file)
