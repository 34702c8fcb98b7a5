"""Flights by Drake's Simulator: each seed of a scenario gives an xarray Dataset."""

import gc
import json
import time
from collections.abc import Callable, Hashable, Iterator
from functools import lru_cache
from typing import Any

import numpy as np
import xarray as xr
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.trajectories import Trajectory

from ortilo_drake import __version__
from ortilo_drake.diagrams.closed_loop import ClosedLoop
from ortilo_drake.diagrams.onboard import NO_PARTS, Parts
from ortilo_drake.flight.flyable import check_flyable
from ortilo_drake.flight.lost import Lost, find_loss
from ortilo_drake.model.measurement import Measurement
from ortilo_drake.model.parts import registered
from ortilo_drake.model.signals import CONTROL_NAMES, N_X, STATE_NAMES, XBAR_NAMES
from ortilo_drake.onboard.planner.planned import planned
from ortilo_drake.scenario import Scenario, with_seed
from ortilo_drake.scenario.scenario import FORMAT, scenario_from_json
from ortilo_drake.sensors.imu import standstill_of
from ortilo_drake.world.vehicle.continuous import steps_a_tick

CHECK_EVERY = 30  # number of ticks between two checks for a loss


def make_simulator(diagram: ClosedLoop, scenario: Scenario) -> Simulator:
    """Return a simulator of a closed loop, with its own Context, the scenario's seed and a vehicle that hovers.

    A sampled plant leaves Drake nothing to integrate. A continuous plant gets one third-order Runge-Kutta step a tick,
    whose error is far below any noise here; a plant with rotors, whose lag is shorter than a tick, gets four. The
    diagram is the closed loop of the scenario; the seed that it was built with does not matter.
    """
    simulator = Simulator(diagram)
    fix_steps(simulator, scenario)
    diagram.SetSeed(simulator.get_mutable_context(), scenario.seed)
    return simulator


def fix_steps(simulator: Simulator, scenario: Scenario) -> None:
    """Set the integrator and step of a simulator; see make_simulator."""
    step = scenario.h / steps_a_tick(scenario)
    config = SimulatorConfig(integration_scheme="runge_kutta3", max_step_size=step, use_error_control=False)
    ApplySimulatorConfig(config, simulator)


def advance(
    simulator: Simulator, scenario: Scenario, ticks: int, progress: Callable[[int], None] | None
) -> tuple[Lost | None, float]:
    """Fly `ticks` ticks, or until the flight is lost; return the loss and the wall time spent in AdvanceTo [s]."""
    room, diagram, context = scenario.load_room(), simulator.get_system(), simulator.get_context()
    state = diagram.GetOutputPort("state")
    simulator.Initialize()
    wall = 0.0
    for k in range(0, ticks, CHECK_EVERY):
        end = min(k + CHECK_EVERY, ticks)
        # Python notices Ctrl-C between two calls of AdvanceTo; having Drake look for it costs more.
        started = time.perf_counter()
        simulator.AdvanceTo(end * scenario.h, interruptible=False)
        wall += time.perf_counter() - started
        if progress:
            progress(end)
        if find_loss(state.Eval(context)[np.newaxis], scenario.h, room, scenario.vehicle):
            break
    log = diagram.FindLog(context)
    return find_loss(log.data()[: len(STATE_NAMES)].T, scenario.h, room, scenario.vehicle), wall


AXES = ("x", "y", "z")
_UNITS = "x, y, z in m; phi, theta, psi in rad; their rates per s"


