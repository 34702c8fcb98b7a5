"""A made-up motion whose quantities are all known, and its files: tables, bags, MCAP."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.model.typed_yaml import parse_yaml, validate

ANCHORS = np.array([(0, 0, 0.2), (6, 0, 2.8), (6, 8, 0.2), (0, 8, 2.8), (3, 0, 1.5), (3, 8, 2.9)], dtype=float)
BIASES = np.array([-0.10, 0.05, -0.20, 0.0, 0.12, -0.05])
LEVER = np.array([0.12, -0.05, 0.04])
OFFSET, YAW, SHIFT = 0.73, 0.4, np.array([1.0, -2.0, 0.3])  # truth's clock minus ours; pose of truth's frame
GRAVITY = 9.81


class Motion(NamedTuple):
    """Stamps and values: ranges (n x 6), imu rates and force (k x 6), attitude (k x 3 x 3), true p (m x 3) and R."""

    t_r: np.ndarray
    r: np.ndarray
    t_imu: np.ndarray
    imu: np.ndarray
    attitude: np.ndarray
    t_truth: np.ndarray
    p: np.ndarray
    R: np.ndarray


def place(t):
    return np.column_stack([3 + 1.8 * np.sin(0.5 * t), 4 + 2.5 * np.sin(0.37 * t + 1), 1.4 + 0.6 * np.sin(0.61 * t)])


def quick_place(t):
    return np.column_stack([3 + 1.2 * np.sin(1.5 * t), 4 + 1.2 * np.sin(1.1 * t + 1), 1.4 + 0.4 * np.sin(0.9 * t)])


def attitude(t):
    angles = np.column_stack([0.8 * np.sin(0.45 * t) + 0.5, 0.10 * np.sin(0.9 * t), 0.08 * np.cos(0.7 * t)])
    return Rotation.from_euler("ZYX", angles)


def made_up(duration=60.0, seed=1, noise=0.03, outliers=0.0, place=place):
    rng = np.random.default_rng(seed)
    t_r, t_imu = np.arange(0.05, duration, 0.05), np.arange(0.0, duration, 0.02)
    p_tag = place(t_r) + attitude(t_r).apply(LEVER)
    r = np.linalg.norm(p_tag[:, None] - ANCHORS, axis=2) + BIASES + noise * rng.standard_normal((len(t_r), 6))
    r += np.where(rng.random(r.shape) < outliers, rng.uniform(0.5, 4.0, r.shape), 0.0)
    h = 1e-3
    a_W = (place(t_imu + h) - 2 * place(t_imu) + place(t_imu - h)) / h**2
    R = attitude(t_imu)
    rates = (attitude(t_imu - h).inv() * attitude(t_imu + h)).as_rotvec() / (2 * h)
    force = R.inv().apply(a_W + [0, 0, GRAVITY])
    rates = rates + [0.002, -0.001, 0.003] + 0.001 * rng.standard_normal(rates.shape)
    force = force + [0.15, -0.1, 0.2] + 0.03 * rng.standard_normal(force.shape)
    t = np.arange(0.1, duration - 0.1, 0.05)
    F = Rotation.from_rotvec([0, 0, YAW])
    p_truth = F.inv().apply(place(t) - SHIFT)
    R_truth = (F.inv() * attitude(t)).as_matrix()
    return Motion(t_r, r, t_imu, np.hstack([rates, force]), R.as_matrix(), t + OFFSET, p_truth, R_truth)


def as_map(text: str) -> Map:
    """Return the map that a text describes."""
    return validate(Map, parse_yaml(text, "MAP.yaml"), "MAP.yaml")


def write_tables(folder: Path, motion: Motion) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    names = ",".join(f"r{i}" for i in range(6))
    np.savetxt(
        folder / "ranges.csv", np.column_stack([motion.t_r, motion.r]), "%.9g", ",", header=f"t,{names}", comments=""
    )
    header = "t,wx,wy,wz,fx,fy,fz"
    imu = np.column_stack([motion.t_imu, motion.imu])
    np.savetxt(folder / "imu.csv", imu, "%.9g", ",", header=header, comments="")
    q = Rotation.from_matrix(motion.R).as_quat()
    truth = np.column_stack([motion.t_truth, motion.p, q])
    np.savetxt(folder / "truth.csv", truth, "%.9g", ",", header="t,x,y,z,qx,qy,qz,qw", comments="")
    return folder


TABLE_MAP = f"""
ranges: {{file: ranges.csv, time: t, values: [r0, r1, r2, r3, r4, r5]}}
anchors: {ANCHORS.tolist()}
imu: {{file: imu.csv, time: t, rates: [wx, wy, wz], force: [fx, fy, fz]}}
truth:
  file: truth.csv
  time: t
  position: [x, y, z]
  rotation: {{columns: [qx, qy, qz, qw], order: xyzw}}
"""
BAG_MAP = f"""
ranges: {{file: BAG, topics: [/r0, /r1, /r2, /r3, /r4, /r5], values: [range]}}
anchors: {ANCHORS.tolist()}
imu: {{file: BAG, topic: /imu, axes: frd}}
truth:
  file: BAG
  topic: /truth
  position: [pose.position.x, pose.position.y, pose.position.z]
"""


def _messages(motion: Motion, store, ros1: bool):
    """Yield (stamp [s], topic, type, message) of a motion; the IMU's axes are forward, right, down."""
    types = store.types
    Time = types["builtin_interfaces/msg/Time"]

    def header(t):
        stamp = Time(int(t), round((t - int(t)) * 1e9))
        return types["std_msgs/msg/Header"](*((0,) if ros1 else ()), stamp, "world")

    Vector, Quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    frd = np.array([1.0, -1.0, -1.0])
    for t, row in zip(motion.t_imu, motion.imu, strict=True):
        w, f = row[:3] * frd, row[3:] * frd
        nine = np.zeros(9)
        still = Quaternion(0.0, 0.0, 0.0, 1.0)
        message = types["sensor_msgs/msg/Imu"](header(t), still, nine, Vector(*w), nine, Vector(*f), nine)
        yield t, "/imu", "sensor_msgs/msg/Imu", message
    for t, row in zip(motion.t_r, motion.r, strict=True):
        for i, r in enumerate(row):
            more = (0.0,) if "variance" in dict(store.fielddefs["sensor_msgs/msg/Range"][1]) else ()
            message = types["sensor_msgs/msg/Range"](header(t), 0, 0.1, 0.1, 50.0, float(r), *more)
            yield t, f"/r{i}", "sensor_msgs/msg/Range", message
    Point, Pose = types["geometry_msgs/msg/Point"], types["geometry_msgs/msg/Pose"]
    for t, p in zip(motion.t_truth, motion.p, strict=True):
        pose = Pose(Point(*p), Quaternion(0.0, 0.0, 0.0, 1.0))
        yield t, "/truth", "geometry_msgs/msg/PoseStamped", types["geometry_msgs/msg/PoseStamped"](header(t), pose)


def write_bag(path: Path, motion: Motion, kind: str, packed: str = "") -> Path:
    """Write a bag of kind `ros1`, or a ROS 2 folder with `sqlite3` or `mcap`; `packed` is '', 'file' or 'message'."""
    ros1 = kind == "ros1"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    if ros1:
        writer = Writer1(path)
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
        if packed:
            writer.set_compression(CompressionMode[packed.upper()], CompressionFormat.ZSTD)
    connections = {}
    with writer:
        for t, topic, name, message in _messages(motion, store, ros1):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            raw = store.serialize_ros1(message, name) if ros1 else store.serialize_cdr(message, name)
            writer.write(connections[topic], round(t * 1e9), raw)
    return path
