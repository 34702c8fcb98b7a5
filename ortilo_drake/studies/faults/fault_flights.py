"""Flights with one fault each, beside the same seeds without any."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.stats import chi2

from ortilo_drake.flight.ensemble import fly_kept
from ortilo_drake.flight.figures import ESTIMATED, NEES, TRUE
from ortilo_drake.flight.intervals import Interval, Middle, middle_of, share_interval
from ortilo_drake.flight.lost import Lost
from ortilo_drake.flight.players import flown_by, kept_player
from ortilo_drake.flight.store import Amount, Count, Error
from ortilo_drake.flight.summary import Loss
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.planner.planned import path_of
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.faults.catalogue import LENGTH, START, Case, catalogue
from ortilo_drake.studies.maps.chunks import traced
from ortilo_drake.theory.consistency.consistency import nees_interval

BIN: Final = 0.5  # length of a bin of time [s]
COMPILED_AT_ONCE: Final = 50  # flights in one job of a worker


@dataclass(frozen=True)
class Course:
    """A flight's errors over time, with its noise's seed, and the time at which it was lost [s], None if it was not.

    Each BIN up to a loss has the mean squared distance of estimated and true position [m^2] and the mean NEES of
    position, 3 if the filter is consistent. player names the one of players.py that flew.
    """

    seed: Count
    lost: Amount | None
    square: list[Error]
    nees: list[float]
    player: str = ""


def course_of(seed: int, trace: np.ndarray, loss: Loss | Lost | None, h: float) -> Course:
    """Return the course of a flight up to where it diverged, from its trace (n, 10 or more), loss and tick h [s]."""
    trace = trace[np.isfinite(trace[:, :NEES]).all(axis=1)]
    bins = np.floor(np.arange(len(trace)) * h / BIN + 1e-6).astype(int)
    square = np.sum((trace[:, ESTIMATED] - trace[:, TRUE]) ** 2, axis=1)
    return Course(seed, None if loss is None else loss.time, _means(bins, square), _means(bins, trace[:, NEES]))


def _means(bins: np.ndarray, values: np.ndarray) -> list[float]:
    mean: list[float] = (np.bincount(bins, values) / np.bincount(bins)).tolist()
    return mean


def fly_courses_of(scenario_json: str, seeds: list[int], folder: str, player: str) -> list[Course]:
    """Fly some seeds and return their courses. Runs in a worker: the arguments are plain data."""
    flying, h = kept_player(scenario_json, folder, player), Scenario.model_validate_json(scenario_json).h
    return [course_of(seed, *traced(flying, seed), h) for seed in seeds]


fly_courses = partial(fly_kept, Course, fly_courses_of, at_once=COMPILED_AT_ONCE)


PASSES: Final = 1.5  # most that the error may be, as a multiple of the error without the fault
WITHIN_3_SIGMA: Final = float(chi2(3).ppf(chi2(1).cdf(3.0**2)))  # NEES of a position at the edge of 3 sigma, 14.16
SETTLES: Final = 2.0  # from a fault's end to the beginning of 'after' [s]
KNOWN: Final = 10.0  # from the start of a fault that does not end to the beginning of 'after' [s]
WINDOW: Final = 5.0  # time for which the error must be small to count as recovered [s]
Settings = tuple[tuple[str, Any], ...]


@dataclass(frozen=True)
class Phase:
    """The estimate in one part of the flights: figures of all flights that were not lost together, and medians.

    error is the root mean square of the distance of estimated and true position [m]; ratio is error over the error of
    the same seeds without the fault in the same ticks [1]. nees is the position's mean NEES, 3 if the filter is
    consistent, and nees_interval its 95 % interval over flights by Student's t, cut at 0; None for fewer than two
    flights. errors [m] and ratios are medians over single flights, with lost ones as worst and without them.
    """

    error: float
    ratio: float
    nees: float
    nees_interval: Interval | None
    errors: Middle
    ratios: Middle


@dataclass(frozen=True)
class FaultRow:
    """Flights of a scenario with one fault."""

    fault: str
    """its name in the catalogue."""
    scenario: str
    """the scenario's name."""
    flights: int
    """number of flights."""
    lost: int
    """number of lost flights."""
    lost_share: Interval
    """Wilson's 95 % interval of the share lost [1]."""
    before: Phase | None
    """part before the fault; None if all flights were lost, as are `during` and `after`."""
    during: Phase | None
    """part from the fault's start to its end; to 10 s after the start if it does not end."""
    after: Phase | None
    """part from 2 s after the fault's end, or 10 s after the start if it does not end, to the flight's end."""
    recovery: float | None
    """time from the fault's end, or its start if it does not end, to the first 5 s in which the error of all flights
    together is at most 1.5 times the one without the fault [s]; None if there is no such time."""
    passed_during: bool
    """whether during the fault the error is at most 1.5 times the one without, or the filter knows of it: the mean NEES
    is at most WITHIN_3_SIGMA."""
    passed_after: bool
    """whether afterwards the error is at most 1.5 times the one without the fault."""
    passed: bool
    """whether no flight was lost, and passed_during and passed_after hold."""
    settings: dict[str, Any] = field(default_factory=dict)
    """the fault's entry in the scenario's list `faults`."""


