"""One flight: how to fly it, look at it, and write it in other people's formats."""

from __future__ import annotations  # help() shows types by their names

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Self

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure
from pydrake.math import RollPitchYaw
from pydrake.systems.framework import System

from ortilo_drake.diagrams.onboard import Parts
from ortilo_drake.flight import flight, metrics, players, saved_flight
from ortilo_drake.flight.files import write_text
from ortilo_drake.flight.flight_table import flight_table
from ortilo_drake.flight.verdict import ending
from ortilo_drake.interop.log.writer import LogWriter
from ortilo_drake.interop.rerun.recording import check_recording, save_recording
from ortilo_drake.interop.rerun.sightings import drawn_again
from ortilo_drake.model.signals import STATE_NAMES
from ortilo_drake.onboard.planner.planned import Planned
from ortilo_drake.scenario import Belief, InputError, Scenario, load_scenario
from ortilo_drake.scenario.load import Settings
from ortilo_drake.views.blackout_figures import draw_availability, draw_blackout_errors
from ortilo_drake.views.figures import draw_flight
from ortilo_drake.views.page.flight_page import flight_page
from ortilo_drake.views.scene_view import make_camera_view
from ortilo_drake.views.themes import in_theme


class Flight:
    """One flight.

    Args:
        data: the Dataset of the flight.

    Attributes:
        data: an xarray Dataset with a row for each tick: truth (12), estimate (15), covariance (15, 15), control (4),
            reference (3) with its velocity and acceleration; measurement and innovation (a column for each row of y,
            NaN where nothing arrived); due and arrival (a column for each sensor). Names and units as in to_pandas.
    """

    def __init__(self, data: xr.Dataset):
        self.data = data

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a file of to_netcdf or `ortilo fly --out`; InputError if the file is damaged or holds no flight."""
        return cls(saved_flight.load_flight(Path(path)))

    @property
    def scenario(self) -> Scenario:
        """The scenario that was flown, with its seed."""
        return flight.scenario_of(self.data)

    @property
    def seed(self) -> int:
        """The seed of all noise."""
        return int(self.data.attrs["seed"])

    @property
    def player(self) -> str | None:
        """The player of the flight: 'engine', 'drake' or 'drake-elements'; None if unknown, as for a log."""
        found: str | None = self.data.attrs.get("player")
        return found

    @property
    def lost(self) -> dict[str, Any] | None:
        """Time [s] and cause of the loss; None for a flight that reached its end."""
        found: dict[str, Any] | None = json.loads(self.data.attrs["lost"])
        return found

    @property
    def error(self) -> xr.DataArray:
        """The estimated minus the true position p_WB at every tick (tick, axis) [m]."""
        axes = list(flight.AXES)
        estimate = self.data["estimate"].sel(xbar=axes).rename(xbar="axis")
        error = (estimate - self.data["truth"].sel(state=axes).rename(state="axis")).rename("error")
        return error.assign_attrs(units="m", long_name="error of the estimated position")

    @property
    def errors(self) -> xr.DataArray:
        """The estimated minus the true state (tick, state), angles in [-pi, pi); coordinate `unit` has the units."""
        estimate = self.data["estimate"].sel(xbar=list(STATE_NAMES)).rename(xbar="state")
        errors = (estimate - self.data["truth"]).rename("errors")
        angles = {"state": list(STATE_NAMES[3:6])}
        errors.loc[angles] = np.remainder(errors.loc[angles] + np.pi, 2.0 * np.pi) - np.pi
        return _with_units(errors, "error of the estimate")

    @property
    def sigma(self) -> xr.DataArray:
        """The errors' standard deviations by the filter's covariance (tick, state); coordinate `unit` has the units."""
        variances = np.diagonal(self.data["covariance"].values, axis1=1, axis2=2)[:, : len(STATE_NAMES)]
        sigma = xr.zeros_like(self.data["truth"]).copy(data=np.sqrt(variances)).rename("sigma")
        return _with_units(sigma, "standard deviation")

    def summary(self) -> dict[str, Any]:
        """Return the figures of the flight, as `ortilo fly --json` writes them; for a lost flight, up to its loss.

        lost                        time [s] and cause, or None
        contacts                    furniture that the vehicle touched
        mse                         mean squared error of the estimated position, by axis [m^2]
        floor                       Cramer-Rao floor of mse, by axis [m^2]
        efficiency                  mse / floor; tick_efficiency: the mean over ticks of squared error / floor
        path_mse                    mean squared distance from the path [m^2], sideways as in the paper
        path_distance_mse           mean squared distance from the nearest point of the path [m^2]
        max_path_distance           largest distance from the path [m]
        max_reference_distance      largest distance from the reference at the same time [m]
        arrivals                    by sensor, the share of the expected messages that the filter used
        fix_errors                  by sensor, median and 95th percentile of the error of its position fixes [m]
        nees, nis                   means; of a consistent filter 3, and by sensor the number of its rows
        real_time_factor            seconds of flight computed in a second
        """
        return asdict(metrics.summary(self.data))

    def plot(self, theme: str = "light") -> Figure:
        """Return a figure of the path, the errors in their 3-sigma bands and the arrivals.

        Args:
            theme: 'light', 'dark', 'slides' or 'print', as the command line's --theme.
        """
        return in_theme(lambda: draw_flight(self.data), theme)

    def plot_blackouts(self, axis: str = "x", theme: str = "light") -> Figure:
        """Return a figure of the error along an axis and the filter's sd [m] over time, with UWB blackouts shaded."""
        flights = {f"{self.scenario.name}, seed {self.seed}": self.data}
        return in_theme(lambda: draw_blackout_errors(flights, axis), theme)

    def plot_availability(self, theme: str = "light") -> Figure:
        """Return a figure of the camera fixes' errors [m] and the used share of due fixes, both over x."""
        return in_theme(lambda: draw_availability(self.data), theme)

    def to_netcdf(self, path: str | Path) -> Path:
        """Write the flight as netCDF with a digest; return the path."""
        saved_flight.save_flight(self.data, Path(path))
        return Path(path)

    def to_html(self, path: str | Path) -> Path:
        """Write the flight as one self-contained page that plays it, as `ortilo fly --html` does; return the path."""
        write_text(Path(path), flight_page(self.data))
        return Path(path)

    def to_pandas(self) -> pd.DataFrame:
        """Return a table with a row for each tick t_k [s]; estimates are those before the measurements of the tick.

        A column is named signal.component; the table's `attrs["units"]` has each column's unit.

            truth.x ... truth.psi_dot             the state x_k [m, rad, m/s, rad/s]
            estimate.x ... estimate.i_z           the predicted state; the servo's integrals, sums over ticks [m]
            control.f_T, control.tau_x ...        commanded thrust [N] and torques [N m]
            reference.x ...                       the planned position [m]
            reference_velocity.x ...              the planned velocity [m/s]
            reference_acceleration.x ...          the planned acceleration [m/s^2]
            due.uwb ...                           True where the sensor's rate has it send in this tick
            arrival.uwb ...                       delta_k, True where a message arrived and the filter used it
            measurement.x_uwb ...                 y_k, NaN where nothing arrived [m, rad, ...]
            innovation.x_uwb ...                  y_k minus the filter's prediction, NaN where nothing arrived
            covariance.x.x, covariance.x.y ...    upper triangle of P_k, the estimate's covariance [m^2, m rad, ...]
        """
        return flight_table(self.data)

    def to_csv(self, path: str | Path) -> Path:
        """Write the table of to_pandas as CSV, booleans as 1 and 0, numbers with every digit; return the path."""
        table = self.to_pandas()
        numbers = table.astype(dict.fromkeys(table.select_dtypes(bool), int))
        write_text(Path(path), numbers.to_csv(na_rep="nan", lineterminator="\n"))
        return Path(path)

    def to_tum(self, path: str | Path, of: str = "estimate") -> Path:
        """Write a trajectory in the format of the TUM RGB-D benchmark, which evo reads; return the path.

        Each tick has a line `t x y z qx qy qz qw`: the time [s], p_WB [m] and the attitude R_WB as a quaternion.

        Args:
            path: the file.
            of: the trajectory, 'estimate' or 'truth'.
        """
        if of not in ("estimate", "truth"):
            raise InputError(f"of: {of!r}: must be 'estimate' or 'truth'")
        lines = []
        for t, x in zip(self.data["time"].values, self.data[of].values, strict=True):
            q = RollPitchYaw(x[3:6]).ToQuaternion()
            lines.append(" ".join(f"{value:.9f}" for value in (t, *x[:3], q.x(), q.y(), q.z(), q.w())))
        write_text(Path(path), "\n".join(lines) + "\n")
        return Path(path)

    def to_mcap(self, folder: str | Path) -> Path:
        """Write truth, estimates, control and reference to a new folder, a log for ROS 2 and Foxglove; return its path.

        A flight does not keep the messages of sensors: `ortilo fly --log` writes a log with them.
        """
        with LogWriter(Path(folder), self.scenario) as log:
            for k, row in enumerate(flight.logged_rows(self.data)):
                log.write_tick(k, row.pop("state"), {}, row)
        return Path(folder)

    def to_rerun(self, path: str | Path) -> Path:
        """Write the flight as a recording for the Rerun viewer (.rrd); return the path.

        A rendered camera's pictures are drawn again. A flight keeps no ranges: `ortilo fly --rerun` writes them too.
        """
        check_recording(Path(path))
        save_recording(self.data, drawn_again(self.data, make_camera_view), Path(path))
        return Path(path)

    def __repr__(self) -> str:
        error = float(np.sqrt(np.nanmean(np.sum(self.error.values**2, axis=1))))
        how = f"{float(self.data['time'].values[-1]):.1f} s, {ending(self.data)}"
        return f"<Flight {self.scenario.name}, seed {self.seed}: {how}, RMS error {error:.3f} m>"


