"""MAVLink out: frames against SciPy's rotations, covariances against numerical Jacobians, packets over a socket."""

import socket
import sys
from collections.abc import Iterator
from contextlib import closing
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from motions import attitude as attitude_in_W
from motions import state
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner
from waiting import HANGS

from ortilo_drake.commands.hil.app import hil_app
from ortilo_drake.hil.bridge import mavlink_target
from ortilo_drake.interop.mavlink import MavlinkBridge, odometry_fields, udp_address, vision_fields
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario

ENU_TO_NED = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
FLU_TO_FRD = np.diag([1, -1, -1])
DIAGONAL = [0, 6, 11, 15, 18, 20]  # of 6 x 6 in its upper right triangle


@st.composite
def estimates(draw: st.DrawFn) -> np.ndarray:
    xbar = draw(arrays(float, 15, elements=st.floats(-3.0, 3.0)))
    xbar[4] *= 0.4  # away from the Euler angles' singularity
    return xbar


def some_covariance(seed: int = 3) -> np.ndarray:
    M = np.random.default_rng(seed).normal(size=(15, 15))
    return 1e-2 * M @ M.T


def estimate(**entries: float) -> np.ndarray:
    return np.array([*state(**entries), 7.0, 8.0, 9.0])


def attitude(rpy: np.ndarray) -> Rotation:
    """F in N by SciPy."""
    return Rotation.from_matrix(ENU_TO_NED @ attitude_in_W(rpy).as_matrix() @ FLU_TO_FRD)


def rates(rpy: np.ndarray, rpy_dot: np.ndarray, dt: float = 1e-4) -> np.ndarray:
    """w_NF_F from how the attitude turns."""
    return (attitude(rpy - dt * rpy_dot).inv() * attitude(rpy + dt * rpy_dot)).as_rotvec() / (2 * dt)


def full(triangle: list[float]) -> np.ndarray:
    C = np.zeros((6, 6))
    C[np.triu_indices(6)] = triangle
    return C + np.triu(C, 1).T


# --- frames ------------------------------------------------------------------------------------------------------


def test_hovering_and_facing_north_by_hand() -> None:
    north = odometry_fields(2.5, estimate(x=3.0, y=8.0, z=1.5, psi=np.pi / 2), np.eye(15))
    assert [north[key] for key in "xyz"] == [8.0, 3.0, -1.5]
    np.testing.assert_allclose(north["q"], [1.0, 0.0, 0.0, 0.0], atol=1e-15)
    assert north["time_usec"] == 2_500_000


def test_facing_east_is_a_quarter_turn_to_the_right() -> None:
    east = odometry_fields(0.0, estimate(vx=1.0, vz=0.5, psi_dot=0.3), np.eye(15))
    np.testing.assert_allclose(east["q"], [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)], atol=1e-15)
    np.testing.assert_allclose([east[key] for key in ("vx", "vy", "vz")], [1.0, 0.0, -0.5], atol=1e-15)
    assert east["yawspeed"] == -0.3  # positive to the right there, to the left here
    vision = vision_fields(0.0, estimate(psi=-3 * np.pi / 4), np.eye(15))
    np.testing.assert_allclose(vision["yaw"], 5 * np.pi / 4 - 2 * np.pi)


def test_nose_up_is_positive_and_flying_left_is_negative() -> None:
    vision = vision_fields(0.0, estimate(theta=-0.2, phi=0.1), np.eye(15))
    np.testing.assert_allclose([vision["roll"], vision["pitch"]], [0.1, 0.2])  # ours is nose down
    left = odometry_fields(0.0, estimate(vy=2.0), np.eye(15))
    np.testing.assert_allclose([left[key] for key in ("vx", "vy", "vz")], [0.0, -2.0, 0.0], atol=1e-15)


