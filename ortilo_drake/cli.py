"""The command `ortilo`."""

import json
import logging
import os
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from ortilo_drake.analyze_cli import analyze
from ortilo_drake.detector_cli import detector_app
from ortilo_drake.experiments.files import write_text
from ortilo_drake.hil_cli import hil_app, replay
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario, read_text, scenario_names
from ortilo_drake.terminal import check_writable, err, out, progress_bar, say_written, write_json
from ortilo_drake.tune_cli import tune

app = typer.Typer(
    help="A laboratory for indoor navigation with sensors that come and go, built on Drake.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
scenario_app = typer.Typer(help="List, show and check scenarios.", no_args_is_help=True)
app.add_typer(scenario_app, name="scenario")
app.add_typer(detector_app, name="detector")
app.command()(analyze)
app.command()(tune)
app.add_typer(hil_app, name="hil")
app.command()(replay)

DEFAULT_SCENARIO = "imu_uwb_yolo"
ScenarioArgument = Annotated[str, typer.Argument(help="A ready-made scenario's name or a .yaml file.")]
SetOption = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a setting; may be repeated.")
]
JsonOption = Annotated[Path | None, typer.Option("--json", help="Write the result as JSON to this file.")]


class Camera(StrEnum):
    """How the camera is simulated."""

    rendered = "rendered"
    projected = "projected"


CameraOption = Annotated[
    Camera | None, typer.Option(help="Draw pictures, or only the boxes; if not as the scenario has it.")
]
DetectorOption = Annotated[
    tuple[Path, Path] | None,
    typer.Option("--detector", metavar="CFG WEIGHTS", help="A Darknet network to look with in place of ours."),
]


def _with_camera(
    settings: list[str] | None, camera: Camera | None, detector: tuple[Path, Path] | None
) -> tuple[str, ...]:
    """Return the settings with the camera's laid over them; a detector needs pictures to look at."""
    chosen = list(settings or ())
    if camera is not None:
        chosen.append(f"camera={camera.value}")
    if detector is not None:
        if camera is Camera.projected:
            raise InputError("--detector: looks at pictures, which --camera projected does not draw")
        cfg, weights = (json.dumps(str(path.absolute())) for path in detector)
        chosen += ["camera=rendered", f"detector.cfg={cfg}", f"detector.weights={weights}"]
    return tuple(chosen)


class Preset(StrEnum):
    """Which covariances and velocities the tables fly with."""

    tuned = "tuned"
    paper = "paper"


def _print_flight(result: dict[str, Any]) -> None:
    lost = result["lost"]
    out.print(f"[bold]{result['scenario']}[/bold], seed {result['seed']}")
    if lost:
        out.print(f"  [red]lost[/red] at {lost['time']:.2f} s: {lost['cause']}")
    mse = ", ".join(f"{axis} {value:.5f}" for axis, value in result["mse"].items())
    out.print(f"  estimation MSE      {mse} m²")
    farthest = result["max_path_distance"], result["max_reference_distance"]
    out.print(f"  farthest from path  {farthest[0]:.3f} m, from the reference {farthest[1]:.3f} m")
    path = "not defined on this path" if result["path_mse"] is None else f"{result['path_mse']:.5f} m²"
    out.print(f"  path MSE            {path}, by distance {result['path_distance_mse']:.5f} m²")
    rates = [f"{s} {'-' if r is None else format(r, '.1%')}" for s, r in result["arrivals"].items()]
    out.print(f"  fixes used of due   {', '.join(rates)}")
    for sensor, error in result["fix_errors"].items():
        out.print(f"  error of {sensor:6} fixes  median {error['median']:.3f} m, 95 % within {error['p95']:.3f} m")
    out.print(f"  position NEES       {result['nees']:.2f} (3 if consistent)")
    if result["contacts"]:
        out.print(f"  [yellow]touched[/yellow]             {', '.join(result['contacts'])}")
    out.print(f"  real-time factor    {result['real_time_factor']:.3g}")


