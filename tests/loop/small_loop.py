"""Elements of a small loop: a double integrator under noise, its sensor and a linear controller."""

from typing import Any

import numpy as np

from ortilo_drake.loop.element import Box, Element, Values


def mass_step(n: Any, x: np.ndarray, u: np.ndarray) -> None:
    """Go on by a tick: position and velocity under a held acceleration."""
    x[0] += n.h * x[1] + n.h * n.h / 2.0 * u[0]
    x[1] += n.h * u[0]


def sensor_out(n: Any, k: int, seed: int, x: np.ndarray, out: np.ndarray) -> None:
    """Say the position, off by what tick and seed make of it, and the tick."""
    out[0] = x[0] + n.off * ((seed + k) % 3)
    out[1] = k


def gain_out(y: np.ndarray, rate: np.ndarray, K: np.ndarray, out: np.ndarray) -> None:
    """Say u = -K [y; rate]."""
    out[0] = -(K[0, 0] * y[0] + K[0, 1] * rate[0])


def watch_out(x: np.ndarray, out: np.ndarray) -> None:
    """Say -1, and 2 where the mass is beyond 3."""
    out[0] = 2.0 if x[0] > 3.0 else -1.0


MASS = Element("mass", step=mass_step, shows="x")
SENSOR = Element("sensor", out=sensor_out)
GAIN = Element("gain", out=gain_out)
WATCH = Element("watch", out=watch_out)
H, K, OFF, X_0 = 0.1, np.array([[1.2, 1.6]]), 0.05, np.array([1.0, 0.5])


def boxes() -> list[Box]:
    """Return the loop's boxes, in an order that is not that of a tick."""
    return [
        Box("gain", GAIN, 1, Values(tables={"K": K}), reads={"y": "sensor.y", "rate": "mass.rate"}),
        Box("watch", WATCH, 1, reads={"x": "mass"}),
        Box("mass", MASS, 2, Values({"h": H}, {"x": X_0}), reads={"u": "gain"}, parts={"rate": (1, 1)}),
        Box("sensor", SENSOR, 2, Values({"off": OFF}), reads={"x": "mass"}, parts={"y": (0, 1)}),
    ]


def flown(ticks: int, seed: int, K: np.ndarray = K, x_0: np.ndarray = X_0, off: float = OFF) -> np.ndarray:
    """Return x, y and u at each tick (ticks, 4), by NumPy's matrices."""
    A, B = np.array([[1.0, H], [0.0, 1.0]]), np.array([H * H / 2.0, H])
    x, rows = x_0.astype(float), []
    for k in range(ticks):
        y = x[0] + off * ((seed + k) % 3)
        u = -(K @ np.array([y, x[1]]))[0]
        rows.append([*x, y, u])
        x = A @ x + B * u
    return np.array(rows)
