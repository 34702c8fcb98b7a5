"""Fly a fault of your own as an element: ranges that grow while it lasts.

    python examples/longer_ranges.py
    ortilo --plugin examples/longer_ranges.py rare --corridor 1 --set 'faults=[{kind: longer_ranges, start: 10.0}]'

The function writes the message as it is while the fault lasts; start and end are applied for it.
"""

from typing import Any, Literal

import numpy as np

import ortilo_drake as od


class LongerRanges(od.Fault):
    """A fault's settings.

    Attributes:
        start: when it begins [s].
        end: when it ends [s]; null if it does not.
        kind: 'longer_ranges'.
        sensor: 'uwb'.
        by: added to every range at first [m].
        rate: by how much more in a second [m/s].
    """

    kind: Literal["longer_ranges"]
    sensor: Literal["uwb"] = "uwb"
    by: float = 0.0
    rate: float = 0.05


def say(n: Any, message: np.ndarray, out: np.ndarray) -> None:
    """Write [arrived, stamp, ranges, whether each is there], with longer ranges."""
    out[:] = message
    anchors = (message.size - 2) // 2
    out[2 : 2 + anchors] += n.by + n.rate * (message[1] - n.start)


def make(its: LongerRanges, size: int, h: float) -> od.Box:
    """Return the fault by its settings."""
    return od.box(size, say, numbers={"by": its.by, "rate": its.rate, "start": its.start})


od.register_fault("longer_ranges", LongerRanges, make)


def main(**settings: Any) -> Any:
    """Fly scenario 1 with it; print the error of the position with and without."""
    faults = [{"kind": "longer_ranges", "start": 5.0}]
    for name, wrong in (("without", []), ("with   ", faults)):
        flight = od.fly("imu_uwb", seed=1, faults=wrong, **settings).data
        e = flight["estimate"].values[:, :3] - flight["truth"].values[:, :3]
        print(f"{name} longer ranges: RMS error {np.sqrt(np.mean(np.sum(e**2, axis=1))):.3f} m")
    return flight


if __name__ == "__main__":
    main()
