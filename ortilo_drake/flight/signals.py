"""Types of signals and their recorders, and which signals the onboard half gives."""

from collections.abc import Callable

import numpy as np

from ortilo_drake.model.measurement import Measurement

Signals = dict[str, np.ndarray]
Record = Callable[[int, np.ndarray | None, Signals, Signals], None]  # a tick, x, messages, outputs


def output_sizes(measurement: Measurement) -> dict[str, int]:
    """Return the onboard half's logged signals with their sizes, in the order of the log's rows."""
    return {name: size for name, size in measurement.logged_sizes().items() if name != "state"}
