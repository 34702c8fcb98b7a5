"""The report of predicted flights: as recorded, simulated with fitted errors, and with white noise; text and figure."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ortilo_drake.studies.predict.predicted import Figures, Group, Predicted, group_of, interval, mean_of
from ortilo_drake.views.numbers import table
from ortilo_drake.views.palette import BLUE, ORANGE
from ortilo_drake.views.pictures import figure_to

COLUMNS = {
    "error": ("error [m]", ".3f"),
    "nees": ("NEES", ".2f"),
    "nis": ("NIS", ".2f"),
    "rejected": ("refused", ".1%"),
}
LEGEND = (
    "Error: RMS of the position. NEES is 3 and NIS about 1 if the filter is consistent. Refused: ranges that its gate "
    "left out. Simulated: mean, and the ends between which 95 % of the simulations lie; in bold where the recorded "
    "flight lies outside."
)


def _cell(real: Figures, runs: Sequence[Figures], of: str) -> str:
    low, high = interval(runs, of)
    form = COLUMNS[of][1]
    text = f"{mean_of(runs, of):{form}} ({low:{form}} to {high:{form}})"
    return text if low <= getattr(real, of) <= high else f"**{text}**"


def prediction_summary(group: Group) -> str:
    """Return a sentence that says whether the simulation predicts the group."""
    ratio, of_white = group.error / group.real_error, group.white_error / group.real_error
    return (
        f"The simulation {'predicts' if group.holds else 'does not predict'} these flights: {ratio:.2f} of their error "
        f"({group.error:.3f} m where {group.real_error:.3f} m is real), NEES {group.nees:.1f} where "
        f"{group.real_nees:.1f} is real. White noise of the same size predicts {of_white:.2f} of the error and a NEES "
        f"of {group.white_nees:.1f}."
    )


def predicted_text(flights: Sequence[Predicted], noise: str) -> str:
    """Return the report in Markdown; `noise` names the file of the sensors' errors."""
    rows = []
    for one in flights:
        rows.append([one.name, "recorded", *(f"{getattr(one.real, of):{form}}" for of, (_, form) in COLUMNS.items())])
        for kind, runs in (("fitted", one.fitted), ("white", one.white)):
            rows.append(["", f"simulated, {kind}", *(_cell(one.real, runs, of) for of in COLUMNS)])
    heads = ["flight", "", *(head for head, _ in COLUMNS.values())]
    lines = [
        "# Predicted flights",
        "",
        prediction_summary(group_of(flights)),
        "",
        f"Errors of the sensors: {noise}.",
        "",
    ]
    return "\n".join([*lines, *table(heads, rows), LEGEND, ""])


APART, WIDE = 0.18, 0.06  # distance of the two kinds from the middle, and half the width of one kind's points


def predicted_figure(flights: Sequence[Predicted], path: Path) -> Path:
    """Draw errors and NEES of the flights and return the file's path."""
    with figure_to(path, (2.0 + 1.3 * len(flights), 6.0)) as figure:
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
    return path
