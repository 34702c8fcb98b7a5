"""Losses and the filter's errors of each flight: all that a study of hundreds keeps, as a flight takes megabytes.

A flight's whole summary, with its Cramer-Rao floor, takes 50 times as long, a fifth of a quick flight. The compiled
engine flies what it can (flight/engine.py), Drake the rest.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from ortilo_drake.diagrams.wiring.whole import why_not
from ortilo_drake.flight.engine import Engine
from ortilo_drake.flight.flight import AXES
from ortilo_drake.flight.kept import AT_ONCE, fly_kept
from ortilo_drake.flight.lost import NOT_LOST
from ortilo_drake.flight.metrics import estimation_mse, loss_of, position_nees
from ortilo_drake.flight.players import kept_player
from ortilo_drake.flight.store import Count, Error
from ortilo_drake.scenario import Scenario

COMPILED_AT_ONCE = 16  # flights in one job of a worker


@dataclass(frozen=True)
class Outcome:
    """The outcome of a flight in a study of mismatches.

    Attributes:
        seed: of all noise.
        lost: whether it was lost.
        mse: mean squared error of the estimate per axis [m^2], see metrics.estimation_mse; up to a loss.
        nees: mean of metrics.position_nees, 3 if the filter is consistent; up to a loss.
    """

    seed: Count
    lost: bool
    mse: dict[str, Error]
    nees: float


def outcome(flight: xr.Dataset) -> Outcome:
    """Return the figures that are kept of a flight."""
    whole = np.isfinite(flight["truth"].values).all(axis=1) & np.isfinite(flight["estimate"].values).all(axis=1)
    if not whole.all():
        flight = flight.isel(tick=whole)  # all but the end of a flight that diverged
    nees = float(np.mean(position_nees(flight)))
    return Outcome(int(flight.attrs["seed"]), loss_of(flight) is not None, estimation_mse(flight), nees)


def compiled_outcome(engine: Engine, seed: int) -> Outcome:
    """Return the figures that are kept of a flight of the engine; if it diverged, the errors may not be finite."""
    found = dict(zip(engine.columns, engine.figures([seed])[0].tolist(), strict=True))
    mse = {axis: found[f"mse_{axis}"] for axis in AXES}
    return Outcome(seed, found["cause"] != NOT_LOST, mse, found["nees"])


def fly_outcomes_of(scenario_json: str, seeds: list[int], folder: str) -> list[Outcome]:
    """Fly some seeds and return their outcomes. Runs in a worker: the arguments are plain data."""
    player = kept_player(scenario_json, folder)
    if isinstance(player, Engine):
        return [compiled_outcome(player, seed) for seed in seeds]
    return [outcome(player.fly(seed)) for seed in seeds]


def fly_outcomes(
    wanted: Sequence[tuple[Scenario, Iterable[int]]],
    out: Path,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
) -> list[list[Outcome]]:
    """Fly scenarios and return their outcomes; arguments and errors as fly_kept's."""
    compiled = all(why_not(scenario) is None for scenario, _ in wanted)
    return fly_kept(Outcome, fly_outcomes_of, wanted, out, workers, progress, COMPILED_AT_ONCE if compiled else AT_ONCE)
