"""The command `ortilo hil onboard`: perception, filter, servo and planner in a process."""

import contextlib
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands.hil.options import InsecureOption, KeyOption, UrlOption, WaitOption
from ortilo_drake.commands.options import (
    DEFAULT_SCENARIO,
    JsonOption,
    ScenarioArgument,
    SeedOption,
    SetOption,
)
from ortilo_drake.commands.terminal import (
    check_writable,
    out,
    progress_bar,
    say_error,
    say_written,
    show_report,
    write_json,
)
from ortilo_drake.hil.wire.urls import DEFAULT_URL
from ortilo_drake.scenario import InputError, Scenario, load_scenario


def _profile(scenario: Scenario, json_file: Path | None) -> None:
    """Print, and write as JSON, the time that each block of the onboard half takes."""
    from ortilo_drake.hil.real_time.panel import profile_table
    from ortilo_drake.hil.real_time.profile import PROFILE_TICKS, profile_onboard
    from ortilo_drake.hil.real_time.warm_up import no_collecting

    with no_collecting():
        rows = profile_onboard(scenario, PROFILE_TICKS)
    write_json(json_file, rows)
    out.print(profile_table(rows, scenario.name))
    say_written(json_file)


def onboard(
    scenario: ScenarioArgument = DEFAULT_SCENARIO,
    seed: SeedOption = None,
    settings: SetOption = None,
    url: UrlOption = DEFAULT_URL,
    key: KeyOption = None,
    insecure: InsecureOption = False,
    wait: WaitOption = 60.0,
    log: Annotated[Path | None, typer.Option(help="Write inputs and outputs as MCAP to this new folder.")] = None,
    checkpoint: Annotated[
        Path | None,
        typer.Option(
            help="In real time, save the state in this file, and a goal's path beside it, to continue after a kill."
        ),
    ] = None,
    keep: Annotated[
        bool, typer.Option("--keep-alive", help="Restart at once whenever the flying process is killed.")
    ] = False,
    exported: Annotated[
        Path | None,
        typer.Option(help="In lockstep, run the half that `ortilo export` wrote to this folder; emulated if needed."),
    ] = None,
    profile: Annotated[
        bool, typer.Option("--profile", help="Time each block on this machine, without a world, and exit.")
    ] = False,
    json_file: JsonOption = None,
) -> None:
    """Run perception, filter, servo and planner for one flight; the world decides on real time or lockstep."""
    chosen = load_scenario(scenario, tuple(settings or ()), seed)
    if profile and (keep or log or checkpoint):
        raise InputError("--profile: runs without a world: leave --keep-alive, --log and --checkpoint out")
    if exported and (profile or keep or checkpoint):
        raise InputError("--exported: flies in lockstep: leave --profile, --keep-alive and --checkpoint out")
    if keep and log:
        raise InputError("--log: a restarted process cannot continue a log: leave --keep-alive out")
    check_writable(checkpoint)
    from ortilo_drake.codegen.exported_half import ExportedHalf
    from ortilo_drake.flight.flyable import flight_ticks
    from ortilo_drake.hil.goals.goals import GoalPlanner
    from ortilo_drake.hil.real_time.warm_up import warm_up
    from ortilo_drake.hil.restart.keep_alive import keep_alive
    from ortilo_drake.hil.restart.until_it_fails import UntilItFails
    from ortilo_drake.hil.sessions import run_onboard
    from ortilo_drake.hil.wire.handshake import PATIENCE
    from ortilo_drake.hil.wire.key_file import choose_key
    from ortilo_drake.interop.log.writer import LogWriter

    if profile:
        _profile(chosen, json_file)
        return
    secret = choose_key(url, key, insecure)
    if checkpoint:
        checkpoint.parent.mkdir(parents=True, exist_ok=True)
    ticks = flight_ticks(chosen)

    def fly_once(killed: int = 0) -> None:
        with contextlib.ExitStack() as stack:
            writer = stack.enter_context(LogWriter(log, chosen)) if log else None
            record = UntilItFails(writer.write_tick, say_error) if writer else None
            half = stack.enter_context(ExportedHalf(chosen, exported)) if exported else None
            bar = stack.enter_context(progress_bar())
            task = bar.add_task("onboard", total=ticks)

            def show(k: int) -> None:
                bar.update(task, completed=k)

            report = run_onboard(chosen, url, secret, wait, show, record, checkpoint, say_error, planner, half)
            write_json(json_file, report.lines())
            show_report(report.lines())
        if record and record.error:
            raise record.error
        if report.real_time and report.real_time.silent_at is not None:
            raise InputError(f"world: silent for {PATIENCE:g} s at tick {report.real_time.silent_at}")
        say_written(log, json_file)

    with GoalPlanner(chosen) as planner, tempfile.TemporaryDirectory() as folder:
        warm_up(chosen)
        planner.wait_until_ready()
        if keep:  # each new process inherits the planner
            checkpoint = checkpoint or Path(folder) / "checkpoint.npz"
            keep_alive(fly_once, say_error)
        else:
            fly_once()
