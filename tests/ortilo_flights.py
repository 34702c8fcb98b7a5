"""The two recorded motions in the folder ORTILO_FLIGHT_DATA, and one map for both."""

import os
from pathlib import Path

import pytest

ANCHORS = "[[0, 0, 0], [0, 8, 0], [8.86, 8, 0], [8.86, 0, 0], [0, 0, 2.2], [0, 8, 2.2], [8.86, 8, 2.2], [8.86, 0, 2.2]]"
MAP = f"""
ranges: {{file: imu.bag, topic: /nlink_linktrack_tagframe0, values: [dis_arr]}}
anchors: {ANCHORS}
imu: {{file: imu.bag, topic: /imu/data, axes: frd}}
truth:
  file: gt.csv
  time: Time
  position: [Position X, Position Y, Position Z]
  rotation: {{columns: [5, 6, 7, 8, 9, 10, 11, 12, 13], of: world}}
filter: {{acceleration: 0.0366, range_white: 0.0277, range_correlated: 0.0361, correlation_time: 0.368}}
"""
TABLE_MAP = f"""
ranges: {{file: uwb.csv, time: Local Time, unit: ms, values: [6, 7, 8, 9, 10, 11, 12, 13]}}
anchors: {ANCHORS}
truth: {{file: gt.csv, time: 1, position: [2, 3, 4]}}
"""


def flight_folder(name: str) -> Path:
    """Return the folder of a motion; if ORTILO_FLIGHT_DATA is not set, skip the test and name the variable."""
    variable = os.environ.get("ORTILO_FLIGHT_DATA")
    if not variable:
        pytest.skip("ORTILO_FLIGHT_DATA is not set: it names the folder of recorded flights (flight1, flight2)")
    for folder in (Path(variable), *sorted(p for p in Path(variable).rglob("*") if p.is_dir())):
        if (folder / "flight1").is_dir():
            return folder / name
    pytest.fail(f"ORTILO_FLIGHT_DATA={variable}: no folder flight1 in or below it")
