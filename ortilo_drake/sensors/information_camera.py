"""Fisher information on the pose in the centres of the camera's boxes, without boxes that the image border cuts.

The centre has the error e = m q(z), z = sqrt(w) s + sqrt(1 - w) v (world/sensors/camera_calibration.py), with m the
size of the error, q its quantile function, v new in every picture, and s slow. With the score of e and of s, and
Stein's lemma, one box's Fisher information about (centre, s), averaged over s, equals the one of a normal error of the
same kind

    e = (m / E) (sqrt(w) s + sqrt(1 - w) v),   E = E[1 / q'(z)],                             (row with a slow error)

and, if q is not linear, a further part about the centre alone (0 for a normal error):

    (F - E^2 + w / (1 - w) Var[1 / q'(z)]) / m^2,   F = E[((z + q'' / q') / q')^2],          (row without)

where F is the information about the centre of an error that is all new. q is a monotone cubic through the measured
quantiles, continued by straight lines. The projected camera draws from a piecewise linear q, whose corners would hold
unbounded information that was never measured.

A landmark's information is weighted by its detection rate. The bound is convex in the information, so the mean of the
bound over the detected landmarks is not below the bound for the mean information.
"""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.equations import rotation_matrix
from ortilo_drake.model.pinhole import Camera, box_center
from ortilo_drake.model.room import Room
from ortilo_drake.scenario import Detector, Scenario
from ortilo_drake.scenario.camera import MeasuredErrors, ParametricErrors
from ortilo_drake.sensors.information_rows import AMPLITUDE, GRADIENT, ROW_SIZE, SLOW, SOURCE, TICK, VARIANCE
from ortilo_drake.world.sensors.camera_tables import Tables, look_up, tables_of
from ortilo_drake.world.sensors.landmark_view import Surroundings, landmark_views, surroundings

_MOST_SLOW = 1.0 - 1e-6  # largest w: the changes of an error that is all slow would hold unbounded information


class CenterErrors(NamedTuple):
    """The distribution of the errors of a box's centre, u and v."""

    gain: np.ndarray
    """E of u and v, in 1 / m (2)."""
    extra: np.ndarray
    """information in addition to the normal error's, of u and v, in 1 / m^2 (2)."""
    share: float
    """share w of the slow error in the variance [1]."""


def quantile_information(normal: np.ndarray, quantiles: np.ndarray) -> tuple[float, float, float]:
    """Return E[1/q'], E[1/q'^2] and F of the error q(z), given `quantiles` (k) at rising normal numbers z (k)."""
    q = PchipInterpolator(normal, quantiles)
    z, step = np.linspace(-8.0, 8.0, 4001, retstep=True)
    inside = np.clip(z, normal[0], normal[-1])
    slope = np.maximum(q(inside, 1), 1e-9)
    bend = np.where(z == inside, q(inside, 2), 0.0)
    chance = np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi) * step
    score = (z + bend / slope) / slope
    return float(chance @ (1.0 / slope)), float(chance @ slope**-2.0), float(chance @ score**2)


def center_errors(tables: Tables) -> CenterErrors:
    """Return the distribution of the errors of a centre's u and v, given a camera's tables."""
    w = min(float(tables.slow[0, 0]), _MOST_SLOW)
    found = np.array([quantile_information(tables.quantiles[0], tables.quantiles[row]) for row in (1, 2)])
    gain, square, fisher = found.T
    return CenterErrors(gain, np.maximum(fisher - gain**2 + w / (1.0 - w) * (square - gain**2), 0.0), w)


@cached_njit
def box_rows(
    ticks: np.ndarray,
    truth: np.ndarray,
    room: Surroundings,
    labels: np.ndarray,
    camera: Camera,
    tables: Tables,
    errors: CenterErrors,
) -> np.ndarray:
    """Return the rows (m, 17) of the landmarks' box centres in the ticks (k) whose picture reached the vehicle.

    The slow error of landmark i has the number 2 i in u and 2 i + 1 in v. `truth` holds the true states (n, 12),
    `labels` the landmarks' classes (l).
    """
    rows, m = np.zeros((4 * ticks.size * labels.size, ROW_SIZE)), 0
    z, J = np.empty(2), np.empty((2, 6))
    whole = look_up(tables.inside, 1, 1.0), look_up(tables.inside, 2, 1.0)
    for tick in ticks:
        p_WB, rpy = truth[tick, 0:3], truth[tick, 3:6]
        R_WB = rotation_matrix(rpy)
        views = landmark_views(truth[tick], room, camera, tables.limits)
        for k in range(views.shape[0]):
            i, distance, inside, visible = int(views[k, 0]), views[k, 1], views[k, 6], views[k, 7]
            if inside < 1.0 or visible < tables.limits[2]:
                continue
            rate = look_up(tables.found, 1 + int(labels[i]), distance) * whole[0] * look_up(tables.visible, 1, visible)
            if rate <= 0.0 or not box_center(room.positions[i], room.outlines[i], p_WB, rpy, R_WB, camera, z, J):
                continue
            growth = look_up(tables.visible, 2, visible) * whole[1]
            for axis in range(2):
                size = growth * look_up(tables.errors, 1, views[k, 4 + axis] - views[k, 2 + axis])
                sd, extra, w = size / errors.gain[axis], errors.extra[axis], errors.share
                number = 2 * i + axis
                rows[m, TICK], rows[m, GRADIENT][:6], rows[m, VARIANCE] = tick, J[axis], (1.0 - w) * sd**2 / rate
                rows[m, SLOW], rows[m, AMPLITUDE] = (number if w > 0.0 else -1), np.sqrt(w) * sd
                rows[m, SOURCE] = number
                m += 1
                if extra > 0.0:
                    rows[m, TICK], rows[m, GRADIENT][:6], rows[m, SLOW] = tick, J[axis], -1.0
                    rows[m, VARIANCE], rows[m, SOURCE] = size**2 / (extra * rate), number
                    m += 1
    return rows[:m].copy()


def camera_tables(scenario: Scenario, room: Room) -> Tables | None:
    """Return the tables of the scenario's camera; None if the errors of its detector have not been measured."""
    errors: MeasuredErrors | ParametricErrors = scenario.camera.errors
    if scenario.is_rendered:
        if not isinstance(scenario.detector, Detector) or scenario.detector.files:
            return None
        errors = MeasuredErrors()
    return tables_of(scenario.camera.model_copy(update={"errors": errors}), room, scenario.h)


def camera_rows(tables: Tables, room: Room, width: int, truth: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Return the rows of the box centres in the ticks marked in `seen` (n), at true states (n, 12).

    `width` is the image's width [px]; `tables` come from camera_tables.
    """
    camera = room.camera.scaled_to(width).constants
    ticks, labels = np.flatnonzero(seen), room.landmark_labels
    return np.asarray(
        box_rows(ticks, np.ascontiguousarray(truth), surroundings(room), labels, camera, tables, center_errors(tables))
    )
