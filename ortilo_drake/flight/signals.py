"""Types of signals and their recorders; OUTPUTS names the signals of the onboard half, with sizes."""

from collections.abc import Callable

import numpy as np

from ortilo_drake.diagrams.closed_loop import LOGGED

Signals = dict[str, np.ndarray]
OUTPUTS = {name: size for name, size in LOGGED.items() if name != "state"}
Record = Callable[[int, np.ndarray | None, Signals, Signals], None]  # a tick, x, messages, outputs
