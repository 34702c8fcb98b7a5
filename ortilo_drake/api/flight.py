"""One flight: flown, looked at, and written in other people's formats."""

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
        data: its Dataset.

    Attributes:
        data: an xarray Dataset with a row for each tick: truth (12), estimate (15), covariance (15, 15), control (4),
            reference (3), its velocity and acceleration; measurement and innovation (a column for each row of y, NaN
            where nothing arrived); due and arrival (a column for each sensor). Names and units as in to_pandas.
    """

    def __init__(self, data: xr.Dataset):
        self.data = data

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what to_netcdf or `ortilo fly --out` wrote; InputError if it is damaged or no flight."""
        return cls(saved_flight.load_flight(Path(path)))

    @property
    def scenario(self) -> Scenario:
        """The scenario flown, its seed included."""
        return flight.scenario_of(self.data)

    @property
    def seed(self) -> int:
        """The seed of all noise."""
        return int(self.data.attrs["seed"])

    @property
    def player(self) -> str | None:
        """The player that flew it: 'engine', 'drake' or 'drake-elements'; None if unknown, as for a log."""
        found: str | None = self.data.attrs.get("player")
        return found

    @property
    def lost(self) -> dict[str, Any] | None:
        """Time [s] and cause of the loss; None for a flight that reached its end."""
        found: dict[str, Any] | None = json.loads(self.data.attrs["lost"])
        return found

    @property
    def error(self) -> xr.DataArray:
        """The estimate of the position minus the truth at every tick (tick, axis) [m]."""
        axes = list(flight.AXES)
        estimate = self.data["estimate"].sel(xbar=axes).rename(xbar="axis")
        error = (estimate - self.data["truth"].sel(state=axes).rename(state="axis")).rename("error")
        return error.assign_attrs(units="m", long_name="error of the estimated position")

    @property
    def errors(self) -> xr.DataArray:
        """The estimated state minus the true one (tick, state), angles in [-pi, pi); `unit` is each state's."""
        estimate = self.data["estimate"].sel(xbar=list(STATE_NAMES)).rename(xbar="state")
        errors = (estimate - self.data["truth"]).rename("errors")
        angles = {"state": list(STATE_NAMES[3:6])}
        errors.loc[angles] = np.remainder(errors.loc[angles] + np.pi, 2.0 * np.pi) - np.pi
        return _with_units(errors, "error of the estimate")

    @property
    def sigma(self) -> xr.DataArray:
        """The standard deviations of errors by the filter's own covariance (tick, state); `unit` is each state's."""
        variances = np.diagonal(self.data["covariance"].values, axis1=1, axis2=2)[:, : len(STATE_NAMES)]
        sigma = xr.zeros_like(self.data["truth"]).copy(data=np.sqrt(variances)).rename("sigma")
        return _with_units(sigma, "standard deviation")

    def summary(self) -> dict[str, Any]:
        """Return the figures of the flight, as `ortilo fly --json` writes them; those of a lost flight end at its loss.

        lost                        time [s] and cause, or None
        contacts                    furniture that the vehicle touched
        mse                         mean squared error of the estimated position, by axis [m^2]
        floor                       the Cramer-Rao floor of that [m^2]
        efficiency                  mse / floor; tick_efficiency: the mean over ticks of squared error / floor
        path_mse                    mean squared distance from the path [m^2], sideways as in the paper
        path_distance_mse           the same to the nearest point of the path
        max_path_distance           farthest from the path [m]
        max_reference_distance      farthest from where it should have been at that time [m]
        arrivals                    by sensor, the share of the expected messages that the filter used
        fix_errors                  by sensor, median and 95th percentile of its position fixes' error [m]
        nees, nis                   3 if the filter is consistent; the NIS by sensor, its number of rows
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
        """Return a figure of the error along an axis and the filter's own sd over time, UWB blackouts shaded."""
        flights = {f"{self.scenario.name}, seed {self.seed}": self.data}
        return in_theme(lambda: draw_blackout_errors(flights, axis), theme)

    def plot_availability(self, theme: str = "light") -> Figure:
        """Return a figure along x of the camera fixes' errors and of the share of due fixes that were used."""
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
        """Return a row for each tick, over time [s]; all at t_k, before the measurements of the tick correct it.

        A column is named signal.component; the table's `attrs["units"]` has each column's unit.

            truth.x ... truth.psi_dot             the state x_k [m, rad, m/s, rad/s]
            estimate.x ... estimate.i_z           the prediction of it; the servo's integrals, sums over ticks [m]
            control.f_T, control.tau_x ...        commanded thrust [N] and torques [N m]
            reference.x ...                       the planned position [m]
            reference_velocity.x ...              its velocity [m/s]
            reference_acceleration.x ...          its acceleration [m/s^2]
            due.uwb ...                           True where the sensor sends in this tick, by its rate
            arrival.uwb ...                       True where the filter used what arrived, delta_k
            measurement.x_uwb ...                 y_k, NaN where nothing arrived [m, rad, ...]
            innovation.x_uwb ...                  y_k less the filter's prediction, NaN where nothing arrived
            covariance.x.x, covariance.x.y ...    upper triangle of P_k, the estimate's covariance [m^2, m rad, ...]
        """
        return flight_table(self.data)

    def to_csv(self, path: str | Path) -> Path:
        """Write the table of to_pandas as CSV, True as 1 and False as 0, every digit of a number; return the path."""
        table = self.to_pandas()
        numbers = table.astype(dict.fromkeys(table.select_dtypes(bool), int))
        write_text(Path(path), numbers.to_csv(na_rep="nan", lineterminator="\n"))
        return Path(path)

    def to_tum(self, path: str | Path, of: str = "estimate") -> Path:
        """Write a trajectory in the format of TUM's RGB-D benchmark, which evo reads; return the path.

        A line a tick: t x y z qx qy qz qw, p_WB [m] and the attitude R_WB.

        Args:
            path: the file.
            of: 'estimate' or 'truth'.
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
        """Write truth, estimates, control and reference as a log for ROS 2 and Foxglove to a new folder; return it.

        A flight does not keep the sensors' messages: `ortilo fly --log` writes those too.
        """
        with LogWriter(Path(folder), self.scenario) as log:
            for k, row in enumerate(flight.logged_rows(self.data)):
                log.write_tick(k, row.pop("state"), {}, row)
        return Path(folder)

    def to_rerun(self, path: str | Path) -> Path:
        """Write the flight as a recording for the Rerun viewer, .rrd; return the path.

        A rendered camera's pictures are drawn again. Ranges are not kept: `ortilo fly --rerun` writes those too.
        """
        check_recording(Path(path))
        save_recording(self.data, drawn_again(self.data, make_camera_view), Path(path))
        return Path(path)

    def __repr__(self) -> str:
        error = float(np.sqrt(np.nanmean(np.sum(self.error.values**2, axis=1))))
        how = f"{float(self.data['time'].values[-1]):.1f} s, {ending(self.data)}"
        return f"<Flight {self.scenario.name}, seed {self.seed}: {how}, RMS error {error:.3f} m>"


_UNIT_OF = [unit for unit in ("m", "rad", "m/s", "rad/s") for _ in range(3)]  # of STATE_NAMES


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
    """Fly a scenario once, also with parts of your own.

        >>> import ortilo_drake as od
        >>> hover = {"kind": "hover", "duration": 0.5}
        >>> flight = od.fly("nominal_imu_uwb_yolo", seed=3, camera__kind="projected", planner=hover, settle=0.0)
        >>> flight.lost is None
        True
        >>> flight.error.sizes["tick"]  # at 30 Hz, with the first and the last tick
        16

    Args:
        scenario: name of a scenario that comes with the package, a file, or a Scenario.
        settings: changes as the command line takes them: "vehicle.mass=1.2", several of these, or a mapping.
        seed: seed of all noise; by default the scenario's own.
        progress: called with the number of ticks flown.
        estimator: makes, of what onboard may know (Belief) and the state at the start, a System in place of the
            scenario's estimator; or its settings, as {"kind": "intermittent"}.
        servo: makes a System in place of the scenario's servo, of the Belief; or its settings.
        planner: makes the path, or the System that gives the reference, of the Belief; or its settings.
        player: 'engine' flies compiled code, 'drake' a Drake Diagram whose halves are compiled, 'drake-elements' one
            with a system for each element; 'fastest' takes the engine where it can. The flight is the same.
        changes: settings by keyword, two underscores for the dot: `uwb__link__loss=0.3`.

    Raises:
        InputError: if the scenario is wrong, or the player cannot fly it.
    """
    parts: dict[str, Any] = {"estimator": estimator, "servo": servo, "planner": planner}
    changes |= {role: part for role, part in parts.items() if part is not None and not callable(part)}
    chosen = Parts(**{role: part if callable(part) else None for role, part in parts.items()})
    return Flight(players.fly(load_scenario(scenario, settings, seed, **changes), progress, player, chosen))
