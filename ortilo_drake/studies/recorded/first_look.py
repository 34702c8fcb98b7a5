"""A look at a recording before its calibration: does the map's reading fit at all, and does another fit better?

Without a truth, the constant-velocity filter over the whole recording tells whether an anchor is elsewhere. The cheap
fit of short times (lone_fit.py) absorbs most of a misplaced anchor as another place of the body, so its residual looks
small. A filter has one path: with the anchor's right place, and a bias for each anchor in both runs, all innovations
shrink. In real rooms errors that depend on the place shrink too, by some 4 %: a smaller gain is not told.
"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import Recording, Truth
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.recorded.calibrate import clock_by_rates, offset_centres
from ortilo_drake.studies.recorded.clock_offset import gains_by_rates
from ortilo_drake.studies.recorded.doubts import NIS, range_noise
from ortilo_drake.studies.recorded.filter_types import FilterSetup, noise_of
from ortilo_drake.studies.recorded.filtered import estimate
from ortilo_drake.studies.recorded.freed import Move, feet_or_nanoseconds, freed_guess, moves_of
from ortilo_drake.studies.recorded.moved_anchors import (
    CLEARLY,
    exchanged_order,
    matched_order,
    moved_anchor,
    worst_anchor,
)
from ortilo_drake.studies.recorded.plain_fit import PlainFit, left_of
from ortilo_drake.studies.recorded.readings import (
    NEAR,
    UNITS,
    Guess,
    Trial,
    as_read,
    better_reading,
    cheap_fit,
    path_of,
    scale_key,
)
from ortilo_drake.studies.recorded.setups import given_level
from ortilo_drake.studies.recorded.truth_path import LEAST

SHRINKS = 0.92  # largest ratio of the mean NIS after to before at which a move is told
BEST = 2  # moves tried, those that gain most
SETTLED = 3.0  # the first seconds do not count: they judge the start [s]


def moved_by_filter(recording: Recording, trial: Trial, map_: Map) -> Guess | None:
    """Return the anchor's place with which the constant-velocity filter predicts all ranges clearly better.

    Args:
        recording: a recording without a truth.
        trial: the setup of the cheap fits.
        map_: the map of the recording.
    """
    tried = [(one.key, *_innovations(recording, map_, one)) for one in moves_of(trial, map_, BEST)]
    good = [(key, left) for key, after, left in tried[1:] if after <= min(SHRINKS * tried[0][1], NIS)]
    if not good:
        return None
    key = " or ".join(key.removeprefix("anchors: ").removesuffix(",") for key, _ in good)
    return Guess(f"anchors: {key},", tried[0][2], good[0][1], "the constant-velocity filter's range")


def _innovations(recording: Recording, map_: Map, by: Move) -> tuple[float, float]:
    """Return the mean NIS, each range bounded by the gate's, and the RMS of the innovations [m]."""
    ranges, settings = recording.ranges, map_.filter
    known = FilterSetup(by.anchors, by.biases, np.zeros(3), None, given_level(map_), tags=recording.tags)
    found = estimate(ranges, None, known, settings, ranges.t[-1:])
    settled = found.range_stamps > ranges.t[0] + SETTLED
    e, variance = found.run.innovation[settled], found.run.variance[settled]
    if not len(e):
        return float("inf"), float("inf")
    return float(np.mean(np.minimum(e**2 / variance, noise_of(settings, False).gate ** 2))), left_of(e)


SUSPECT = 1.5  # other readings are tried if the residual exceeds so many standard deviations of a range
COARSE = 1.0  # step between clock offsets tried where nothing tells the offset [s]
LEAST_MISFIT = 1.0  # errors larger than this and than the motion itself leave nothing to calibrate [m]
ROOM = 1.0  # least size of the anchors' room [m]
STILL = 0.1  # a truth smaller than this stands still [m]
OUTDOORS = 100.0  # a range larger than any room [m]
FITS = 0.05  # largest residual as a share of the ranges: scaled down, any reading has a small residual in metres
SCALED = ("ranges", "differences", "truth")
FAR = 10.0  # ranges are in metres if their median is less than so many sizes of the anchors' room


class CheapFit(NamedTuple):
    """The cheap fit of the map's reading, and a reading that is clearly better; None without anchors or enough ranges.

    Without a truth the ranges are fitted to one another.
    """

    fit: PlainFit | None
    guess: Guess | None


