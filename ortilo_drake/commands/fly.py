"""The command `ortilo fly`: a single flight."""

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from ortilo_drake.commands import options, terminal
from ortilo_drake.flight.files import write_text
from ortilo_drake.flight.summary import Summary
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario

LOST = 3  # exit code of a lost flight


def _print_flight(
    result: Summary, chosen: Scenario, line: str, blackout: float, by_drake: str | None, advice: str | None
) -> None:
    from ortilo_drake.sensors.described import described

    terminal.say_heading(result.scenario, f", seed {result.seed}")
    terminal.out.print(f"  [{'red' if result.lost else 'green'}]{escape(line)}[/]", soft_wrap=True)
    terminal.show_rows(
        _rows(result)
        | _loss_rows(chosen, result)
        | {"flown by": f"{result.player}{f' ({by_drake})' if by_drake else ''}"}
    )
    notes = [("touched", "yellow", ", ".join(result.contacts))]
    if result.lost:
        rare = "one flight cannot tell; `ortilo rare` estimates it for the same scenario and settings"
        notes.append(("how often", "default", rare))
    notes.append(("angles, rates", "yellow", advice or ""))
    if blackout > 0.0:
        times = f"{blackout:.1%} of the time, on purpose: uwb.link.blackouts of the scenario"
        notes.append(("UWB blacked out", "default", times))
    notes += [(name, "yellow", described(name).advice or "") for name, rate in result.arrivals.items() if rate == 0.0]
    for name, color, note in notes:
        if note:
            terminal.out.print(f"  [{color}]{name:18}[/]  {escape(note)}", soft_wrap=True)


def _rows(result: Summary) -> dict[str, str]:
    path = "not defined on this path" if result.path_mse is None else f"{result.path_mse:.5f} m²"
    farthest = result.max_path_distance, result.max_reference_distance
    rates = [f"{sensor} {rate:.1%}" for sensor, rate in result.arrivals.items() if rate is not None]
    return {
        "estimation MSE": ", ".join(f"{axis} {value:.5f}" for axis, value in result.mse.items()) + " m²",
        "farthest from path": f"{farthest[0]:.3f} m, from the reference {farthest[1]:.3f} m",
        "path MSE": f"{path}, by distance {result.path_distance_mse:.5f} m²",
        "fixes used": ", ".join(rates) or "none",
        **{
            f"error of {sensor}": f"median {error.median:.3f} m, 95 % of its fixes within {error.p95:.3f} m"
            for sensor, error in result.fix_errors.items()
        },
        "position NEES": f"{result.nees:.2f} (3 if consistent)",
        "real-time factor": terminal.three_digits(result.real_time_factor),
    }


def _loss_rows(scenario: Scenario, result: Summary) -> dict[str, str]:
    """Return rows with each link's random loss and the share of its due fixes that were missing for any reason."""
    from ortilo_drake.scenario.loss_chain import mean_loss

    asked = {sensor: mean_loss(scenario.link_of(sensor).loss, scenario.h) for sensor in result.arrivals}
    losses = [
        f"{sensor} set to {asked[sensor]:.1%}, in this flight {1.0 - rate:.1%} with blackouts and refused fixes"
        for sensor, rate in result.arrivals.items()
        if rate is not None and asked[sensor] > 0.0
    ]
    return {"loss": ", ".join(losses)} if losses else {}


