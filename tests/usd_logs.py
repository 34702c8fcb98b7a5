"""A Crazyflie's uSD log written by Python's struct, and the recorded flights that ORTILO_FLIGHT_DATA may hold."""

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
    """Return the folder of the eight flights; skip the test where there is none."""
    variable = os.environ.get("ORTILO_FLIGHT_DATA")
    if not variable:
        pytest.skip("ORTILO_FLIGHT_DATA is not set: it names the folder of recorded flights (util_flights)")
    folder = Path(variable) / "util_flights"
    if not folder.is_dir():
        pytest.skip(f"ORTILO_FLIGHT_DATA={variable}: no folder util_flights in it")
    return folder
