"""A landmark camera without an image: what a trained detector would return, drawn from projected outlines."""

import numpy as np
from numba import njit
from numba.extending import register_jitable
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.equations import rotation_matrix
from ortilo_drake.model.pinhole import NEAR, Camera, extent_box, in_body_frame
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import DETECTION_SIZE, DETECTIONS_SIZE, MAX_DETECTIONS, N_X, PAYLOAD
from ortilo_drake.scenario import ProjectedCamera as ProjectedCameraSettings
from ortilo_drake.world.line_of_sight import is_hidden
from ortilo_drake.world.noise import normals, stream_id, uniforms

# Where an extent is looked at, as shares of its half sizes: its centre and points towards its corners.
_SAMPLES = np.array([[0.0, 0.0, 0.0], *[[x, y, z] for x in (-0.7, 0.7) for y in (-0.7, 0.7) for z in (-0.7, 0.7)]])
_MAX_FALSE = 16  # a Poisson number of mean 5, the largest allowed, exceeds it once in 70,000 images


@register_jitable
def _is_near(p: np.ndarray, q: np.ndarray, x: float, y: float, reach: float) -> bool:
    """Return whether (x, y) is nearer than reach to the line from p to q, in plan."""
    dx, dy, ox, oy = q[0] - p[0], q[1] - p[1], x - p[0], y - p[1]
    length = np.sqrt(dx**2 + dy**2)
    along = ox * dx + oy * dy
    return abs(ox * dy - oy * dx) <= reach * length and -reach * length <= along <= (length + reach) * length


@njit(cache=True)
def visible_share(
    p_WC: np.ndarray,
    p_WL: np.ndarray,
    size: np.ndarray,
    walls: np.ndarray,
    stands: np.ndarray,
    samples: np.ndarray,
) -> float:
    """Return the share of an extent's sample points that the camera sees past walls (n, 7) and stands (m, 4).

    Args:
        p_WC: the camera in W (3).
        p_WL: the extent's centre in W (3).
        size: the extent along W's axes (3).
        walls: see line_of_sight.
        stands: see line_of_sight.
        samples: the points, as shares of the half sizes (k, 3).
    """
    # Few obstacles stand near the line of sight: pick them once for all points.
    aside = 0.5 * np.sqrt(size[0] ** 2 + size[1] ** 2)
    near_walls, n_walls = np.empty_like(walls), 0
    for i in range(walls.shape[0]):
        if _is_near(p_WC, p_WL, walls[i, 0], walls[i, 1], np.sqrt(walls[i, 4] ** 2 + walls[i, 5] ** 2) + aside):
            near_walls[n_walls] = walls[i]
            n_walls += 1
    near_stands, n_stands = np.empty_like(stands), 0
    for i in range(stands.shape[0]):
        if _is_near(p_WC, p_WL, stands[i, 0], stands[i, 1], stands[i, 2] + aside):
            near_stands[n_stands] = stands[i]
            n_stands += 1
    seen = 0
    point = np.empty(3)
    for k in range(samples.shape[0]):
        for axis in range(3):
            point[axis] = p_WL[axis] + 0.5 * samples[k, axis] * size[axis]
        if not is_hidden(p_WC, point, near_walls[:n_walls], near_stands[:n_stands]):
            seen += 1
    return seen / samples.shape[0]


@register_jitable
def _write_row(message: np.ndarray, row: int, label: float, score: float, box: np.ndarray) -> None:
    start = PAYLOAD + row * DETECTION_SIZE
    message[start], message[start + 1] = label, score
    message[start + 2 : start + 6] = box


@register_jitable
def _cut(value: float, size: float) -> float:
    return min(max(value, -0.5), size - 0.5)


@njit(cache=True)
def poisson(u: float, mean: float, largest: int) -> int:
    """Return the Poisson number of a mean that belongs to u in [0, 1), by inversion; at most largest."""
    term = np.exp(-mean)
    total, k = term, 0
    while u >= total and k < largest:
        k += 1
        term *= mean / k
        total += term
    return k


