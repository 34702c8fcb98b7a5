"""A logged flight as one self-contained page that plays it."""

from html import escape

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.trajectories import Trajectory

from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_X, N_XBAR
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import M100, Vehicle
from ortilo_drake.world.scenery.meshcat_draw import (
    ESTIMATED,
    PLANNED,
    TRUE,
    UNCERTAINTY,
    draw_flown,
    draw_plan,
    draw_vehicle,
    show_pose,
)
from ortilo_drake.world.scenery.meshcat_room import ANCHOR, aim_camera, class_color, draw_room, make_meshcat
from ortilo_drake.world.scenery.meshcat_zones import Zone, draw_zones

FRAME_RATE = 15.0  # of a replay [Hz]
LEGEND_STYLE = """
#legend { position: fixed; left: 0; top: 0; right: 250px; padding: 6px 10px; display: flex; flex-wrap: wrap;
  gap: 0 14px; background: rgba(255, 255, 255, 0.8); font: 13px/1.5 sans-serif }
#legend span { display: inline-block; width: 12px; height: 12px; margin-right: 6px }
"""
AROUND = np.array([1.5, 3.5, 1.5])  # [m] of the room to show around a replayed flight


def legend(room: Room) -> str:
    """Return an HTML legend of the colours of paths, ellipsoid, anchors and landmark classes."""
    colors = {"planned path": PLANNED, "true path": TRUE, "estimate": ESTIMATED, "3 sigma": UNCERTAINTY}
    colors |= {"anchor": ANCHOR} | {label: class_color(room, label) for label in room.classes}
    rows = "".join(
        f'<div><span style="background:rgb({255 * c.r():.0f},{255 * c.g():.0f},{255 * c.b():.0f})"></span>'
        f"{escape(name)}</div>"
        for name, c in colors.items()
    )
    return f'<style>{LEGEND_STYLE}</style>\n<div id="legend">{rows}</div>\n'


def _check_log(times: np.ndarray, **arrays: np.ndarray) -> None:
    """Raise InputError unless times rise and every array is finite and has a row for each time."""
    if times.ndim != 1 or len(times) < 2 or not np.all(np.diff(times) > 0):
        raise InputError(f"times: shape {times.shape}: must be two or more rising times")
    shapes = {"states": (N_X,), "estimates": (N_XBAR,), "covariances": (N_XBAR, N_XBAR)}
    for name, array in arrays.items():
        if array.shape != (len(times), *shapes[name]):
            raise InputError(f"{name}: shape {array.shape}: must be {(len(times), *shapes[name])}")
        if not np.all(np.isfinite(array)):
            raise InputError(f"{name}: must be finite numbers")


def html_replay(
    room: Room,
    trajectory: Trajectory | None,
    times: np.ndarray,
    states: np.ndarray,
    estimates: np.ndarray,
    covariances: np.ndarray,
    meshcat: Meshcat | None = None,
    vehicle: Vehicle = M100,
    zones: list[Zone] | None = None,
) -> str:
    """Return a logged flight as one HTML page that plays without a network.

    The planned path has p_W as its first three values. The log has equally spaced times (n) [s], states x (n, 12),
    estimates (n, 15) and covariances (n, 15, 15). It is drawn in a new Meshcat if none is given, the vehicle with its
    own arms, zones on the floor. InputError naming the array that does not fit.
    """
    _check_log(times, states=states, estimates=estimates, covariances=covariances)
    meshcat = make_meshcat() if meshcat is None else meshcat
    draw_room(meshcat, room)
    draw_zones(meshcat, room, zones or [])
    if trajectory is not None:
        draw_plan(meshcat, trajectory)
    draw_vehicle(meshcat, vehicle)
    h = (times[-1] - times[0]) / (len(times) - 1)
    stride = max(1, round(1.0 / (FRAME_RATE * h)))
    shown = slice(0, len(times), stride)
    draw_flown(meshcat, np.hstack([states[shown, :3], estimates[shown, :3]]))
    inside = np.clip(states[:, :3], room.interior.min, room.interior.max)  # a lost flight may end anywhere
    aim_camera(meshcat, inside.min(axis=0) - AROUND, inside.max(axis=0) + AROUND)
    frames_per_second = 1.0 / (stride * h)
    R = np.eye(3)
    meshcat.DeleteRecording()
    meshcat.StartRecording(frames_per_second, set_visualizations_while_recording=False)
    log = zip(states[shown], estimates[shown], covariances[shown, :3, :3], strict=True)
    for frame, (x, xhat, P) in enumerate(log):
        # Meshcat rounds a time down to a frame: half a frame keeps it clear of rounding.
        R = show_pose(meshcat, x, xhat, P, R, (frame + 0.5) / frames_per_second)
    meshcat.StopRecording()
    meshcat.PublishRecording()
    return meshcat.StaticHtml().replace("</body>", legend(room) + "</body>")
