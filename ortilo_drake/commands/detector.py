"""The commands `ortilo detector`: render, train, judge, export and calibrate, as was done for the shipped detector."""

import os
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands.options import JsonOption, OnnxOption, SetOption, WorkersOption, finite
from ortilo_drake.commands.terminal import bar, check_writable, out, progress_bar, say, say_written, write_json
from ortilo_drake.model.optional import check_installed
from ortilo_drake.model.typed_yaml import InputError, validate
from ortilo_drake.scenario import Detector, load_scenario
from ortilo_drake.views.pictures import figure_file

detector_app = typer.Typer(
    help="Render pictures, train, judge, export and calibrate the detector.", no_args_is_help=True
)

PicturesOption = Annotated[Path, typer.Option("--pictures", help="Folder of the rendered pictures.")]
SeedOption = Annotated[int, typer.Option(min=0, max=999, help="Seed of everything random.")]
NetworkOption = Annotated[
    tuple[Path, Path] | None,
    typer.Option(
        "--detector", metavar="CFG WEIGHTS", help="Use this network instead of ours; .weights or .safetensors."
    ),
]
WidthOption = Annotated[int, typer.Option(min=64, max=2048, help="Image width [px].")]
PICTURES = Path("out/detector/pictures")
TRAINED = Path("out/detector/training")
NETWORK = TRAINED / "ortilo.safetensors"
LOWEST = 0.01  # least score of a detection in a precision-recall curve


def _settings(network: tuple[Path, Path] | None, onnx: Path | None, backend: str = "auto") -> Detector:
    files = {} if network is None else {"cfg": str(network[0]), "weights": str(network[1])}
    files |= {} if onnx is None else {"onnx": str(onnx)}
    return validate(Detector, {"backend": backend, **files}, "detector")


def _render(folder: Path, parts: tuple[str, ...], seed: int, scale: float, width: int, workers: int | None) -> None:
    from ortilo_drake.training.pictures.sets import KINDS, SCENES, render_set

    counts = {(part, kind): max(1, round(scale * SCENES[part][kind])) for part in parts for kind in KINDS}
    with progress_bar() as progress:
        for (part, kind), scenes in counts.items():
            task = progress.add_task(f"{part} {kind}", total=scenes)
            render_set(
                folder, part, kind, seed, scenes, width, workers or os.cpu_count() or 1, partial(progress.advance, task)
            )


@detector_app.command()
def render(
    pictures: PicturesOption = PICTURES,
    seed: SeedOption = 0,
    scale: Annotated[
        float,
        typer.Option(
            min=0.001, max=100.0, callback=finite, help="Number of scenes; 1.0 is as many as for our detector."
        ),
    ] = 1.0,
    width: WidthOption = 320,
    workers: WorkersOption = None,
) -> None:
    """Render labelled pictures of the paper's room and of random rooms, for training and tests.

    Scenes already there are kept, so an interrupted run continues where it stopped.
    """
    check_writable(pictures / "test" / "x.npz")
    _render(pictures, ("test", "train"), seed, scale, width, workers)
    say(f"pictures in {pictures}")


@detector_app.command()
def train(
    pictures: PicturesOption = PICTURES,
    out_folder: Annotated[Path, typer.Option("--out", help="Folder of checkpoint, losses and network.")] = TRAINED,
    epochs: Annotated[int, typer.Option(min=1, max=10_000, help="Passes over the pictures.")] = 20,
    seed: SeedOption = 0,
    threads: Annotated[int | None, typer.Option(min=1, max=256, help="Threads; by default all cores.")] = None,
) -> None:
    """Train the detector on the rendered pictures; an interrupted training continues from its last finished epoch."""
    check_installed("torch", "torch")
    check_writable(out_folder / NETWORK.name)
    import torch

    from ortilo_drake.flight.files import write_bytes, write_text
    from ortilo_drake.model.input_files import read_text
    from ortilo_drake.onboard.detector.darknet_cfg import read_cfg
    from ortilo_drake.onboard.detector.darknet_file import OWN_EPSILON, network_bytes
    from ortilo_drake.onboard.detector.darknet_network import DarknetNetwork
    from ortilo_drake.onboard.detector.detector_network import OWN_CFG, OWN_CLASSES
    from ortilo_drake.training.network.train import BATCH, initialize, losses_figure
    from ortilo_drake.training.network.train import train as train_network
    from ortilo_drake.training.pictures.sets import load_set

    frames = load_set(pictures, "train")
    cfg = read_cfg(OWN_CFG)
    if frames.images.shape[1:3] != (cfg.net.height, cfg.net.width):
        height, width = frames.images.shape[1:3]
        wanted = f"{OWN_CFG.name} takes {cfg.net.width} x {cfg.net.height}"
        raise InputError(f"{pictures}: pictures of {width} x {height}, {wanted}")
    torch.set_num_threads(threads or os.cpu_count() or 1)
    torch.manual_seed(seed)
    network = DarknetNetwork(cfg, OWN_EPSILON)
    initialize(network)
    steps = len(frames.images) // BATCH
    with bar("training", epochs * steps) as update:

        def show(epoch: int, step: int, loss: float) -> None:
            update(completed=epoch * steps + step + 1, description=f"epoch {epoch + 1}, loss {loss:.2f}")

        history = train_network(network, frames, epochs, seed, out_folder, show)
    target = out_folder / NETWORK.name
    write_bytes(target, network_bytes(network, list(OWN_CLASSES), str(target)))
    for file in (OWN_CFG, OWN_CFG.with_suffix(".names")):  # --detector looks for them beside the weights
        write_text(out_folder / file.name, read_text(file))
    figure = losses_figure(history, figure_file(out_folder, "losses"))
    say_written(target, out_folder / "losses.json", figure)