@njit(cache=True)
def detections_message(
    x: np.ndarray,
    positions: np.ndarray,
    outlines: np.ndarray,
    sizes: np.ndarray,
    labels: np.ndarray,
    n_classes: int,
    walls: np.ndarray,
    stands: np.ndarray,
    samples: np.ndarray,
    camera: Camera,
    limits: np.ndarray,
    noise: np.ndarray,
    seed: int,
    streams: np.ndarray,
    time: float,
    h: float,
) -> np.ndarray:
    """Return the detections message at state x: the landmarks found, in the map's order, then false boxes.

    A landmark at distance d is found if its box, cut at the image border, is large enough, enough of it is
    seen, and it is not missed, P(miss) = min(1, miss_base + miss_per_metre d). Every edge has its own noise,
    save one cut at the border, which stays there.

    Args:
        x: state (12).
        positions: p_W of the landmarks (n, 3).
        outlines: their outlines, see pinhole.py (n, m, 3).
        sizes: their extents along W's axes (n, 3).
        labels: their classes (n).
        n_classes: number of classes, for false boxes.
        walls: the room's walls (m, 7).
        stands: the room's stands (k, 4).
        samples: see visible_share.
        camera: the camera.
        limits: max_distance [m], min_size [px], min_visible.
        noise: edge_sd [px], miss_base, miss_per_metre [1/m], false_boxes.
        seed: seed of all noise.
        streams: numbers of the noise streams of edges, of misses and scores, and of false boxes (3).
        time: t_k [s].
        h: tick [s].
    """
    message = np.zeros(DETECTIONS_SIZE)
    message[0], message[1] = 1.0, time
    message[PAYLOAD::DETECTION_SIZE] = -1.0
    tick, n = tick_of(time, h), positions.shape[0]
    # Each landmark owns fixed places of the streams, so its noise is the same whatever else is seen.
    edge_noise, chance = normals(seed, streams[0], tick, 4 * n), uniforms(seed, streams[1], tick, 2 * n)
    p_WB, R_WB, p_BC, image = x[0:3], rotation_matrix(x[3:6]), camera.p_BC, camera.image
    p_WC = p_WB + R_WB @ p_BC
    box, noisy, row = np.empty(4), np.empty(4), 0
    for i in range(n):
        p_BL = in_body_frame(positions[i, 0], positions[i, 1], positions[i, 2], p_WB, R_WB)
        q_x, q_y, q_z = p_BL[0] - p_BC[0], p_BL[1] - p_BC[1], p_BL[2] - p_BC[2]
        distance = np.sqrt(q_x**2 + q_y**2 + q_z**2)
        if row == MAX_DETECTIONS or q_x < NEAR or distance > limits[0]:
            continue
        if chance[2 * i] < noise[1] + noise[2] * distance:
            continue
        if not extent_box(positions[i], outlines[i], p_WB, R_WB, camera, box):
            continue
        for k in range(4):
            edge = _cut(box[k], image[k % 2])
            inside = edge == box[k]
            box[k] = edge
            noisy[k] = _cut(edge + noise[0] * edge_noise[4 * i + k], image[k % 2]) if inside else edge
        if min(box[2] - box[0], box[3] - box[1]) < max(limits[1], 1e-9):
            continue
        if visible_share(p_WC, positions[i], sizes[i], walls, stands, samples) < limits[2]:
            continue
        if noisy[0] < noisy[2] and noisy[1] < noisy[3]:
            _write_row(message, row, labels[i], 1.0 - 0.5 * chance[2 * i + 1], noisy)
            row += 1
    n_false = poisson(uniforms(seed, streams[2], tick, 1)[0], noise[3], _MAX_FALSE)
    if n_false > 0:
        u = uniforms(seed, streams[2], tick, 1 + 6 * n_false)[1:].reshape((n_false, 6))
        for k in range(min(n_false, MAX_DETECTIONS - row)):
            for axis in range(2):
                # Anywhere in the image, between the smallest size and a quarter of the image more.
                middle = u[k, 1 + axis] * image[axis] - 0.5
                half = 0.5 * (max(limits[1], 1.0) + 0.25 * u[k, 3 + axis] * image[axis])
                box[axis], box[2 + axis] = _cut(middle - half, image[axis]), _cut(middle + half, image[axis])
            _write_row(message, row, np.floor(u[k, 0] * n_classes), 0.25 + 0.5 * u[k, 5], box)
            row += 1
    return message


class ProjectedCamera(LeafSystem):
    """A memoryless camera and detector in one, of known errors.

    Of more than MAX_DETECTIONS boxes the last are left out. Scores are uniform, on (1/2, 1] for landmarks and
    on [1/4, 3/4) for false boxes.

    Ports:
        state (12): x of the vehicle.
        detections (DETECTIONS_SIZE, output): the message, see model/signals.py; there in every tick.

    Args:
        settings: image width, errors and limits.
        room: landmarks, walls, stands and the camera.
        seed: seed of all noise.
        h: tick [s].
    """

    def __init__(self, settings: ProjectedCameraSettings, room: Room, seed: int, h: float):
        super().__init__()
        self.set_name("projected_camera")
        streams = [stream_id(name) for name in ("camera", "camera misses", "camera false boxes")]
        self._constants = (
            room.landmark_positions,
            room.landmark_outlines,
            room.landmark_sizes,
            room.landmark_labels,
            len(room.classes),
            room.wall_boxes,
            room.stand_cylinders,
            _SAMPLES,
            room.camera.scaled_to(settings.width).constants,
            np.array([settings.max_distance, settings.min_size, settings.min_visible]),
            np.array([settings.edge_sd, settings.miss_base, settings.miss_per_metre, settings.false_boxes]),
            seed,
            np.array(streams, dtype=np.uint64),
        )
        self._h = h
        self._state = self.DeclareVectorInputPort("state", N_X)
        self.DeclareVectorOutputPort(
            "detections",
            DETECTIONS_SIZE,
            self._calc_detections,
            prerequisites_of_calc={self._state.ticket(), self.time_ticket()},
        )

    def _calc_detections(self, context: Context, output: BasicVector) -> None:
        x, time = self._state.Eval(context), context.get_time()
        output.SetFromVector(detections_message(x, *self._constants, time, self._h))