def test_frames_and_estimator_are_those_that_px4_takes() -> None:
    from pymavlink.dialects.v20 import common

    fields = odometry_fields(0.0, estimate(), np.eye(15), reset_counter=258, quality=60)
    assert fields["frame_id"] == common.MAV_FRAME_LOCAL_NED
    assert fields["child_frame_id"] == common.MAV_FRAME_BODY_FRD
    assert fields["estimator_type"] == common.MAV_ESTIMATOR_TYPE_VIO
    assert (fields["reset_counter"], fields["quality"]) == (2, 60)


@given(estimates())
def test_pose_and_twist_are_scipy_s(xbar: np.ndarray) -> None:
    R_NF = attitude(xbar[3:6])
    odometry, vision = odometry_fields(0.0, xbar, np.eye(15)), vision_fields(0.0, xbar, np.eye(15))
    q = np.roll(R_NF.as_quat(canonical=True), 1)
    assert min(abs(odometry["q"] - q).max(), abs(odometry["q"] + q).max()) < 1e-12
    assert odometry["q"][0] >= 0.0
    angles = [vision["yaw"], vision["pitch"], vision["roll"]]
    assert (Rotation.from_euler("ZYX", angles) * R_NF.inv()).magnitude() < 1e-12
    assert -np.pi < vision["yaw"] <= np.pi
    v_F = R_NF.inv().apply(ENU_TO_NED @ xbar[6:9])
    np.testing.assert_allclose([odometry[key] for key in ("vx", "vy", "vz")], v_F, atol=1e-12)
    w_F = [odometry[key] for key in ("rollspeed", "pitchspeed", "yawspeed")]
    np.testing.assert_allclose(w_F, rates(xbar[3:6], xbar[9:12]), atol=1e-5)


# --- covariances -------------------------------------------------------------------------------------------------


