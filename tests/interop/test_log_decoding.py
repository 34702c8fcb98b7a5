"""Every message of a log, decoded by two libraries that know nothing of ours, against the flight itself."""

from collections import defaultdict

import cv2
import numpy as np
import pytest
import yaml
from logged_flights import GOALS, flight, scenario, ticks
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from motions import attitude, body_rates
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.log.writer import LogWriter
from ortilo_drake.interop.ros.ros_types import typestore


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("logs") / "flight"
    with LogWriter(path, scenario()) as log:
        for tick in ticks():
            log.write_tick(*tick)
    return path


def by_mcap(folder):
    found = defaultdict(list)
    with (folder / "flight.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            found[channel.topic].append((message.log_time, decoded))
        assert reader.get_summary().statistics.message_count == sum(map(len, found.values()))
    return found


def by_rosbags(folder):
    found = defaultdict(list)
    with AnyReader([folder], default_typestore=typestore()) as reader:
        for connection, log_time, data in reader.messages():
            found[connection.topic].append((log_time, reader.deserialize(data, connection.msgtype)))
        assert reader.message_count == sum(map(len, found.values()))
    return found


@pytest.fixture(scope="module", params=[by_mcap, by_rosbags])
def decoded(request, folder):
    return request.param(folder)


def xyz(v):
    return np.array([v.x, v.y, v.z])


def xyzw(q):
    return np.array([q.x, q.y, q.z, q.w])


def same_attitude(q, rpy):
    error = (Rotation.from_quat(q) * attitude(rpy).inv()).magnitude()
    assert np.all(error < 1e-14)


def test_signals_are_the_datasets_bits(decoded):
    data = flight()
    expected = {
        "state": data.truth,
        "control": data.control,
        "estimate": data.estimate,
        "covariance": data.covariance,
    }
    for name, signal in expected.items():
        found = decoded[f"/ortilo/{name}"]
        np.testing.assert_array_equal([m.data for _, m in found], signal.values.reshape(len(signal), -1))
        assert [t for t, _ in found] == [round(t * 1e9) for t in data.time.values]
        dims = found[0][1].layout.dim
        assert np.prod([d.size for d in dims]) == found[0][1].layout.dim[0].stride == len(found[0][1].data)
    reference = np.array([m.data for _, m in decoded["/ortilo/reference"]])
    np.testing.assert_array_equal(reference[:, 3:6], data.reference_velocity)
    y, delta, V2 = (np.array([m.data for _, m in decoded[f"/ortilo/{name}"]]) for name in ("y", "delta", "V2"))
    np.testing.assert_array_equal(delta > 0, data.arrival)
    there = np.repeat(data.arrival.values, 3, axis=1)
    np.testing.assert_array_equal(y[there], data.measurement.values[there])
    np.testing.assert_array_equal(V2, data.measurement_covariance.values.reshape(len(V2), -1))
    assert len(decoded["/ortilo/y"][0][1].layout.dim) == 1
    assert "/ortilo/measurement" not in decoded  # of format 1


def test_sensor_vectors_are_the_messages_bits(decoded):
    for name in ("imu", "uwb", "detections", "shutter"):
        sent = [tick.messages[name] for tick in ticks() if name in tick.messages]
        assert len(sent) > 2
        np.testing.assert_array_equal([m.data for _, m in decoded[f"/ortilo/{name}"]], sent)


@pytest.mark.parametrize("who", ["truth", "estimate"])
def test_poses_and_motion(decoded, who):
    x = np.array(flight()[who].values)
    odometry = [m for _, m in decoded[f"/{who}/odometry"]]
    assert len(odometry) == len(x)
    np.testing.assert_array_equal([xyz(m.pose.pose.position) for m in odometry], x[:, 0:3])
    same_attitude([xyzw(m.pose.pose.orientation) for m in odometry], x[:, 3:6])
    v_B = attitude(x[:, 3:6]).inv().apply(x[:, 6:9])
    np.testing.assert_allclose([xyz(m.twist.twist.linear) for m in odometry], v_B, atol=1e-14)
    w_B = body_rates(x[:, 3:6], x[:, 9:12])
    np.testing.assert_allclose([xyz(m.twist.twist.angular) for m in odometry], w_B, atol=1e-9)
    assert {(m.header.frame_id, m.child_frame_id) for m in odometry} == {("map", "base_link")}
    poses = [m for _, m in decoded[f"/{who}/pose"]]
    inner = [m.pose if who == "truth" else m.pose.pose for m in poses]
    np.testing.assert_array_equal([xyz(p.position) for p in inner], x[:, 0:3])


def test_covariances(decoded):
    x, P = flight().estimate.values, flight().covariance.values
    np.testing.assert_array_equal(
        [np.reshape(m.pose.covariance, (6, 6)) for _, m in decoded["/estimate/pose"]], P[:, 0:6, 0:6]
    )
    for k in (0, 40, 90):
        T = np.zeros((6, 6))
        T[0:3, 0:3] = attitude(x[k, 3:6]).as_matrix().T
        T[3:6, 3:6] = np.column_stack([body_rates(x[k, 3:6], e) for e in np.eye(3)])
        found = np.reshape(decoded["/estimate/odometry"][k][1].twist.covariance, (6, 6))
        np.testing.assert_allclose(found, T @ P[k, 6:12, 6:12] @ T.T, atol=1e-9)


def test_frames(decoded):
    truth = flight().truth.values
    body = [m.transforms[0] for _, m in decoded["/tf"]]
    np.testing.assert_array_equal([xyz(b.transform.translation) for b in body], truth[:, 0:3])
    same_attitude([xyzw(b.transform.rotation) for b in body], truth[:, 3:6])
    assert {(b.header.frame_id, b.child_frame_id) for b in body} == {("map", "base_link")}
    room = scenario().load_room()
    *anchors, camera = decoded["/tf_static"][0][1].transforms
    np.testing.assert_array_equal([xyz(a.transform.translation) for a in anchors], room.anchor_positions)
    R_BC = Rotation.from_quat(xyzw(camera.transform.rotation)).as_matrix()
    # C's axes in B: right is -y, down is -z, forward is x.
    np.testing.assert_allclose(R_BC, np.column_stack([[0, -1, 0], [0, 0, -1], [1, 0, 0]]), atol=1e-15)
    assert camera.header.frame_id == "base_link"


def test_reference_and_path(decoded):
    point = flight().reference.values
    np.testing.assert_array_equal([xyz(m.pose.position) for _, m in decoded["/reference/pose"]], point)
    path = decoded["/reference/path"]
    assert len(path) == 1
    np.testing.assert_array_equal(xyz(path[0][1].poses[-1].pose.position), point[-1])


def test_imu(decoded):
    sent = [tick.messages["imu"] for tick in ticks() if tick.messages["imu"][0] == 1.0]
    found = [m for _, m in decoded["/imu/data"]]
    same_attitude([xyzw(m.orientation) for m in found], np.array(sent)[:, 2:5])
    np.testing.assert_array_equal([xyz(m.angular_velocity) for m in found], np.array(sent)[:, 5:8])
    np.testing.assert_array_equal([xyz(m.linear_acceleration) for m in found], np.array(sent)[:, 8:11])
    sd = scenario().imu.sds(scenario().h)[2]
    np.testing.assert_allclose(np.reshape(found[0].linear_acceleration_covariance, (3, 3)), sd**2 * np.eye(3))
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in found]
    assert stamps == [round(s[1] * 1e9) for s in sent]


