"""Other readings of the same files (units, axes, frames, clocks, anchors), each named by the key that sets it.

A cheap fit tries each reading: to the truth (plain_fit.py), or of the ranges to one another without a truth
(lone_fit.py). A reading is told only if it fits at least twice as well, and about as well as the ranges' noise allows.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import Ranges, Recording, Truth
from ortilo_drake.interop.recorded.units import axes_matrix, axes_names, in_axes
from ortilo_drake.studies.recorded.lone_fit import WINDOWS, lone_fit
from ortilo_drake.studies.recorded.plain_fit import FEW, PlainFit, Reading, plain_fit
from ortilo_drake.studies.recorded.truth_path import TruthPath, truth_path

UNITS = {"mm": 0.001, "cm": 0.01, "in": 0.0254, "ft": 0.3048, "km": 1000.0}
OF_RANGES = {"there and back": 0.5, "ns of flight": 0.299792458, "ticks of 15.65 ps": 0.299792458 / 63.8976}
BACK = {"m, not mm": 1000.0, "m, not cm": 100.0, "m, not ft": 1 / 0.3048}
UPS = {  # our x, y and z, each as an axis of the truth as it is read now
    "y is up": ("x", "-z", "y"),
    "z is down": ("x", "-y", "-z"),
    "y is down": ("x", "z", "-y"),
    "x is up": ("y", "z", "x"),
    "x is down": ("-y", "z", "-x"),
    "left-handed": ("x", "-y", "z"),
    "left-handed, y is up": ("x", "z", "y"),
    "left-handed, z is down": ("x", "y", "-z"),
}
BETTER = 2.0  # a reading is told if its residual is smaller by this factor
NEAR = 3.0  # and at most so many standard deviations of the ranges
SMALL = 0.2  # and at most this share of the ranges: scaled down, any reading has a small residual
ALIKE = 1.2  # of readings within this factor of the least residual, the first and simplest one is told
FAR = 100.0  # largest clock offset tried [s]
LEAST_TIME, MEET = 5.0, 0.4  # least overlap of truth and ranges [s], and as a share of the shorter one
SPREADS = (0.05, 1.2)  # plausible spread of an anchor's ranges, in sizes of the path


class Guess(NamedTuple):
    """The key that mends the map, the RMS of the ranges' errors before and after [m], and the name of these errors."""

    key: str
    before: float
    after: float
    of: str = "range"


def as_read(recording: Recording, map_: Map) -> Reading:
    """Return the map's own reading."""
    frame = map_.calibration.frame
    anchors = np.asarray(recording.anchors)
    return Reading("", recording.ranges, anchors, recording.truth, frame, tags=recording.tags)


def readings(now: Reading, map_: Map) -> Iterator[Reading]:
    """Yield other readings than the map's, the simplest first."""
    yield from _lengths(now, map_)
    if map_.differences is not None:
        turned = now.ranges._replace(r=np.where(now.ranges.other >= 0, -now.ranges.r, now.ranges.r))
        yield now._replace(key=f"differences: {{sign: {-map_.differences.sign}}}", ranges=turned)
    if now.truth is not None and map_.truth is not None:
        yield from _frames(now, now.truth, map_)


def _lengths(now: Reading, map_: Map) -> Iterator[Reading]:
    """Yield readings with other units of length."""

    def heard(by: float) -> tuple[str, Ranges]:
        return scale_key(map_, by), now.ranges._replace(r=now.ranges.r * by)

    for unit, by in {**UNITS, **BACK}.items():
        key, scaled = heard(by)
        yield now._replace(key=f"{key} ({unit})", ranges=scaled)
        if now.truth is None or map_.truth is None:
            continue
        of_truth = now._replace(truth=now.truth._replace(p=now.truth.p * by))
        truth_key = f"truth: {{scale: {map_.truth.scale * by:.6g}}}"
        anchors_key = f"anchors: in metres, those of the map times {by:.6g}"
        yield of_truth._replace(key=f"{truth_key} ({unit})")
        yield now._replace(key=f"{anchors_key} ({unit})", anchors=now.anchors * by)
        yield of_truth._replace(key=f"{truth_key}, {anchors_key} ({unit})", anchors=now.anchors * by)
        yield of_truth._replace(key=f"{key}, {truth_key} ({unit})", ranges=scaled)
        yield now._replace(key=f"{key}, {anchors_key} ({unit})", ranges=scaled, anchors=now.anchors * by)
    for unit, by in OF_RANGES.items():
        key, scaled = heard(by)
        yield now._replace(key=f"{key} ({unit})", ranges=scaled)


