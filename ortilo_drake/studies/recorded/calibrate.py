"""Calibration by the truth of a first part: clock, frame, biases of the ranges, lever of the antenna, and anchors.

With the truth p_k, R_k at the ranges' stamps, and F and s the turn and shift between the frames, it minimises

    Σ rho((|F (p_k + R_k l) + s - a_i| + c_i - r_ki) / 0.06 m) + |l|² / (0.1 m)² + Σ c_i² / (0.2 m)²,   rho = soft L1

over F, s, the biases c and the lever l, over the clock's offset unless the body rates or the map tell it, and over the
anchors a_i if they are to be found. A known antenna height adds the square (mean z - height)² / sd². Differences
r_b - r_a do not tell the sum of the biases, which is held at 0.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import OptimizeResult, least_squares
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.map_file import Estimated
from ortilo_drake.interop.recorded.recording import ONE_TAG, Ranges, Recording
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.recorded.clock_offset import TELLS, ByRates, best_by_rates
from ortilo_drake.studies.recorded.filter_types import UNKNOWN_LEVEL, Level
from ortilo_drake.studies.recorded.plain_fit import left_of
from ortilo_drake.studies.recorded.truth_path import (
    LEAST,
    TruthPath,
    antennas,
    covered_ranges,
    far_away,
    first_part,
    modelled,
    random_sample,
    truth_path,
)

SPREAD, LEVER, BIAS = 0.06, 0.1, 0.2  # standard deviations of a range, a lever and a bias [m]
COARSE = 0.25  # step between the offsets tried as starts where the ranges tell the clock [s]
FEW = 400  # ranges used to judge a start
MANY = 40_000  # ranges used in a fit, at most
SURE = 1e-4  # standard deviation of the biases' sum, held at 0 because differences do not tell it [m]
KEPT = 0.99  # share of the errors, smallest first, that counts in `left`
FLAT = 0.5  # anchors whose heights differ by less do not tell above from below [m]


class Calibration(NamedTuple):
    """The relation between truth and sensors: clock, frame, lever, anchors and the biases of their ranges.

    offset: truth's clock less the sensors' [s], each from its own first stamp; told_by: `rates`, `ranges` or `map`;
    F (3, 3), shift (3): p in the anchors' frame = F p_truth + shift; mount (3, 3): turn from the IMU's body axes to the
    truth's, None if the body rates do not tell it;
    lever (3): to the antenna, IMU's body axes [m]; biases (n) [m]; anchors (n, 3) [m]; end: the last stamp of the first
    part by the truth's clock [s]; left: RMS of the ranges' errors after the fit, without the largest 1 % [m].
    """

    offset: float
    told_by: str
    F: np.ndarray
    shift: np.ndarray
    mount: np.ndarray | None
    lever: np.ndarray
    biases: np.ndarray
    anchors: np.ndarray
    end: float
    left: float

    def position(self, p: np.ndarray) -> np.ndarray:
        """Return the truth's positions (m, 3) in the anchors' frame."""
        return p @ self.F.T + self.shift


class _Fit(NamedTuple):
    """The choice of the free unknowns, and their places in the vector of unknowns; tags in the truth's body axes."""

    kind: str
    offset: bool
    lever: bool
    find: bool
    n: int
    level: Level = UNKNOWN_LEVEL
    tags: np.ndarray = ONE_TAG

    def parts(self, x: np.ndarray) -> tuple[float, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return offset, F, shift, biases, lever and found anchors from a vector of unknowns."""
        turned = np.array([0.0, 0.0, x[3]]) if self.kind == "yaw" else x[1:4]
        found = x[10 + self.n :].reshape(-1, 3)
        return x[0], Rotation.from_rotvec(turned).as_matrix(), x[4:7], x[10 : 10 + self.n], x[7:10], found

    def free(self) -> np.ndarray:
        """Return a mask of the unknowns that are estimated."""
        frame = {"yaw": [False, False, True], "se3": [True] * 3, "same": [False] * 3}[self.kind]
        shift = [self.kind != "same"] * 3
        found = [True] * 3 * self.n if self.find else []
        return np.array([self.offset, *frame, *shift, *[self.lever] * 3, *[True] * self.n, *found])


def _solve(x: np.ndarray, fit: _Fit, ranges: Ranges, chosen: np.ndarray, path: TruthPath, anchors: np.ndarray) -> tuple:
    seen = ranges.only(chosen)
    t, differ = seen.t, bool((ranges.other >= 0).all())
    free = fit.free()
    fixed = None if fit.offset else path.at(t + x[0])

    def parts(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the ranges' errors [m], and the residuals of the prior knowledge [standard deviations]."""
        full = x.copy()
        full[free] = y
        offset, F, shift, biases, lever, found = fit.parts(full)
        p, R = path.at(t + offset) if fixed is None else fixed
        p = antennas(p, R, lever, fit.tags, seen.tag) @ F.T + shift
        z = float(p[:, 2].mean())
        height = [(z - fit.level.height) / fit.level.deviation] * bool(fit.level.deviation < np.inf)
        total = [biases.sum() / SURE] * differ
        e = modelled(p, found if fit.find else anchors, biases, seen) - seen.r
        return e, np.concatenate([lever / LEVER, biases / BIAS, height, total])

    def residuals(y: np.ndarray) -> np.ndarray:
        e, others = parts(y)
        return np.concatenate([e / SPREAD, others])

    solved = least_squares(residuals, x[free], loss="soft_l1")
    full = x.copy()
    full[free] = solved.x
    return full, float(solved.cost), parts(solved.x)[0]


def found_roughly(p: np.ndarray, r: np.ndarray) -> OptimizeResult:
    """Return the best of eight fits of an anchor's position x (3) to its ranges r (m) from places p (m, 3)."""
    middle, far = p.mean(axis=0), np.median(r)
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-0.3, 0.3)])
    fits = [
        least_squares(
            lambda a: np.linalg.norm(p - a, axis=1) - r, middle + far * 0.7 * s, loss="soft_l1", f_scale=SPREAD
        )
        for s in signs
    ]
    return min(fits, key=lambda found: found.cost)


