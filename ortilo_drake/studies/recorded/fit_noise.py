"""The filter's noise fitted to the first parts of recorded motions: one set for all of them.

By innovations, the fit maximises their log-likelihood Σ -1/2 (log S + min(e²/S, gate²)): each range counts at most as
if it lay on the gate. By truth, it maximises the errors' log-likelihood Σ -1/2 (log |P| + e' P^-1 e) at the truth's
stamps.
The Nelder-Mead simplex searches the logarithms of the numbers. It begins anew where it stopped until that gains
nothing. The rest of the motions judges whether the noise found is better (held_out.py); lines of text say so.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.stats import chi2

from ortilo_drake.interop.recorded.map_file import FilterSettings, Map
from ortilo_drake.interop.recorded.recording import Recording, between
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.white_noise import nees_of
from ortilo_drake.studies.recorded.filter_types import noise_of
from ortilo_drake.studies.recorded.filtered import Begin, estimate
from ortilo_drake.studies.recorded.held_out import By, Gain, HeldOut, Parts, Verdict, judge, parts_of
from ortilo_drake.studies.recorded.reacquired import innovation_score
from ortilo_drake.studies.recorded.truth_path import truth_path

FITTED = ("acceleration", "range_white", "range_correlated", "correlation_time")
LIMITS = {  # bounds of the search, widened to the map's own value; they keep out degenerate corners
    "acceleration": (5e-4, 10.0),
    "range_white": (5e-4, 1.0),
    "range_correlated": (5e-4, 1.0),
    "correlation_time": (0.1, 30.0),
}
STEP = 0.4  # edge of each search's first simplex, in the numbers' logarithms
MOST = 800  # likelihoods computed, at most; a fit takes some 100 to 500
GAINED = 1.0  # a search that raises the log-likelihood by less is the last
AT_EDGE = 0.05  # a number whose logarithm is this near to a bound is at the edge of its search
SETTLED = 3.0  # the first seconds are left out: they judge the start, not the noise [s]
SILENT, HALF = 1.0, 0.25  # a longer time between two ranges is silent [s]; a larger share of silent time is told
CONSISTENT, RISEN = 3.0, 1.3  # mean NEES of a consistent filter; a rise by a smaller factor is not told

NAMES = {
    "innovations": "likelihood of the ranges",
    "errors": "likelihood of the errors",
    "accuracy": "position error",
}


class Fitted(NamedTuple):
    """The settings found, the log-likelihood before and after, its number of evaluations, and the criterion.

    at_limit: the bounds of each number that ended at the edge of its search; ranges: number of ranges fitted;
    fitted_time, silent: duration of the fitted parts, and how much of it has no ranges [s]; judged: the noise's
    judgement on the rest; doubts: about a replay by the map before.
    """

    settings: FilterSettings
    before: float
    after: float
    computed: int
    by: str
    motions: tuple[str, ...]
    at_limit: dict[str, tuple[float, float]]
    ranges: int
    fitted_time: float
    silent: float
    judged: HeldOut
    doubts: tuple[str, ...] = ()

    @property
    def chance(self) -> float | None:
        """Return the gain that a fit exceeds by chance once in twenty if the noise was right before (Wilks: chi²/2).

        None for a fit by truth: the errors at the truth's stamps are correlated, so the gain by chance is larger.
        """
        return float(0.5 * chi2.ppf(0.95, len(FITTED))) if self.by == "innovations" else None

    @property
    def notes(self) -> list[str]:
        """Return sentences on what makes the fit doubtful."""
        notes = [
            f"{name}: {getattr(self.settings, name):.3g} is at the edge of its search, {least:g} to {largest:g}: the "
            "recording hardly tells it"
            for name, (least, largest) in self.at_limit.items()
        ]
        if self.silent > HALF * self.fitted_time:
            notes.append(
                f"no ranges in {self.silent:.1f} of the {self.fitted_time:.1f} s fitted: little to fit; a larger "
                "calibration.share fits more"
            )
        if self.is_chance:
            gain = self.after - self.before
            notes.append(f"a gain of {gain:.1f} is no more than chance: {self.chance:.1f} where the noise was right")
        return notes

    @property
    def is_chance(self) -> bool:
        """Whether the fitted part gains no more than by chance, if the noise was right before."""
        return self.chance is not None and self.after - self.before <= self.chance

    @property
    def verdict(self) -> Verdict:
        """Return the rest's verdict, but "the same" for one gained by chance, and "mend first" if the map is doubted.

        Noise that is fitted to a mistake in the map hides the mistake: NIS is then 1.
        """
        if self.doubts:
            return "mend first"
        return "the same" if self.is_chance and self.judged.verdict == "better" else self.judged.verdict


def _heard(motion: Parts) -> tuple[int, float, float]:
    """Return the number of ranges in a motion's fitted part, its duration [s] and its time without ranges [s]."""
    t = motion.recording.ranges.t
    t = t[t <= motion.end]
    gaps = np.diff(np.append(t, motion.end))
    return len(t), float(motion.end - t[0]), float(gaps[gaps > SILENT].sum())