@pytest.mark.long
@settings(max_examples=25)
@given(estimates(), st.integers(0, 99))
def test_odometry_s_covariances_follow_the_numerical_jacobian(xbar: np.ndarray, seed: int) -> None:
    R_0 = attitude(xbar[3:6])

    def seen(x: np.ndarray) -> np.ndarray:
        R_NF = attitude(x[3:6])
        r = (R_0.inv() * R_NF).as_rotvec()
        v_F = R_NF.inv().apply(ENU_TO_NED @ x[6:9])
        return np.concatenate([ENU_TO_NED @ x[0:3], r, v_F, rates(x[3:6], x[9:12])])

    e, P = 1e-4, some_covariance(seed)
    J = np.column_stack([(seen(xbar[:12] + e * row) - seen(xbar[:12] - e * row)) / (2 * e) for row in np.eye(12)])
    C = J @ P[:12, :12] @ J.T
    fields = odometry_fields(0.0, xbar, P.ravel())
    np.testing.assert_allclose(full(fields["pose_covariance"]), C[:6, :6], rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(full(fields["velocity_covariance"]), C[6:, 6:], rtol=1e-4, atol=1e-4)


def test_vision_s_covariance_is_that_of_drawn_estimates() -> None:
    rng, P = np.random.default_rng(1), 1e-2 * some_covariance()
    mean = estimate(x=1.0, y=2.0, z=1.5, phi=0.1, theta=-0.2, psi=0.7)
    drawn = rng.multivariate_normal(mean, P, size=4000)
    names = ("x", "y", "z", "roll", "pitch", "yaw")
    values = np.array([[fields[name] for name in names] for fields in (vision_fields(0.0, x, P) for x in drawn)])
    C, expected = full(vision_fields(0.0, mean, P)["covariance"]), np.cov(values.T)
    scale = np.sqrt(np.outer(np.diag(C), np.diag(C)))
    assert abs((C - expected) / scale).max() < 5 * np.sqrt(2 / 4000)


@given(estimates())
def test_variances_are_positive_and_the_integrals_play_no_part(xbar: np.ndarray) -> None:
    P = some_covariance()
    fields = odometry_fields(0.0, xbar, P)
    assert all(fields[key][k] > 0.0 for key in ("pose_covariance", "velocity_covariance") for k in DIAGONAL)
    P[12:, :] = P[:, 12:] = 0.0
    xbar[12:] = 0.0
    assert odometry_fields(0.0, xbar, P) == fields


# --- packets -----------------------------------------------------------------------------------------------------


@pytest.fixture
def receiver() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listening:
        listening.bind(("127.0.0.1", 0))
        listening.settimeout(HANGS)
        yield listening


def test_what_is_sent_is_what_pymavlink_decodes(receiver: socket.socket) -> None:
    from pymavlink.dialects.v20 import common

    bridge = MavlinkBridge(f"udpout:127.0.0.1:{receiver.getsockname()[1]}", system=4)
    xbar, P = (
        estimate(x=1.0, y=-2.0, z=1.5, phi=0.1, theta=-0.2, psi=0.7, vx=0.4, vy=0.1, psi_dot=0.2),
        some_covariance(),
    )
    bridge.send(12.345678, xbar, P, reset_counter=3)
    bridge.send_vision(12.345678, xbar, P, reset_counter=3)
    bridge.send_heartbeat()
    packets = [receiver.recv(1000) for _ in range(3)]
    bridge.close()
    assert all(packet[0] == 0xFD for packet in packets)  # MAVLink 2

    parser = common.MAVLink(None)
    messages = [parser.parse_buffer(packet)[0] for packet in packets]
    assert [message.get_msgId() for message in messages] == [331, 102, 0]
    assert [message.get_seq() for message in messages] == [0, 1, 2]
    assert {(message.get_srcSystem(), message.get_srcComponent()) for message in messages} == {(4, 197)}
    fields = odometry_fields(12.345678, xbar, P, 3), vision_fields(12.345678, xbar, P, 3)
    for message, expected in zip(messages, fields, strict=False):
        decoded = message.to_dict()
        del decoded["mavpackettype"]
        assert decoded.keys() == expected.keys()
        for name, value in expected.items():
            np.testing.assert_allclose(decoded[name], value, rtol=1e-7, atol=1e-30)  # they are single precision
    assert messages[0].time_usec == messages[1].usec == 12_345_678
    assert messages[2].type == common.MAV_TYPE_ONBOARD_CONTROLLER


def test_a_text_of_any_length_comes_whole_and_in_ascii(receiver: socket.socket) -> None:
    """A part of 50 bytes may end within a character of several."""
    from pymavlink.dialects.v20 import common

    line = "x" * 49 + "90° at 9.81 m/s² or é"
    with closing(MavlinkBridge(f"udpout:127.0.0.1:{receiver.getsockname()[1]}")) as bridge:
        bridge.send_text(line, 5)
        parts = [common.MAVLink(None).parse_buffer(receiver.recv(1000))[0] for _ in range(2)]
    assert [part.severity for part in parts] == [5, 5]
    assert "".join(part.text for part in parts) == "x" * 49 + "90 deg at 9.81 m/s2 or ?"


def test_nobody_listening_is_no_error() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
    bridge = MavlinkBridge(f"udpout:127.0.0.1:{port}")
    for k in range(3):
        bridge.send(0.1 * k, estimate(), np.eye(15))
    bridge.close()
    assert bridge._mavlink.seq == 3  # MAVLink's own count of what was sent


@pytest.mark.parametrize(
    "url",
    [
        "", "udpout", "udpout:127.0.0.1", "udpout::14540", "udpout:127.0.0.1:0", "udpout:127.0.0.1:65536",
        "udpout:127.0.0.1:x", "udpout:127.0.0.1:²", "udpin:127.0.0.1:14540", "udpout:127.0.0.1:-1",
        "udpout:no such host:14540", f"udpout:{'a' * 70}:1",
    ],
)  # fmt: skip
def test_a_wrong_url_is_refused_in_one_line(url: str) -> None:
    with pytest.raises(InputError, match="mavlink url: ") as error:
        MavlinkBridge(url)
    assert repr(url) in str(error.value)
    assert "\n" not in str(error.value)


def test_the_default_stays_on_this_machine() -> None:
    bridge = MavlinkBridge()
    bridge.close()
    assert udp_address("udpout:localhost:14540") == ("127.0.0.1", 14540)
    assert MavlinkBridge.__init__.__defaults__ == ("udpout:127.0.0.1:14580", 1, 197)


def test_without_pymavlink_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"ortilo-drake\[mavlink\]"):
        MavlinkBridge()
    assert "ortilo_drake.interop.mavlink" in sys.modules  # which needs no package to be imported


