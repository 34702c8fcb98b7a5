"""A video of a flight: its frames and its file."""

import io
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from ortilo_drake.flight.blackouts import in_blackout
from ortilo_drake.flight.files import write_bytes
from ortilo_drake.flight.flight import AXES, scenario_of
from ortilo_drake.model.optional import check_installed, later
from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.views.figures import COLOR, draw_arrivals, position_errors
from ortilo_drake.views.scene_view import FLOWN, PLANNED, class_bgr, draw_boxes, make_camera_view, make_room_view
from ortilo_drake.world.scenery.rendering import check_egl

cv2 = later("cv2")

DPI = 100
CURSOR = (30, 30, 30)
STRIP_HEIGHT = 240
_PATH_STEP = 0.1  # distance between two points of a drawn path [m]


def error_strip(flight: xr.Dataset, width: int, height: int) -> tuple[np.ndarray, np.ndarray, tuple[int, int]]:
    """Draw position errors in 3-sigma bands, arrivals below them, and shaded blackouts.

    Return the BGR picture (height x width x 3), the column of every tick (n) [px], and the first and last row of the
    plots over time [px].
    """
    time, truth, scenario = flight["time"].values, flight["truth"].values, scenario_of(flight)
    error, sigma = position_errors(flight)
    with mpl.rc_context({"font.size": 7, "axes.spines.top": False, "axes.spines.right": False}):
        figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI)
        canvas = FigureCanvasAgg(figure)
        grid = figure.add_gridspec(
            4, 1, left=70 / width, right=1 - 15 / width, top=1 - 8 / height, bottom=37 / height, hspace=0.25
        )
        for i, axis in enumerate(AXES):
            axes = figure.add_subplot(grid[i])
            axes.fill_between(time, -3 * sigma[:, i], 3 * sigma[:, i], color="#56B4E9", alpha=0.35, lw=0)
            axes.plot(time, error[:, i], color="k", lw=0.7)
            axes.set_ylabel(f"error\n{axis} [m]")  # one line would be longer than the axes
            axes.tick_params(labelbottom=False)
        draw_arrivals(figure.add_subplot(grid[3]), flight)
        for axes in figure.axes:
            axes.set_xlim(time[0], max(time[-1], time[0] + 1e-3))
            for sensor in ("uwb", "camera"):
                shaded = in_blackout(truth, scenario, sensor)
                across = axes.get_xaxis_transform()
                shade: Any = {"color": COLOR[sensor], "alpha": 0.12, "lw": 0, "zorder": 0}  # below the bars
                axes.fill_between(time, 0, 1, where=shaded, transform=across, **shade)
        canvas.draw()
        first, last = figure.axes[0], figure.axes[-1]
        columns = first.transData.transform(np.column_stack([time, np.zeros_like(time)]))[:, 0]
        rows = round(height - first.bbox.y1), round(height - last.bbox.y0)
        picture = np.asarray(canvas.buffer_rgba())[..., 2::-1].copy()
    return picture, np.round(columns).astype(int), rows


def _write(picture: np.ndarray, text: str) -> None:
    """Write a line of text into the upper left corner of a picture, white on black."""
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.4, 1)
    cv2.rectangle(picture, (0, 0), (width + 12, height + 11), (0, 0, 0), cv2.FILLED)
    cv2.putText(picture, text, (6, height + 6), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (255, 255, 255), 1, cv2.LINE_AA)


def _name_paths(picture: np.ndarray) -> None:
    """Write a legend of the planned and the flown path into the lower left corner of a picture."""
    low, width = picture.shape[0], 160
    cv2.rectangle(picture, (0, low - 20), (width, low), (255, 255, 255), cv2.FILLED)
    for left, name, color in ((6, "planned", PLANNED), (92, "flown", FLOWN)):
        cv2.line(picture, (left, low - 10), (left + 16, low - 10), color, 2)
        cv2.putText(picture, name, (left + 20, low - 6), cv2.FONT_HERSHEY_SIMPLEX, 0.38, (0, 0, 0), 1, cv2.LINE_AA)


