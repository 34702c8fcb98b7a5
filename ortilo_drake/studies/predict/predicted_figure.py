"""Figure of predicted flights: error and NEES of each simulation, and of the recorded flight."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from ortilo_drake.studies.predict.predicted import Predicted
from ortilo_drake.views.palette import BLUE, ORANGE, STYLE
from ortilo_drake.views.pictures import save_picture

APART, WIDE = 0.18, 0.06  # of the two kinds, and of the points of one


def predicted_figure(flights: Sequence[Predicted], path: Path) -> Path:
    """Draw the flights and return the file's path."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(2.0 + 1.3 * len(flights), 6.0), layout="constrained")
        for k, (of, label) in enumerate((("error", "RMS error [m]"), ("nees", "NEES (3 if consistent)"))):
            axes = figure.add_subplot(2, 1, k + 1)
            for at, one in enumerate(flights):
                for side, runs, color, name in (
                    (-APART, one.fitted, BLUE, "simulated, fitted errors"),
                    (APART, one.white, ORANGE, "simulated, white noise"),
                ):
                    values = [getattr(run, of) for run in runs]
                    x = at + side + np.linspace(-WIDE, WIDE, len(values))
                    axes.plot(x, values, ".", color=color, ms=4, label=name if at == 0 else None)
                real = getattr(one.real, of)
                axes.plot(
                    [at - 2 * APART, at + 2 * APART], [real, real], "k", lw=2, label="recorded" if at == 0 else None
                )
            axes.set_ylim(bottom=0.0)
            axes.set_ylabel(label)
            axes.set_xticks(range(len(flights)), [one.name for one in flights] if k else [""] * len(flights))
            if k == 0:
                axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.2), ncols=3, fontsize=7)
        return save_picture(figure, path)
