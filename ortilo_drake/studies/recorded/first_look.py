"""A look at a recording before its calibration: does the map's reading fit at all, and does another fit better?"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import Recording
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.recorded.calibrate import offset_centres
from ortilo_drake.studies.recorded.clock_offset import offset_by_rates
from ortilo_drake.studies.recorded.doubts import range_noise
from ortilo_drake.studies.recorded.plain_fit import PlainFit, plain_fit
from ortilo_drake.studies.recorded.readings import UNITS, Guess, better_reading
from ortilo_drake.studies.recorded.truth_path import first_part, truth_path

SUSPECT = 1.5  # other readings are tried where more than so many standard deviations of a range are left
COARSE = 1.0  # clock offsets tried where nothing tells them [s]
LEAST_MISFIT = 1.0  # errors larger than this and than the motion itself leave nothing to calibrate [m]
STILL = 0.1  # a truth smaller than this stands still [m]
FAR = 10.0  # ranges are in metres if their median is less than so many sizes of the anchors' room


class CheapFit(NamedTuple):
    """The cheap fit of the map's reading, and a reading that is clearly better; None without truth or anchors."""

    fit: PlainFit | None
    guess: Guess | None


def first_look(recording: Recording, map_: Map) -> CheapFit:
    """Fit clock and frame of the truth cheaply, before the filter runs.

    Raises:
        InputError: if ranges, anchors and truth are not of one size, so that nothing can be made of them.
    """
    anchors = recording.anchors
    if isinstance(anchors, int) or map_.ranges is None:
        return CheapFit(None, None)
    recording = recording._replace(ranges=recording.ranges.only(recording.ranges.other < 0))
    r, room = recording.ranges.r, float(np.linalg.norm(np.ptp(anchors, axis=0)))
    said = f"{recording.name}: ranges of {np.quantile(r, 0.02):.3g} to {np.quantile(r, 0.98):.3g} m"
    said += f" for anchors {room:.3g} m apart"
    far = float(np.median(r)) > FAR * room
    if recording.truth is None:
        if far:
            raise InputError(f"{said}: {_unit(float(np.median(r)), room, map_)}")
        return CheapFit(None, None)
    offsets, moves = _offsets(recording, map_)
    path, frame = truth_path(recording.truth), map_.calibration.frame
    fit = plain_fit(recording.ranges, anchors, path, offsets, frame=frame, moves=moves, tags=recording.tags)
    if fit is None:
        if far:
            raise InputError(f"{said}: {_unit(float(np.median(r)), room, map_)}")
        return CheapFit(None, None)
    noise = range_noise(map_.filter, recording.imu is not None)
    better = better_reading(recording, map_, offsets, moves, fit, noise) if fit.left > SUSPECT * noise else None
    size = float(np.linalg.norm(np.ptp(np.percentile(recording.truth.p, [2, 98], axis=0), axis=0)))
    if far or fit.left > max(size, LEAST_MISFIT) or size > FAR * room:
        hint = _unit(float(np.median(r)), room, map_) if far else "ranges, anchors and truth must all be in metres"
        if not far and size < STILL:
            hint = "the truth stands still, the ranges change: other columns, or a body that was lost?"
        if better is not None:
            hint = f"{better.key} fits: range errors {better.before:.3g} m RMS -> {better.after:.3f} m"
        raise InputError(f"{said} and a truth {size:.3g} m across do not fit together ({fit.left:.3g} m RMS): {hint}")
    return CheapFit(fit, better)


def _unit(middle: float, room: float, map_: Map) -> str:
    """Return the unit that brings the ranges nearest to the room's size."""
    assert map_.ranges is not None
    unit = min(UNITS, key=lambda one: abs(np.log(middle * UNITS[one] / (0.6 * room))))
    return f"in {unit}? ranges: {{scale: {map_.ranges.scale * UNITS[unit]:.6g}}} makes them metres"


def _offsets(recording: Recording, map_: Map) -> tuple[np.ndarray, bool]:
    """Return the clock offsets to start from [s], and whether they may move."""
    truth, settings = recording.truth, map_.calibration
    assert truth is not None
    if settings.clock != "estimate":
        return np.array([float(settings.clock) - recording.truth_origin + recording.origin]), False
    centres = offset_centres(recording, settings.search)
    if recording.imu is not None:

        def part(offset: float) -> tuple[float, float]:
            return first_part(truth, recording.ranges, settings.share, offset)

        rates = offset_by_rates(recording.imu, truth, part, settings.search, None, centres)
        if rates is not None:
            return np.array([rates.offset]), False
    step = min(COARSE, settings.search / 2.0)
    steps = np.arange(-settings.search, settings.search + step / 2.0, step)
    return np.concatenate([centre + steps for centre in centres]), True