def _likelihood_of(motion: Parts, by: By) -> Callable[[FilterSettings, bool], float]:
    """Return the log-likelihood of a motion's first part as a function of the settings.

    The function's second argument says whether to search the filter's start anew, which takes nine tenths of the time.
    """
    recording, known, calibration, _, end, _ = motion
    truth, imu, queries = recording.truth, recording.imu, np.zeros(0)
    if truth is not None and calibration is not None and by == "truth":
        queries = truth.t - calibration.offset
        queries = queries[(queries >= SETTLED) & (queries <= end)]
    ranges = recording.ranges.only(recording.ranges.t <= end)
    imu = None if imu is None else between(imu, -np.inf, ranges.t[-1])

    begin: Begin | None = None

    def likelihood(settings: FilterSettings, anew: bool) -> float:
        nonlocal begin
        found = estimate(ranges, imu, known, settings, queries, begin=None if anew else begin)
        begin = found.begin
        if truth is None or calibration is None or by == "innovations":
            settled = found.range_stamps >= SETTLED
            run = found.run._replace(innovation=found.run.innovation[settled], variance=found.run.variance[settled])
            return innovation_score(run, noise_of(settings, imu is not None).gate)
        e = found.p - calibration.position(truth_path(truth).at(found.t + calibration.offset)[0])
        return float(-0.5 * np.sum(np.linalg.slogdet(found.P)[1] + nees_of(e, found.P)))

    return likelihood


def fit_noise(
    recordings: Sequence[Recording], map_: Map, by: By, count: Callable[[int], None], most: int = MOST
) -> Fitted:
    """Return the noise that fits the first parts of all motions best, starting from the map's noise.

    `count` is called with the number of likelihoods computed so far, which is at most `most`.

    Raises:
        InputError: if there is no IMU, or no truth to fit by.
    """
    if any(recording.imu is None for recording in recordings):
        raise InputError("imu: the map has none; the noise of the constant-velocity filter is not fitted")
    if by == "truth" and any(recording.truth is None for recording in recordings):
        raise InputError("truth: the map has none; fit by innovations")
    if map_.calibration.share == 0.0:
        raise InputError("calibration.share: 0: the noise is fitted to the first part: give its share")
    if any(isinstance(recording.anchors, int) and recording.truth is None for recording in recordings):
        raise InputError("anchors: unknown")
    motions = [parts_of(recording, map_) for recording in recordings]
    likelihoods = [_likelihood_of(motion, by) for motion in motions]
    computed = 0

    def settings_at(x: np.ndarray) -> FilterSettings:
        numbers = {name: float(np.exp(v)) for name, v in zip(FITTED, x, strict=True)}
        return map_.filter.model_copy(update=numbers)

    def cost(x: np.ndarray, anew: bool = False) -> float:
        nonlocal computed
        computed += 1
        count(computed)
        if np.any((x < np.log(least)) | (x > np.log(largest))):
            return 1e12
        return -sum(likelihood(settings_at(x), anew) for likelihood in likelihoods)

    before = sum(likelihood(map_.filter, True) for likelihood in likelihoods)
    own = np.array([getattr(map_.filter, name) for name in FITTED])
    least, largest = np.array([LIMITS[name] for name in FITTED]).T
    least, largest, x = np.minimum(least, own), np.maximum(largest, own), np.log(own)
    best = cost(x)
    while computed < most:  # the gate makes the cost jump, and one simplex may get stuck there
        simplex = np.vstack([x, x + STEP * np.eye(len(x))])
        options = {"maxfev": most - computed, "xatol": 0.01, "fatol": 0.2, "initial_simplex": simplex, "adaptive": True}
        found = minimize(cost, x, method="Nelder-Mead", options=options)
        if found.fun < best:
            x = found.x
        last, best = best, cost(x, anew=True)
        if last - best < GAINED:
            break
    rounded = {name: float(f"{v:.3g}") for name, v in zip(FITTED, np.exp(x), strict=True)}
    settings = map_.filter.model_copy(update=rounded)
    edges = zip(FITTED, x - np.log(least), np.log(largest) - x, least.tolist(), largest.tolist(), strict=True)
    heard = [_heard(motion) for motion in motions]
    return Fitted(
        settings=settings,
        before=before,
        after=-best,
        computed=computed,
        by=by,
        motions=tuple(recording.name for recording in recordings),
        at_limit={name: (low, high) for name, below, above, low, high in edges if min(below, above) < AT_EDGE},
        ranges=sum(one[0] for one in heard),
        fitted_time=sum(one[1] for one in heard),
        silent=sum(one[2] for one in heard),
        judged=judge(motions, map_.filter, settings),
    )


