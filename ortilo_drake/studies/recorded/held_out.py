"""Tuned noise judged on the parts of recorded motions that it was not fitted to, beside the noise before.

Both noises run over all ranges. What follows the fitted part is cut into batches of at least 2 s, at most 20 for each
motion. A gain is the sum of the batches' differences; its interval is by their spread (Student's t), which counts what
lasts no longer than a batch (batch means: Law, Simulation Modeling and Analysis, section 9.5.3). All intervals hold
together at least as often as LEVEL says: each of n misses in (1 - LEVEL) / n (Bonferroni).
"""

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import numpy as np
from scipy.stats import t as student

from ortilo_drake.interop.recorded.map_file import FilterSettings, Map
from ortilo_drake.interop.recorded.recording import Recording
from ortilo_drake.studies.recorded.at_rest import at_rest
from ortilo_drake.studies.recorded.calibrate import Calibration, calibrate
from ortilo_drake.studies.recorded.filtered import Estimate, FilterSetup, estimate, noise_of
from ortilo_drake.studies.recorded.reacquired import Innovations, innovation_score
from ortilo_drake.studies.recorded.replayed import with_lever
from ortilo_drake.studies.recorded.scores import nees_of, nis_of, rms_by_axis
from ortilo_drake.studies.recorded.setups import (
    calibrated_setup,
    given_level,
    judged_part,
    uncalibrated_setup,
    with_aids,
)
from ortilo_drake.studies.recorded.truth_path import truth_path

BATCH, BATCHES = 2.0, 20  # the least duration of a batch [s], and how many at most
LEVEL = 0.95  # confidence of the gains' intervals together
By = Literal["innovations", "truth"]
Verdict = Literal["better", "the same", "worse", "mixed", "mend first"]


class Gain(NamedTuple):
    """A sum that is better if it is larger: before, after, and half the interval of its gain."""

    before: float
    after: float
    half: float

    @property
    def sign(self) -> int:
        """Return 1 if the gain is above 0 beyond its interval, -1 if it is below, else 0."""
        gain = self.after - self.before
        return int(np.sign(gain)) if abs(gain) > self.half else 0


class HeldOut(NamedTuple):
    """What the part that was not fitted says of the noise before and after.

    Attributes:
        duration: of this part, all motions together [s].
        gains: by what is judged: `innovations` (log-likelihood of the ranges' innovations) and, with a truth, `errors`
            (log-likelihood of the position's errors by the filter's covariance) and `accuracy` (mean square error of
            the position, negative [m²]).
        nis: mean NIS before and after, each motion counting alike.
        nees: mean NEES before and after, None without a truth.
        rmse: RMS error by axis before and after [m], None without a truth.
    """

    duration: float
    gains: dict[str, Gain]
    nis: tuple[float, float]
    nees: tuple[float, float] | None
    rmse: tuple[tuple[float, ...], tuple[float, ...]] | None

    @property
    def verdict(self) -> Verdict:
        """Return what the gains together say; mixed if one is surely above 0 and another surely below."""
        signs = {gain.sign for gain in self.gains.values()}
        if -1 in signs:
            return "mixed" if 1 in signs else "worse"
        return "better" if 1 in signs else "the same"


class Parts(NamedTuple):
    """A motion with the filter's settings for it, its fitted part and the rest.

    Attributes:
        recording: the motion.
        known: the settings of the replay's main row with IMU.
        calibration: by the truth, None without one.
        t: stamps of the estimates, of both parts [s].
        end: where the fitted part ends [s].
        judged: which stamps are of the rest (n) -> (n).
    """

    recording: Recording
    known: FilterSetup
    calibration: Calibration | None
    t: np.ndarray
    end: float
    judged: Callable[[np.ndarray], np.ndarray]


def parts_of(recording: Recording, map_: Map) -> Parts:
    """Return a motion's parts; InputError if hardly anything is left to judge."""
    calibration = None
    if recording.truth is None:
        known = with_lever(uncalibrated_setup(recording, map_, at_rest(recording, map_)), recording, map_, [])
    else:
        level, lever = given_level(map_), recording.imu is not None
        calibration = calibrate(recording, map_.calibration, lever=lever, level=level, airborne=map_.airborne)
        known = with_aids(calibrated_setup(calibration, recording, map_), recording, map_, False)
    return Parts(recording, known, calibration, *judged_part(recording, calibration, map_))


