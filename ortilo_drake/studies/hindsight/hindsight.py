"""The estimates of the filter that flew, beside smoothed estimates from the same messages."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ortilo_drake.flight.efficiency import floor_at_ticks
from ortilo_drake.flight.metrics import loss_of
from ortilo_drake.flight.processes.workers import run_all
from ortilo_drake.model.optional import is_installed, missing
from ortilo_drake.model.white_noise import nees_of
from ortilo_drake.scenario import IntermittentFilter, Scenario
from ortilo_drake.studies.hindsight.recorded_flight import RecordedFlight, fly_recorded
from ortilo_drake.studies.hindsight.rts import is_linear, smoothed
from ortilo_drake.views.numbers import table

FLOWN, RTS, GRAPH, FLOOR = "flown", "rts", "graph", "floor"
EXTRA: Final = "smoother"  # the optional dependencies with gtsam


@dataclass(frozen=True)
class Judged:
    """The errors of one flight's estimates."""

    mse: tuple[float, float, float]
    """mean squared error of the position per axis [m^2]."""
    nees: float | None
    """mean of e^T P_pp^-1 e, 3 if P is right; None for the floor, which has no errors."""


@dataclass(frozen=True)
class FlightInHindsight:
    """The errors of all ways of estimating one flight."""

    seed: int
    """seed of all noise."""
    lost: float | None
    """time at which the flight was lost [s], up to which errors count; None if it was not lost."""
    ways: dict[str, Judged]
    """errors of each way of estimating that applies: FLOWN, RTS, GRAPH, FLOOR."""


@dataclass(frozen=True)
class HindsightRow:
    """The errors of one way of estimating, over all flights."""

    way: str
    """FLOWN, RTS, GRAPH or FLOOR."""
    rms: tuple[float, float, float]
    """root mean square of the flights' errors per axis [m]."""
    rms_distance: float
    """root mean square of the distance between estimated and true position [m]."""
    nees: float | None
    """mean NEES over the flights."""


@dataclass(frozen=True)
class Hindsight:
    """The study that `ortilo hindsight --json` writes."""

    scenario: str
    """name of the scenario."""
    estimator: str
    """the kind of filter that flew."""
    lost: int
    """number of lost flights."""
    rows: list[HindsightRow]
    """one row for each way of estimating."""
    missing: list[str]
    """lines that say why rows are missing."""
    flights: list[FlightInHindsight]
    """results of each flight."""


def judged(x: np.ndarray, P: np.ndarray, truth: np.ndarray) -> Judged:
    """Return errors and NEES of estimated positions x (n, 3) with covariance P (n, 3, 3) against the truth (n, 3)."""
    e = x - truth
    a, b, c = np.mean(e**2, axis=0).tolist()
    return Judged((a, b, c), float(np.mean(nees_of(e, P))))


def in_hindsight(recorded: RecordedFlight) -> FlightInHindsight:
    """Return a flight's errors, by the filter that flew, by each smoother that applies, and by the floor."""
    flight = recorded.flight
    truth = flight["truth"].values[:, :3]
    flown = flight["estimate"].values[:, :3], flight["covariance"].values[:, :3, :3]
    ways = {FLOWN: judged(*flown, truth)}
    if is_linear(recorded.scenario):
        x, P = smoothed(recorded)
        ways[RTS] = judged(x[:, :3], P[:, :3, :3], truth)
    if is_installed("gtsam"):
        from ortilo_drake.studies.hindsight.graph import graph_smoothed

        x, P = graph_smoothed(recorded)
        ways[GRAPH] = judged(x[:, :3], P[:, :3, :3], truth)
    floor = floor_at_ticks(flight)
    if floor is not None:
        a, b, c = np.mean(floor, axis=0).tolist()
        ways[FLOOR] = Judged((a, b, c), None)
    loss = loss_of(flight)
    return FlightInHindsight(int(flight.attrs["seed"]), None if loss is None else loss.time, ways)


