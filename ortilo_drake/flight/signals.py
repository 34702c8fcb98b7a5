"""Types of signals and of their recorders, and the list of signals that the onboard half gives."""

from collections.abc import Callable

import numpy as np

from ortilo_drake.model.measurement import Measurement

Signals = dict[str, np.ndarray]
Record = Callable[[int, np.ndarray | None, Signals, Signals], None]  # a tick, x (12) or None, messages, outputs


def output_sizes(measurement: Measurement) -> dict[str, int]:
    """Return the sizes of the onboard half's logged signals by name, in the order of a log row."""
    return {name: size for name, size in measurement.logged_sizes().items() if name != "state"}