def offset_centres(recording: Recording, search: float) -> list[float]:
    """Return the clock offsets to search around [s]: 0 (both files begin together), and the offset of one common clock.

    The second is left out if the search around 0 reaches it, or if truth and ranges do not overlap by it.
    """
    truth, ranges = recording.truth, recording.ranges
    assert truth is not None
    one_clock = recording.origin - recording.truth_origin
    meet = min(truth.t[-1], ranges.t[-1] + one_clock) - max(truth.t[0], ranges.t[0] + one_clock)
    return [0.0, one_clock] if abs(one_clock) > search and meet > search else [0.0]


def clock_by_rates(recording: Recording, settings: Estimated, known: float | None) -> ByRates | None:
    """Return the clock's offset and the mount by the body rates, or only the mount if the offset is known [s].

    None without imu or attitudes, where the body hardly turned, and where the rates do not explain its turns.
    """
    imu, truth = recording.imu, recording.truth
    if imu is None or truth is None or truth.R is None:
        return None

    def part(offset: float) -> tuple[float, float]:
        return first_part(truth, recording.ranges, settings.share, offset)

    found = best_by_rates(imu, truth, part, settings.search, known, offset_centres(recording, settings.search))
    return found if found.left < TELLS else None


def _uncalibrated(recording: Recording, settings: Estimated, lever: bool, airborne: float | None) -> Calibration:
    """Return the map's own values as a calibration: nothing is estimated, the truth only judges.

    `left` counts only ranges at least `airborne` [m] above the truth's first height: on a floor ranges may be wrong.
    """
    truth, ranges, anchors = recording.truth, recording.ranges, np.asarray(recording.anchors)
    assert truth is not None
    assert isinstance(settings.clock, float | int)
    assert isinstance(settings.lever, tuple)
    offset, arm = float(settings.clock) - recording.truth_origin + recording.origin, np.array(settings.lever) * lever
    path = truth_path(truth)
    seen = ranges.only(covered_ranges(ranges, offset, path))
    p, R = path.at(seen.t + offset)
    c = np.zeros(len(anchors))
    p = antennas(p, R, arm, recording.tags * lever, seen.tag)
    errors = modelled(p, anchors, c, seen) - seen.r
    up = p[:, 2] > truth.p[0, 2] + (-np.inf if airborne is None else airborne)
    left = left_of(errors[up] if up.any() else errors, KEPT)
    return Calibration(offset, "map", np.eye(3), np.zeros(3), None, arm, c, anchors, float(truth.t[0]), left)