# --- a flight ----------------------------------------------------------------------------------------------------


def messages_of(answered: list[int], receiver: socket.socket, *settings: str, vision: bool = False) -> list[Any]:
    """Pass the ticks up to the last that was answered on; return what came of the estimates."""
    from pymavlink.dialects.v20 import common

    scenario, parser = load_scenario("nominal_imu_uwb", settings), common.MAVLink(None)
    outputs = {"estimate": estimate(), "covariance": np.eye(15).ravel()}
    with closing(MavlinkBridge(f"udpout:127.0.0.1:{receiver.getsockname()[1]}")) as bridge:
        send = mavlink_target(bridge, scenario, vision)
        for k in range(answered[-1] + 1):
            send(k * scenario.h, {}, outputs if k in answered else {})
    found: list[Any] = []
    while len(found) < len(answered):
        message = parser.parse_buffer(receiver.recv(1000))[0]
        if message.get_type() != "HEARTBEAT":
            found.append(message)
    return found


def test_a_reset_is_counted_after_each_gap_that_the_failsafe_does_not_tolerate(receiver: socket.socket) -> None:
    # At 30 Hz a command counts for 0.2 s: a gap of 6 ticks is tolerated, one of 7 is not, and none before the first.
    answered = [20, 21, 27, 28, 35, 36, 42, 60, 61]
    found = messages_of(answered, receiver)
    assert [message.get_type() for message in found] == ["ODOMETRY"] * 9
    assert [message.reset_counter for message in found] == [0, 0, 0, 0, 1, 1, 1, 2, 2]
    assert [round(message.time_usec * 30e-6) for message in found] == answered


def test_ticks_longer_than_the_failsafe_s_patience_are_no_gaps(receiver: socket.socket) -> None:
    found = messages_of([0, 1, 2, 4], receiver, "control_rate=5", "uwb.link.rate=null", "failsafe.timeout=0.05")
    assert [message.reset_counter for message in found] == [0, 0, 0, 1]


def test_vision_is_sent_in_place_of_odometry_with_the_same_resets(receiver: socket.socket) -> None:
    found = messages_of([3, 4, 20], receiver, vision=True)
    assert [message.get_type() for message in found] == ["VISION_POSITION_ESTIMATE"] * 3
    assert [message.reset_counter for message in found] == [0, 0, 1]


def bridging(monkeypatch: pytest.MonkeyPatch, *options: str) -> Any:
    """Call the command with one tick in place of a bus; return its result."""

    def runs(url: str, key: bytes, scenario: Any, targets: Any, *_: Any) -> Any:
        targets["mavlink"](0.5, {}, {"estimate": estimate(), "covariance": np.eye(15).ravel()})
        return SimpleNamespace(lines=dict)

    monkeypatch.setattr("ortilo_drake.hil.bridge.run_bridge", runs)
    return CliRunner().invoke(hil_app, ["bridge", "nominal_imu_uwb", *options])


@pytest.mark.parametrize(("options", "name"), [([], "ODOMETRY"), (["--vision"], "VISION_POSITION_ESTIMATE")])
def test_the_command_sends_what_it_is_asked_for(
    monkeypatch: pytest.MonkeyPatch, receiver: socket.socket, options: list[str], name: str
) -> None:
    from pymavlink.dialects.v20 import common

    url = f"udpout:127.0.0.1:{receiver.getsockname()[1]}"
    result = bridging(monkeypatch, "--mavlink", url, *options)
    assert result.exit_code == 0, result.output
    assert common.MAVLink(None).parse_buffer(receiver.recv(1000))[0].get_type() == name


def test_vision_without_mavlink_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    result = bridging(monkeypatch, "--ros2", "--vision")
    assert isinstance(result.exception, InputError)
    assert "--vision" in str(result.exception)
    assert "--mavlink" in str(result.exception)