@detector_app.command()
def evaluate(
    pictures: PicturesOption = PICTURES,
    seed: SeedOption = 0,
    scale: Annotated[
        float,
        typer.Option(
            min=0.001, max=100.0, callback=finite, help="Number of scenes; 1.0 is as many as for our detector."
        ),
    ] = 1.0,
    width: WidthOption = 320,
    backend: Annotated[str, typer.Option(help="auto, onnxruntime, opencv or torch.")] = "auto",
    network: NetworkOption = None,
    onnx: OnnxOption = None,
    worst: Annotated[Path | None, typer.Option(help="PNG file for the worst pictures.")] = None,
    workers: WorkersOption = None,
    json_file: JsonOption = None,
) -> None:
    """Test the detector on pictures it has never seen; missing pictures are rendered first."""
    check_writable(worst, pictures / "test" / "x.npz")
    if worst is not None and worst.suffix != ".png":
        raise InputError(f"--worst {worst}: must end in .png")
    from ortilo_drake.onboard.detector.detector_network import load_detector
    from ortilo_drake.training.judging.judge import judge

    settings = _settings(network, onnx, backend)
    room = load_scenario("imu_uwb_yolo").load_room()
    load_detector(settings, room, (width, width))  # reports bad files before minutes of rendering
    _render(pictures, ("test",), seed, scale, width, workers)
    result = judge(settings, room, pictures, LOWEST, worst)
    write_json(json_file, result)
    for kind, value in result.map50.items():
        center = result.center_error_px[kind]
        error = "-" if center is None else f"{center:.2f} px"
        clear = result.map50_clear[kind]
        out.print(f"[bold]{kind}[/bold]: mAP50 {value:.3f} ({clear:.3f} for objects in clearer view), ", end="")
        out.print(f"median centre error {error}, ", end="")
        more = result.sets[kind]
        out.print(f"recall {more.recall:.1%}, {more.false_boxes_per_image:.3f} false boxes per picture")
        for name, ap in more.ap50.items():
            say(f"  {name:14} {'-' if ap is None else format(ap, '.3f')}")
    out.print(f"{result.ms_per_frame:.1f} ms a picture on one core ({result.backend})")
    say_written(json_file, worst)


@detector_app.command()
def recognise(
    network: NetworkOption = None,
    onnx: OnnxOption = None,
    backend: Annotated[str, typer.Option(help="auto, onnxruntime, opencv or torch.")] = "auto",
    scenario: Annotated[str, typer.Option(help="Use this scenario's room, path and camera.")] = "imu_uwb_yolo",
    settings: SetOption = None,
    json_file: JsonOption = None,
) -> None:
    """Say which landmarks of the room the detector recognises, along the way and from 2 m on all sides."""
    chosen = load_scenario(scenario, tuple(settings or ()))
    from ortilo_drake.onboard.detector.detector_network import load_detector
    from ortilo_drake.training.judging.recognised import recognised

    look = _settings(network, onnx, backend)
    room = chosen.load_room()
    camera = room.camera.scaled_to(chosen.camera.width)
    all_boxes = validate(Detector, look.model_dump() | {"threshold": LOWEST}, "detector")
    found = recognised(load_detector(all_boxes, room, (camera.width, camera.height)), chosen, look.threshold)
    out.print(
        f"best score of a box on the landmark; pictures with {look.threshold:g} or more, as flights need",
        soft_wrap=True,
    )
    say(f"  {'landmark':18}{'on the way':>22}{'from near':>22}")
    for one in found:
        views = [f"{v.best:.2f}, {v.found} of {v.pictures}" for v in (one.way, one.near)]
        say(f"  {one.number:2} {one.label:15}{views[0]:>22}{views[1]:>22}")
    for name, best in (("on the way", [o.way.best for o in found]), ("from near", [o.near.best for o in found])):
        counts = ", ".join(f"{sum(b >= at for b in best)} at {at:g}" for at in (0.1, 0.25, look.threshold))
        say(f"  {name}: of {len(found)} landmarks {counts}")
    write_json(json_file, found)
    say_written(json_file)


@detector_app.command()
def export(
    network: Annotated[Path, typer.Option(help="A trained network, .safetensors.")] = NETWORK,
    onnx: Annotated[Path, typer.Option(help="ONNX file to write.")] = TRAINED / "ortilo.onnx",
) -> None:
    """Write a trained network as ONNX, for OpenCV and onnxruntime."""
    check_installed("torch", "torch")
    check_writable(onnx)
    from ortilo_drake.training.network.export import export as export_network

    export_network(network, onnx)
    say_written(onnx)


@detector_app.command()
def calibrate(
    flights: Annotated[int, typer.Option(min=1, max=1000, help="Flights to measure on.")] = 4,
    first_seed: Annotated[
        int, typer.Option(min=0, help="Seed of the first flight; `ortilo tables` uses seeds from 0.")
    ] = 100,
    network: NetworkOption = None,
    onnx: OnnxOption = None,
    out_file: Annotated[Path, typer.Option("--out", help="The calibration file.")] = Path(
        "out/detector/camera_calibration.yaml"
    ),
) -> None:
    """Measure the detector's errors and misses on rendered flights, for the projected camera.

    Use the file with --set camera.errors.file=FILE.
    """
    check_writable(out_file)
    settings = _settings(network, onnx)
    from ortilo_drake.training.calibration.calibrate import calibrate as measure

    seeds = range(first_seed, first_seed + flights)
    with bar("measuring") as update:
        found = measure(seeds, out_file, lambda done, total: update(completed=done, total=total), settings)
    say(f"flown by {found.source.flown_by}")
    say_written(out_file)