def first_look(recording: Recording, map_: Map) -> CheapFit:
    """Fit clock and frame of the truth cheaply, or the ranges to one another, before the filter runs.

    Raises:
        InputError: if ranges, anchors and truth differ in size so much that no fit is possible.
    """
    anchors, ranges = recording.anchors, recording.ranges
    if isinstance(anchors, int):
        return CheapFit(None, None)
    r, room = np.abs(ranges.r), float(np.linalg.norm(np.ptp(anchors, axis=0)))
    said = f"{recording.name}: ranges of {np.quantile(r, 0.02):.3g} to {np.quantile(r, 0.98):.3g} m"
    said += f" for anchors {room:.3g} m apart"
    far = float(np.median(r)) > FAR * room
    now, noise = as_read(recording, map_), range_noise(map_.filter, recording.imu is not None)
    offsets, moves = (np.zeros(1), False) if recording.truth is None else _offsets(recording, map_)
    now = now._replace(truth=_airborne(now.truth, map_))
    path = path_of(now)
    fit = None if far and path is None else cheap_fit(now, path, offsets, moves=moves)
    noise *= np.sqrt(2.0) if (ranges.other >= 0).all() else 1.0  # a difference has the errors of two ranges
    if fit is None:
        if far:
            raise InputError(f"{said}: {_unit(float(np.median(r)), room, map_)}")
        return CheapFit(None, None)
    better = None
    trial = Trial(now, fit, offsets, moves, noise, recording.origin - recording.truth_origin)
    if fit.left > SUSPECT * noise:
        better = _all_small(trial, map_) or better_reading(trial, map_)
        better = better and feet_or_nanoseconds(trial, map_, better)
        better = better or matched_order(trial, map_)
    if moves:  # one or two anchors hardly hide the clock
        trial = trial._replace(offsets=fit.offset + np.array([-COARSE, 0.0, COARSE]))
    if fit.left > SUSPECT * noise:
        better = better or freed_guess(trial, map_, _gained(recording, offsets))
        better = better or moved_anchor(trial, map_) or exchanged_order(trial, map_)
    else:
        better = exchanged_order(trial, map_, 1, CLEARLY) if worst_anchor(fit, anchors) > noise else None
        better = better or freed_guess(trial, map_, _gained(recording, offsets))
    if recording.truth is None:
        return CheapFit(fit, better or moved_by_filter(recording, trial, map_))
    size = float(np.linalg.norm(np.ptp(np.percentile(recording.truth.p, [2, 98], axis=0), axis=0)))
    if far or fit.left > max(size, LEAST_MISFIT) or size > FAR * room:
        constant = 2.0 * room < r.min() and np.ptp(np.quantile(r, [0.02, 0.98])) < 1.5 * room
        hint = _unit(float(np.median(r)), room, map_) if far else "ranges, anchors and truth must all be in metres"
        if not far and size < STILL:
            hint = "the truth stands still, the ranges change: wrong columns, or was the body lost?"
        if constant:
            hint = f"all ranges have a constant of some {np.median(r) - 0.6 * room:.0f} m: antenna delays?"
        if better is not None:
            hint = f"{better.key} fits: range errors {better.before:.3g} m RMS -> {better.after:.3f} m"
        raise InputError(f"{said} and a truth {size:.3g} m across do not fit together ({fit.left:.3g} m RMS): {hint}")
    return CheapFit(fit, better)


def _gained(recording: Recording, offsets: np.ndarray) -> float | None:
    """Return the gain of the truth's clock on the imu's [s/s]; None if it is not known."""
    return gains_by_rates(recording.imu, recording.truth, float(offsets[0])) if len(offsets) == 1 else None


def _airborne(truth: Truth | None, map_: Map) -> Truth | None:
    """Return the truth from its first to its last stamp in the air: on a floor ranges may be wrong."""
    if truth is None or map_.airborne is None:
        return truth
    up = np.flatnonzero(truth.p[:, 2] > truth.p[0, 2] + map_.airborne)
    return truth if len(up) < LEAST else truth.only(slice(up[0], up[-1] + 1))


def _all_small(trial: Trial, map_: Map) -> Guess | None:
    """Return the guess of one smaller unit (mm or cm) for all lengths, if ranges exceed 100 m and the unit fits."""
    now, middle = trial.now, float(np.median(np.abs(trial.now.ranges.r)))
    for unit in ("mm", "cm"):
        by = UNITS[unit]
        if middle * by < OUTDOORS < middle and by * np.linalg.norm(np.ptp(now.anchors, axis=0)) > ROOM:
            truth = None if now.truth is None else now.truth._replace(p=now.truth.p * by)
            ranges = now.ranges._replace(r=now.ranges.r * by)
            small = now._replace(ranges=ranges, anchors=now.anchors * by, truth=truth)
            fit = trial.fit_of(small, path_of(small))
            if fit is not None and fit.left < min(NEAR * trial.noise, FITS * middle * by):
                keys = [
                    f"{key}: {{scale: {getattr(map_, key).scale * by:.6g}}}" for key in SCALED if getattr(map_, key)
                ]
                said = f"{', '.join(keys)}, anchors: in metres, those of the map times {by:g} ({unit})"
                return Guess(said, trial.fit.left, fit.left)
    return None


def _unit(middle: float, room: float, map_: Map) -> str:
    """Return the question whether the ranges have the unit that brings them nearest to the room's size."""
    unit = min(UNITS, key=lambda one: abs(np.log(middle * UNITS[one] / (0.6 * room))))
    return f"in {unit}? {scale_key(map_, UNITS[unit])} makes them metres"


def _offsets(recording: Recording, map_: Map) -> tuple[np.ndarray, bool]:
    """Return the clock offsets to start from [s], and whether a fit may change them."""
    settings = map_.calibration
    if settings.clock != "estimate":
        return np.array([float(settings.clock) - recording.truth_origin + recording.origin]), False
    rates = clock_by_rates(recording, settings, None)
    if rates is not None:
        return np.array([rates.offset]), False
    centres = offset_centres(recording, settings.search)
    step = min(COARSE, settings.search / 2.0)
    steps = np.arange(-settings.search, settings.search + step / 2.0, step)
    return np.concatenate([centre + steps for centre in centres]), True
