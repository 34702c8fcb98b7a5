"""All doubts about one replayed motion, the likeliest cause first."""

from collections.abc import Mapping, Sequence

import numpy as np

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import Recording
from ortilo_drake.interop.recorded.rejected import frozen_rows
from ortilo_drake.studies.recorded import doubts
from ortilo_drake.studies.recorded.calibrate import Calibration, offset_centres
from ortilo_drake.studies.recorded.first_look import CheapFit
from ortilo_drake.studies.recorded.imu_doubts import (
    attitude_doubts,
    axes_doubts,
    drift_doubts,
    force_doubts,
    rate_doubts,
)
from ortilo_drake.studies.recorded.level_doubts import level_doubts
from ortilo_drake.studies.recorded.readings import as_read, cheap_fit, path_of
from ortilo_drake.studies.recorded.scores import Scores
from ortilo_drake.studies.recorded.setups import height_doubts

CALIBRATED = ("with IMU", "constant velocity")
BARE = ("with IMU, not calibrated (biases online)", "constant velocity, not calibrated")


def doubts_of(
    recording: Recording,
    map_: Map,
    look: CheapFit,
    calibration: Calibration | None,
    rows: Mapping[str, Scores],
    found: tuple[np.ndarray, np.ndarray | None],
    heading: Sequence[str] = (),
) -> list[str]:
    """Return the doubts about a replay, a sentence each.

    Args:
        recording: the motion.
        map_: the map by which it was read.
        look: the result of the cheap fits.
        calibration: by the truth, None without a truth.
        rows: scores by the row's name.
        found: estimates in the anchors' frame (m, 3), and the truth at their stamps, if known.
        heading: doubts about the heading, returned if there is no other doubt.
    """
    truth, imu, settings = recording.truth, recording.imu, map_.calibration
    if said := stamp_doubts(recording, map_):
        return said  # nothing else means anything then
    said += doubts.of_cover(recording.ranges, imu) if imu is not None else []
    said += doubts.of_stuck(recording.ranges) + doubts.of_guess(look.guess)
    noise = doubts.range_noise(map_.filter, imu is not None)
    if truth is None and look.fit is not None and look.guess is None:
        said += doubts.of_agreement(look.fit.left, noise)
    frozen: list[tuple[float, float]] = []
    moving = recording
    if truth is not None and calibration is not None:
        up = truth.p[0, 2] + (-np.inf if map_.airborne is None else map_.airborne)  # on the floor it may rest
        found_frozen = doubts.freezes(truth, recording.ranges, calibration.offset)
        frozen = [one for one in found_frozen if truth.p[np.searchsorted(truth.t, one[0]), 2] > up]
        kept = ~frozen_rows(truth.t, truth.p, doubts.FROZEN)
        if frozen:
            moving = recording._replace(truth=truth.only(kept))
            said += doubts.of_freezes(frozen, look.fit.left if look.fit else None, _left(moving, map_, calibration))
    if imu is not None:
        said += force_doubts(imu, map_) + level_doubts(imu, map_)
        if calibration is None:
            said += rate_doubts(imu, map_)
        else:
            # A frame that does not fit tells nothing about up; a wrong clock tells nothing about turns.
            up_T = calibration.F.T[:, 2] if look.fit is not None and not said else None
            if look.guess is None or "clock" not in look.guess.key:
                told = [] if up_T is None else axes_doubts(moving, map_, calibration.offset)
                said += told or attitude_doubts(moving, map_, calibration.offset, up_T)
                said += [] if said else drift_doubts(moving, map_, calibration.offset)
    if calibration is not None and truth is not None:
        lever = calibration.lever if settings.lever == "estimate" else None
        said += doubts.of_calibration(calibration.left, noise, lever, calibration.biases)
        centres = offset_centres(recording, settings.search)
        said += doubts.of_offset(calibration.offset, centres, settings.search, calibration.told_by)
        said += height_doubts(map_, calibration, recording)
    main = [name for name in (BARE if calibration is None else CALIBRATED) if name in rows][:1]
    said += doubts.of_rows(rows, tuple(main))
    if not said:
        said += list(heading) or doubts.of_imu(rows, *(BARE if calibration is None else CALIBRATED))
    if not isinstance(recording.anchors, int) and map_.height is None:
        heard = np.union1d(recording.ranges.anchor, recording.ranges.other[recording.ranges.other >= 0])
        said += doubts.of_plane(np.asarray(recording.anchors)[heard], *found, map_.planar)
    return said


def stamp_doubts(recording: Recording, map_: Map) -> list[str]:
    """Return a doubt about the unit of the ranges' stamps."""
    unit = next(source.unit for source in (map_.ranges, map_.differences) if source is not None)
    return doubts.of_stamps(recording.ranges, unit)


def _left(recording: Recording, map_: Map, calibration: Calibration) -> float | None:
    """Return the RMS residual of a cheap fit to a motion at the calibrated clock offset [m]; None without a fit."""
    if isinstance(recording.anchors, int):
        return None
    now = as_read(recording, map_)
    fit = cheap_fit(now, path_of(now), np.array([calibration.offset]))
    return None if fit is None else fit.left