@dataclass(frozen=True)
class FaultStudy:
    """The result of the study of faults, as `ortilo faults --json` writes it; rows by fault, then by scenario.

    Each row has `flights` flights. Faults begin at `start` [s]; those that end last `length` [s]. lost_without is the
    number of flights lost without a fault, for each scenario. flown_by names the players that flew.
    """

    scenarios: list[str]
    flights: int
    start: float
    length: float
    lost_without: list[int]
    rows: list[FaultRow]
    flown_by: str


def fault_study(
    vary: Sequence[Callable[[Settings], Scenario]],
    names: Sequence[str],
    flights: int,
    out: Path,
    start: float = START,
    length: float = LENGTH,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
    player: str = "fastest",
) -> FaultStudy:
    """Fly scenarios without a fault, and with each named fault that applies to them, on `flights` seeds from 0.

    Each function of `vary` returns a scenario with settings laid over it. Faults begin at `start` [s]; those that end
    last `length` [s]. `out`, workers, progress and player are as in fly_kept. InputError as there, or if a flight ends
    too early to show anything after the fault.
    """
    wanted: list[tuple[Scenario, Case | None]] = []
    scenarios = []
    for make in vary:
        calm = make((("faults", []),))
        check_length(calm, start, length)
        scenarios.append(calm)
        wanted.append((calm, None))
        cases = [case for case in catalogue(calm, start, length) if case.name in names]
        wanted += [(make((("faults", [case.fault]),)), case) for case in cases]
    flown = fly_courses([(scenario, range(flights)) for scenario, _ in wanted], out, workers, progress, player=player)
    rows, without, lost_without = [], flown[0], []
    for (scenario, case), courses in zip(wanted, flown, strict=True):
        if case is None:
            without = courses
            lost_without.append(_lost(courses))
        else:
            rows.append(row_of(scenario.name, case, courses, without))
    rows.sort(key=lambda row: names.index(row.fault))  # stable: scenarios stay in their order
    by = flown_by((scenario for scenario, _ in wanted), (course.player for courses in flown for course in courses))
    return FaultStudy([s.name for s in scenarios], flights, start, length, lost_without, rows, by)


def check_length(scenario: Scenario, start: float, length: float) -> None:
    """Raise InputError if a flight ends too soon after its faults, or if a fault's times are no multiples of BIN."""
    for name, value in (("--start", start), ("--length", length)):
        if value % BIN != 0.0:
            raise InputError(f"{name} {value:g}: must be a multiple of {BIN:g} s")
    end = path_of(scenario).end_time() + scenario.settle
    least = start + max(length + SETTLES, KNOWN) + BIN
    if end < least:
        raise InputError(
            f"{scenario.name}: ends at {end:.1f} s: with faults from {start:g} s on it must fly to {least:g} s"
        )


def _lost(courses: Sequence[Course]) -> int:
    return sum(course.lost is not None for course in courses)


def row_of(scenario: str, case: Case, courses: Sequence[Course], without: Sequence[Course]) -> FaultRow:
    """Return the row of a fault and the named scenario, from courses of the same seeds with and without the fault."""
    pairs = [(a, b) for a, b in zip(courses, without, strict=True) if a.lost is None and b.lost is None]
    lost = _lost(courses)
    known = case.name, scenario, len(courses), lost, share_interval(lost, len(courses))
    if not pairs:
        return FaultRow(*known, None, None, None, None, False, False, False, case.fault)
    square, calm, nees = map(np.array, zip(*((a.square, b.square, a.nees) for a, b in pairs), strict=True))
    first = round(case.start / BIN)
    last = round((case.start + KNOWN if case.end is None else case.end) / BIN)
    then = last if case.end is None else last + round(SETTLES / BIN)
    before, during, after = (
        _phase(square[:, part], calm[:, part], nees[:, part], lost)
        for part in (slice(0, first), slice(first, last), slice(then, None))
    )
    recovery = recovery_time(square, calm, first if case.end is None else last)
    good_during = during.ratio <= PASSES or during.nees <= WITHIN_3_SIGMA
    good_after = after.ratio <= PASSES
    verdict = good_during, good_after, lost == 0 and good_during and good_after
    return FaultRow(*known, before, during, after, recovery, *verdict, case.fault)


def _phase(square: np.ndarray, calm: np.ndarray, nees: np.ndarray, lost: int) -> Phase:
    """Return a phase of the flights that were not lost (flights, bins); `lost` is the number of those that were."""
    each, its_calm = square.mean(axis=1), calm.mean(axis=1)
    return Phase(
        error=float(np.sqrt(square.mean())),
        ratio=float(np.sqrt(square.mean() / calm.mean())),
        nees=float(nees.mean()),
        nees_interval=nees_interval(nees.mean(axis=1)),
        errors=middle_of(np.sqrt(each).tolist(), lost),
        ratios=middle_of(np.sqrt(each / its_calm).tolist(), lost),
    )


def recovery_time(square: np.ndarray, calm: np.ndarray, origin: int) -> float | None:
    """Return the time from the bin `origin` to the first WINDOW with an error of at most PASSES times the calm one.

    Both are mean squared errors (flights, bins) [m^2], of the same seeds with the fault and without it.
    """
    n = round(WINDOW / BIN)
    for k in range(origin, square.shape[1] - n + 1):
        if square[:, k : k + n].mean() <= PASSES**2 * calm[:, k : k + n].mean():
            return (k - origin) * BIN
    return None
