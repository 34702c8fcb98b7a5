"""A histogram of the latencies from sensor messages to command."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ortilo_drake.views.palette import BLUE, ORANGE
from ortilo_drake.views.pictures import save_picture


def latency_figure(latencies_ms: np.ndarray, h: float, path: Path) -> Path:
    """Draw the latencies of the commands [ms], if there are any, and a line at one tick h [s]; return the path."""
    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    axes = figure.subplots()
    if len(latencies_ms):
        bins = np.geomspace(max(latencies_ms.min(), 1e-2), latencies_ms.max() * 1.01, 60)
        axes.hist(latencies_ms, bins=bins.tolist(), color=BLUE)
        axes.axvline(np.quantile(latencies_ms, 0.99), color="black", linestyle="--", label="99th percentile")
    axes.axvline(1e3 * h, color=ORANGE, label="one tick")
    axes.set(xscale="log", xlabel="sense to command [ms]", ylabel="ticks", title=f"{len(latencies_ms)} ticks")
    axes.legend()
    return save_picture(figure, path)
