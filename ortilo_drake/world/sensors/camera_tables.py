"""A camera's rates and errors as tables for compiled functions: linear between knots and constant beyond.

For their meaning see camera_calibration.py.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.room import Room
from ortilo_drake.scenario import Camera
from ortilo_drake.scenario.camera import MeasuredErrors, ParametricErrors
from ortilo_drake.world.sensors.camera_calibration import OTHER, QUANTILES, CameraCalibration, load_calibration


class Tables(NamedTuple):
    """A calibration as compiled functions take it; the first row of a table holds its knots."""

    found: np.ndarray
    """distance [m]; rate of each class of the room (1 + classes, k)."""
    inside: np.ndarray
    """share inside the image; factor; growth of errors; factor of errors at the border (4, k)."""
    visible: np.ndarray
    """share not hidden; factor; growth of errors (3, k)."""
    errors: np.ndarray
    """size [px]; mean error of centre and of extent [px] (3, k)."""
    quantiles: np.ndarray
    """normal quantile; quantiles of the errors of centre u, v, width, height (5, k)."""
    slow: np.ndarray
    """rows of errors and of misses: share of the slow part, ticks between its nodes (2, 2)."""
    limits: np.ndarray
    """max_distance [m], min_size [px], min_visible (3)."""
    false_classes: np.ndarray
    """mean number of false boxes; then the cumulative sums of the classes' shares (1 + classes)."""
    false_sizes: np.ndarray
    """probability; quantiles of width and of height [px] (3, k)."""


@register_jitable
def look_up(table: np.ndarray, row: int, at: float) -> float:
    """Return the value of a table's row: linear between the knots of row 0, constant beyond."""
    last = table.shape[1] - 1
    if at <= table[0, 0]:
        return table[row, 0]
    for k in range(last):
        if at < table[0, k + 1]:
            a = (at - table[0, k]) / (table[0, k + 1] - table[0, k])
            return (1.0 - a) * table[row, k] + a * table[row, k + 1]
    return table[row, last]


def measured_tables(calibration: CameraCalibration, classes: tuple[str, ...], width: int, h: float) -> Tables:
    """Return the tables of a calibration for a room's classes, an image width [px] and a tick [s].

    Errors in px grow with the image width, because the detector scales every image to one size.
    """
    found, errors, false = calibration.found, calibration.errors, calibration.false_boxes
    scale = width / calibration.source.width
    shares = np.array([false.classes.get(name, 0.0) for name in classes])
    if shares.sum() <= 0.0:
        shares = np.ones(len(classes))
    slow = [[part.share, max(round(part.period / h), 1)] for part in (calibration.slow_errors, calibration.slow_misses)]
    return Tables(
        found=np.array([found.distance, *(found.rate.get(name, found.rate[OTHER]) for name in classes)]),
        inside=np.array([found.inside, found.inside_factor, errors.inside_growth, errors.border_factor]),
        visible=np.array([found.visible, found.visible_factor, errors.visible_growth]),
        errors=scale * np.array([errors.size, errors.center, errors.extent]),
        quantiles=np.array([errors.normal, *(errors.quantiles[name] for name in QUANTILES)]),
        slow=np.array(slow, dtype=float),
        limits=np.array([found.distance[-1], scale, 0.0]),
        false_classes=np.array([false.mean, *np.cumsum(shares / max(shares.sum(), 1e-12))]),
        false_sizes=np.array(
            [np.linspace(0.0, 1.0, len(false.width)), scale * np.array(false.width), scale * np.array(false.height)]
        ),
    )


def parametric_tables(settings: ParametricErrors, classes: tuple[str, ...], image: np.ndarray) -> Tables:
    """Return the tables of ParametricErrors, for a room's classes and an image's width and height [px] (2).

    Each edge of a box has its own noise, so the centre's standard deviation is 1 / sqrt(2) and the extent's sqrt(2)
    times the edge's. The noise is normal, so its mean size is sqrt(2 / pi) times its standard deviation.
    """
    far = settings.max_distance
    sure = (1.0 - settings.miss_base) / settings.miss_per_metre if settings.miss_per_metre > 0.0 else np.inf
    knots = np.unique([0.0, min(sure, far), far, far + 1.0])  # the rate falls to 0 and stays there
    rate = np.clip(1.0 - settings.miss_base - settings.miss_per_metre * knots, 0.0, 1.0)
    mean = settings.edge_sd * np.sqrt(2.0 / np.pi)
    reach, flat = np.sqrt(np.pi / 2.0) * 10.0, np.ones(2)  # normal numbers do not reach 10
    least = max(settings.min_size, 1.0)
    return Tables(
        found=np.array([knots, *([rate] * len(classes))]),
        inside=np.array([[0.0, 1.0], flat, flat, 0.0 * flat]),
        visible=np.array([[0.0, 1.0], flat, flat]),
        errors=np.array([[0.0, 1.0], flat * mean / np.sqrt(2.0), flat * mean * np.sqrt(2.0)]),
        quantiles=np.array([[-10.0, 10.0], *([[-reach, reach]] * 4)]),
        slow=np.array([[0.0, 1.0], [0.0, 1.0]]),
        limits=np.array([far, max(settings.min_size, 1e-9), settings.min_visible]),
        false_classes=np.array([settings.false_boxes, *(np.arange(1, len(classes) + 1) / max(len(classes), 1))]),
        false_sizes=np.array(
            [[0.0, 1.0], least + np.array([0.0, 0.25]) * image[0], least + np.array([0.0, 0.25]) * image[1]]
        ),
    )


@cache
def _own_calibration() -> CameraCalibration:
    return load_calibration(MeasuredErrors())  # reading it takes as long as a flight's bound


def tables_of(settings: Camera, room: Room, h: float) -> Tables:
    """Return a camera's rates and errors; InputError if the file of measured errors is missing or wrong."""
    errors = settings.errors
    if isinstance(errors, ParametricErrors):
        return parametric_tables(errors, room.classes, room.camera.scaled_to(settings.width).constants.image)
    calibration = _own_calibration() if errors == MeasuredErrors() else load_calibration(errors)
    return measured_tables(calibration, room.classes, settings.width, h)
