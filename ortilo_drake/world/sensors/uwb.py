"""Ultra-wideband ranging to the room's anchors (paper, section III-A)."""

from typing import Any

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.geometry.line_of_sight import walls_crossed
from ortilo_drake.model.placing import fill
from ortilo_drake.model.room import Room
from ortilo_drake.model.scalars import values_of
from ortilo_drake.model.signals import uwb_size
from ortilo_drake.scenario import Uwb
from ortilo_drake.world.noise import normals, put_normals, stream_id


@register_jitable
def put_uwb_message(
    message: np.ndarray,
    v: np.ndarray,
    x: np.ndarray,
    anchors: np.ndarray,
    bias: np.ndarray,
    boxes: np.ndarray,
    settings: np.ndarray,
    time: float,
) -> None:
    """Write the uwb message (2 + 2 n): ranges d_i + b_i + b w_i + (s_0 + s_1 d_i) v_i, then their presence flags.

    d_i = |p_WB - p_WA_i|, w_i is the number of walls between, and v_i (n) are standard normal, drawn for absent ranges
    too. A range is present if d_i is within the greatest distance and w_i within the greatest number of walls; else it
    is 0. No range is below 0.

    `message` must hold zeros; the antenna is the origin of B in the state x (12); bias is b_i of each anchor [m]; boxes
    (m, 7) are the walls that act on a range; settings are s_0 [m], s_1, b of each wall [m], greatest number of walls,
    greatest distance [m]. The time is t_k [s].
    """
    n = anchors.shape[0]
    message[0] = 1.0
    message[1] = time
    p_WB = x[:3]
    for i in range(n):
        a = anchors[i]
        d = np.sqrt((p_WB[0] - a[0]) ** 2 + (p_WB[1] - a[1]) ** 2 + (p_WB[2] - a[2]) ** 2)
        if d > settings[4]:
            continue
        w = walls_crossed(values_of(p_WB), values_of(a), boxes)
        if w > settings[3]:
            continue
        message[2 + i] = max(d + bias[i] + settings[2] * w + (settings[0] + settings[1] * d) * v[i], 0.0)
        message[2 + n + i] = 1.0


@cached_njit
def uwb_message(
    x: np.ndarray,
    anchors: np.ndarray,
    bias: np.ndarray,
    boxes: np.ndarray,
    settings: np.ndarray,
    seed: int,
    stream: np.uint64,
    time: float,
    h: float,
) -> np.ndarray:
    """Return the uwb message (2 + 2 n), see put_uwb_message.

    Arguments as there, with seed, stream and tick h [s] of the noise.
    """
    n = anchors.shape[0]
    message = np.zeros(2 + 2 * n, x.dtype)
    put_uwb_message(message, normals(seed, stream, tick_of(time, h), n), x, anchors, bias, boxes, settings, time)
    return message


def ranging_settings(settings: Uwb) -> np.ndarray:
    """Return the settings (5) in the form that uwb_message takes."""
    walls = settings.walls
    bias = walls.per_wall if walls.kind == "bias" else 0.0
    most_walls = 0.0 if walls.kind == "block" else np.inf
    return np.array([*settings.sds, bias, most_walls, settings.max_distance])


def walls_between(settings: Uwb, room: Room) -> np.ndarray:
    """Return the walls that act on a range (m, 7): the room's, none unless the walls' kind is bias or block."""
    return room.wall_boxes if settings.walls.kind in ("bias", "block") else np.empty((0, 7))


def uwb_out(
    n: Any,
    k: int,
    seed: int,
    sent: np.ndarray,
    state: np.ndarray,
    anchors: np.ndarray,
    bias: np.ndarray,
    walls: np.ndarray,
    v: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output the uwb message of put_uwb_message in a tick in which it is sent, else zeros."""
    fill(out, 0.0)
    if sent[0] >= 0.0:
        put_normals(v, seed, n.stream, k)
        put_uwb_message(out, v, state, anchors, bias, walls, n.settings, k * n.h)


def uwb_box(settings: Uwb, room: Room, h: float, stream: str = "uwb") -> Box:
    """Return the receiver, with the noise of a stream.

    It reads `sent` (1), not negative where its message is sent, and the true state (12).
    """
    count = len(room.anchors)
    given = Values(
        {"settings": ranging_settings(settings), "stream": stream_id(stream), "h": h},
        tables={"anchors": room.anchor_positions, "bias": np.zeros(count), "walls": walls_between(settings, room)},
    )
    return Box("uwb", Element("uwb", out=uwb_out), uwb_size(count), given, {"v": (count,)})
