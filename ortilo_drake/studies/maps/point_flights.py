"""The figures of a point's flights: by the compiled engine where it can, by Drake where it cannot."""

import numpy as np
import xarray as xr

from ortilo_drake.flight.engine import Engine
from ortilo_drake.flight.figures import ESTIMATED, FIGURES, NEES, TRACE_SIZE, TRUE, figures_of
from ortilo_drake.flight.flight import scenario_of
from ortilo_drake.flight.lost import CAUSES, NOT_LOST
from ortilo_drake.flight.metrics import loss_of, position_nees
from ortilo_drake.flight.players import kept_player
from ortilo_drake.scenario import Scenario


def columns_of(scenario: Scenario) -> tuple[str, ...]:
    """Return the names of the figures of a flight: those of the engine, see flight/engine.py."""
    flying = [name for name in scenario.measurement.sensors if name in scenario.sensors]
    return (*FIGURES, *(f"{what}_{sensor}" for sensor in flying for what in ("arrived", "due")))


def fly_figures(scenario_json: str, seeds: range, folder: str) -> np.ndarray:
    """Fly seeds and return the figures of each (n, columns). Runs in a worker: the arguments are plain data."""
    player = kept_player(scenario_json, folder)
    if isinstance(player, Engine):
        return player.figures(seeds)
    return np.array([drake_figures(player.fly(seed)) for seed in seeds])


def drake_figures(flight: xr.Dataset) -> list[float]:
    """Return the figures of a flight of Drake's, as the engine has them."""
    scenario = scenario_of(flight)
    truth, estimate = flight["truth"].values[:, :3], flight["estimate"].values[:, :3]
    trace = np.empty((len(truth), TRACE_SIZE))
    trace[:, TRUE], trace[:, ESTIMATED], trace[:, NEES] = truth, estimate, position_nees(flight)
    out = np.empty(len(FIGURES))
    figures_of(trace, np.ascontiguousarray(flight["reference"].values[:, :3]), out)
    loss, last = loss_of(flight), len(truth) - 1
    out[0], out[1] = last, NOT_LOST if loss is None else CAUSES.index(loss.cause)
    counts: list[float] = []
    for sensor in scenario.measurement.sensors:
        if sensor in scenario.sensors:
            counts += [float(flight["arrival"].sel(sensor=sensor).sum()), last // scenario.every(sensor) + 1]
    return [*out.tolist(), *counts]