@app.command()
def fly(
    scenario: ScenarioArgument = DEFAULT_SCENARIO,
    seed: Annotated[int | None, typer.Option(help="Seed of all noise, if not the scenario's own.")] = None,
    settings: SetOption = None,
    camera: CameraOption = None,
    detector: DetectorOption = None,
    meshcat: Annotated[bool, typer.Option("--meshcat", help="Show the flight live in the browser.")] = False,
    html: Annotated[Path | None, typer.Option(help="Write the flight as one self-contained page.")] = None,
    png: Annotated[Path | None, typer.Option(help="Draw path, errors and arrivals to this file.")] = None,
    video: Annotated[
        Path | None, typer.Option(help="Draw camera, room and errors as a video, .mp4 or .gif, three times as fast.")
    ] = None,
    out_file: Annotated[Path | None, typer.Option("--out", help="Write the flight's data as netCDF.")] = None,
    log: Annotated[
        Path | None, typer.Option(help="Write everything as MCAP (rosbag2, for Foxglove) to this new folder.")
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Fly one scenario and print its errors, arrival rates and real-time factor."""
    chosen = load_scenario(scenario, _with_camera(settings, camera, detector), seed)
    if detector is not None and not chosen.is_rendered:
        raise InputError(f"--detector: {chosen.name} flies without a camera that it could look through")
    if meshcat and log:
        raise InputError("--log: is written by a flight that is not shown live; leave --meshcat out")
    check_writable(html, png, video, out_file, json_file)
    # Only now: Drake and numba take seconds to import, a typing error should not.
    from ortilo_drake.experiments.display import flight_page, fly_live
    from ortilo_drake.experiments.figures import flight_figure
    from ortilo_drake.experiments.flight import flight_ticks, save_flight
    from ortilo_drake.experiments.flight import fly as fly_once
    from ortilo_drake.experiments.metrics import summary
    from ortilo_drake.hil.logged_flight import fly_logged

    if video:
        from ortilo_drake.experiments.video import check_video, flight_video

        check_video(video)
    logging.getLogger("drake").setLevel(logging.WARNING)  # importing Drake has set it to INFO

    with progress_bar() as progress:
        task = progress.add_task("compiling" if not meshcat else "flying live", total=flight_ticks(chosen))

        def show(ticks: int) -> None:
            progress.update(task, completed=ticks, description="flying")

        if log:
            flight = fly_logged(chosen, log, show)
        else:
            flight = fly_live(chosen, err.print, show) if meshcat else fly_once(chosen, show)
    result = summary(flight)
    if out_file:
        save_flight(flight, out_file)
    if html:
        write_text(html, flight_page(flight))
    if png:
        flight_figure(flight, png)
    if video:
        with progress_bar() as progress:
            drawing = progress.add_task("drawing the video", total=None)
            flight_video(flight, video, lambda done, total: progress.update(drawing, completed=done, total=total))
    write_json(json_file, result)
    _print_flight(result)
    say_written(html, png, video, out_file, log, json_file)


@app.command()
def tables(
    flights: Annotated[int, typer.Option(min=1, max=100_000, help="Flights of each scenario, seeds from 0.")] = 20,
    workers: Annotated[int | None, typer.Option(min=1, max=1024, help="Worker processes; all cores.")] = None,
    preset: Annotated[Preset, typer.Option(help="Our tuning or the paper's printed covariances.")] = Preset.tuned,
    settings: SetOption = None,
    camera: CameraOption = None,
    detector: DetectorOption = None,
    out_folder: Annotated[Path, typer.Option("--out", help="Folder of flights, tables and figures.")] = Path(
        "out/tables"
    ),
    json_file: JsonOption = None,
) -> None:
    """Fly both of the paper's scenarios many times and print its tables I and II beside ours.

    Flights already in the folder are kept, so an interrupted run goes on where it stopped.
    """
    from ortilo_drake.experiments.report import table_text
    from ortilo_drake.experiments.tables import SCENARIOS, make_tables

    prefix = "paper_" if preset is Preset.paper else ""
    chosen = {name: load_scenario(prefix + name, tuple(settings or ())) for name in SCENARIOS}
    laid_over = _with_camera(settings, camera, detector)
    for name, flown in chosen.items():
        if "camera" in flown.sensors:  # so that the flights without one stay the same
            chosen[name] = load_scenario(prefix + name, laid_over)
    check_writable(json_file, out_folder / f"tables_{preset.value}.md")
    from ortilo_drake.diagrams.closed_loop import make_closed_loop
    from ortilo_drake.experiments.ensemble import flight_file, fly_many
    from ortilo_drake.experiments.figures import arrival_figure, error_figure, trajectory_figure
    from ortilo_drake.experiments.flight import load_flight

    for flown in chosen.values():
        make_closed_loop(flown)  # refuses a wrong detector or a missing renderer before anything is flown
    count = workers or os.cpu_count() or 1
    summaries: dict[str, list[dict[str, Any]]] = {}
    with progress_bar() as progress:
        tasks = {name: progress.add_task(flown.name, total=flights) for name, flown in chosen.items()}
        for name, flown in chosen.items():

            def show(_: dict[str, Any], name: str = name) -> None:
                progress.advance(tasks[name])

            summaries[name] = fly_many(flown, range(flights), out_folder / "flights", count, show)
    result = make_tables(preset.value, summaries)
    text = table_text(result)
    first = {
        name: [load_flight(flight_file(out_folder / "flights", flown, seed)) for seed in range(min(flights, 20))]
        for name, flown in chosen.items()
    }
    written = [
        trajectory_figure(first, out_folder / f"trajectories_{preset.value}.png"),
        error_figure(summaries, out_folder / f"errors_{preset.value}.png"),
        arrival_figure({n: rows[0] for n, rows in first.items()}, out_folder / f"arrivals_{preset.value}.png"),
    ]
    write_text(out_folder / f"tables_{preset.value}.md", text)
    write_json(json_file, result)
    out.print(text, markup=False, soft_wrap=True)
    for path in (*written, out_folder / f"tables_{preset.value}.md", *([json_file] if json_file else [])):
        out.print(f"wrote {path}", markup=False, soft_wrap=True)


@app.command()
def diagram(
    scenario: ScenarioArgument = DEFAULT_SCENARIO,
    svg: Annotated[Path, typer.Option(help="The image file.")] = Path("diagram.svg"),
    settings: SetOption = None,
    depth: Annotated[int, typer.Option(min=0, max=3, help="How far to open nested diagrams.")] = 2,
) -> None:
    """Draw the closed loop's block diagram."""
    chosen = load_scenario(scenario, tuple(settings or ()))
    check_writable(svg)
    from ortilo_drake.experiments.block_diagram import diagram_svg

    write_text(svg, diagram_svg(chosen, depth))
    out.print(f"wrote {svg}", markup=False, soft_wrap=True)


@scenario_app.command("list")
def list_scenarios() -> None:
    """List the ready-made scenarios with the first line of their description."""
    from ortilo_drake.scenario import SCENARIO_FOLDER

    for name in scenario_names():
        first = read_text(SCENARIO_FOLDER / f"{name}.yaml").splitlines()[0]
        out.print(f"[bold]{name:20}[/bold]{first.removeprefix('#').strip()}", soft_wrap=True)


@scenario_app.command("show")
def show_scenario(scenario: ScenarioArgument = DEFAULT_SCENARIO, settings: SetOption = None) -> None:
    """Print a scenario in full, every default filled in, as YAML that loads again."""
    import yaml

    chosen = load_scenario(scenario, tuple(settings or ()))
    out.print(yaml.safe_dump(chosen.model_dump(mode="json"), sort_keys=False), end="", markup=False, soft_wrap=True)


@scenario_app.command("check")
def check_scenario(scenario: ScenarioArgument = DEFAULT_SCENARIO, settings: SetOption = None) -> None:
    """Check a scenario: its fields, its room, and that there is a path and a servo gain."""
    chosen: Scenario = load_scenario(scenario, tuple(settings or ()))
    from ortilo_drake.experiments.flight import flight_ticks
    from ortilo_drake.onboard.lq_gain import servo_gain

    seconds = flight_ticks(chosen) * chosen.h
    servo_gain(chosen.vehicle, chosen.servo.weights, chosen.h)
    out.print(f"{chosen.name}: valid; flies {seconds:.1f} s with {', '.join(chosen.sensors)}")


def main() -> None:
    """Run the command; bad input ends it with one line and exit code 2, Ctrl-C with 130."""
    usage_error = typer.BadParameter.__base__  # Typer's own copy of click's, by whichever name it has it
    assert usage_error is not None
    try:
        code = app(standalone_mode=False)
        if code == 130:  # some versions of Typer turn Ctrl-C into this
            raise KeyboardInterrupt
        sys.exit(code)
    except InputError as error:
        _fail(str(error), 2)
    except usage_error as error:  # type: ignore[misc]  # an exception class, but mypy cannot know
        if type(error).__name__ == "NoArgsIsHelpError":
            error.show()
            sys.exit(2)
        _fail(" ".join(error.format_message().split()), 2)
    except (KeyboardInterrupt, typer.Abort):
        _fail("interrupted; what is finished is kept", 130)


def _fail(line: str, code: int) -> NoReturn:
    err.print(f"ortilo: {line}", style="red", markup=False, soft_wrap=True)
    sys.exit(code)


if __name__ == "__main__":
    main()
