"""The command `ortilo hil check`: a flight of both halves on this machine, and a report on the flight."""

import contextlib
import json
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape

from ortilo_drake.commands.hil.options import LockstepOption, SecondsOption, WaitOption, showing_flight
from ortilo_drake.commands.options import (
    DEFAULT_SCENARIO,
    JsonOption,
    ScenarioArgument,
    SeedOption,
    SetOption,
    picture_option,
)
from ortilo_drake.commands.terminal import (
    out,
    say_heading,
    say_if_compiling,
    say_written,
    show_report,
    write_json,
)
from ortilo_drake.model.as_data import as_data
from ortilo_drake.scenario import InputError, Scenario, load_scenario

AFTERWARDS = 20.0  # longest time for the onboard half to end after the flight [s]


def _bus_of_our_own() -> str:
    """Return the URL of an unused bus on this machine, so that two checks at once do not meet."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return f"tcp://127.0.0.1:{free.getsockname()[1]}"


@contextlib.contextmanager
def _other_half(scenario: Scenario, url: str, key: bytes, wait: float) -> Iterator[Callable[[], None]]:
    """Run `ortilo hil onboard` in another process; yield a check that raises InputError if that process failed."""
    with tempfile.TemporaryDirectory() as folder:
        import yaml

        from ortilo_drake.hil.wire.key_file import STDIN

        file = Path(folder) / f"{scenario.name}.yaml"
        file.write_text(yaml.safe_dump(scenario.model_dump(mode="json")), encoding="utf-8")
        words = ("hil", "onboard", str(file), "--url", url, "--key", STDIN, "--wait", str(wait))
        command = (sys.executable, "-m", "ortilo_drake.cli", *words)
        pipe = subprocess.PIPE
        with subprocess.Popen(command, stdin=pipe, stdout=subprocess.DEVNULL, stderr=pipe, text=True) as process:
            assert process.stdin is not None
            with contextlib.suppress(BrokenPipeError):  # the process has already ended, see check_alive
                process.stdin.write(f"{key.hex()}\n")
                process.stdin.close()
            process.stdin = None  # communicate would flush it

            def check_alive() -> None:
                if process.poll():
                    said = (process.communicate()[1] or "").strip().splitlines() or ["nothing"]
                    raise InputError(f"onboard half: ended with code {process.returncode}, and said: {said[-1]}")

            try:
                yield check_alive
                process.wait(AFTERWARDS)
                check_alive()
            except subprocess.TimeoutExpired:
                raise InputError(f"onboard half: still running {AFTERWARDS:g} s after the flight") from None
            finally:
                process.terminate()


def check(
    scenario: ScenarioArgument = DEFAULT_SCENARIO,
    seed: SeedOption = None,
    settings: SetOption = None,
    lockstep: LockstepOption = False,
    seconds: SecondsOption = None,
    url: Annotated[
        str | None,
        typer.Option(help="The address, tcp://HOST:PORT; by default a free port that only this machine reaches."),
    ] = None,
    wait: WaitOption = 60.0,
    png: Annotated[Path | None, picture_option("Draw the latencies' histogram to this file")] = None,
    json_file: JsonOption = None,
) -> None:
    """Run both halves on this machine, in two processes, and report the effect of time and link on the flight."""
    chosen = load_scenario(scenario, tuple(settings or ()), seed)
    if lockstep and (seconds is not None or png is not None):
        raise InputError("--seconds, --png: are for real time: leave --lockstep out")
    from ortilo_drake.flight.flight import fly
    from ortilo_drake.flight.flyable import flight_ticks
    from ortilo_drake.hil.real_time.tick_timing import Quantiles
    from ortilo_drake.hil.sessions import run_world
    from ortilo_drake.hil.wire.key_file import new_key

    say_if_compiling()
    url, key = url or _bus_of_our_own(), new_key()
    with (
        showing_flight("flying", flight_ticks(chosen), lockstep) as shown,
        _other_half(chosen, url, key, wait) as check_alive,
    ):
        flight, report = run_world(chosen, url, key, lockstep, wait, seconds, check_alive=check_alive, **shown)
    identical = None
    if lockstep:
        import xarray as xr

        alone = fly(chosen)
        del alone.attrs["real_time_factor"]
        identical = bool(xr.Dataset.identical(flight, alone))
    none = as_data(Quantiles())
    lines = {"identical": identical, "latency_ms": none, "missed_deadlines": None} | report.lines()
    lines["lost"] = json.loads(flight.attrs["lost"])
    write_json(json_file, lines)
    if png and report.latencies_ms is not None:
        from ortilo_drake.hil.real_time.latency_figure import latency_figure

        latency_figure(report.latencies_ms, chosen.h, png)
    say_heading(chosen.name, f", seed {chosen.seed}, {'lockstep' if lockstep else 'real time'}")
    good = lines["lost"] is None and identical is not False
    out.print(f"  [{'green' if good else 'red'}]{escape(check_verdict(lines, chosen.h))}[/]", soft_wrap=True)
    show_report(lines)
    say_written(png, json_file)
    if identical is False:
        raise InputError(f"{chosen.name}: the flight of two processes differs from the one in a single process")


def check_verdict(report: Mapping[str, Any], h: float) -> str:
    """Return the verdict of `ortilo hil check`, for a reader who has not seen the figures yet.

    Args:
        report: the data that the command writes as JSON; 'identical' is None for a flight in real time.
        h: length of a tick [s].
    """
    lost, ticks = report["lost"], report["ticks"]
    end = f"lost at {lost['time']:.1f} s: {lost['cause']}" if lost else f"flew {(ticks - 1) * h:.1f} s, not lost"
    if report["identical"] is not None:
        same = "bit for bit" if report["identical"] else "NOT the same"
        return f"{end}; in lockstep its {ticks} ticks are {same} as in a single process"
    latency = report["latency_ms"]
    if latency["median"] is None:
        return f"{end}; none of {ticks} ticks was answered"
    return (
        f"{end}; a command came {latency['median']:.2g} ms (99 %: {latency['p99']:.2g} ms) after its measurement; "
        f"{report['missed_deadlines']} of {ticks} ticks of {1e3 * h:.3g} ms missed their deadline"
    )