def scale_key(map_: Map, by: float, unit: str = "") -> str:
    """Return the keys that make ranges and differences `by` times as long."""
    sources = {key: source for key in ("ranges", "differences") if (source := getattr(map_, key)) is not None}
    keys = ", ".join(f"{key}: {{scale: {source.scale * by:.6g}}}" for key, source in sources.items())
    return f"{keys} ({unit})" if unit else keys


def _frames(now: Reading, truth: Truth, map_: Map) -> Iterator[Reading]:
    """Yield readings with other frames of the truth and of the anchors."""
    assert map_.truth is not None
    own = axes_matrix(map_.truth.axes, "truth.axes", mirrors=True)
    for order in ((1, 0, 2), (0, 2, 1), (2, 1, 0)):
        first, second = ("xyz"[i] for i, j in enumerate(order) if i != j)
        key = f"anchors: {first} and {second} of each change places"
        if order[2] == 2 and now.frame != "same":  # no fit can tell the two readings apart
            left = axes_matrix(UPS["left-handed"], "truth.axes", mirrors=True)
            key += f", or truth: {{axes: {axes_names(left @ own)}}} (left-handed)"
        yield now._replace(key=key, anchors=now.anchors[:, order])
    if now.frame == "same":
        now = now._replace(frame="yaw")
        yield now._replace(key="calibration: {frame: yaw}")
    for what, axes in UPS.items():
        A = axes_matrix(axes, "truth.axes", mirrors=True)
        turned = truth._replace(p=truth.p @ A.T, R=None if truth.R is None else in_axes(truth.R, A))
        names = axes_names(A @ own)
        key = f"truth: {{axes: {names}}}"
        other = "anchors: z of each with the other sign, or " if axes == ("x", "y", "-z") else ""  # the same mirror
        yield now._replace(key=f"{other}{key} ({what})", truth=turned)
        for unit, by in UNITS.items():
            small = turned._replace(p=turned.p * by)
            both = f"truth: {{axes: {names}, scale: {map_.truth.scale * by:.6g}}} ({what}, {unit})"
            yield now._replace(key=both, truth=small)
    if now.frame != "se3":
        yield now._replace(key="calibration: {frame: se3}", frame="se3")


def clocks(trial: "Trial", map_: Map) -> Iterator[Reading]:
    """Yield readings with an estimated clock where the map gives the clock, and with a wider search.

    Where the body rates told the clock, the ranges may have another clock than the imu.
    """
    now, truth, ranges = trial.now, trial.now.truth, trial.now.ranges
    if truth is None:
        return
    longest = min(FAR, max(ranges.t[-1], truth.t[-1]))
    wide = np.arange(-longest, longest + 1.0)
    meet = np.minimum(truth.t[-1], ranges.t[-1] + wide) - np.maximum(0.0, wide)
    wide = wide[meet > max(LEAST_TIME, MEET * min(truth.t[-1], ranges.t[-1]))]
    few = wide[np.abs(wide) <= map_.calibration.search]
    if map_.calibration.clock != "estimate":
        yield now._replace(key="calibration: {clock: estimate}", offsets=few)
    elif map_.imu is not None and not trial.moves:
        yield now._replace(key="imu: {late: LATE}", offsets=wide)
        return
    if len(few) < len(wide):
        yield now._replace(key="calibration: {clock: estimate, search: SEARCH}", offsets=wide)


def cheap_fit(
    reading: Reading,
    path: TruthPath | None,
    offsets: np.ndarray,
    *,
    moves: bool = False,
    near: PlainFit | None = None,
    few: int = FEW,
    windows: int = WINDOWS,
) -> PlainFit | None:
    """Return the fit of a reading to its truth, see plain_fit; without a truth, the fit of its ranges (lone_fit)."""
    if path is None:
        return lone_fit(reading, windows)
    return plain_fit(reading, path, offsets, moves=moves, near=near, few=few)


