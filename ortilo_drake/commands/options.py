"""Options that several commands share."""

import json
import math
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from ortilo_drake.flight.files import check_output
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import scenario_names
from ortilo_drake.views.pictures import check_picture


def scenarios_from(begun: str) -> list[str]:
    """Return the ready-made scenarios whose names begin with `begun`; if there are none, the shell completes files."""
    return [name for name in scenario_names() if name.startswith(begun)]


DEFAULT_SCENARIO = "imu_uwb_yolo"
ScenarioArgument = Annotated[
    str, typer.Argument(help="A ready-made scenario's name or a .yaml file.", autocompletion=scenarios_from)
]
SetOption = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a setting; may be repeated.")
]
SeedOption = Annotated[int | None, typer.Option(help="Seed of all noise; by default the scenario's.")]


def _of_workers(number: int | None) -> int | None:
    """Raise InputError for more than one process if the package that starts processes is missing; return the number."""
    if number is not None and number > 1:
        from ortilo_drake.model.optional import EXTRAS, check_installed

        check_installed("distributed", EXTRAS["distributed"])
    return number


WorkersOption = Annotated[
    int | None,
    typer.Option(
        min=1, max=1024, callback=_of_workers, help="Number of worker processes; by default one for each core."
    ),
]


def picture_option(text: str) -> Any:
    """Return an option that names a figure's file; its help begins with `text`."""
    return typer.Option(help=f"{text}, .png, .svg or .pdf.", callback=_of_picture)


def _of_picture(file: Path | None) -> Path | None:
    """Raise InputError, before any work, if a figure cannot have this file's ending or the file cannot be written."""
    if file is not None:
        check_picture(file)
    return _to_write(file)


def _to_write(file: Path | None) -> Path | None:
    if file is not None:
        check_output(file)
    return file


def yaml_option(text: str) -> Any:
    """Return the option --out for a YAML file."""
    return typer.Option("--out", help=text, callback=_of_yaml)


def _of_yaml(file: Path | None) -> Path | None:
    if file is not None and file.suffix not in (".yaml", ".yml"):
        raise InputError(f"--out {file}: must end in .yaml")
    return _to_write(file)


RoomFileOption = Annotated[Path | None, yaml_option("Write the room to this .yaml.")]
FolderOption = Annotated[Path, typer.Option("--out", help="Folder of the report, its figures and data.")]
MAP_OPTION = typer.Option("--map", help="MAP.yaml: which column or topic is what (docs/how_to/recorded.md).")
MapOption = Annotated[Path, MAP_OPTION]
_JSON = typer.Option("--json", help="Write the result as JSON to this file.", callback=_to_write)
JsonOption = Annotated[Path | None, _JSON]


def finite(value: float | None) -> float | None:
    """Refuse NaN and infinity on the command line, which Typer's ranges accept."""
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter(f"must be a finite number, not {value}")
    return value


class Camera(StrEnum):
    """Kinds of simulated camera."""

    rendered = "rendered"
    projected = "projected"


class PlayerName(StrEnum):
    """The players that can fly a scenario (flight/players.py)."""

    fastest = "fastest"
    engine = "engine"
    drake = "drake"
    drake_elements = "drake-elements"


PlayerOption = Annotated[
    PlayerName,
    typer.Option(
        "--player",
        metavar="PLAYER",
        help="What computes the flight; all give the same bits: compiled code (engine); a Drake Diagram, its halves "
        "compiled (drake) or a system for each element (drake-elements); or the fastest that can.",
    ),
]
CameraOption = Annotated[
    Camera | None,
    typer.Option(help="Render pictures, or compute only the boxes (projected); by default as in the scenario."),
]
DetectorOption = Annotated[
    tuple[Path, Path] | None,
    typer.Option("--detector", metavar="CFG WEIGHTS", help="Use this Darknet network instead of ours."),
]
OnnxOption = Annotated[Path | None, typer.Option("--onnx", help="Use this YOLOv5, v8 or v11 network instead of ours.")]


def with_camera(
    settings: list[str] | None, camera: Camera | None, detector: tuple[Path, Path] | None, onnx: Path | None = None
) -> tuple[str, ...]:
    """Return the settings with the options of camera and detector laid over; a user's detector renders pictures."""
    chosen = list(settings or ())
    if camera is not None:
        chosen.append(f"camera.kind={camera.value}")
    files = dict(zip(("cfg", "weights"), detector, strict=True)) if detector else {}
    if onnx is not None:
        if detector is not None:
            raise InputError("--onnx, --detector: give only one of them")
        files = {"onnx": onnx}
    if files:
        option = "--onnx" if onnx else "--detector"
        if camera is Camera.projected:
            raise InputError(f"{option}: needs pictures, which --camera projected does not draw")
        chosen.append("camera.kind=rendered")
        chosen += [f"detector.{key}={json.dumps(str(path.absolute()))}" for key, path in files.items()]
    return tuple(chosen)