def _thinned(points: np.ndarray) -> np.ndarray:
    """Return the indices of points about _PATH_STEP apart along a path, the last point included."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    _, kept = np.unique(np.floor(way / _PATH_STEP), return_index=True)
    return np.union1d(kept, [len(points) - 1])


def make_views(flight: xr.Dataset, panel: int) -> Callable[[int], np.ndarray]:
    """Return the function from a tick to the BGR picture of camera and room side by side (height x 2 panel x 3).

    Each of the two is `panel` wide [px]. The camera's side shows the last picture taken with the boxes found in it,
    even if they did not arrive. InputError if there is no EGL or a file of the scenario's detector is wrong.
    """
    scenario = scenario_of(flight)
    room = scenario.load_room()
    model = room.camera.scaled_to(scenario.image_width)
    height = 2 * round(panel * model.height / model.width / 2)  # video codecs need even sizes
    time, x = flight["time"].values, flight["truth"].values
    planned = flight["reference"].values
    shown = _thinned(x[:, :3])
    room_view = make_room_view(room, planned[_thinned(planned)], panel, height, scenario.vehicle)
    has_camera = "camera" in scenario.sensors
    camera_view = make_camera_view(scenario) if has_camera else None

    def camera_picture(tick: int) -> np.ndarray:
        if camera_view is None:
            picture = np.zeros((height, panel, 3), dtype=np.uint8)
            _write(picture, "no camera in this scenario")
            return picture
        taken = tick - tick % scenario.every("camera")
        image, boxes = camera_view(float(time[taken]), x[taken])
        picture = cv2.resize(image, (panel, height), interpolation=cv2.INTER_LINEAR)
        draw_boxes(picture, boxes, room, panel / model.width)
        return picture

    def views(tick: int) -> np.ndarray:
        flown = x[np.append(shown[shown < tick], tick), :3]
        right = room_view(x[tick], flown)
        _write(right, f"{time[tick]:5.1f} s   {scenario.name}, seed {scenario.seed}")
        _name_paths(right)
        return np.hstack([camera_picture(tick), right])

    return views


def make_frames(flight: xr.Dataset, panel: int) -> Callable[[int], np.ndarray]:
    """Return the function from a tick to a whole BGR frame of the video (height x 2 panel x 3); see make_views."""
    views = make_views(flight, panel)
    strip, columns, (top, bottom) = error_strip(flight, 2 * panel, STRIP_HEIGHT)

    def frame(tick: int) -> np.ndarray:
        below = strip.copy()
        cv2.line(below, (int(columns[tick]), top), (int(columns[tick]), bottom), CURSOR, 1)
        return np.vstack([views(tick), below])

    return frame


SUFFIXES = (".gif", ".mp4")
SPEED = 3.0  # playing speed over real time: a flight of a minute takes 20 s to watch
RATE = {".mp4": 10.0, ".gif": 2.5}  # frames per second of flight [Hz]
PANEL = {".mp4": 640, ".gif": 320}  # width of the camera's and of the room's picture [px]
COLORS = 24  # colours of a gif besides the class colours; more would show the bricks' grain, and take most of the file
SAMPLES = 12  # number of frames from which the colours are chosen

Progress = Callable[[int, int], None]
Draw = Callable[[int], np.ndarray]


def check_video(path: Path) -> None:
    """Check that a video can be written to this file; InputError names the allowed suffixes, or what to install."""
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: unknown kind of video '{path.suffix}', give one of {', '.join(SUFFIXES)}")
    if path.suffix.lower() == ".mp4":
        check_installed("av", "video")
    check_egl()


def frame_ticks(flight: xr.Dataset, rate: float) -> np.ndarray:
    """Return the ticks to draw at about `rate` [Hz], without ticks whose state is not finite (a lost flight's end)."""
    stride = max(1, round(scenario_of(flight).control_rate / rate))
    there = np.isfinite(flight["truth"].values).all(axis=1)
    return np.flatnonzero(there)[::stride]


def _write_mp4(file: io.BytesIO, draw: Draw, ticks: np.ndarray, fps: float, step: Progress) -> None:
    """Write H.264 video, which every browser plays."""
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
    """Return an image whose palette has the commonest colours of some BGR frames, and the fixed BGR colours."""
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
    """Draw a flight as a video: camera with boxes, vehicle in its room, errors and arrivals; return the path.

    The pictures are drawn again from the recorded states. An .mp4 has 10 frames per second of flight, a small .gif 2.5.
    The video plays `speed` times as fast as the flight. `progress` is called with the number of frames drawn and the
    number of all frames. InputError if the suffix is another, the file cannot be written, there is no EGL, or a file of
    the scenario's detector is wrong.
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
