"""The command `ortilo fit`: the errors of simulated sensors, fitted to recordings with a true path."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands import terminal
from ortilo_drake.commands.options import JsonOption, MapOption
from ortilo_drake.model.typed_yaml import InputError


def fit(
    recordings: Annotated[list[Path], typer.Argument(help="Folders of recordings that one map describes.")],
    map_file: MapOption,
    out_file: Annotated[Path, typer.Option("--out", help="File to write, for `ortilo predict`.")] = Path("NOISE.yaml"),
    places: Annotated[
        bool,
        typer.Option(
            "--places", help="Separate errors that depend on the place from those that last; takes some minutes."
        ),
    ] = False,
    scenario_file: Annotated[
        Path | None, typer.Option("--scenario", help="Also write a scenario with these errors.")
    ] = None,
    base: Annotated[str, typer.Option("--base", help="The base of that scenario.")] = "tight_imu_uwb",
    json_file: JsonOption = None,
) -> None:
    """Fit the errors of ranges and IMU to recordings with a truth, with 95 % intervals.

    It fits each anchor's constant, an error that lasts (Gauss-Markov), white noise, outliers and their bursts, and
    the IMU's noise in flight and at rest.
    """
    terminal.check_writable(out_file, scenario_file)
    from ortilo_drake.flight.files import write_text
    from ortilo_drake.interop.recorded.map_file import load_map
    from ortilo_drake.interop.recorded.recording import read_recording
    from ortilo_drake.scenario.load import files_of, load_scenario
    from ortilo_drake.scenario.noise_file import noise_text
    from ortilo_drake.studies.fit.fit import fit_recordings
    from ortilo_drake.studies.fit.fit_report import base_seen_from, fit_lines, scenario_text, seen_from

    read_files = {"--map": [map_file]}
    if scenario_file is not None:
        named, below = base_seen_from(scenario_file, base), load_scenario(base)
        read_files["--base"] = files_of(base, "--base")
    check_apart(read_files, {"--out": out_file, "--scenario": scenario_file, "--json": json_file})
    if scenario_file is not None and out_file.suffix not in (".yaml", ".yml"):
        raise InputError(f"--out: {out_file}: must end in .yaml, because the scenario refers to it")
    map_ = load_map(map_file)
    read = [read_recording(path, map_) for path in recordings]  # reports wrong recordings before any fit
    terminal.say_if_compiling()
    with terminal.bar("fitting") as update:
        found = fit_recordings(read, map_, places, lambda part: update(description=part, advance=1))
    write_text(out_file, noise_text(found))
    if scenario_file is not None:
        write_text(scenario_file, scenario_text(found, seen_from(scenario_file, out_file), named, below))
    terminal.write_json(json_file, found)
    terminal.say_heading(", ".join(found.recordings))
    terminal.say_lines(fit_lines(found))
    terminal.say_written(out_file, scenario_file, json_file)


def check_apart(read: Mapping[str, Sequence[Path]], written: Mapping[str, Path | None]) -> None:
    """Raise InputError if an option would write a file that is also read, or that another option writes."""
    taken = {os.path.realpath(file): option for option, files in read.items() for file in files}
    for option, file in written.items():
        if file is not None:
            at = os.path.realpath(file)
            if at in taken:
                raise InputError(f"{option}: {file}: is a file of {taken[at]}, and would be overwritten: give another")
            taken[at] = option