def fly(
    scenario: options.ScenarioArgument = options.DEFAULT_SCENARIO,
    seed: options.SeedOption = None,
    settings: options.SetOption = None,
    camera: options.CameraOption = None,
    detector: options.DetectorOption = None,
    onnx: options.OnnxOption = None,
    seconds: Annotated[
        float | None,
        typer.Option(min=0.1, callback=options.finite, help="Fly only this long [s]; path and noise stay the same."),
    ] = None,
    player: options.PlayerOption = options.PlayerName.fastest,
    meshcat: Annotated[bool, typer.Option("--meshcat", help="Show the flight live in the browser.")] = False,
    html: Annotated[Path | None, typer.Option(help="Write the flight as one self-contained page.")] = None,
    png: Annotated[Path | None, options.picture_option("Draw path, errors and arrivals to this file")] = None,
    video: Annotated[
        Path | None,
        typer.Option(help="Draw camera, room and errors as a video, .mp4 or .gif, at three times the speed."),
    ] = None,
    out_file: Annotated[Path | None, typer.Option("--out", help="Write the flight's data as netCDF.")] = None,
    log: Annotated[
        Path | None, typer.Option(help="Write a log as MCAP (rosbag2, for Foxglove) to this new folder.")
    ] = None,
    rerun: Annotated[Path | None, typer.Option(help="Write pictures, 3D scene and signals for Rerun, .rrd.")] = None,
    json_file: options.JsonOption = None,
) -> None:
    """Fly one scenario; print the verdict, its errors, arrival rates and real-time factor.

    Exit code 3 means that the flight was lost; every output is written nevertheless.
    """
    settings = [*(settings or ()), *([] if seconds is None else [f"seconds={seconds}"])]
    chosen = load_scenario(scenario, options.with_camera(settings, camera, detector, onnx), seed)
    if (detector or onnx) and not chosen.is_rendered:
        raise InputError(f"{'--onnx' if onnx else '--detector'}: needs a camera, which {chosen.name} does not have")
    for option, path in (("--log", log), ("--rerun", rerun)):
        if meshcat and path:
            raise InputError(f"{option}: cannot be combined with --meshcat: leave one of them out")
    for option, asked in (("--meshcat", meshcat), ("--log", log), ("--rerun", rerun)):
        if asked and player not in (options.PlayerName.fastest, options.PlayerName.drake):
            raise InputError(f"--player: {player}: must be drake or fastest with {option}")
    terminal.check_writable(html, video, out_file, rerun)
    # Imported only now and as needed: Drake, numba and matplotlib take seconds, and a wrong argument must fail at once.
    from ortilo_drake.flight.blackouts import in_blackout
    from ortilo_drake.flight.flyable import flight_ticks
    from ortilo_drake.flight.metrics import summary
    from ortilo_drake.flight.players import choose, why_not_engine
    from ortilo_drake.flight.players import fly as fly_once
    from ortilo_drake.flight.verdict import lag_advice, verdict
    from ortilo_drake.studies.cautions.cautions import cautions

    if video:
        from ortilo_drake.views.video import check_video, flight_video

        check_video(video)
    choose(chosen, player)
    recorder = None
    if rerun:
        from ortilo_drake.interop.rerun.recording import check_recording, save_recording
        from ortilo_drake.interop.rerun.sightings import SightingsRecorder

        check_recording(rerun)
        recorder = SightingsRecorder(chosen)
    ticks = flight_ticks(chosen)  # reports a missing path, in one line, before any warning
    terminal.say_warnings(cautions(chosen, scenario, settings))
    terminal.say_if_compiling()

    with terminal.bar("flying live" if meshcat else "compiling", ticks) as update:

        def show(ticks: int) -> None:
            update(completed=ticks, description="flying")

        if log or recorder:
            from ortilo_drake.interop.log.logged_flight import fly_logged

            flight = fly_logged(chosen, log, show, recorder.record if recorder else None)
        elif meshcat:
            from ortilo_drake.views.display import fly_live

            flight = fly_live(chosen, terminal.say_error, show)
        else:
            flight = fly_once(chosen, show, player)
    result = summary(flight)
    if out_file:
        from ortilo_drake.flight.saved_flight import save_flight

        save_flight(flight, out_file)
    if html:
        from ortilo_drake.views.page.flight_page import flight_page

        write_text(html, flight_page(flight))
    if png:
        from ortilo_drake.views.figures import flight_figure

        flight_figure(flight, png)
    if video:
        with terminal.bar("drawing the video") as update:
            flight_video(flight, video, lambda done, total: update(completed=done, total=total))
    if rerun and recorder:
        save_recording(flight, recorder.sightings, rerun)
    terminal.write_json(json_file, result)
    blackout = in_blackout(flight["truth"].values, chosen).mean() if chosen.measures_ranges else 0.0
    by_drake = why_not_engine(chosen) if player is options.PlayerName.fastest else None
    lags = chosen.world.rotors.kind == "first_order" and chosen.linear_filter is not None and not result.lost
    advice = lag_advice(flight) if lags else None
    _print_flight(result, chosen, verdict(flight), float(blackout), by_drake, advice)
    terminal.say_written(html, png, video, out_file, log, rerun, json_file)
    if result.lost:
        raise typer.Exit(LOST)
