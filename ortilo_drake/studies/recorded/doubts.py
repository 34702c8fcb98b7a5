"""Doubts about a replay, in sentences: each says what is odd and, if possible, which key of the map mends it.

These are pure functions of numbers; readings.py and imu_doubts.py try other readings of the files.
"""

from collections.abc import Mapping

import numpy as np

from ortilo_drake.interop.recorded.columns import UNITS
from ortilo_drake.interop.recorded.map_file import FilterSettings
from ortilo_drake.interop.recorded.recording import Imu, Ranges, Truth
from ortilo_drake.interop.recorded.rejected import frozen_rows
from ortilo_drake.interop.recorded.units import size_of
from ortilo_drake.studies.recorded.readings import Guess
from ortilo_drake.studies.recorded.scores import Scores

TIMES = 3.0  # a larger residual is doubtful [standard deviations of a range]
LARGE = 0.5  # a larger lever or bias is doubtful [m]
EDGE = 0.3  # an offset so near to the end of its search is doubtful [s]
REFUSED = 0.2  # a larger share of refused ranges is doubtful
WORSE, NIS = 1.5, 1.6  # larger errors than so many times those without imu, or a larger mean NIS: the imu is misread
# Without a truth: an imu read wrongly predicts the ranges at least 12 % worse than no imu, one read rightly 1 % worse.
PREDICTS, AGREES, OUT = 1.05, 1.2, 0.01  # ratio of innovations with and without imu; NIS and refused share without
CLAIMED = 6.0  # mean NEES of errors 1.4 times as large as the filter claims
TUNE = "`ortilo tune FOLDER --map MAP.yaml --out TUNED.yaml`"
OFF_PLANE = 0.3  # anchors nearer to one plane than this (RMS) leave a mirror image [m]
FROZEN = 0.5  # a position that stands still for longer may be frozen [s]
JUMP, STEPS = 0.05, 5.0  # it was frozen if it then jumps by more than so far [m] and so many usual steps
OFTEN = (3e-4, 5.0)  # the time between two ranges of an anchor lies between these [s]
UNIT_KEYS = {f"{{unit: {unit}}}": size for unit, size in UNITS.items()} | {"{unit: 86400} (days)": 86400.0}
ALIKE, STUCK = 5, 0.05  # steps of equal ranges that count as stuck, at least; share of the time from which it is told
COVERED, MISSED = 0.9, 1.0  # least share of the ranges that imu samples cover; so much may miss at either end [s]
MOVED = 0.3  # ranges that change by more show that the body moved [m]


def range_noise(settings: FilterSettings, imu: bool) -> float:
    """Return the standard deviation of a range that the filter assumes [m]."""
    return float(np.hypot(settings.range_white, settings.range_correlated)) if imu else settings.baseline_range


def of_calibration(left: float, noise: float, lever: np.ndarray | None, biases: np.ndarray) -> list[str]:
    """Return the doubts about a calibration, a sentence each.

    left: RMS of the ranges' errors after the calibration [m]; noise: a range's standard deviation [m]; lever: the
    antenna's (3) [m], None if it was not estimated; biases: of the ranges (n) [m].
    """
    found = []
    if left > TIMES * noise:
        found.append(
            f"the ranges do not fit the truth: {left:.3g} m RMS are left after the calibration, {left / noise:.0f} "
            f"times the range noise ({noise:.3f} m)"
        )
    if lever is not None and np.linalg.norm(lever) > LARGE:
        found.append(f"the antenna was found {np.linalg.norm(lever):.2f} m from the truth's point: is that so?")
    large = np.flatnonzero(np.abs(biases) > LARGE)
    if len(large):
        told = ", ".join(f"{biases[i]:+.2f} m (anchor {i + 1})" for i in large)
        found.append(f"biases of more than {LARGE:g} m: {told}")
    return found


def of_agreement(left: float, noise: float) -> list[str]:
    """Return a doubt if ranges of the same time fit no place: RMS error left [m], beside the noise of a range [m]."""
    if left <= TIMES * noise:
        return []
    return [
        f"the ranges of one time fit no place: {left:.3g} m RMS are left, {left / noise:.0f} times the range noise "
        f"({noise:.3f} m): anchors, units, biases?"
    ]


def of_stamps(ranges: Ranges, unit: str | float) -> list[str]:
    """Return a doubt if the anchors are heard so seldom or so often that the unit of the stamps must be wrong."""
    steps = [np.diff(np.unique(ranges.t[ranges.anchor == i])) for i in np.unique(ranges.anchor)]
    step = float(np.median(np.concatenate(steps))) if any(map(len, steps)) else 1.0
    for key, size in UNIT_KEYS.items():
        then = step * size / size_of(unit, UNITS)
        if not OFTEN[0] < step < OFTEN[1] and OFTEN[0] < then < OFTEN[1]:
            return [
                f"an anchor is heard every {step:.3g} s: ranges: {key} would make it {then:.3g} s; the "
                "other files' stamps likewise?"
            ]
    return []


