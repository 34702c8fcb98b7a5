"""One flight: a scenario in, an xarray Dataset out."""

import gc
import json
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import xarray as xr
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Context, Diagram

from ortilo_drake import __version__
from ortilo_drake.diagrams.closed_loop import LOGGED, make_closed_loop, set_hovering
from ortilo_drake.experiments.files import replacing
from ortilo_drake.experiments.lost import Lost, find_loss
from ortilo_drake.model.signals import (
    CONTROL_NAMES,
    MEASUREMENT_DELTA,
    MEASUREMENT_V2,
    MEASUREMENT_Y,
    OUTPUT_NAMES,
    SENSORS,
    STATE_NAMES,
)
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.planner import plan
from ortilo_drake.scenario import Scenario

AXES = ("x", "y", "z")
CHECK_EVERY = 30  # ticks between two looks at whether the flight is lost
XBAR_NAMES = (*STATE_NAMES, "i_x", "i_y", "i_z")
_UNITS = "x, y, z in m; phi, theta, psi in rad; their rates per s"


def flight_ticks(scenario: Scenario) -> int:
    """Return how many ticks a flight takes: its path and the time to settle; InputError if there is no path."""
    trajectory = plan(scenario.planner, scenario.load_room(), scenario.vehicle)
    return round((trajectory.end_time() + scenario.settle) * scenario.control_rate)


def make_simulator(diagram: Diagram, scenario: Scenario) -> Simulator:
    """Return a simulator of a closed loop that hovers at the start.

    A sampled plant leaves Drake nothing to integrate. A continuous one gets one third-order Runge-Kutta step a tick,
    whose error is far below any noise here; rotors, whose lag is shorter than a tick, get four.
    """
    simulator = Simulator(diagram)
    fix_steps(simulator, scenario)
    set_hovering(diagram, simulator.get_mutable_context(), scenario)
    return simulator


def fix_steps(simulator: Simulator, scenario: Scenario) -> None:
    """Give a simulator its integrator; see make_simulator."""
    steps = 4 if scenario.world.rotors.kind == "first_order" else 1
    config = SimulatorConfig(
        integration_scheme="runge_kutta3", max_step_size=scenario.h / steps, use_error_control=False
    )
    ApplySimulatorConfig(config, simulator)


def _advance(
    simulator: Simulator,
    diagram: Diagram,
    scenario: Scenario,
    ticks: int,
    progress: Callable[[int], None] | None,
) -> tuple[Lost | None, float]:
    """Fly that many ticks, or until the flight is lost; return the loss and the seconds spent in AdvanceTo."""
    room = scenario.load_room()
    context: Context = simulator.get_context()
    state = diagram.GetOutputPort("state")
    simulator.Initialize()
    wall = 0.0
    for k in range(0, ticks, CHECK_EVERY):
        end = min(k + CHECK_EVERY, ticks)
        # Ctrl-C is seen between two of these; asking Drake to look for it costs more.
        started = time.perf_counter()
        simulator.AdvanceTo(end * scenario.h, interruptible=False)
        wall += time.perf_counter() - started
        if progress:
            progress(end)
        if find_loss(state.Eval(context)[np.newaxis], scenario.h, room, scenario.vehicle):
            break
    log = diagram.GetSubsystemByName("log").FindLog(context)
    return find_loss(log.data()[: len(STATE_NAMES)].T, scenario.h, room, scenario.vehicle), wall


def fly(
    scenario: Scenario, progress: Callable[[int], None] | None = None, meshcat: Meshcat | None = None
) -> xr.Dataset:
    """Fly one scenario.

    Args:
        scenario: the scenario, its seed included.
        progress: called with the number of ticks flown.
        meshcat: shows the flight live; it is then paced by the wall clock.

    Returns:
        A Dataset over ticks; see flight_dataset. The same scenario gives the same numbers bit for bit; only the
        attribute real_time_factor differs.

    Raises:
        InputError: if the scenario has no path or no servo gain.
    """
    diagram = make_closed_loop(scenario, meshcat=meshcat)
    ticks = flight_ticks(scenario)
    # A throwaway start, so that numba's compilation is not taken for flying time.
    make_simulator(diagram, scenario).AdvanceTo(3.5 * scenario.h)

    simulator = make_simulator(diagram, scenario)
    if meshcat is not None:
        simulator.set_target_realtime_rate(1.0)
    collects = gc.isenabled()
    gc.collect()
    gc.disable()  # a flight makes no cycles, and looking for them costs it a twentieth of its time
    try:
        lost, wall = _advance(simulator, diagram, scenario, ticks, progress)
    finally:
        if collects:
            gc.enable()
    log = diagram.GetSubsystemByName("log").FindLog(simulator.get_context())
    end = lost.tick + 1 if lost else ticks + 1
    dataset = flight_dataset(scenario, log.sample_times()[:end], log.data().T[:end], lost)
    dataset.attrs["real_time_factor"] = simulator.get_context().get_time() / wall
    return dataset