def fitted_lines(fitted: Fitted) -> list[str]:
    """Return lines with the figures of the fitted and the held-out part, before and after, and the verdict."""
    held = fitted.judged
    chance = "" if fitted.chance is None else f"; {len(FITTED)} numbers gain {fitted.chance:.1f} by chance"
    lines = [
        f"fitted to {fitted.ranges} ranges in {fitted.fitted_time:.1f} s: log-likelihood {fitted.before:.1f} -> "
        f"{fitted.after:.1f}, computed {fitted.computed} times{chance}",
        *(f"note: {note}" for note in fitted.notes),
        f"on the {held.duration:.1f} s that were not fitted, before -> after, changes with intervals (95 % for all):",
        f"  log-likelihood of the ranges    {_gain(held.gains['innovations'])}",
        f"  NIS (1 if consistent)           {held.nis[0]:.2f} -> {held.nis[1]:.2f}",
    ]
    if held.nees is not None and held.rmse is not None:
        before, after = (", ".join(f"{axis:.3f}" for axis in one) for one in held.rmse)
        lines += [
            f"  log-likelihood of the errors    {_gain(held.gains['errors'])}",
            f"  NEES (3 if consistent)          {held.nees[0]:.2f} -> {held.nees[1]:.2f}",
            f"  RMS error in x, y, z            {before} -> {after} m",
            f"  mean square error               {_mean_square(held.gains['accuracy'])}",
        ]
    return [*lines, verdict_line(fitted)]


def verdict_line(fitted: Fitted) -> str:
    """Return a sentence: whether the tuned noise is better where it was not fitted, and what to do."""
    held = fitted.judged
    if fitted.verdict == "mend first":
        return "mend these first; the noise may only have been fitted to them:" + "".join(
            f"\n  {doubt}" for doubt in fitted.doubts
        )
    better, worse = (
        ", ".join(NAMES[name] for name, gain in held.gains.items() if gain.sign == sign) for sign in (1, -1)
    )
    if fitted.verdict == "better":
        return f"the tuned noise is better there ({better}): use it{_claims(held)}"
    if fitted.verdict == "worse":
        return f"the tuned noise is worse there ({worse}): keep the map that you had"
    if fitted.verdict == "mixed":
        return (
            f"the tuned noise is worse there in one respect ({worse}), better in another ({better}): keep the map that "
            "you had, unless the other matters more to you"
        )
    if held.verdict == "better":
        return "what was fitted gains no more than by chance, whatever the rest gains: keep the map that you had"
    return "the tuned noise is no better there, the same within its uncertainty: keep the map that you had"


def _claims(held: HeldOut) -> str:
    """Return a warning if NEES rises above 3: the likelihood of the ranges cannot see the calibration's errors."""
    if held.nees is None or held.nees[1] <= RISEN * max(CONSISTENT, held.nees[0]):
        return ""
    times = (held.nees[1] / CONSISTENT) ** 0.5
    return f"; but NEES rises to {held.nees[1]:.1f}: errors are {times:.1f} times what its standard deviations claim"


def _gain(gain: Gain) -> str:
    return f"{gain.before:.1f} -> {gain.after:.1f}: {gain.after - gain.before:+.1f} ± {gain.half:.1f}"


def _mean_square(gain: Gain) -> str:
    """Return the text of a gain in mean squares [m²], which the gain holds with a negative sign."""
    return f"{-gain.before:.5f} -> {-gain.after:.5f} m²: {gain.before - gain.after:+.5f} ± {gain.half:.5f}"
