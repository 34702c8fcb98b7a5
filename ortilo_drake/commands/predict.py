"""The command `ortilo predict`: simulations of recorded flights, with fitted errors and with white noise."""

from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands.options import FolderOption, JsonOption, MapOption
from ortilo_drake.commands.terminal import bar, check_writable, hand_over, say_if_compiling
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.views.pictures import figure_file


def predict(
    recordings: Annotated[list[Path], typer.Argument(help="Folders of recordings that one map describes.")],
    map_file: MapOption,
    noise: Annotated[str, typer.Option("--noise", help="NOISE.yaml of `ortilo fit`, or util_2021 or iasl_2023.")],
    runs: Annotated[int, typer.Option("--runs", min=2, max=1000, help="Simulations of each kind and flight.")] = 20,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the simulated errors.")] = 0,
    out_folder: FolderOption = Path("out/predicted"),
    json_file: JsonOption = None,
) -> None:
    """Simulate recorded flights, and compare error, NEES, NIS and rejected ranges with the recorded ones.

    Each simulation follows the recorded path, at the recorded stamps, through the same filter.
    """
    report, picture = out_folder / "predicted.md", figure_file(out_folder, "predicted")
    check_writable(report, picture)
    from ortilo_drake.interop.recorded.map_file import load_map
    from ortilo_drake.interop.recorded.recording import read_recording
    from ortilo_drake.scenario.noise_file import load_noise
    from ortilo_drake.studies.predict.predicted import group_of
    from ortilo_drake.studies.predict.predicted import predict as predict_recording
    from ortilo_drake.studies.predict.predicted_report import predicted_figure, predicted_text

    map_, errors = load_map(map_file), load_noise(noise)
    read = [read_recording(path, map_) for path in recordings]  # reports wrong recordings before any flight
    names = [recording.name for recording in read]
    if len(set(names)) < len(names):
        raise InputError(f"{', '.join(names)}: folders must have different names: rename one")
    say_if_compiling()
    with bar("flights", len(read) * (1 + 2 * runs)) as update:

        def say(part: str) -> None:
            update(description=part, advance=1)

        flights = [predict_recording(one, map_, errors, runs, seed, say) for one in read]
    predicted_figure(flights, picture)
    data = {"noise": errors, "flights": flights, "group": group_of(flights)}
    hand_over(predicted_text(flights, noise), report, data, json_file, picture)