def test_ranges(decoded):
    anchors = len(scenario().load_room().anchors)
    for i in range(anchors):
        sent = [t.messages["uwb"] for t in ticks() if "uwb" in t.messages and t.messages["uwb"][2 + anchors + i]]
        np.testing.assert_array_equal(
            [m.range for _, m in decoded[f"/uwb/anchor_{i}"]], np.float32([s[2 + i] for s in sent])
        )


@pytest.mark.family
def test_boxes(decoded):
    classes, sent = scenario().load_room().classes, []
    for tick in ticks():
        rows = tick.messages.get("detections", np.zeros(2))
        if rows[0] == 1.0:
            sent.append([row for row in rows[2:].reshape(-1, 6) if row[0] >= 0])
    found = [m.detections for _, m in decoded["/camera/detections"]]
    assert [len(boxes) for boxes in found] == [len(rows) for rows in sent]
    assert sum(map(len, sent)) > 10
    for boxes, rows in zip(found, sent, strict=True):
        for box, row in zip(boxes, rows, strict=True):
            centre, half = box.bbox.center.position, np.array([box.bbox.size_x, box.bbox.size_y]) / 2
            corners = [centre.x - half[0], centre.y - half[1], centre.x + half[0], centre.y + half[1]]
            np.testing.assert_allclose(corners, row[2:6], atol=1e-12)
            assert box.results[0].hypothesis.class_id == classes[int(row[0])]
            assert box.results[0].hypothesis.score == row[1]


def test_goals_are_what_a_tool_for_a_2d_goal_would_send(decoded):
    found = {round(log_time * 1e-9 / scenario().h): m for log_time, m in decoded["/goal_pose"]}
    assert {k: tuple(xyz(m.pose.position)) for k, m in found.items()} == {k: (*p, 0.0) for k, p in GOALS.items()}
    assert {tuple(xyzw(m.pose.orientation)) for m in found.values()} == {(0.0, 0.0, 0.0, 1.0)}
    assert {m.header.frame_id for m in found.values()} == {"map"}
    assert "/ortilo/goal" not in decoded


def test_pictures(decoded):
    sent = [tick.messages["image"] for tick in ticks() if "image" in tick.messages]
    found = [m for _, m in decoded["/camera/image/compressed"]]
    assert {m.format for m in found} == {"png"}
    for message, image in zip(found, sent, strict=True):
        bgr = cv2.imdecode(np.frombuffer(bytes(message.data), np.uint8), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(bgr[..., 2::-1], image[..., :3])


@pytest.mark.family
def test_folder_is_a_rosbag2(folder, decoded):
    about = yaml.safe_load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (about["storage_identifier"], about["relative_file_paths"]) == ("mcap", ["flight.mcap"])
    counts = {t["topic_metadata"]["name"]: t["message_count"] for t in about["topics_with_message_count"]}
    assert counts == {topic: len(messages) for topic, messages in decoded.items()}
    with Reader(folder) as reader:
        assert reader.message_count == about["message_count"]
        assert reader.duration == about["duration"]["nanoseconds"] + 1  # rosbags counts the last nanosecond
        assert {c.topic: c.msgcount for c in reader.connections} == counts
        store = typestore()
        assert all(c.digest == store.hash_rihs01(c.msgtype) for c in reader.connections)
        once = {
            c.topic for c in reader.connections if c.ext.offered_qos_profiles[0].durability.name == "TRANSIENT_LOCAL"
        }
        assert once == {"/ortilo/scenario", "/tf_static", "/reference/path"}