def of_stuck(ranges: Ranges) -> list[str]:
    """Return a doubt if an anchor's ranges keep one value for long while other ranges change, or if they then jump."""
    stuck: dict[int, float] = {}
    single = ranges.other < 0
    for i in np.unique(ranges.anchor[single]):
        its = single & (ranges.anchor == i)
        t, r = ranges.t[its], ranges.r[its]
        begins = np.flatnonzero(np.concatenate(([True], np.diff(r) != 0.0)))
        ends = np.append(begins[1:], len(r)) - 1
        long = (ends - begins >= ALIKE) & (t[ends] - t[begins] > FROZEN)
        for first, last in zip(begins[long], ends[long], strict=True):
            then = single & (ranges.t >= t[first]) & (ranges.t <= t[last])
            others = [ranges.r[then & (ranges.anchor == j)] for j in np.unique(ranges.anchor[then])]
            jumps = last + 1 < len(r) and abs(r[last + 1] - r[last]) > MOVED
            if jumps or max(map(np.ptp, others)) > MOVED:
                stuck[int(i)] = stuck.get(int(i), 0.0) + float(t[last] - t[first])
    least = STUCK * float(np.ptp(ranges.t))
    told = ", ".join(f"anchor {i + 1} for {long:.1f} s" for i, long in stuck.items() if long > least)
    said = f"ranges that keep one value while others change or it then jumps: {told}: last values repeated?"
    return [said] if told else []


def of_cover(ranges: Ranges, imu: Imu) -> list[str]:
    """Return a doubt if the imu's stamps cover only a part of the ranges' stamps."""
    covered = float(np.mean((ranges.t >= imu.t[0] - MISSED) & (ranges.t <= imu.t[-1] + MISSED)))
    if covered > COVERED:
        return []
    return [
        f"imu: its stamps, {imu.t[0]:.4g} to {imu.t[-1]:.4g} s after the first range, cover {covered:.0%} of the "
        "ranges: another clock? imu: {late: SECONDS} takes what it is late off"
    ]


def of_failed(failed: tuple[float, ...], drag: tuple[float, float]) -> list[str]:
    """Return sentences on drag's k and its sd, and on the accelerometer's x and y, which failed at [s], inf if not."""
    k, sd = drag
    found = [f"drag: its k at the end is {k:.3f} 1/s, standard deviation {sd:.3f}"] if sd > 0.0 else []
    return found + [
        f"imu: the accelerometer's {axis} contradicts drag and is not used from {since:.1f} s on: drag takes its place"
        for axis, since in zip("xy", failed, strict=True)
        if np.isfinite(since)
    ]


def of_guess(guess: Guess | None) -> list[str]:
    """Return a sentence on the reading of the files that fits better, if there is one."""
    if guess is None:
        return []
    return [f"{guess.key} would fit better: {guess.of} errors {guess.before:.3g} m RMS -> {guess.after:.3f} m"]


def of_offset(offset: float, centres: list[float], search: float, told_by: str) -> list[str]:
    """Return a doubt if a clock offset lies at the end of its search; both count from the files' first stamps [s]."""
    if told_by == "map":
        return []
    inside = search - min(abs(offset - centre) for centre in centres)
    if inside > min(EDGE, search / 4.0):
        return []
    return [
        f"the clock's offset lies at the end of its search: calibration: {{search: {2 * search:g}}} looks farther, "
        "{clock: SECONDS} gives it"
    ]


def of_rows(rows: Mapping[str, Scores], main: tuple[str, ...]) -> list[str]:
    """Return doubts about the main rows: the filter was lost or refused many ranges."""
    found = []
    for name in main:
        if name in rows and not np.isfinite(rows[name].nis):
            found.append(f"{name}: the filter is lost: no range was taken in the judged part")
        elif name in rows and rows[name].rejected > REFUSED:
            found.append(f"{name}: {rows[name].rejected:.0%} of the ranges were refused")
    return found


def of_imu(rows: Mapping[str, Scores], name: str, bare: str) -> list[str]:
    """Return a doubt if the filter with IMU (row `name`) does worse than it expects, or than the row `bare` without."""
    if name not in rows:
        return []
    said, s = "axes, signs, units or clock of the imu", rows[name]
    without = None if bare not in rows else rows[bare].rmse
    if s.rmse is not None and without is not None:
        error, other = float(np.linalg.norm(s.rmse)), float(np.linalg.norm(without))
        if error > WORSE * other:
            return [f"{name}: {error:.2f} m RMS, without it {other:.2f} m: {said}?"]
    if s.nis > NIS and not of_noise(rows, name, bare):
        return [
            f"{name}: its innovations are larger than it expects, NIS is {s.nis:.1f}, not 1: {said}? If "
            f"they are right, the noise, which {TUNE} fits"
        ]
    return []


