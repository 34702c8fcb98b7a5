"""A Crazyflie's uSD log, written with Python's struct, and the recorded flights that ORTILO_FLIGHT_DATA may hold."""

import os
import struct
from pathlib import Path
from zlib import crc32

import pytest


def usd_log(kinds, events, version=2) -> bytes:
    """Return a log: kinds {number: (name, [(field, code)])}, events [(number, ticks, values)]."""
    data = bytearray(struct.pack("<BHH", 0xBC, version, len(kinds)))
    for number, (name, fields) in kinds.items():
        data += struct.pack("<H", number) + name.encode() + b"\0" + struct.pack("<H", len(fields))
        for field, code in fields:
            data += f"{field}({code})".encode() + b"\0"
    for number, ticks, values in events:
        data += struct.pack("<HQ" if version == 2 else "<HI", number, ticks)
        data += struct.pack("<" + "".join(code for _, code in kinds.get(number, ("", []))[1]), *values)
    return bytes(data) + struct.pack("<I", crc32(data))


def util_folder() -> Path:
    """Return the folder of the eight flights; skip the test if there is none."""
    variable = os.environ.get("ORTILO_FLIGHT_DATA")
    if not variable:
        pytest.skip("ORTILO_FLIGHT_DATA is not set: it names the folder of recorded flights (util_flights)")
    folder = Path(variable) / "util_flights"
    if not folder.is_dir():
        pytest.skip(f"ORTILO_FLIGHT_DATA={variable}: no folder util_flights in it")
    return folder


FLIGHTS = {  # day of the anchors' survey, and height of the downward sensors above the estimated point [m]
    "0425-traj2": ("0425", -0.037),
    "0425-traj4": ("0425", -0.037),
    "0425-traj16": ("0425", -0.037),
    "0425-traj20": ("0425", -0.037),
    "0426-traj2": ("0426", None),
    "0426-traj9": ("0426", None),
    "0426-traj12": ("0426", None),
    "tdoa2-obs-log1": ("0607", -0.03),
}
TUNED_ON = ("0425-traj2", "0426-traj2", "0426-traj9")
FILTER = """
  {acceleration: 0.05, acceleration_bias: 0.004, rotation: 0.005, rotation_bias: 0.0005, bias_start: 0.07,
   bias_walk: 0.0005, range_white: 0.2, range_correlated: 0.14, correlation_time: 1.0, range_tail: 0.7, near_floor: 0.5,
   huber: 1.2, gate: 5}"""


def util_map(name: str, settings: str = FILTER) -> str:
    """Return the map of one of the eight flights: known start, rest before take-off, one clock, no calibration."""
    day, below = FLIGHTS[name]
    rows = (line.strip().split(",") for line in (util_folder() / f"anchor_{day}.txt").read_text().splitlines())
    anchors = {row[0][9:]: [float(cell) for cell in row[1:4]] for row in rows if row[0].startswith("anchorAnt")}
    text = f"""
differences: {{file: {name}, topic: estTDOA, value: distanceDiff, a: idA, b: idB}}
anchors: {anchors}
imu: {{file: {name}, topic: estGyroscope, rates: [gyro.x, gyro.y, gyro.z], rate_unit: deg/s, force_unit: g}}
accelerometer: {{file: {name}, topic: estAcceleration, force: [acc.x, acc.y, acc.z]}}
truth: {{file: {name}, topic: estPose, position: [locSrv.x, locSrv.y, locSrv.z], late: 0.004}}
start: {{position: [1.5, 0.04, 0.03], heading: 0, rests: true, lands: true}}
calibration: {{share: 0, clock: 0, frame: same, biases: online, lever: [-0.01245, 0.00127, 0.0908]}}
drag: {{k: 0.38, k_sd: 0.1, noise: 0.08}}
airborne: 0.25
imposed: {{lost: 0, gaps: null}}
filter: {settings}
"""
    if below is not None:
        text += f"""
range_finder: {{file: {name}, topic: estTOF, distance: range.zrange, scale: 0.001, at: [0, 0, {below}]}}
flow: {{file: {name}, topic: estFlow, pixels: [motion.deltaX, motion.deltaY], per_rad: 4.356, sd: 3}}
"""
    return text