class FlightSimulator:
    """The closed loop of a scenario, built once; it flies one seed after the other.

    A Diagram takes a tenth of a second to build and 4 MiB, with a renderer twenty times as much, which Drake 1.51 never
    frees. Each flight gets its own Context, which holds its seed, its start and every evolving value, so earlier
    flights change nothing. The scenario's own seed is not used. A Meshcat shows each flight live; the flight is then
    paced by the wall clock. `parts` are an estimator, servo and planner in place of the scenario's, see
    diagrams/onboard.py. With `fused` all elements of a half are one system, which is faster, else each element is a
    system. InputError if the scenario cannot be flown, see check_flyable.
    """

    def __init__(self, scenario: Scenario, meshcat: Meshcat | None = None, parts: Parts = NO_PARTS, fused: bool = True):
        self._scenario, self._is_live = scenario, meshcat is not None
        self._name = "drake" if fused else "drake-elements"
        plan = planned(scenario, parts.planner)
        self._ticks = check_flyable(scenario, plan)
        path = plan if isinstance(plan, Trajectory) else None
        self._diagram = ClosedLoop(scenario, path, meshcat, parts, fused)
        # A throwaway start: numba's compilation must not count as flying time, and VTK's very first picture of a scene
        # differs from the later ones in the last bits of a few pixels.
        make_simulator(self._diagram, scenario).AdvanceTo(3.5 * scenario.h)

    def fly(self, seed: int, progress: Callable[[int], None] | None = None) -> xr.Dataset:
        """Fly one seed.

        InputError if the seed is not allowed.

        Args:
            seed: the seed of all noise.
            progress: called with the number of ticks flown.

        Returns:
            A Dataset over ticks; see flight_dataset. The same seed gives the same numbers bit for bit, whichever
            player flies it (players.py); only the attributes `player` and `real_time_factor` differ.
        """
        scenario = with_seed(self._scenario, seed)
        simulator = make_simulator(self._diagram, scenario)
        if self._is_live:
            simulator.set_target_realtime_rate(1.0)
        collects = gc.isenabled()
        gc.disable()  # a flight makes no reference cycles; looking for them takes a twentieth of its time
        try:
            lost, wall = advance(simulator, scenario, self._ticks, progress)
        finally:
            if collects:
                gc.enable()
        log = self._diagram.FindLog(simulator.get_context())
        end = lost.tick + 1 if lost else self._ticks + 1
        dataset = flight_dataset(scenario, log.sample_times()[:end], log.data().T[:end], lost)
        dataset.attrs |= {"player": self._name, "real_time_factor": simulator.get_context().get_time() / wall}
        return dataset


def fly(
    scenario: Scenario,
    progress: Callable[[int], None] | None = None,
    meshcat: Meshcat | None = None,
    parts: Parts = NO_PARTS,
) -> xr.Dataset:
    """Fly one scenario with its own seed in Drake's Simulator; for many seeds make one FlightSimulator instead.

    InputError if the scenario cannot be flown, see check_flyable.

    Args:
        scenario: the scenario.
        progress: called with the number of ticks flown.
        meshcat: shows the flight live; the flight is then paced by the wall clock.
        parts: estimator, servo and planner in place of the scenario's.

    Returns:
        A Dataset over ticks; see FlightSimulator.fly.
    """
    return FlightSimulator(scenario, meshcat, parts).fly(scenario.seed, progress)


def flight_dataset(scenario: Scenario, times: np.ndarray, logged: np.ndarray, lost: Lost | None) -> xr.Dataset:
    """Return the log of a closed loop as a Dataset over ticks; `logged_rows` is the inverse.

    The log has a row for each time t_k (n) [s]; the signals of a row stand in the order of the scenario's
    measurement.logged_sizes(). `lost` says when and why the flight ended early, if it did.
    """
    measurement = scenario.measurement
    sizes, sensors = measurement.logged_sizes(), measurement.sensors
    signal = dict(zip(sizes, np.split(logged, np.cumsum(list(sizes.values()))[:-1], axis=1), strict=True))
    n = len(times)
    y, delta, estimate = signal["y"], signal["delta"] > 0, signal["estimate"]
    there = measurement.by_row(delta)
    predicted = estimate[:, :N_X] @ measurement.layout.C.T
    due = np.array([[k % scenario.every(s) == 0 and s in scenario.sensors for s in sensors] for k in range(n)])
    reference = signal["reference"].reshape(n, 3, 3)

    def series(dimensions: str, values: np.ndarray, units: str, meaning: str | None = None) -> xr.Variable:
        attributes = {"units": units} | ({} if meaning is None else {"long_name": meaning})
        return xr.Variable(("tick", *dimensions.split()), values, attributes)

    P, V2 = signal["covariance"].reshape(n, 15, 15), padded_covariances(measurement, signal["V2"])
    measured, innovation = np.where(there, y, np.nan), np.where(there, y - predicted, np.nan)
    innovation_is = "Delta_k y_k - H_k xhat_k|k-1, NaN where nothing arrived"
    return xr.Dataset(
        {
            "truth": series("state", signal["state"], _UNITS, "true state x_k"),
            "estimate": series("xbar", estimate, _UNITS + "; i in m ticks", "prediction xhat_k|k-1"),
            "covariance": series(
                "xbar xbar_column", P, "products of the estimate's", "covariance P_k of the prediction"
            ),
            "control": series(
                "control_name", signal["control"], "f_T in N; tau in N m", "commanded control u_k, f_T absolute"
            ),
            "reference": series("axis", reference[:, 0], "m", "planned position r_k"),
            "reference_velocity": series("axis", reference[:, 1], "m/s"),
            "reference_acceleration": series("axis", reference[:, 2], "m/s^2"),
            "measurement": series(
                "output", measured, "positions in m; angles in rad", "y_k, NaN where nothing arrived"
            ),
            "innovation": series("output", innovation, "as measurement", innovation_is),
            "measurement_covariance": series(
                "sensor row column", V2, "m^2, rad^2", "V_2 of each sensor, NaN beyond its rows"
            ),
            "arrival": series("sensor", delta, "1", "delta_k: used by the filter"),
            "due": series("sensor", due, "1", "the sensor's rate has it send in this tick"),
        },
        coords={
            "time": ("tick", times, {"units": "s"}),
            "state": list(STATE_NAMES),
            "xbar": list(XBAR_NAMES),
            "xbar_column": list(XBAR_NAMES),
            "control_name": list(CONTROL_NAMES),
            "axis": list(AXES),
            "output": list(measurement.outputs),
            "sensor": list(sensors),
        },
        attrs={
            "title": "A flight of ortilo-drake",
            "software": f"ortilo-drake {__version__}",
            "scenario": scenario.model_dump_json(),
            "format": FORMAT,
            "seed": scenario.seed,
            "lost": json.dumps(None if lost is None else {"time": lost.time, "cause": lost.cause}),
            **standstill_attrs(scenario),
            "frames": "W: east, north, up; B: forward, left, up",
        },
    )


