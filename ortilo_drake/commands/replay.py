"""The command `ortilo replay`: it flies a log again with the onboard half, or filters anyone's recording."""

from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands import terminal
from ortilo_drake.commands.options import MAP_OPTION, JsonOption
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.views.pictures import figure_file


def replay(
    log: Annotated[list[Path], typer.Argument(help="A log's folder or .mcap file; with --map, folders of recordings.")],
    map_file: Annotated[Path | None, MAP_OPTION] = None,
    out_folder: Annotated[
        Path, typer.Option("--out", help="With --map, folder of report, figures and trajectories.")
    ] = Path("out/recorded"),
    json_file: JsonOption = None,
) -> None:
    """Replay a log through the onboard half, or with --map filter recorded ranges and IMU and compare with the truth.

    Exit code 3 means that a recording or its map is doubtful: the report says why, and which key may correct it.

    With --map several motions share one map: FOLDER1 FOLDER2. `ortilo tune FOLDERS --map MAP.yaml` fits the noise.
    """
    if map_file is not None:
        _replay_recorded(log, map_file, out_folder, json_file)
        return
    if len(log) != 1:
        raise InputError(f"LOG: {len(log)} given: must be one log, or recordings with --map")
    from ortilo_drake.interop.log.replay import replay_log

    terminal.say_if_compiling()
    result = replay_log(log[0])
    terminal.write_json(json_file, result)
    terminal.say_heading(str(log[0]))
    terminal.show_report(result)
    terminal.say_written(json_file)


def _replay_recorded(paths: list[Path], map_file: Path, out_folder: Path, json_file: Path | None) -> None:
    report = out_folder / "recorded.md"
    terminal.check_writable(report)
    from ortilo_drake.interop.recorded.map_file import load_map
    from ortilo_drake.interop.recorded.recording import read_recording
    from ortilo_drake.model.optional import check_installed
    from ortilo_drake.studies.recorded.recorded_figure import motion_figure
    from ortilo_drake.studies.recorded.recorded_report import report_text, write_trajectories
    from ortilo_drake.studies.recorded.replayed import replay as replay_recording

    map_ = load_map(map_file)
    if map_.truth is not None:
        check_installed("evo", "recorded")
    recordings = [read_recording(path, map_) for path in paths]  # reports wrong recordings before any work
    names = [recording.name for recording in recordings]
    if len(set(names)) < len(names):
        raise InputError(f"{', '.join(names)}: folders must have different names: rename one")
    terminal.say_if_compiling()
    motions, figures, tracks = [], [], []
    with terminal.bar("rows") as update:

        def say(part: str) -> None:
            update(description=part, advance=1)

        for recording in recordings:
            terminal.err.print(f"{recording.name} ...", markup=False, highlight=False)
            found, drawn = replay_recording(recording, map_, say)
            motions.append(found)
            figures.append(motion_figure(found, drawn, map_.available, figure_file(out_folder, recording.name)))
            tracks += write_trajectories(out_folder, found, drawn, recording, map_.calibration.frame)
    terminal.hand_over(
        report_text(motions, map_.calibration.share),
        report,
        {"map": map_, "motions": motions},
        json_file,
        *figures,
        *tracks,
    )
    doubtful = [found for found in motions if found.doubts]
    for found in doubtful:
        for doubt in found.doubts:
            terminal.say_error(f"{found.name}: doubtful: {doubt}")
    if doubtful:
        raise typer.Exit(terminal.DOUBTFUL)
