"""Tuned noise judged on the parts of recorded motions that it was not fitted to, beside the noise before.

Filters with either noise run over all ranges. The part after the fitted one is cut into batches of at least 2 s, at
most 20 for each motion. A gain is the sum of the batches' differences. Its interval follows from their spread
(Student's t), which covers correlation within a batch (batch means: Law, Simulation Modeling and Analysis, section
9.5.3). All n intervals hold together with probability LEVEL at least: each misses with (1 - LEVEL) / n (Bonferroni).
"""

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import numpy as np
from scipy.stats import t as student

from ortilo_drake.interop.recorded.map_file import FilterSettings, Map
from ortilo_drake.interop.recorded.recording import Recording
from ortilo_drake.model.white_noise import nees_of
from ortilo_drake.studies.recorded.at_rest import at_rest
from ortilo_drake.studies.recorded.calibrate import Calibration, calibrate
from ortilo_drake.studies.recorded.filter_types import FilterSetup, noise_of
from ortilo_drake.studies.recorded.filtered import Estimate, estimate
from ortilo_drake.studies.recorded.reacquired import Innovations, innovation_score
from ortilo_drake.studies.recorded.replayed import with_lever
from ortilo_drake.studies.recorded.scores import nis_of, rms_by_axis
from ortilo_drake.studies.recorded.setups import (
    calibrated_setup,
    given_level,
    judged_part,
    uncalibrated_setup,
    with_aids,
)
from ortilo_drake.studies.recorded.truth_path import truth_path

BATCH, BATCHES = 2.0, 20  # least duration of a batch [s], and largest number of batches
LEVEL = 0.95  # joint confidence of the gains' intervals
By = Literal["innovations", "truth"]
Verdict = Literal["better", "the same", "worse", "mixed", "mend first"]


class Gain(NamedTuple):
    """A sum, larger is better: before, after, and half the width of its gain's interval."""

    before: float
    after: float
    half: float

    @property
    def sign(self) -> int:
        """Return 1 if the gain's interval lies above 0, -1 if below, else 0."""
        gain = self.after - self.before
        return int(np.sign(gain)) if abs(gain) > self.half else 0


class HeldOut(NamedTuple):
    """The judgement of the noise before and after, by the part that was not fitted.

    Attributes:
        duration: of this part, all motions together [s].
        gains: by criterion: `innovations` (log-likelihood of the ranges' innovations) and, with a truth, `errors`
            (log-likelihood of the position's errors by the filter's covariance) and `accuracy` (negative mean square
            error of the position [m²]).
        nis: mean NIS before and after, each motion with the same weight.
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
        """Return the verdict of all gains; mixed if one is surely above 0 and another surely below."""
        signs = {gain.sign for gain in self.gains.values()}
        if -1 in signs:
            return "mixed" if 1 in signs else "worse"
        return "better" if 1 in signs else "the same"


class Parts(NamedTuple):
    """A motion with the filter's settings for it, its fitted part and the rest.

    Attributes:
        recording: the motion.
        known: the settings of the replay's main row with IMU.
        calibration: by the truth, None without a truth.
        t: stamps of the estimates of both parts [s].
        end: end of the fitted part [s].
        judged: maps stamps to a mask of those in the rest (n) -> (n).
    """

    recording: Recording
    known: FilterSetup
    calibration: Calibration | None
    t: np.ndarray
    end: float
    judged: Callable[[np.ndarray], np.ndarray]


def parts_of(recording: Recording, map_: Map) -> Parts:
    """Return a motion's parts; raise InputError if hardly anything is left to judge."""
    calibration = None
    if recording.truth is None:
        known = with_lever(uncalibrated_setup(recording, map_, at_rest(recording, map_)), recording, map_, [])
    else:
        level, lever = given_level(map_), recording.imu is not None
        calibration = calibrate(recording, map_.calibration, lever=lever, level=level, airborne=map_.airborne)
        known = with_aids(calibrated_setup(calibration, recording, map_), recording, map_, False)
    return Parts(recording, known, calibration, *judged_part(recording, calibration, map_))


class _Judged(NamedTuple):
    """One motion with one noise: by batch, the log-likelihoods and squared errors; NIS, and NEES and error by stamp."""

    innovations: np.ndarray
    errors: np.ndarray
    squares: np.ndarray
    nis: float
    nees: np.ndarray
    e: np.ndarray


def judge(motions: Sequence[Parts], before: FilterSettings, after: FilterSettings) -> HeldOut:
    """Return the judgement of the noise `after` beside `before`, on the parts that were not fitted."""
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
    """Return the position's errors at the estimates' stamps (m, 3) [m]; empty (0, 3) without a truth."""
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
    """Return the sums over all batches before and after, and half the interval of their difference at this level."""
    befores, afters = np.concatenate(before), np.concatenate(after)
    n, differences = len(befores), afters - befores
    spread = float(np.std(differences, ddof=1) * np.sqrt(n))
    return Gain(float(befores.sum()), float(afters.sum()), float(student.ppf(0.5 + level / 2.0, n - 1)) * spread)
