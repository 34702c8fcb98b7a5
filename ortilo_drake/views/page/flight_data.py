"""The data of a flight's page, as plain numbers."""

from typing import Any

import numpy as np
import xarray as xr

from ortilo_drake.flight.blackouts import in_blackout
from ortilo_drake.flight.flight import AXES, scenario_of
from ortilo_drake.model.room import Room
from ortilo_drake.scenario import PositionBlackout, Scenario
from ortilo_drake.views.figures import COLOR, OTHER, position_errors
from ortilo_drake.world.scenery.meshcat_replay import Zone

MOST_TICKS = 6000  # most ticks on a page; a longer flight is thinned, but its arrivals are not
LAMP_SECONDS = 0.2  # time for which a lamp stays lit after a fix [s]


def finite_part(flight: xr.Dataset) -> xr.Dataset:
    """Return a flight without the ticks whose state or estimate is not finite, as at the end of a diverged flight."""
    names = ("truth", "estimate")
    whole = np.all([np.isfinite(flight[name].values).all(axis=1) for name in names], axis=0)
    return flight.isel(tick=whole)


def shown_sensors(flight: xr.Dataset) -> list[str]:
    """Return the sensors, except the imu, that are due at least once."""
    return [str(s) for s in flight["sensor"].values if s != "imu" and flight["due"].sel(sensor=s).any()]


def sensor_color(sensor: str) -> str:
    """Return a sensor's colour as #RRGGBB."""
    return COLOR.get(sensor, OTHER)


def intervals(time: np.ndarray, mask: np.ndarray) -> list[tuple[float, float]]:
    """Return the intervals [s] in which a mask over ticks is true; each ends at the first tick where it is false."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    last = len(time) - 1
    return [(float(time[a]), float(time[min(b, last)])) for a, b in edges.reshape(-1, 2)]


def flight_data(flight: xr.Dataset) -> dict[str, Any]:
    """Return times, positions, errors, arrivals and blackouts for the page's script; all numbers finite."""
    time, scenario = flight["time"].values, scenario_of(flight)
    error, sigma = position_errors(flight)
    shown = slice(0, None, -(-len(time) // MOST_TICKS))
    sensors = []
    for name in shown_sensors(flight):
        used, due = (flight[part].sel(sensor=name).values for part in ("arrival", "due"))
        sensors.append(
            {
                "name": name,
                "arrivals": np.round(time[used], 4).tolist(),
                "missing": np.round(time[due & ~used], 4).tolist(),
                "blackouts": intervals(time, in_blackout(flight["truth"].values, scenario, name)),
            }
        )
    return {
        "time": np.round(time[shown], 4).tolist(),
        "truth": np.round(flight["truth"].values[shown, :3], 3).tolist(),
        "estimate": np.round(flight["estimate"].values[shown, :3], 3).tolist(),
        "error": np.round(error[shown], 4).tolist(),
        "sigma": np.round(sigma[shown], 4).tolist(),
        "sensors": sensors,
        "lampSeconds": LAMP_SECONDS,
    }


def blackout_zones(scenario: Scenario, room: Room) -> list[Zone]:
    """Return the strips of the floor where a sensor is blacked out by position in x or y."""
    zones = []
    for sensor in scenario.sensors:
        code = sensor_color(sensor)
        color = (int(code[1:3], 16) / 255, int(code[3:5], 16) / 255, int(code[5:7], 16) / 255)
        for blackout in scenario.link_of(sensor).blackouts:
            if not isinstance(blackout, PositionBlackout) or blackout.axis == "z":
                continue
            i = AXES.index(blackout.axis)
            low, high = list(room.interior.min[:2]), list(room.interior.max[:2])
            low[i], high[i] = max(low[i], blackout.start), min(high[i], blackout.end)
            if low[i] < high[i]:
                zones.append(Zone((low[0], low[1]), (high[0], high[1]), color))
    return zones