def of_noise(rows: Mapping[str, Scores], name: str, bare: str) -> list[str]:
    """Return a sentence if only the filter's noise does not fit: the imu helps, and errors are about as claimed.

    Without a truth: the filter without imu agrees with ranges and anchors, and the imu predicts the ranges as well.
    """
    if name not in rows or bare not in rows or not rows[name].nis > NIS:
        return []
    s, without = rows[name], rows[bare]
    if s.rmse is None or s.nees is None or without.rmse is None:
        if s.innovation is None or without.innovation is None or s.innovation > PREDICTS * without.innovation:
            return []
        if not without.nis < AGREES or without.rejected > OUT:
            return []
    elif np.linalg.norm(s.rmse) >= np.linalg.norm(without.rmse) or s.nees > CLAIMED:
        return []
    return [f"{name}: NIS is {s.nis:.1f}, not 1: the noise under `filter` is too small, and {TUNE} fits it"]


def of_plane(anchors: np.ndarray, p: np.ndarray, truth: np.ndarray | None, planar: bool = False) -> list[str]:
    """Return a doubt if the anchors lie in a plane, so that the position has a mirror image.

    Args:
        anchors: positions (n, 3).
        p: estimates in the anchors' frame (m, 3).
        truth: true positions at the same stamps, if known.
        planar: whether the vehicle keeps one height: a path in the anchors' plane is then its own mirror image.
    """
    middle = anchors.mean(axis=0)
    _, sizes, axes = np.linalg.svd(anchors - middle)
    off, normal = float(sizes[-1]) / np.sqrt(len(anchors)) if len(sizes) > 2 else 0.0, axes[-1]
    if off >= OFF_PLANE:
        return []
    mirrored = p - 2.0 * np.outer((p - middle) @ normal, normal)
    here, there = np.median(p, axis=0), np.median(mirrored, axis=0)
    if np.linalg.norm(here - there) < OFF_PLANE:
        told = f"the anchors stand {off:.2f} m RMS off one plane, and the vehicle in it: ranges hardly tell its height"
        return [] if planar else [f"{told}; give `planar: true`, or `height` (the antenna's z)"]
    said = (
        f"the anchors stand {off:.2f} m RMS off one plane: the place ({_point(here)}) and its mirror image "
        f"({_point(there)}) have the same ranges; give `height` (the antenna's z), or calibration: {{frame: same}} if "
        "the truth's frame is the anchors'"
    )
    if truth is not None:
        error, other = (float(np.sqrt(np.mean(np.sum((q - truth) ** 2, axis=1)))) for q in (p, mirrored))
        if other < error / 2.0:
            said += f"; the filter is in the mirror image: {error:.2f} m RMS from the truth, mirrored {other:.2f} m"
    return [said]


def _point(p: np.ndarray) -> str:
    return ", ".join(f"{v:.1f}" for v in p)


def freezes(truth: Truth, ranges: Ranges, offset: float) -> list[tuple[float, float]]:
    """Return the intervals in which the truth's position froze, (begin, end) by the truth's clock [s].

    A body at rest repeats its position too: the truth froze only if it then jumps, or if the ranges change meanwhile.
    """
    rows = frozen_rows(truth.t, truth.p, FROZEN)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], rows, [False])).astype(int)))
    steps = np.linalg.norm(np.diff(truth.p, axis=0), axis=1)
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    found = []
    for first, end in edges.reshape(-1, 2):
        jumped = end < len(truth.t) and steps[end - 1] > max(JUMP, STEPS * usual)
        begin, last = float(truth.t[first - 1]), float(truth.t[end - 1])
        if jumped or _changed(ranges, begin - offset, last - offset):
            found.append((begin, last))
    return found


def _changed(ranges: Ranges, begin: float, end: float) -> bool:
    """Return whether the ranges to at least two anchors change between two stamps [s]."""
    third = (end - begin) / 3.0
    changes = 0
    for i in np.unique(ranges.anchor):
        t, r = ranges.t[ranges.anchor == i], ranges.r[ranges.anchor == i]
        before, after = (r[(t >= a) & (t <= a + third)] for a in (begin, end - third))
        if len(before) and len(after):
            changes += abs(float(np.median(after) - np.median(before))) > MOVED
    return changes >= 2


def of_freezes(found: list[tuple[float, float]], before: float | None = None, after: float | None = None) -> list[str]:
    """Return a sentence on frozen rows, the key that drops them, and the range errors `before` and `after` that [m]."""
    if not found:
        return []
    begin, end = max(found, key=lambda one: one[1] - one[0])
    total = sum(end - begin for begin, end in found)
    better = "" if before is None or after is None else f": range errors {before:.3g} m RMS -> {after:.3f} m"
    return [
        f"truth: its position freezes {len(found)} times, {total:.1f} s in all, the longest {end - begin:.1f} s at "
        f"{begin:.1f} s: truth: {{drop_frozen: {FROZEN:g}}} drops these rows{better}"
    ]
