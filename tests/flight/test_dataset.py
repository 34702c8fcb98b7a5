"""The Dataset of a flight: what it holds, that it is what the filter consumed, and that files keep it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy.linalg import expm

from ortilo_drake.flight.flight import flight_dataset, fly, logged_rows, scenario_of
from ortilo_drake.flight.saved_flight import load_flight, save_flight
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.filter_model import filter_model
from ortilo_drake.onboard.estimator.intermittent_filter import filter_step
from ortilo_drake.onboard.servo.lq_gain import servo_gain
from ortilo_drake.onboard.servo.lq_servo import servo_control
from ortilo_drake.scenario import Scenario, load_scenario

SHORT = "planner={kind: waypoints, points: [[0, 0, 1.5], [2.2, 0.9, 1.5]]}"  # into the first blackout, x >= 1.5
PROJECTED = "camera.kind=projected"  # as fast as the rest
HOVER = "planner={kind: hover, point: [8, 1, 1.5], duration: 2}"
SEEN = [0, 1, 2, 0, 1, 2, 3, 4, 5]  # the state behind each row of y


@pytest.fixture(scope="module")
def flight(flown: Any) -> xr.Dataset:
    return flown("nominal_imu_uwb_yolo", (SHORT, PROJECTED), 3)


def flown_here(name: str, *settings: str) -> tuple[Scenario, xr.Dataset]:
    scenario = load_scenario(name, settings)
    return scenario, fly(scenario)


@pytest.mark.long
def test_the_dimensions_are_ticks_by_states_sensors_and_axes(flight: xr.Dataset) -> None:
    n = flight.sizes["tick"]
    shapes = {
        "truth": (n, 12),
        "estimate": (n, 15),
        "covariance": (n, 15, 15),
        "control": (n, 4),
        "reference": (n, 3),
        "reference_velocity": (n, 3),
        "reference_acceleration": (n, 3),
        "measurement": (n, 9),
        "innovation": (n, 9),
        "measurement_covariance": (n, 3, 3, 3),
        "arrival": (n, 3),
        "due": (n, 3),
    }
    assert {name: variable.shape for name, variable in flight.data_vars.items()} == shapes
    assert all(variable.dims[0] == "tick" for variable in flight.data_vars.values())
    assert flight["sensor"].values.tolist() == ["uwb", "camera", "imu"]
    np.testing.assert_allclose(flight["time"].values, np.arange(n) / 30.0, atol=1e-9)


def test_every_variable_and_the_time_carry_units(flight: xr.Dataset) -> None:
    bare = [name for name, variable in flight.data_vars.items() if not variable.attrs.get("units")]
    assert bare == []
    assert flight["time"].attrs["units"] == "s"


def test_the_scenario_and_its_seed_are_inside(flight: xr.Dataset) -> None:
    assert scenario_of(flight) == load_scenario("nominal_imu_uwb_yolo", (SHORT, PROJECTED, "seed=3"))
    assert flight.attrs["seed"] == 3


def test_a_flight_starts_hovering_where_its_reference_starts(flight: xr.Dataset) -> None:
    np.testing.assert_array_equal(flight["truth"].values[0], [0.0, 0.0, 1.5, *[0.0] * 9])
    # The planned acceleration starts from 0 but for the rounding of the retimed path.
    np.testing.assert_allclose(flight["control"].values[0], [2.7 * 9.81, 0.0, 0.0, 0.0], atol=1e-5)


def test_innovations_are_measurements_less_predictions_where_something_arrived(flight: xr.Dataset) -> None:
    there = np.repeat(flight["arrival"].values, 3, axis=1)
    y, innovation = flight["measurement"].values, flight["innovation"].values
    np.testing.assert_array_equal(np.isfinite(y), there)
    np.testing.assert_array_equal(np.isfinite(innovation), there)
    predicted = flight["estimate"].values[:, SEEN]
    np.testing.assert_array_equal(innovation[there], (y - predicted)[there])
    assert all(there[:, row].sum() > 0 for row in range(9))


def test_sensors_are_due_at_their_rates_and_arrive_only_then(flight: xr.Dataset) -> None:
    k = np.arange(flight.sizes["tick"])
    due = flight["due"].values.copy()
    np.testing.assert_array_equal(due, np.column_stack([k % 3 == 0, k % 3 == 0, k >= 0]))
    due[1:, 1] = due[:-1, 1].copy()  # a camera's fix comes a tick after its picture was due
    due[0, 1] = False
    assert not np.any(flight["arrival"].values & ~due)


def test_no_uwb_arrives_in_a_blackout_and_every_one_outside(flight: xr.Dataset) -> None:
    x = flight["truth"].values[:, 0]
    dark = (x >= 1.5) & (x < 5.5)
    due, used = (flight[name].sel(sensor="uwb").values for name in ("due", "arrival"))
    assert 20 < np.sum(dark & due) < np.sum(due) - 20
    np.testing.assert_array_equal(used, due & ~dark)


@pytest.mark.family
@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("nominal_imu_uwb_yolo", (SHORT, PROJECTED)),
        ("nominal_imu_uwb_yolo", (SHORT, PROJECTED, "estimator.integrator=literal")),
        ("nominal_imu_uwb", (SHORT, "estimator.integrator=hold", "servo.form=paper")),
        ("paper_imu_uwb", (HOVER,)),
        ("bursty_link", (HOVER,)),
        ("rotors", (HOVER, "servo.yaw=0.1", "estimator.gates.uwb=0.9")),
    ],
)
def test_the_log_is_what_filter_and_servo_consumed(name: str, settings: tuple[str, ...]) -> None:
    scenario, flight = flown_here(name, *settings)
    h, vehicle, servo = scenario.h, scenario.vehicle, scenario.servo
    L = servo_gain(vehicle, servo.weights, h, servo.yaw)
    model, layout = (
        filter_model(scenario.estimator, vehicle, scenario.estimator.integrator, h, servo.yaw),
        scenario.measurement.layout,
    )
    hover = np.array([vehicle.hover_thrust, 0.0, 0.0, 0.0])
    xhat, P, u = (flight[name].values for name in ("estimate", "covariance", "control"))
    r = np.hstack([flight[f"reference{d}"].values for d in ("", "_velocity", "_acceleration")])
    y, delta = np.nan_to_num(flight["measurement"].values), flight["arrival"].values.astype(float)
    V2 = flight["measurement_covariance"].values
    for k in range(flight.sizes["tick"] - 1):
        belief = np.concatenate([xhat[k], P[k].ravel()])
        after = filter_step(belief, y[k], delta[k], V2[k].ravel(), u[k] - hover, r[k], model, layout)
        np.testing.assert_array_equal(after[:15], xhat[k + 1])
        np.testing.assert_array_equal(after[15:].reshape(15, 15), P[k + 1])
    for k in range(flight.sizes["tick"]):
        seen = xhat[k].copy()
        if servo.velocities == "truth":
            seen[6:12] = flight["truth"].values[k, 6:12]
        commanded = servo_control(seen, r[k], L, vehicle.mass, servo.yaw, servo.form == "error")
        np.testing.assert_array_equal(commanded, u[k])


def test_the_plant_flies_the_logged_control_over_the_tick_that_follows() -> None:
    still = "world.disturbance={force_density: 0.0, torque_density: 0.0}"
    scenario, flight = flown_here("nominal_imu_uwb", SHORT, still, "world.kinematics=linear")
    I_x, I_y, I_z = scenario.vehicle.inertia
    A, B = np.zeros((12, 12)), np.zeros((12, 4))
    A[0:6, 6:12] = np.eye(6)
    A[6, 4], A[7, 3] = 9.81, -9.81
    B[8, 0], B[9, 1], B[10, 2], B[11, 3] = 1.0 / scenario.vehicle.mass, 1.0 / I_x, 1.0 / I_y, 1.0 / I_z
    M = expm(np.block([[A, B], [np.zeros((4, 16))]]) * scenario.h)
    x, u = flight["truth"].values, flight["control"].values - [scenario.vehicle.hover_thrust, 0.0, 0.0, 0.0]
    # Runge-Kutta of third order leaves out h^4 / 24 times the jerk's rate: about g h^4 tau / (24 I) = 3e-6 m here.
    np.testing.assert_allclose(x[1:], x[:-1] @ M[:12, :12].T + u[:-1] @ M[:12, 12:].T, rtol=0.0, atol=1e-5)
    assert np.abs(u).max() > 0.1


def test_a_file_keeps_a_flight_bit_for_bit(flight: xr.Dataset, tmp_path: Path) -> None:
    path = tmp_path / "deep" / "down" / "flight.nc"
    save_flight(flight, path)
    again = load_flight(path)
    xr.testing.assert_identical(flight, again)
    for name, variable in flight.variables.items():
        assert again[name].dtype == variable.dtype or variable.dtype.kind in "UO"
        assert again[name].values.tobytes() == variable.values.tobytes() or variable.dtype.kind in "UO"
    assert [p.name for p in path.parent.iterdir()] == ["flight.nc"]


def test_a_file_is_plain_netcdf4_that_other_tools_read(flight: xr.Dataset, tmp_path: Path) -> None:
    import h5py

    save_flight(flight, tmp_path / "flight.nc")
    with h5py.File(tmp_path / "flight.nc") as file:
        np.testing.assert_array_equal(file["truth"][:], flight["truth"].values)
        units = file["control"].attrs["units"]
    assert units == "f_T in N; tau in N m"


@pytest.mark.family
@pytest.mark.parametrize("damage", ["missing", "folder", "empty", "text", "truncated", "foreign"])
def test_what_is_no_flight_is_refused_by_name(flight: xr.Dataset, tmp_path: Path, damage: str) -> None:
    path = tmp_path / "flight.nc"
    save_flight(flight, path)
    match damage:
        case "missing":
            path.unlink()
        case "folder":
            path.unlink()
            path.mkdir()
        case "empty":
            path.write_bytes(b"")
        case "text":
            path.write_text("not a flight at all\n" * 100)
        case "truncated":
            path.write_bytes(path.read_bytes()[:20_000])
        case "foreign":
            xr.Dataset({"a": ("b", [1.0])}).to_netcdf(path, engine="h5netcdf")
    with pytest.raises(InputError, match=r"flight\.nc") as caught:
        load_flight(path)
    assert "\n" not in str(caught.value)


def test_a_flight_that_cannot_be_written_is_refused_and_leaves_nothing(flight: xr.Dataset, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match="cannot be written"):
        save_flight(flight, tmp_path / "file" / "flight.nc")
    (tmp_path / "folder.nc").mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        save_flight(flight, tmp_path / "folder.nc")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder.nc"]


def test_the_rows_of_a_flight_make_it_again(flight: xr.Dataset) -> None:
    sizes = scenario_of(flight).measurement.logged_sizes()
    rows = np.array([np.concatenate([row[name] for name in sizes]) for row in logged_rows(flight)])
    again = flight_dataset(scenario_of(flight), flight["time"].values, rows, None)
    xr.testing.assert_identical(again.drop_attrs(deep=False), flight.drop_attrs(deep=False))
