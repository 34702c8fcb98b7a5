"""The commands `ortilo hil` and `ortilo replay`: the two halves in two processes, and a log flown again."""

import contextlib
import logging
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from ortilo_drake.scenario import InputError, Scenario, load_scenario
from ortilo_drake.terminal import check_writable, err, out, progress_bar, say_written, write_json

hil_app = typer.Typer(no_args_is_help=True, help="Hardware in the loop: the two halves in two processes, over LCM.")

DEFAULT_URL = "udpm://239.255.76.67:7667?ttl=0"
ONBOARD_URL = DEFAULT_URL.replace(":7667", ":7668")
ScenarioArgument = Annotated[str, typer.Argument(help="A ready-made scenario's name or a .yaml file.")]
SetOption = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a setting; may be repeated.")
]
SeedOption = Annotated[int | None, typer.Option(help="Seed of all noise, if not the scenario's own.")]
UrlOption = Annotated[str, typer.Option(help="The LCM bus; by default of this machine alone (ttl=0).")]
WaitOption = Annotated[float, typer.Option(min=1.0, help="How long to look for the other half [s].")]
JsonOption = Annotated[Path | None, typer.Option("--json", help="Write the report as JSON to this file.")]
LockstepOption = Annotated[bool, typer.Option("--lockstep", help="Wait for each answer: bit for bit `ortilo fly`.")]


def _quiet() -> None:
    logging.getLogger("drake").setLevel(logging.WARNING)  # importing Drake has set it to INFO


def _show(lines: dict[str, Any]) -> None:
    for name, value in lines.items():
        if isinstance(value, dict):
            value = ", ".join(f"{key} {_number(part)}" for key, part in value.items() if not isinstance(part, dict))
        out.print(f"  {name.replace('_', ' '):20}{_number(value)}", markup=False, soft_wrap=True)