class Trial(NamedTuple):
    """The setup of the cheap fits of readings.

    now, fit: the map's reading and its fit; offsets: clock offsets to start from [s]; moves: whether the ranges tell
    the clock; noise: standard deviation of a range [m]; one_clock: the offset if the files share one clock [s].
    """

    now: Reading
    fit: PlainFit
    offsets: np.ndarray
    moves: bool
    noise: float
    one_clock: float

    def fit_of(self, reading: Reading, path: TruthPath | None, near: PlainFit | None = None) -> PlainFit | None:
        """Return the cheap fit of a reading; started at the frame of `near` if given."""
        at = self.offsets if reading.offsets is None else reading.offsets
        return cheap_fit(reading, path, at, moves=self.moves or reading.offsets is not None, near=near)

    def is_better(self, fit: PlainFit, reading: Reading, by: float = BETTER) -> bool:
        """Return whether a fit's residual is clearly smaller, in metres and relative to its possibly scaled ranges."""
        size, read = (float(np.median(np.abs(one.ranges.r))) for one in (self.now, reading))
        before, after = self.fit.left / size, fit.left / read
        # a changed sign or order of the anchors scales nothing down
        kept = reading.truth is self.now.truth and read == size and _size(reading.anchors) == _size(self.now.anchors)
        return bool(fit.left <= NEAR * self.noise and (kept or after < SMALL) and by * after <= before)


def better_reading(trial: Trial, map_: Map) -> Guess | None:
    """Return the reading that is clearly better than the map's, if there is one."""
    for tried in (readings(trial.now, map_), clocks(trial, map_)):
        good: list[Guess] = []
        read, path = trial.now.truth, path_of(trial.now)
        for reading in tried:
            if not is_plausible(reading):
                continue
            if reading.truth is not read:
                read, path = reading.truth, path_of(reading)
            fit = trial.fit_of(reading, path)
            if fit is not None and trial.is_better(fit, reading):
                reach = np.ceil(min(abs(fit.offset), abs(fit.offset - trial.one_clock)) + 1.0)
                key = reading.key.replace("SEARCH", f"{reach:g}")
                if map_.imu is not None:
                    key = key.replace("LATE", f"{map_.imu.late + fit.offset - trial.fit.offset:.3f}")
                good.append(Guess(key, trial.fit.left, fit.left))
                if fit.left <= trial.noise:
                    break  # no reading can fit clearly better
        if good:
            least = min(one.after for one in good)
            return next(one for one in good if one.after <= ALIKE * least)
    return None


def path_of(reading: Reading) -> TruthPath | None:
    """Return the path of a reading's truth, if there is a truth."""
    return None if reading.truth is None else truth_path(reading.truth)


def is_plausible(reading: Reading) -> bool:
    """Return whether a reading is plausible: an anchor's ranges change about as much as the body moves.

    Also, the anchors' median ranges differ by no more than the anchors lie apart, and the longest range is long enough.
    """
    single = reading.ranges.other < 0
    r, anchor, room = reading.ranges.r[single], reading.ranges.anchor[single], _size(reading.anchors)
    if not len(r):
        return bool(np.median(np.abs(reading.ranges.r)) < room)
    of_each = [r[anchor == i] for i in np.unique(anchor)]
    spread = max(float(np.ptp(np.percentile(one, [5, 95]))) for one in of_each)
    path = room if reading.truth is None else _size(np.percentile(reading.truth.p, [2, 98], axis=0))
    least = 0.0 if reading.truth is None else SPREADS[0] * path
    middles = [float(np.median(one)) for one in of_each]
    apart = max(middles) - min(middles)
    return least <= spread <= SPREADS[1] * path + 0.5 and apart <= 1.2 * room + 0.5 and r.max() > 0.3 * room


def _size(points: np.ndarray) -> float:
    return float(np.linalg.norm(np.ptp(points, axis=0)))
