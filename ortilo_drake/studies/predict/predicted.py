"""A recorded flight and simulations of it: the same path, stamps and filter, errors drawn by a NOISE.yaml."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import Recording
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario.noise_file import NoiseFile, as_white
from ortilo_drake.studies.fit.imu_errors import body_path, mount_of
from ortilo_drake.studies.predict.simulated import numbers_of, simulated
from ortilo_drake.studies.recorded.at_rest import at_rest
from ortilo_drake.studies.recorded.calibrate import calibrate
from ortilo_drake.studies.recorded.filtered import Estimate, estimate
from ortilo_drake.studies.recorded.scores import nees_of, nis_of
from ortilo_drake.studies.recorded.setups import calibrated_setup, judged_part, with_aids
from ortilo_drake.world.sensors.fitted_errors import Day, draw_day

QUERY_RATE = 30.0  # of the judged stamps, at most [Hz]
SHARES = (2.5, 97.5)  # of the simulations, between which the interval lies [%]
OF_ERROR, OF_NEES = 0.3, 1.5  # a group is predicted within this share of its error, and within this much of its NEES


@dataclass(frozen=True)
class Figures:
    """Total RMS error [m], NEES (3 if consistent), NIS of the ranges (about 1), and the share of ranges refused."""

    error: float
    nees: float
    nis: float
    rejected: float


@dataclass(frozen=True)
class Predicted:
    """A flight's figures, those of its simulations, and those of its simulations with white noise alone."""

    name: str
    real: Figures
    fitted: tuple[Figures, ...]
    white: tuple[Figures, ...]


def interval(runs: Sequence[Figures], of: str) -> tuple[float, float]:
    """Return the ends between which 95 % of the simulations lie."""
    low, high = np.percentile([getattr(run, of) for run in runs], SHARES)
    return float(low), float(high)


def mean_of(runs: Sequence[Figures], of: str) -> float:
    """Return the mean of the simulations; the root of the mean square of errors."""
    values = np.array([getattr(run, of) for run in runs])
    return float(np.sqrt(np.mean(values**2)) if of == "error" else np.mean(values))


def figures_of(found: Estimate, true: np.ndarray) -> Figures:
    """Return the figures of an estimate against true positions (m, 3)."""
    e = found.p - true
    error = float(np.sqrt(np.mean(np.sum(e**2, axis=1))))
    return Figures(error, float(np.mean(nees_of(e, found.P))), *nis_of(found, found.t[0], found.t[-1]))


def predict(
    recording: Recording, map_: Map, noise: NoiseFile, runs: int, seed: int, say: Callable[[str], None] = lambda _: None
) -> Predicted:
    """Return a flight's figures beside those of simulations along its path, each on a day of its own.

    The days are drawn by the seed, the same for all recordings; `say` is called before each flight.

    Raises:
        InputError: if it has no truth, or too little of it, or the noise is that of another number of anchors.
    """
    truth, imu = recording.truth, recording.imu
    if truth is None:
        raise InputError(f"{recording.name}: truth: the map has none, and a prediction flies along it")
    if imu is not None and noise.imu is None:
        raise InputError("noise.imu: is missing, and the recording has an imu")
    by = calibrate(recording, map_.calibration, lever=imu is not None)
    constants, n = noise.uwb.constants, len(by.anchors)
    if constants is not None and len(constants) != n:
        raise InputError(f"noise.uwb.constants: {len(constants)} of them, but {recording.name} has {n} anchors")
    path = body_path(recording.name, truth, by)
    mount = mount_of(recording, path, by, map_)
    known = with_aids(calibrated_setup(by, recording, map_), recording, map_, False)
    stamps, _, judged = judged_part(recording, by, map_)
    stamps = stamps[judged(stamps)]
    stamps = stamps[:: max(1, round(1.0 / (QUERY_RATE * float(np.median(np.diff(stamps))))))]
    say(f"{recording.name}, as recorded")
    found = estimate(recording.ranges, imu, known, map_.filter, stamps)
    real, failed = figures_of(found, path.position(found.t)), found.failed

    def flown(kind: NoiseFile, run: int) -> Figures:
        of_day = np.random.Generator(np.random.Philox(np.random.SeedSequence([seed, run])))
        of_flight = np.random.Generator(np.random.Philox(np.random.SeedSequence([seed, run, *recording.name.encode()])))
        day = draw_day(kind.uwb, n, numbers_of(of_day))
        if known.biases is not None:  # calibrated ones are what the simulated anchors have, too
            day = Day(known.biases, day.fields)
        made = simulated(recording, by, path, mount, map_.floor, kind, day, failed, of_flight)
        told = known._replace(rest=at_rest(made, map_))  # by its own imu
        then = estimate(made.ranges, made.imu, told, map_.filter, stamps)
        return figures_of(then, path.position(then.t))

    figures = []
    for name, kind in (("fitted", noise), ("white", as_white(noise))):
        rows = []
        for run in range(runs):
            say(f"{recording.name}, {name}, {run + 1} of {runs}")
            rows.append(flown(kind, run))
        figures.append(tuple(rows))
    return Predicted(recording.name, real, *figures)


@dataclass(frozen=True)
class Group:
    """All flights together: error RMS [m] and NEES as recorded, and of the simulations of either kind."""

    real_error: float
    real_nees: float
    error: float
    nees: float
    white_error: float
    white_nees: float

    @property
    def holds(self) -> bool:
        """Return whether the simulation predicts the group: error within 30 %, NEES within 1.5."""
        return abs(self.error / self.real_error - 1.0) <= OF_ERROR and abs(self.nees - self.real_nees) <= OF_NEES


def group_of(flights: Sequence[Predicted]) -> Group:
    """Return the figures of several flights, each counted alike."""

    def both(runs: Sequence[Sequence[Figures]]) -> tuple[float, float]:
        errors, nees = ([mean_of(one, of) for one in runs] for of in ("error", "nees"))
        return float(np.sqrt(np.mean(np.square(errors)))), float(np.mean(nees))

    kinds = ([(one.real,) for one in flights], [one.fitted for one in flights], [one.white for one in flights])
    return Group(*(figure for kind in kinds for figure in both(kind)))
