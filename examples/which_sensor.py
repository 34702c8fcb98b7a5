"""Which sensor should I buy? Flights in a room with each choice of sensors beside the imu, as a table.

    python examples/which_sensor.py hall.yaml

Without a file the room is the authors'. Each choice flies with the same seeds; the error is the median over flights of
the estimate's RMS error of the position, three axes together; of a lost flight up to its loss.
"""

import sys
from typing import Any

import numpy as np
import pandas as pd

import ortilo_drake as od

CHOICES = (["uwb"], ["camera"], ["uwb", "camera"], ["uwb", "altimeter"], ["camera", "altimeter"])
COMMON = {"control_rate": 60.0, "camera.kind": "projected", "uwb.link.blackouts": [], "uwb.walls": {"kind": "block"}}


def fly(room: str | None = None, seeds: range = range(10), **settings: Any) -> pd.DataFrame:
    """Return a row for each choice: flights, how many were lost, the error and that of the height [m], NEES."""
    rows = {}
    for sensors in CHOICES:
        its = COMMON | {"sensors": ["imu", *sensors]} | ({"room": room} if room else {})
        if "altimeter" in sensors:
            its["altimeter.link.rate"] = 20.0  # of a range finder such as TFmini or VL53L1X
        flights = od.fly_many("imu_uwb_yolo", seeds, its, **settings)
        of_axes = [np.sqrt((flight.error**2).mean("tick").values) for flight in flights]
        error, height = np.median([[np.linalg.norm(rms), rms[2]] for rms in of_axes], axis=0)
        table = flights.table()
        its_row = {"flights": len(table), "lost": table["lost"].sum(), "error [m]": error, "height [m]": height}
        rows[" + ".join(sensors)] = its_row | {"nees": table["nees"].median()}
    return pd.DataFrame.from_dict(rows, orient="index")


if __name__ == "__main__":
    print(fly(sys.argv[1] if len(sys.argv) > 1 else None).round(4).to_string())