def _number(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


@hil_app.command("world")
def world(
    scenario: ScenarioArgument = "imu_uwb_yolo",
    seed: SeedOption = None,
    settings: SetOption = None,
    lockstep: LockstepOption = False,
    url: UrlOption = DEFAULT_URL,
    wait: WaitOption = 60.0,
    seconds: Annotated[float | None, typer.Option(min=0.1, help="In real time, end after that much [s].")] = None,
    out_file: Annotated[Path | None, typer.Option("--out", help="Write the flight's data as netCDF.")] = None,
    log: Annotated[Path | None, typer.Option(help="Write the flight as MCAP to this new folder.")] = None,
    json_file: JsonOption = None,
) -> None:
    """Run plant, sensors, link and camera; wait for an onboard half and fly on its commands."""
    chosen = load_scenario(scenario, tuple(settings or ()), seed)
    if seconds is not None and lockstep:
        raise InputError("--seconds: ends a flight in real time, not in --lockstep")
    check_writable(out_file, json_file)
    from ortilo_drake.experiments.flight import flight_ticks, save_flight
    from ortilo_drake.hil.runs import run_world
    from ortilo_drake.logs.writer import LogWriter

    _quiet()
    with contextlib.ExitStack() as stack:
        record = stack.enter_context(LogWriter(log, chosen)).write_tick if log else None
        shown = stack.enter_context(_shown("world", flight_ticks(chosen), lockstep))
        flight, report = run_world(chosen, url, lockstep, wait, seconds, record=record, **shown)
    if out_file:
        save_flight(flight, out_file)
    report.pop("latencies_ms", None)
    report["lost"] = flight.attrs["lost"]
    write_json(json_file, report)
    out.print(f"[bold]{chosen.name}[/bold], seed {chosen.seed}, {'lockstep' if lockstep else 'real time'}")
    _show(report)
    say_written(out_file, log, json_file)


@hil_app.command("onboard")
def onboard(
    scenario: ScenarioArgument = "imu_uwb_yolo",
    seed: SeedOption = None,
    settings: SetOption = None,
    url: UrlOption = DEFAULT_URL,
    wait: WaitOption = 60.0,
    log: Annotated[Path | None, typer.Option(help="Write what it took and made of it as MCAP to this folder.")] = None,
    checkpoint: Annotated[
        Path | None, typer.Option(help="Keep the filter's state in this file, to join a flight again after a kill.")
    ] = None,
    keep: Annotated[
        bool, typer.Option("--keep-alive", help="Start again at once whenever the process that flies is killed.")
    ] = False,
    profile: Annotated[
        bool, typer.Option("--profile", help="Time each block on this machine, without a world, and end.")
    ] = False,
    json_file: JsonOption = None,
) -> None:
    """Run perception, filter, servo and planner for one flight of a world; real time or lockstep as the world says."""
    chosen = load_scenario(scenario, tuple(settings or ()), seed)
    if keep and log:
        raise InputError("--log: a process that is started again cannot go on in it; leave --keep-alive out")
    check_writable(json_file, checkpoint)
    from ortilo_drake.experiments.flight import flight_ticks
    from ortilo_drake.hil.keep_alive import keep_alive
    from ortilo_drake.hil.runs import run_onboard
    from ortilo_drake.hil.warm_up import warm_up
    from ortilo_drake.logs.writer import LogWriter

    _quiet()
    if profile:
        _profile(chosen, json_file)
        return
    ticks = flight_ticks(chosen)
    warm_up(chosen)

    def fly_once() -> None:
        with contextlib.ExitStack() as stack:
            record = stack.enter_context(LogWriter(log, chosen)).write_tick if log else None
            bar = stack.enter_context(progress_bar())
            task = bar.add_task("onboard", total=ticks)
            report = run_onboard(chosen, url, wait, lambda k: bar.update(task, completed=k), record, checkpoint)
        write_json(json_file, report)
        _show(report)
        say_written(log, json_file)

    if not keep:
        fly_once()
        return
    with tempfile.TemporaryDirectory() as folder:
        checkpoint = checkpoint or Path(folder) / "checkpoint.npz"
        keep_alive(fly_once, lambda line: err.print(line, markup=False))


@hil_app.command("bridge")
def bridge(
    scenario: ScenarioArgument = "imu_uwb_yolo",
    seed: SeedOption = None,
    settings: SetOption = None,
    ros2: Annotated[bool, typer.Option("--ros2", help="Publish as a ROS 2 node, on this machine.")] = False,
    mavlink: Annotated[
        str | None, typer.Option(metavar="udpout:HOST:PORT", help="Send the estimate as MAVLink 2 there.")
    ] = None,
    url: UrlOption = DEFAULT_URL,
    wait: WaitOption = 60.0,
    seconds: Annotated[float | None, typer.Option(min=0.1, help="End after that long [s].")] = None,
    json_file: JsonOption = None,
) -> None:
    """Listen to a flight of a world and an onboard half, and pass it on to ROS 2 or a MAVLink autopilot."""
    chosen = load_scenario(scenario, tuple(settings or ()), seed)
    if not ros2 and mavlink is None:
        raise InputError("--ros2, --mavlink: give one of them or both")
    check_writable(json_file)
    from ortilo_drake.bridges.mavlink import MavlinkBridge
    from ortilo_drake.bridges.ros2 import Ros2Bridge
    from ortilo_drake.hil.bridge import Target, mavlink_target, ros2_target, run_bridge

    _quiet()
    targets: dict[str, Target] = {}
    with contextlib.ExitStack() as stack:
        if mavlink is not None:
            sender = stack.enter_context(contextlib.closing(MavlinkBridge(mavlink)))
            targets["mavlink"] = mavlink_target(sender, chosen.control_rate)
        if ros2:
            targets["ros2"] = ros2_target(stack.enter_context(Ros2Bridge(chosen)))
        report = run_bridge(url, chosen, targets, seconds, wait, lambda line: print(line, flush=True))
    write_json(json_file, report)
    _show(report)
    say_written(json_file)


def _profile(scenario: Scenario, json_file: Path | None) -> None:
    """Print, and write as JSON, which block of the onboard half spends the time."""
    from ortilo_drake.hil.panel import profile_table
    from ortilo_drake.hil.profile import PROFILE_TICKS, profile_onboard
    from ortilo_drake.hil.warm_up import stop_collecting

    stop_collecting()
    rows = profile_onboard(scenario, PROFILE_TICKS)
    write_json(json_file, rows)
    out.print(profile_table(rows, scenario.name))
    say_written(json_file)


@hil_app.command("check")
def check(
    scenario: ScenarioArgument = "imu_uwb_yolo",
    seed: SeedOption = None,
    settings: SetOption = None,
    lockstep: LockstepOption = False,
    seconds: Annotated[float | None, typer.Option(min=0.1, help="In real time, end after that much [s].")] = None,
    url: UrlOption = DEFAULT_URL,
    png: Annotated[Path | None, typer.Option(help="Draw the latencies' histogram to this file.")] = None,
    json_file: JsonOption = None,
) -> None:
    """Run both halves on this machine, in two processes, and report what time and link did to the flight."""
    chosen = load_scenario(scenario, tuple(settings or ()), seed)
    if lockstep and (seconds is not None or png is not None):
        raise InputError("--seconds, --png: belong to a flight in real time, not to --lockstep")
    check_writable(png, json_file)
    from ortilo_drake.experiments.flight import flight_ticks, fly
    from ortilo_drake.hil.latency_figure import latency_figure
    from ortilo_drake.hil.runs import run_world

    _quiet()
    with _shown("flying", flight_ticks(chosen), lockstep) as shown, _other_half(chosen, url):
        flight, report = run_world(chosen, url, lockstep, 60.0, seconds, **shown)
    identical = None
    if lockstep:
        import xarray as xr

        alone = fly(chosen)
        del alone.attrs["real_time_factor"]
        identical = bool(xr.Dataset.identical(flight, alone))
    if png:
        latency_figure(report["latencies_ms"], chosen.h, png)
    report.pop("latencies_ms", None)
    none = {"median": None, "p99": None, "max": None}
    report = {"identical": identical, "latency_ms": none, "missed_deadlines": None} | report
    write_json(json_file, report)
    out.print(f"[bold]{chosen.name}[/bold], seed {chosen.seed}, {'lockstep' if lockstep else 'real time'}")
    _show(report)
    say_written(png, json_file)
    if identical is False:
        raise InputError(f"{chosen.name}: the flight over LCM differs from the one in a single process")


@contextlib.contextmanager
def _shown(name: str, ticks: int, lockstep: bool) -> Iterator[dict[str, Any]]:
    """Show a flight in the terminal, in real time its figures; yields what run_world wants for that."""
    from ortilo_drake.hil.panel import live_panel

    if lockstep:
        with progress_bar() as bar:
            task = bar.add_task(name, total=ticks)
            yield {"progress": lambda k: bar.update(task, completed=k)}
    else:
        with live_panel(err) as watching:
            yield {"watching": watching}


@contextlib.contextmanager
def _other_half(scenario: Scenario, url: str) -> Iterator[None]:
    """Run `ortilo hil onboard` beside this process."""
    with tempfile.TemporaryDirectory() as folder:
        import yaml

        file = Path(folder) / f"{scenario.name}.yaml"
        file.write_text(yaml.safe_dump(scenario.model_dump(mode="json")), encoding="utf-8")
        command = [sys.executable, "-m", "ortilo_drake.cli", "hil", "onboard", str(file), "--url", url]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
            try:
                yield
                process.wait(20.0)
            except InputError as error:
                process.terminate()
                said = (process.communicate()[1] or "").strip()
                raise InputError(f"{error}" + (f" (it said: {said.splitlines()[-1]})" if said else "")) from None
            finally:
                process.terminate()


@hil_app.command("relay")
def relay(
    faults: Annotated[
        str, typer.Option(help="Of both directions, in SI units: '{loss: 0.2, delay: 0.04, spread: 0.02, ...}'.")
    ] = "{}",
    to_onboard: Annotated[str | None, typer.Option(help="Faults on the way to the onboard half, if others.")] = None,
    to_world: Annotated[str | None, typer.Option(help="Faults on the way to the world, if others.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all chances.")] = 1,
    url_world: Annotated[str, typer.Option(help="The world's bus.")] = DEFAULT_URL,
    url_onboard: Annotated[str, typer.Option(help="The onboard half's bus.")] = ONBOARD_URL,
    seconds: Annotated[float, typer.Option(min=0.0, help="Stop after that long [s]; Ctrl-C stops it too.")] = 86400.0,
    json_file: JsonOption = None,
) -> None:
    """Pass packets on between the halves, each on a bus of its own, with faults; the fields are in hil/faults.py."""
    check_writable(json_file)
    from ortilo_drake.hil.faults import Faults
    from ortilo_drake.hil.relay import run_relay
    from ortilo_drake.model.typed_yaml import parse_yaml, validate

    _quiet()
    there, back = (
        validate(Faults, parse_yaml(text, option), option)
        for option, text in (
            ("--faults" if to_onboard is None else "--to-onboard", faults if to_onboard is None else to_onboard),
            ("--faults" if to_world is None else "--to-world", faults if to_world is None else to_world),
        )
    )
    counts = run_relay(url_world, url_onboard, there, back, seed, seconds)
    write_json(json_file, counts)
    _show(counts)
    say_written(json_file)


def replay(
    log: Annotated[Path, typer.Argument(help="A log's folder, or its .mcap file.")],
    json_file: JsonOption = None,
) -> None:
    """Drive the onboard half from a recorded world and compare its estimates with the recorded ones."""
    check_writable(json_file)
    from ortilo_drake.hil.replay import replay_log

    _quiet()
    result = replay_log(log)
    write_json(json_file, result)
    out.print(f"[bold]{log}[/bold]")
    _show(result)
    say_written(json_file)
