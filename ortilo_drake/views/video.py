"""A flight as a video."""

import io
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np
import xarray as xr
from PIL import Image

from ortilo_drake.flight.files import write_bytes
from ortilo_drake.flight.flight import scenario_of
from ortilo_drake.model.optional import check_installed
from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.views.flight_frames import make_frames
from ortilo_drake.views.scene_view import class_bgr
from ortilo_drake.world.scenery.rendering import check_egl

SUFFIXES = (".gif", ".mp4")
SPEED = 3.0  # times real time: a flight of a minute takes 20 s to watch
RATE = {".mp4": 10.0, ".gif": 2.5}  # frames a second of flight [Hz]
PANEL = {".mp4": 640, ".gif": 320}  # width of camera and room [px]
COLORS = 24  # of a gif, besides those of the classes; more would show the bricks' grain, at most of the file's size
SAMPLES = 12  # frames from which the colours are chosen

Progress = Callable[[int, int], None]
Draw = Callable[[int], np.ndarray]


def check_video(path: Path) -> None:
    """Check that a video of that name can be drawn; InputError says what is allowed, or what to install."""
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: unknown kind of video '{path.suffix}', give one of {', '.join(SUFFIXES)}")
    if path.suffix.lower() == ".mp4":
        check_installed("av", "video")
    check_egl()


def frame_ticks(flight: xr.Dataset, rate: float) -> np.ndarray:
    """Return the ticks to draw, at about that rate [Hz]; a lost flight may end without a state."""
    stride = max(1, round(scenario_of(flight).control_rate / rate))
    there = np.isfinite(flight["truth"].values).all(axis=1)
    return np.flatnonzero(there)[::stride]


def _write_mp4(file: io.BytesIO, draw: Draw, ticks: np.ndarray, fps: float, step: Progress) -> None:
    """Write H.264, which every browser plays."""
    import av

    first = draw(int(ticks[0]))
    with av.open(file, "w", format="mp4") as container:
        stream = container.add_stream(
            "libx264", rate=Fraction(fps).limit_denominator(1000), options={"preset": "veryfast"}
        )
        stream.height, stream.width, _ = first.shape
        stream.pix_fmt = "yuv420p"
        for k, tick in enumerate(ticks):
            frame = first if k == 0 else draw(int(tick))
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format="bgr24")))
            step(k + 1, len(ticks))
        container.mux(stream.encode())


def _image(frame: np.ndarray) -> Image.Image:
    return Image.fromarray(np.ascontiguousarray(frame[..., ::-1]))


def _palette(frames: list[np.ndarray], fixed: list[tuple[int, int, int]]) -> Image.Image:
    """Return an image with a palette of the commonest colours of some frames, and fixed colours, all as BGR."""
    common = _image(np.vstack(frames)).quantize(COLORS, Image.Quantize.MEDIANCUT).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette(common[: 3 * COLORS] + [part for color in fixed for part in reversed(color)])
    return palette


def _write_gif(file: io.BytesIO, draw: Draw, ticks: np.ndarray, fps: float, room: Room, step: Progress) -> None:
    sampled = [draw(int(tick)) for tick in ticks[:: max(1, len(ticks) // SAMPLES)]]
    palette = _palette(sampled, [class_bgr(room, label) for label in room.classes])

    def frames() -> Iterator[Image.Image]:
        for k, tick in enumerate(ticks):
            yield _image(draw(int(tick))).quantize(palette=palette, dither=Image.Dither.NONE)
            step(k + 1, len(ticks))

    images = frames()
    duration = 10 * round(100 / fps)  # the unit of a gif is a hundredth of a second
    next(images).save(file, "GIF", save_all=True, append_images=images, duration=duration, loop=0)


def flight_video(flight: xr.Dataset, path: Path, progress: Progress | None = None, speed: float = SPEED) -> Path:
    """Draw a flight as a video: camera with boxes, vehicle in its room, errors and arrivals.

    The pictures are drawn again from the recorded states. An .mp4 has 10 frames a second of flight, a small .gif 2.5;
    it plays so many times faster than the flight, its speed. The progress is told as frames drawn and to draw.
    InputError if the suffix is another, the file cannot be written, there is no EGL, or a file of the scenario's
    detector is wrong.
    """
    check_video(path)
    kind = path.suffix.lower()
    scenario = scenario_of(flight)
    ticks = frame_ticks(flight, RATE[kind])
    stride = int(ticks[1] - ticks[0]) if len(ticks) > 1 else 1
    fps = speed * scenario.control_rate / stride
    draw = make_frames(flight, PANEL[kind])
    step = progress or (lambda done, total: None)
    drawn = io.BytesIO()
    if kind == ".mp4":
        _write_mp4(drawn, draw, ticks, fps, step)
    else:
        _write_gif(drawn, draw, ticks, fps, scenario.load_room(), step)
    write_bytes(path, drawn.getvalue())
    return path
