"""Flights under each mismatch: at given values, and at a ladder of values in search of the one that loses 5 %."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from ortilo_drake.flight.flight import AXES
from ortilo_drake.flight.summaries import fly_summaries
from ortilo_drake.flight.summary import Summary
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.sensitivity.loss_level import Flown, loss_level
from ortilo_drake.studies.sensitivity.mismatches import Mismatch, Settings, all_together, mismatches_of

LOST_SHARE: Final = 0.05
NONE: Final = "none"
STEP: Final = 2.0  # from one value of the ladder to the next, as a factor
LEAST: Final = 1.0 / 32.0  # of the careful value: below it none is flown


@dataclass(frozen=True)
class Row:
    """Flights under one mismatch at one value.

    Attributes:
        mismatch: its name with the value's unit; 'none' without one.
        value: of the mismatch.
        flights: how many.
        lost: how many of them.
        mse: medians over the others of the estimate's mean squared error per axis [m^2]; None if all were lost.
        nees: mean over the others of the position's NEES, 3 if the filter is consistent; None if all were lost.
    """

    mismatch: str
    value: float
    flights: int
    lost: int
    mse: dict[str, float] | None
    nees: float | None


@dataclass(frozen=True)
class Limit:
    """The value of a mismatch at which 5 % of the flights are lost; see loss_level.py for None and 0.

    Attributes:
        mismatch: its name with the value's unit.
        value: the one at which that share is lost.
        interval: its 95 % interval.
    """

    mismatch: str
    value: float | None
    interval: tuple[float | None, float | None]


@dataclass(frozen=True)
class Sensitivity:
    """What the filter does not know, and what comes of it, as `ortilo sensitivity --json` writes it.

    Attributes:
        scenario: its name.
        rows: without mismatch, and each mismatch alone at its given values.
        limits: of each mismatch alone, and of all together.
    """

    scenario: str
    rows: list[Row]
    limits: list[Limit]


def sensitivity(
    vary: Callable[[Settings], Scenario],
    seeds: Iterable[int],
    out: Path,
    workers: int = 1,
    say: Callable[[str], None] = lambda part: None,
    progress: Callable[[int], None] | None = None,
) -> Sensitivity:
    """Fly a scenario under each mismatch that changes anything for it.

    Args:
        vary: returns the scenario with settings laid over it; its cameras are flown projected.
        seeds: the same for every value.
        out: folder for the summaries of the flights.
        workers: worker processes.
        say: called with each mismatch's name as it begins.
        progress: called with the number of flights that came in.
    """
    seeds = list(seeds)

    def fly(settings: Settings) -> list[Summary]:
        return fly_summaries(vary(settings).projected(), seeds, out, workers, progress)

    say(NONE)
    scenario, calm = vary(()), fly(())
    mismatches = mismatches_of(scenario)
    rows, limits = [_row(NONE, 0.0, calm)], []
    for mismatch in (*mismatches, all_together(mismatches)):
        say(mismatch.name)
        flown: dict[float, list[Summary]] = {}

        def lost_at(value: float, mismatch: Mismatch = mismatch, flown: dict[float, list[Summary]] = flown) -> int:
            if value not in flown:
                flown[value] = fly(mismatch.settings(value))
            return _lost(flown[value])

        for value in mismatch.given:
            lost_at(value)
        rows += [_row(mismatch.name, value, flown[value]) for value in mismatch.given]
        if mismatch.largest is not None:
            climb(lost_at, mismatch.careful, mismatch.largest, len(seeds))
            at = [Flown(value, len(seeds), _lost(found)) for value, found in sorted(flown.items()) if value > 0.0]
            limits.append(Limit(mismatch.name, *loss_level(Flown(0.0, len(seeds), _lost(calm)), at, LOST_SHARE)))
    return Sensitivity(scenario.name, rows, limits)


def climb(lost_at: Callable[[float], int], careful: float, largest: float, flights: int) -> None:
    """Fly a ladder of values from where none is lost to where at least half are, then the middle of the step between.

    Args:
        lost_at: flies a value and returns how many flights were lost.
        careful: where the ladder begins.
        largest: its upper end.
        flights: how many are flown at each value.
    """
    value = careful
    while lost_at(value) < flights / 2.0 and value * STEP <= largest:
        value *= STEP
    above = value
    value = careful
    while lost_at(value) > 0 and value / STEP >= LEAST * careful:
        value /= STEP
    while value * STEP < above and lost_at(value * STEP) == 0:
        value *= STEP
    if value < above:
        lost_at(math.sqrt(value * min(value * STEP, above)))


def _lost(summaries: Sequence[Summary]) -> int:
    return sum(s.lost is not None for s in summaries)


def _row(mismatch: str, value: float, summaries: Sequence[Summary]) -> Row:
    kept = [s for s in summaries if s.lost is None]
    mse = {axis: float(np.median([s.mse[axis] for s in kept])) for axis in AXES} if kept else None
    nees = float(np.mean([s.nees for s in kept])) if kept else None
    return Row(mismatch, value, len(summaries), _lost(summaries), mse, nees)