def calibrate(
    recording: Recording,
    settings: Estimated,
    lever: bool = True,
    near: float | None = None,
    level: Level = UNKNOWN_LEVEL,
    airborne: float | None = None,
) -> Calibration:
    """Return the calibration by the first part of a motion; with `settings.share` 0 the map's own values.

    Args:
        recording: a motion with truth.
        settings: what to estimate.
        lever: whether to look for the antenna's lever and to let the body rates tell the clock; False for a filter
            without IMU.
        near: a rough clock offset to start from [s]; None searches.
        level: what is known of the antenna's height in the anchors' frame.
        airborne: with a share of 0, ranges count in `left` only at least so far above the truth's first height [m].

    Raises:
        InputError: if too few ranges fall in the first part, or truth and ranges do not overlap in time.
    """
    if settings.share == 0.0:
        return _uncalibrated(recording, settings, lever, airborne)
    truth, ranges = recording.truth, recording.ranges
    assert truth is not None
    find = isinstance(recording.anchors, int)
    kind = "same" if find else settings.frame
    middle = truth.p.mean(axis=0) if far_away(truth.p) and kind != "same" else np.zeros(3)
    truth = truth._replace(p=truth.p - middle)
    path = truth_path(truth)
    n = recording.anchors if isinstance(recording.anchors, int) else len(recording.anchors)
    shift_of_files = recording.truth_origin - recording.origin
    centres = offset_centres(recording, settings.search)

    def part(offset: float) -> tuple[float, float]:
        return first_part(truth, ranges, settings.share, offset)

    known = None if settings.clock == "estimate" else float(settings.clock) - shift_of_files
    rates = clock_by_rates(recording, settings, known) if lever else None
    given = settings.lever if isinstance(settings.lever, tuple) else None
    frees_lever = lever and rates is not None and given is None
    mount = np.eye(3) if rates is None else rates.mount
    start_lever = mount @ np.array(given if given is not None and lever else (0.0, 0.0, 0.0))
    told_by = "map" if known is not None else "ranges" if rates is None else "rates"
    offset = known if known is not None else 0.0 if rates is None else rates.offset
    fit = _Fit(kind, told_by == "ranges", frees_lever, find, n, level, recording.tags @ mount.T * lever)
    centre = np.zeros(3) if find else np.asarray(recording.anchors).mean(axis=0)
    flat = not find and float(np.ptp(np.asarray(recording.anchors)[:, 2])) < FLAT

    def start(offset: float, yaw: float) -> tuple[np.ndarray, np.ndarray]:
        chosen = covered_ranges(ranges, offset, path, part(offset)[1])
        if len(chosen) < LEAST:
            return np.zeros(0), chosen
        p = path.at(ranges.t[chosen] + offset)[0]
        turned = Rotation.from_rotvec([0.0, 0.0, yaw]).as_matrix() @ p.mean(axis=0)
        shift = np.zeros(3) if kind == "same" else centre - turned
        if level.deviation < np.inf and kind != "same":
            shift[2] = level.height - turned[2]
        elif flat and kind != "same":
            shift[2] = middle[2]  # of two mirror images, start at the one where both frames share their floor
        found = np.zeros(0)
        if find:
            few = [np.flatnonzero(ranges.anchor[chosen] == i) for i in range(n)]
            if min(map(len, few)) < LEAST:
                raise InputError(
                    f"{recording.name}: an anchor to be found has fewer than {LEAST} ranges in the first part"
                )
            few = [part[:: max(1, len(part) // 100)] for part in few]
            found = np.concatenate([found_roughly(p[part], ranges.r[chosen[part]]).x for part in few])
        x = np.concatenate([[offset, 0.0, 0.0, yaw], shift, start_lever, np.zeros(n), found])
        return x, chosen

    offsets = np.array([offset])
    if fit.offset:
        grid = np.arange(-settings.search, settings.search + COARSE, COARSE)
        offsets = np.concatenate([centre + grid for centre in centres]) if near is None else np.array([near])
    yaws = (0.0,) if kind == "same" else (0.0, np.pi / 2, np.pi, -np.pi / 2)
    best: tuple[float, np.ndarray] | None = None
    held = fit._replace(offset=False, lever=False)
    for tried in offsets:
        for yaw in yaws:
            x, chosen = start(float(tried), yaw)
            if len(x):
                few = random_sample(chosen, FEW)
                x, cost, _ = _solve(x, held, ranges, few, path, np.asarray(recording.anchors))
                cost /= len(few)
                if best is None or cost < best[0]:
                    best = cost, x
    if best is None:
        raise InputError(
            f"{recording.name}: fewer than {LEAST} ranges in the first {settings.share:.0%} of the truth; "
            "a larger calibration.share takes more of it"
        )
    x = best[1]
    chosen = random_sample(covered_ranges(ranges, x[0], path, part(x[0])[1]), MANY)
    x, _, errors = _solve(x, fit, ranges, chosen, path, np.asarray(recording.anchors))
    offset, F, shift, biases, lever_T, found = fit.parts(x)
    anchors = found if find else np.asarray(recording.anchors)
    left = left_of(errors, KEPT)
    told_mount, shift = None if rates is None else mount, shift - F @ middle
    return Calibration(offset, told_by, F, shift, told_mount, mount.T @ lever_T, biases, anchors, part(offset)[1], left)
