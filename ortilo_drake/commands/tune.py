"""The command `ortilo tune`: it fits a filter's noise, or other settings, to flights or recordings."""

import os
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from ortilo_drake.commands import options, terminal
from ortilo_drake.commands.options import JsonOption, WorkersOption, picture_option, yaml_option
from ortilo_drake.model.as_data import as_data
from ortilo_drake.model.optional import check_installed
from ortilo_drake.model.typed_yaml import InputError

if TYPE_CHECKING:
    from ortilo_drake.studies.tuning.tune import Check, Tuning
    from ortilo_drake.theory.consistency.consistency import Average


def _entry(found: "Average | None") -> str:
    from ortilo_drake.views.numbers import mean_with_interval

    return "-" if found is None else mean_with_interval(found.mean, found.interval)


def _print_tuning(report: "Tuning", short: list[str]) -> None:
    terminal.say_heading(report.scenario, f", fitted to {len(report.flights)} flights")
    terminal.say_lines(short)
    terminal.out.print()
    terminal.say_lines(report.notes)
    for name, number in report.numbers.items():
        line = f"  {name:32} {number.before:.6g} "
        if number.stays:
            line += f"stays: {number.stays}"
        else:
            line += f"-> {number.after:.6g} ± {number.standard_error:.2g}"
            if number.robust_error is not None:
                line += f" (by the spread of the flights ± {number.robust_error:.2g})"
        terminal.say(line)
    likelihood = report.log_likelihood
    terminal.out.print(f"  log-likelihood {likelihood.before:.1f} -> {likelihood.after:.1f} ", end="")
    terminal.say(f"(of {', '.join(report.counted)})")
    terminal.out.print("  on the same measurements, 3 if consistent, with 95 % intervals:")
    for kind, befores, afters in (
        ("NEES", report.before.nees, report.after.nees),
        ("NIS", report.before.nis, report.after.nis),
    ):
        for key, before in befores.items():
            if before is not None:
                terminal.say(f"    {kind} {key:9} {_entry(before)} -> {_entry(afters[key])}")
    terminal.out.print(f"    MSE of position {sum(report.before.mse):.6f} -> {sum(report.after.mse):.6f} m²")


def _print_check(check: "Check") -> None:
    terminal.out.print(f"  new flights, seeds {check.seeds[0]} to {check.seeds[-1]}, by {check.flown_by}:")
    for when, found in (("before", check.before), ("after", check.after)):
        mse = "none" if found.mse is None else f"{sum(found.mse):.6f} m²"
        line = f"    {when:6} {found.lost} lost, MSE of position {mse}, NEES {_entry(found.nees)}"
        terminal.say(line)


class FitBy(StrEnum):
    """The criterion for fitting the noise of recorded motions."""

    innovations = "innovations"
    truth = "truth"


def _tune_recorded(paths: list[Path], map_file: Path, by: FitBy, out_file: Path | None, json_file: Path | None) -> None:
    from ortilo_drake.flight.files import write_text
    from ortilo_drake.interop.recorded.map_edit import tuned_map_text
    from ortilo_drake.interop.recorded.map_file import Imposed, load_map
    from ortilo_drake.interop.recorded.recording import read_recording
    from ortilo_drake.studies.recorded.fit_noise import FITTED, MOST, fit_noise, fitted_lines, verdict_line
    from ortilo_drake.studies.recorded.replayed import replay

    map_ = load_map(map_file)
    if map_.truth is not None:
        check_installed("evo", "recorded")
    recordings = [read_recording(path, map_) for path in paths]
    terminal.say_if_compiling()
    kind: Literal["innovations", "truth"] = "truth" if by is FitBy.truth else "innovations"
    whole = map_.model_copy(update={"imposed": Imposed(lost=0.0, gaps=None)})
    replays = [replay(recording, whole, lambda _: None)[0] for recording in recordings]
    with terminal.flights_to_go("likelihoods") as show:
        fitted = fit_noise(recordings, map_, kind, lambda n: show(n, MOST))
    fitted = fitted._replace(doubts=tuple(f"{one.name}: {doubt}" for one in replays for doubt in one.doubts))
    before = {name: getattr(map_.filter, name) for name in FITTED}
    after = {name: getattr(fitted.settings, name) for name in FITTED}
    if out_file is not None:
        write_text(out_file, tuned_map_text(map_file, map_, after, out_file))
    terminal.write_json(json_file, fitted._asdict() | {"settings_before": map_.filter, "verdict": fitted.verdict})
    terminal.say_heading(", ".join(fitted.motions), f", fitted by {by.value} to the first parts")
    for name in FITTED:
        terminal.say(f"  {name:32} {before[name]:.3g} -> {after[name]:.3g}")
    terminal.say_lines(fitted_lines(fitted))
    terminal.say_written(out_file, json_file)
    if fitted.verdict != "better":
        terminal.say_error(f"{', '.join(fitted.motions)}: doubtful: {verdict_line(fitted)}")
        raise typer.Exit(terminal.DOUBTFUL)