def hindsight_of(scenario_json: str, seed: int) -> FlightInHindsight:
    """Fly a seed and estimate it in hindsight. Runs in a worker process: the arguments are plain data."""
    return in_hindsight(fly_recorded(Scenario.model_validate_json(scenario_json), seed))


def fly_in_hindsight(
    scenario: Scenario, seeds: Sequence[int], workers: int = 1, progress: Callable[[int], None] | None = None
) -> Hindsight:
    """Fly seeds of a scenario, ignoring its own seed, and estimate each in hindsight; InputError as flight.fly.

    One worker flies in this process. `progress` is called with the number of flights just finished.
    """
    found: dict[int, FlightInHindsight] = {}

    def take(number: int, its: FlightInHindsight) -> None:
        found[number] = its
        if progress:
            progress(1)

    text = scenario.model_dump_json()
    run_all(hindsight_of, [(text, seed) for seed in seeds], workers, take)
    return study_of(scenario, [found[number] for number in sorted(found)])


def study_of(scenario: Scenario, flights: list[FlightInHindsight]) -> Hindsight:
    """Return the study of a scenario's flights."""
    rows = []
    for way in (FLOWN, RTS, GRAPH, FLOOR):
        its = [flight.ways[way] for flight in flights if way in flight.ways]
        if its:
            mse = np.mean([one.mse for one in its], axis=0)
            known = [one.nees for one in its if one.nees is not None]
            x, y, z = np.sqrt(mse).tolist()
            nees = float(np.mean(known)) if known else None
            rows.append(HindsightRow(way, (x, y, z), float(np.sqrt(mse.sum())), nees))
    lost = sum(flight.lost is not None for flight in flights)
    return Hindsight(scenario.name, str(scenario.estimator.kind), lost, rows, _missing(scenario, rows), flights)


def _missing(scenario: Scenario, rows: list[HindsightRow]) -> list[str]:
    """Return the reasons why rows are missing."""
    there, lines = {row.way for row in rows}, []
    if RTS not in there:
        settings = scenario.estimator
        runs_again = isinstance(settings, IntermittentFilter) and settings.delay == "replay"
        why = "runs again where a measurement comes late (estimator.delay replay)" if runs_again else "is not linear"
        lines.append(f"RTS: the filter that flew {why}.")
    if GRAPH not in there:
        lines.append(f"graph: {missing('gtsam', EXTRA)}.")
    if FLOOR not in there:
        lines.append("floor: the errors of this camera's detector have not been measured.")
    return lines


_HEADER = ["estimate", "x [mm]", "y [mm]", "z [mm]", "distance [mm]", "over flown", "NEES"]
_NAMES = {RTS: "RTS, in hindsight", GRAPH: "graph, in hindsight", FLOOR: "Cramér-Rao floor of a filter"}


def hindsight_text(found: Hindsight) -> str:
    """Return the report in Markdown."""
    n = len(found.flights)
    seeds = ", ".join(str(flight.seed) for flight in found.flights)
    lines = [f"# In hindsight: {found.scenario}", ""]
    lost = f", {found.lost} of them lost" if found.lost else ""
    lines += [f"{n} flight{'s' * (n > 1)} (seed{'s' * (n > 1)} {seeds}){lost}.", ""]
    flown = next(row for row in found.rows if row.way == FLOWN)
    rows = []
    for row in found.rows:
        name = f"{found.estimator}, as it flew" if row.way == FLOWN else _NAMES[row.way]
        errors = [f"{1e3 * value:.1f}" for value in (*row.rms, row.rms_distance)]
        share = f"{row.rms_distance / flown.rms_distance:.2f}" if flown.rms_distance else "-"
        rows.append([name, *errors, share, "-" if row.nees is None else f"{row.nees:.2f}"])
    lines += table(_HEADER, rows)
    lines += [
        "Root mean squares of the estimated position less the true one, over all ticks of all flights; NEES is 3 on "
        "average where the covariance is right. Hindsight knows the messages of the whole flight, a filter those until "
        "then: so it may err less than a filter's floor.",
        "",
    ]
    for line in found.missing:
        lines += [f"No row: {line}", ""]
    return "\n".join(lines)