class _Judged(NamedTuple):
    """One motion by one noise: by batch the innovations' score and the errors', and what the means are taken of."""

    innovations: np.ndarray
    errors: np.ndarray
    squares: np.ndarray
    nis: float
    nees: np.ndarray
    e: np.ndarray


def judge(motions: Sequence[Parts], before: FilterSettings, after: FilterSettings) -> HeldOut:
    """Return how the noise `after` does on the parts that were not fitted, beside the noise `before`."""
    befores: list[_Judged] = []
    afters: list[_Judged] = []
    duration = 0.0
    for one in motions:
        ranges, imu, t, end = one.recording.ranges, one.recording.imu, one.t, one.end
        last = float(t[one.judged(t)][-1])
        duration += last - end
        edges = np.linspace(end, last, 1 + int(np.clip((last - end) / BATCH, 2, BATCHES)))
        for settings, found in ((before, befores), (after, afters)):
            run = estimate(ranges, imu, one.known, settings, t)  # at all stamps, as in a replay
            e, there = _errors(run, one), one.judged(run.t)
            run = run._replace(t=run.t[there], P=run.P[there])
            found.append(_in_batches(run, e[there[: len(e)]], edges, noise_of(settings, imu is not None).gate))
    pairs = {"innovations": ([one.innovations for one in befores], [one.innovations for one in afters])}
    nees = rmse = None
    if all(one.calibration is not None for one in motions):
        m = sum(len(one.e) for one in befores)
        pairs["errors"] = [one.errors for one in befores], [one.errors for one in afters]
        pairs["accuracy"] = [-one.squares / m for one in befores], [-one.squares / m for one in afters]
        nees_before, nees_after = (float(np.concatenate([one.nees for one in of]).mean()) for of in (befores, afters))
        rmse_before, rmse_after = (rms_by_axis(np.vstack([one.e for one in of])) for of in (befores, afters))
        nees, rmse = (nees_before, nees_after), (rmse_before, rmse_after)
    gains = {name: gain_of(*pair, 1.0 - (1.0 - LEVEL) / len(pairs)) for name, pair in pairs.items()}
    nis = (float(np.mean([one.nis for one in befores])), float(np.mean([one.nis for one in afters])))
    return HeldOut(float(duration), gains, nis, nees, rmse)


def _errors(run: Estimate, of: Parts) -> np.ndarray:
    """Return the position's errors at the estimates' stamps (m, 3) [m]; none without a truth (0, 3)."""
    truth, by = of.recording.truth, of.calibration
    if truth is None or by is None:
        return np.zeros((0, 3))
    return np.asarray(run.p - by.position(truth_path(truth).at(run.t + by.offset)[0]))


def _in_batches(run: Estimate, e: np.ndarray, edges: np.ndarray, gate: float) -> _Judged:
    of_ranges = np.searchsorted(edges, run.range_stamps, side="left") - 1
    of_stamps = np.clip(np.searchsorted(edges, run.t, side="left") - 1, 0, len(edges) - 2)[: len(e)]
    batches = range(len(edges) - 1)
    scores = [innovation_score(Innovations(*(part[of_ranges == k] for part in run.run)), gate) for k in batches]
    nees = nees_of(e, run.P[: len(e)])
    likelihoods = -0.5 * (np.linalg.slogdet(run.P[: len(e)])[1] + nees)
    return _Judged(
        np.array(scores),
        np.bincount(of_stamps, likelihoods, len(batches)),
        np.bincount(of_stamps, np.sum(e**2, axis=1), len(batches)),
        nis_of(run, edges[0], edges[-1])[0],
        nees,
        e,
    )


def gain_of(before: list[np.ndarray], after: list[np.ndarray], level: float) -> Gain:
    """Return the sums over all batches before and after, and half the interval of their difference by this level."""
    befores, afters = np.concatenate(before), np.concatenate(after)
    n, differences = len(befores), afters - befores
    spread = float(np.std(differences, ddof=1) * np.sqrt(n))
    return Gain(float(befores.sum()), float(afters.sum()), float(student.ppf(0.5 + level / 2.0, n - 1)) * spread)