_UNIT_OF = [unit for unit in ("m", "rad", "m/s", "rad/s") for _ in range(3)]  # units in the order of STATE_NAMES


def _with_units(values: xr.DataArray, long_name: str) -> xr.DataArray:
    """Return values (tick, state) with a label for plots and the unit of each state."""
    named = values.assign_coords(unit=("state", _UNIT_OF))
    named.attrs = {"long_name": long_name, "units": ", ".join(dict.fromkeys(_UNIT_OF))}
    return named


def fly(
    scenario: str | Path | Scenario = "imu_uwb_yolo",
    settings: Settings = (),
    *,
    seed: int | None = None,
    progress: Callable[[int], None] | None = None,
    estimator: Callable[[Belief, np.ndarray], System] | Mapping[str, Any] | None = None,
    servo: Callable[[Belief], System] | Mapping[str, Any] | None = None,
    planner: Callable[[Belief], Planned] | Mapping[str, Any] | None = None,
    player: str = "fastest",
    **changes: Any,
) -> Flight:
    """Fly a scenario once, if you like with your own parts.

        >>> import ortilo_drake as od
        >>> hover = {"kind": "hover", "duration": 0.5}
        >>> flight = od.fly("nominal_imu_uwb_yolo", seed=3, camera__kind="projected", planner=hover, settle=0.0)
        >>> flight.lost is None
        True
        >>> flight.error.sizes["tick"]  # at 30 Hz, with the first and the last tick
        16

    Args:
        scenario: the name of a scenario that comes with the package, a .yaml file, or a Scenario.
        settings: changes in the form of the command line, "vehicle.mass=1.2", a list of them, or a mapping.
        seed: the seed of all noise; by default the scenario's own.
        progress: called with the number of ticks flown.
        estimator: a function (Belief, first estimate xbar_0 (15)) -> System that replaces the scenario's estimator; or
            settings of an estimator, such as {"kind": "intermittent"}. The Belief is what onboard may know.
        servo: a function Belief -> System that replaces the scenario's servo; or settings of a servo.
        planner: a function Belief -> path p_WB(t), or System whose output is the reference; or settings of a planner.
        player: 'engine' flies compiled code, 'drake' a Drake Diagram whose halves are compiled, 'drake-elements' a
            Diagram with a system for each element; 'fastest' takes the engine where it can. The flight is the same.
        changes: settings by keyword, with two underscores for the dot: `uwb__link__loss=0.3`.

    Raises:
        InputError: if the scenario is wrong, or the player cannot fly it.
    """
    parts: dict[str, Any] = {"estimator": estimator, "servo": servo, "planner": planner}
    changes |= {role: part for role, part in parts.items() if part is not None and not callable(part)}
    chosen = Parts(**{role: part if callable(part) else None for role, part in parts.items()})
    return Flight(players.fly(load_scenario(scenario, settings, seed, **changes), progress, player, chosen))