def standstill_attrs(scenario: Scenario) -> dict[str, str]:
    """Return a flight's attribute `standstill`: seconds, samples, the rates and specific force subtracted; or {}."""
    found = standstill_of(scenario, scenario.load_room()) if scenario.samples_at_rest else {}
    return {"standstill": json.dumps(found)} if found else {}


def padded_covariances(measurement: Measurement, V2: np.ndarray) -> np.ndarray:
    """Return each sensor's covariance at each tick (n, s, m, m); m is the most rows of a sensor, NaN beyond its own."""
    rows = [measurement.rows_of(sensor) for sensor in measurement.sensors]
    most = max(r.stop - r.start for r in rows)
    padded = np.full((len(V2), len(rows), most, most), np.nan)
    for j, sensor in enumerate(measurement.sensors):
        m = rows[j].stop - rows[j].start
        padded[:, j, :m, :m] = V2[:, measurement.block_of(sensor)].reshape(-1, m, m)
    return padded


def logged_rows(flight: xr.Dataset) -> Iterator[dict[str, np.ndarray]]:
    """Yield the signals of measurement.logged_sizes() at each tick of a flight: the inverse of flight_dataset."""
    measurement, n = scenario_of(flight).measurement, flight.sizes["tick"]
    V2 = flight["measurement_covariance"].values
    m = [V2[:, j] for j in range(V2.shape[1])]
    references = [flight[name].values for name in ("reference", "reference_velocity", "reference_acceleration")]
    parts = {
        "state": flight["truth"].values,
        "control": flight["control"].values,
        "y": np.nan_to_num(flight["measurement"].values),
        "delta": flight["arrival"].values.astype(float),
        "V2": np.hstack([m[j][:, :k, :k].reshape(n, -1) for j, k in enumerate(np.diff(measurement.layout.first))]),
        "estimate": flight["estimate"].values,
        "covariance": flight["covariance"].values.reshape(n, -1),
        "reference": np.hstack(references),
    }
    for k in range(n):
        yield {name: values[k] for name, values in parts.items()}


def scenario_of(flight: xr.Dataset) -> Scenario:
    """Return the scenario that a flight carries; InputError if its text is no valid scenario.

    The last few scenarios are cached: a summary asks nine times.
    """
    return _read_scenario(flight.attrs["scenario"], flight.attrs.get("format"), registered())


@lru_cache(maxsize=4)
def _read_scenario(text: str, version: Any, parts: Hashable) -> Scenario:
    """Return a flight's scenario. `parts` are the registered parts, on which the meaning of the text depends."""
    return scenario_from_json(text, version, "scenario")