def flight_dataset(scenario: Scenario, times: np.ndarray, logged: np.ndarray, lost: Lost | None) -> xr.Dataset:
    """Return the log of a closed loop as a Dataset over ticks.

    Args:
        scenario: the scenario flown.
        times: t_k (n).
        logged: the log's rows, signals in the order of closed_loop.LOGGED (n, 304).
        lost: when and why the flight ended early, if it did.
    """
    edges = np.cumsum([0, *LOGGED.values()])
    signal = {name: logged[:, edges[i] : edges[i + 1]] for i, name in enumerate(LOGGED)}
    n = len(times)
    y, delta = signal["measurement"][:, MEASUREMENT_Y], signal["measurement"][:, MEASUREMENT_DELTA] > 0
    V2 = signal["measurement"][:, MEASUREMENT_V2].reshape(n, 3, 3, 3)
    there = np.repeat(delta, 3, axis=1)
    estimate = signal["estimate"]
    predicted = estimate[:, [0, 1, 2, 0, 1, 2, 3, 4, 5]]
    ticks = np.arange(n)
    due = np.array([[k % scenario.link_of(s).every == 0 and s in scenario.sensors for s in SENSORS] for k in ticks])
    reference = signal["reference"].reshape(n, 3, 3)
    return xr.Dataset(
        {
            "truth": (("tick", "state"), signal["state"], {"units": _UNITS, "long_name": "true state x_k"}),
            "estimate": (
                ("tick", "xbar"),
                estimate,
                {"units": _UNITS + "; i in m ticks", "long_name": "prediction xhat_k|k-1"},
            ),
            "covariance": (
                ("tick", "xbar", "xbar_column"),
                signal["covariance"].reshape(n, 15, 15),
                {"units": "products of the estimate's", "long_name": "covariance P_k of the prediction"},
            ),
            "control": (
                ("tick", "control_name"),
                signal["control"],
                {"units": "f_T in N; tau in N m", "long_name": "commanded control u_k, f_T absolute"},
            ),
            "reference": (
                ("tick", "axis"),
                reference[:, 0],
                {"units": "m", "long_name": "planned position r_k"},
            ),
            "reference_velocity": (("tick", "axis"), reference[:, 1], {"units": "m/s"}),
            "reference_acceleration": (("tick", "axis"), reference[:, 2], {"units": "m/s^2"}),
            "measurement": (
                ("tick", "output"),
                np.where(there, y, np.nan),
                {"units": "positions in m; angles in rad", "long_name": "y_k, NaN where nothing arrived"},
            ),
            "innovation": (
                ("tick", "output"),
                np.where(there, y - predicted, np.nan),
                {
                    "units": "as measurement",
                    "long_name": "Delta_k y_k - H_k xhat_k|k-1, NaN where nothing arrived",
                },
            ),
            "measurement_covariance": (
                ("tick", "sensor", "row", "column"),
                V2,
                {"units": "m^2, rad^2", "long_name": "V_2 of each sensor"},
            ),
            "arrival": (
                ("tick", "sensor"),
                delta,
                {"units": "1", "long_name": "delta_k: used by the filter"},
            ),
            "due": (
                ("tick", "sensor"),
                due,
                {"units": "1", "long_name": "the sensor's rate has it send in this tick"},
            ),
        },
        coords={
            "time": ("tick", times, {"units": "s"}),
            "state": list(STATE_NAMES),
            "xbar": list(XBAR_NAMES),
            "control_name": list(CONTROL_NAMES),
            "axis": list(AXES),
            "output": list(OUTPUT_NAMES),
            "sensor": list(SENSORS),
        },
        attrs={
            "title": "A flight of ortilo-drake",
            "software": f"ortilo-drake {__version__}",
            "scenario": scenario.model_dump_json(),
            "seed": scenario.seed,
            "lost": json.dumps(None if lost is None else {"time": lost.time, "cause": lost.cause}),
            "frames": "W: east, north, up; B: forward, left, up",
        },
    )


def save_flight(flight: xr.Dataset, path: Path) -> None:
    """Write a flight to a netCDF file, under a temporary name first.

    Raises:
        InputError: if the folder cannot be written.
    """
    encoding = {name: {"zlib": True, "complevel": 1} for name in flight.data_vars}
    with replacing(path) as partial:
        flight.to_netcdf(partial, engine="h5netcdf", encoding=encoding)


def load_flight(path: Path) -> xr.Dataset:
    """Read a flight that save_flight wrote.

    Raises:
        InputError: if the file is missing or is not such a flight.
    """
    if not path.exists():
        raise InputError(f"{path}: no such flight")
    try:
        with xr.open_dataset(path, engine="h5netcdf") as dataset:
            flight = dataset.load()
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"{path}: not a netCDF flight: {' '.join(str(error).split())}") from None
    if "scenario" not in flight.attrs or "truth" not in flight:
        raise InputError(f"{path}: not a flight: has no scenario or truth")
    return flight


def scenario_of(flight: xr.Dataset) -> Scenario:
    """Return the scenario that a flight carries."""
    return Scenario.model_validate_json(flight.attrs["scenario"])