def _tune_by_flights(
    files: list[Path], kept: Path, workers: int | None, player: str, out_file: Path | None, json_file: Path | None
) -> None:
    if len(files) != 1:
        raise InputError(f"--fly: {len(files)} files: must be one, a SEARCH.yaml")
    from ortilo_drake.studies.maps.sweep import load_over
    from ortilo_drake.studies.tuning.search import Search

    search = load_over(Search, files[0])
    check_installed("cma", "search")
    terminal.check_writable(kept / "search")
    from ortilo_drake.flight.files import write_text
    from ortilo_drake.studies.tuning.search import found_text, search_by_flights, search_lines

    terminal.say_if_compiling()
    with terminal.bar("searching", search.evaluations) as update:

        def show(flown: int, least: float) -> None:
            update(completed=flown, description=f"searching, {1000.0 * least:.1f} mm")

        found = search_by_flights(search, str(files[0]), kept, workers or os.cpu_count() or 1, show, player)
    if out_file is not None:
        # The result may lie in another folder than the search's scenario file: name the file by its absolute path.
        base = os.path.realpath(search.scenario) if search.scenario.endswith((".yaml", ".yml")) else search.scenario
        write_text(out_file, found_text(found, base))
    terminal.write_json(json_file, found)
    terminal.say_heading(search.scenario, ", searched by flights")
    for key, value in found.best.settings.items():
        numbers = value if isinstance(value, list) else [value]
        terminal.say(f"  {key:32} {', '.join(f'{number:.4g}' for number in numbers)}")
    terminal.say_lines(search_lines(found))
    terminal.say_written(out_file, json_file)


def tune(
    flights: Annotated[
        list[Path],
        typer.Argument(
            help="Flights of one scenario, saved by `ortilo fly SCENARIO --out FLIGHT.nc`, or folders of them; with "
            "--map folders of logs or recordings, with --fly a SEARCH.yaml."
        ),
    ],
    out_file: Annotated[
        Path | None, yaml_option("Write the tuned scenario, or with --map the tuned map, to this .yaml.")
    ] = None,
    json_file: JsonOption = None,
    figure: Annotated[Path | None, picture_option("Draw the fit to this file (not with --map or --fly)")] = None,
    check: Annotated[
        int, typer.Option(min=0, max=1000, help="Then fly this many new seeds before and after, and compare.")
    ] = 0,
    map_file: Annotated[
        Path | None,
        typer.Option(
            "--map", help="FLIGHTS are folders of logs or recordings, read by this MAP.yaml: docs/how_to/recorded.md."
        ),
    ] = None,
    by: Annotated[
        FitBy,
        typer.Option(help="With --map: maximise the likelihood of the innovations, or of the errors from the truth."),
    ] = FitBy.innovations,
    fly: Annotated[bool, typer.Option("--fly", help="Search any settings by flights: docs/how_to/tune.md.")] = False,
    kept: Annotated[Path, typer.Option(help="With --fly: folder of the flights' figures.")] = Path("out/tune"),
    workers: WorkersOption = None,
    player: options.PlayerOption = options.PlayerName.fastest,
) -> None:
    """Fit a filter's noise: to saved flights, to recordings with --map, or by new flights with --fly.

    Saved flights: the process noise W and measurement noise V of the paper's filter (nominal_imu_uwb) are fitted by
    maximum likelihood, with NEES and NIS before and after. `ortilo fly FILE.yaml` flies the tuned scenario. For other
    filters, such as those of imu_uwb and imu_uwb_yolo, use --fly or --map.

    --map: the noise is fitted to the first part of each recording and judged on the rest. `ortilo replay FOLDERS --map
    FILE.yaml` uses the tuned map. Exit code 3 means that the tuned noise is no better on the rest, or that `ortilo
    replay` doubts the map: noise would only hide a mistake in it. A log (`ortilo fly --log DIR`) has a map beside it:
    `ortilo tune DIR --map DIR/map.yaml`.

    --fly: CMA-ES searches any settings (servo weights, gates, noise) for the smallest distance from the path in
    flights. The result is judged on flights with other seeds.
    """
    if fly:
        if figure is not None or check or map_file is not None:
            raise InputError("--figure, --check, --map: cannot be combined with --fly")
        _tune_by_flights(flights, kept, workers, player, out_file, json_file)
        return
    if player != "fastest" and not check:
        raise InputError(f"--player: {player}: needs --fly or --check")
    if map_file is not None:
        if figure is not None or check:
            raise InputError("--figure, --check: cannot be combined with --map; `ortilo replay` draws recordings")
        _tune_recorded(flights, map_file, by, out_file, json_file)
        return
    from ortilo_drake.flight.files import write_text
    from ortilo_drake.flight.flight import scenario_of
    from ortilo_drake.flight.saved_flight import load_flight
    from ortilo_drake.studies.consistency.consistency_figures import tuning_figure
    from ortilo_drake.studies.tuning.tune import check_flights, find_flights, overlay_text, tuning_summary
    from ortilo_drake.studies.tuning.tune import tune as tune_flights

    terminal.say_if_compiling()
    files = find_flights(flights)
    with terminal.bar("fitting") as update:
        tuning = tune_flights(files, lambda n: update(completed=n, description=f"fitting, {n} likelihoods"))
    checked = None
    if check:
        before = scenario_of(load_flight(files[0]))
        with terminal.bar("new flights", 2 * check) as update:
            checked = check_flights(tuning, before, check, lambda: update(advance=1), player)
    if out_file is not None:
        write_text(out_file, overlay_text(tuning))
    if figure is not None:
        tuning_figure(tuning, figure)
    data = as_data(tuning) | ({"check": checked} if checked else {})
    del data["fitted"]
    terminal.write_json(json_file, data)
    _print_tuning(tuning, tuning_summary(tuning, checked))
    if checked:
        _print_check(checked)
    terminal.say_written(out_file, figure, json_file)
