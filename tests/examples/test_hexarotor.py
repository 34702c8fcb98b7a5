"""The hexarotor: its physics by hand, its flight, and the example as a user runs it."""

import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from module_of import module_of

from ortilo_drake.model.vehicle import load_vehicle, mixing_inverse, mixing_matrix
from ortilo_drake.world.vehicle.rotors import Rotors_, wrench_of

EXAMPLE = Path(__file__).parents[2] / "examples" / "hexarotor.py"
HEXAROTOR = load_vehicle(EXAMPLE.with_suffix(".yaml"))
K, C, L = 8.54858e-6, 0.016 * 8.54858e-6, 0.215  # RotorS's motor and moment constant, arm [m]
# RotorS has the rotors here, in these senses about the vertical: ccw is +1. Its drag turns the body the other way.
SIN, COS = 0.5, 0.866025403784
PLACES = L * np.array([[COS, SIN, 0], [0, 1, 0], [-COS, SIN, 0], [-COS, -SIN, 0], [0, -1, 0], [COS, -SIN, 0]])
TURNS = np.array([1, -1, 1, -1, 1, -1])
SHORT = {"planner": {"kind": "waypoints", "points": [[0, 0, 1.5], [1.2, 0.6, 1.5]]}, "settle": 5.0}
LOSSLESS = {"uwb__link__loss": 0.0, "camera__link__loss": 0.0, "uwb__link__blackouts": []}


@pytest.fixture(scope="module")
def example() -> ModuleType:
    return module_of(EXAMPLE)


def test_each_rotor_carries_a_sixth_at_hover() -> None:
    np.testing.assert_allclose(HEXAROTOR.hover_rotor_speeds, np.sqrt(1.53 * 9.81 / (6 * K)), rtol=1e-12)
    assert 1.5 < HEXAROTOR.largest_thrust / HEXAROTOR.hover_thrust < 3.0


@pytest.mark.long
@given(arrays(float, 6, elements=st.floats(0.0, 838.0)))
def test_wrench_is_that_of_forces_and_drags_at_rotorss_places(speeds: np.ndarray) -> None:
    forces = np.outer(K * speeds**2, [0.0, 0.0, 1.0])
    torque = np.cross(PLACES, forces).sum(axis=0) - [0.0, 0.0, np.sum(TURNS * C * speeds**2)]
    rotors = Rotors_[float](HEXAROTOR)
    context = rotors.CreateDefaultContext()
    context.SetContinuousState(speeds)
    expected = [forces[:, 2].sum(), *torque]
    np.testing.assert_allclose(rotors.get_output_port().Eval(context), expected, rtol=1e-11, atol=1e-11)


def test_mixing_is_the_closed_form_of_a_regular_hexagon() -> None:
    """Rows of M are orthogonal there, so M^+ is its transpose over their squared lengths: 6 k^2, 3 (k l)^2, 6 c^2."""
    M = mixing_matrix(HEXAROTOR)
    squared = np.array([6 * K**2, 3 * (K * L) ** 2, 3 * (K * L) ** 2, 6 * C**2])
    np.testing.assert_allclose(mixing_inverse(HEXAROTOR), M.T / squared, rtol=0.0, atol=1e-9 / C)
    np.testing.assert_allclose(M @ mixing_inverse(HEXAROTOR), np.eye(4), rtol=0.0, atol=1e-12)


@pytest.mark.long
def test_a_rotor_that_stops_pulls_the_body_to_its_own_side() -> None:
    speeds = HEXAROTOR.hover_rotor_speeds
    speeds[1] = 0.0  # the left one
    f_T, roll, pitch, yaw = wrench_of(speeds, mixing_matrix(HEXAROTOR))
    sixth = 1.53 * 9.81 / 6
    np.testing.assert_allclose([f_T, roll, pitch, yaw], [5 * sixth, -L * sixth, 0.0, -0.016 * sixth], atol=1e-12)


@pytest.mark.long
def test_a_hexarotor_that_loses_nothing_flies_to_its_goal(example: ModuleType) -> None:
    flight = example.fly(**SHORT, **LOSSLESS)
    assert flight.lost is None
    assert flight.scenario.vehicle == HEXAROTOR
    np.testing.assert_allclose(flight.data["truth"].values[-1, :3], [1.2, 0.6, 1.5], atol=0.1)
    control = flight.data["control"].values
    assert control[:, 0].mean() == pytest.approx(1.53 * 9.81, rel=0.02)


@pytest.mark.long
def test_the_example_says_how_the_flight_went(example: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    example.main(**SHORT)
    says = capsys.readouterr().out.splitlines()
    assert says[0] == "6 rotors, at hover 541 rad/s each"
    assert says[1].startswith("arrived, 0.")
    assert says[2].startswith("error of the estimated position, RMS: 0.0")


@pytest.mark.processes
def test_the_example_runs_from_anywhere(tmp_path: Path) -> None:
    env = os.environ | {"PYTHONPATH": str(EXAMPLE.parents[1])}  # a relative one would mean another folder there
    found = subprocess.run([sys.executable, EXAMPLE], cwd=tmp_path, env=env, capture_output=True, text=True, check=True)
    assert "arrived" in found.stdout
    assert found.stderr == ""
    assert list(tmp_path.iterdir()) == []
