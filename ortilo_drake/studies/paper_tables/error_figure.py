"""Figure of the errors of many flights beside the paper's."""

from pathlib import Path

import numpy as np

from ortilo_drake.flight.flight import AXES
from ortilo_drake.flight.summary import Summary
from ortilo_drake.studies.paper_tables.tables import PAPER
from ortilo_drake.views.figures import COLOR, OTHER, TITLE
from ortilo_drake.views.pictures import figure_to
from ortilo_drake.views.themes import broken_name

BOXED = 5  # fewest flights with a box: quartiles of fewer are the flights themselves


def _label(name: str, rows: list[Summary]) -> str:
    lost = sum(row.lost is not None for row in rows)
    title = TITLE[name].replace("+", "+\n") if name in TITLE else broken_name(name, 10)
    return title + (f"\n{lost} of {len(rows)} lost" if lost else "")


def error_figure(summaries: dict[str, list[Summary]], path: Path) -> Path:
    """Draw each table column's distribution over the kept flights, with the paper's median and quartiles.

    Few flights are drawn as points about their median, BOXED or more with a box.
    """
    with figure_to(path, (10, 3.6)) as figure:
        for k, column in enumerate((*AXES, "path")):
            axes = figure.add_subplot(1, 4, k + 1)
            for i, (name, rows) in enumerate(summaries.items()):
                kept = [row for row in rows if row.lost is None]
                found = [row.path_mse if column == "path" else row.mse[column] for row in kept]
                values = [value for value in found if value is not None]
                if len(values) < BOXED:
                    axes.plot([i - 0.26, i - 0.04], 2 * [np.median(values or [np.nan])], color="k", lw=1.0)
                else:
                    axes.boxplot(
                        values, positions=[i - 0.15], widths=0.22, showfliers=False, medianprops={"color": "k"}
                    )
                spread = np.linspace(-0.06, 0.06, len(values))
                axes.plot(i - 0.15 + spread, values, ".", color=COLOR.get(name, OTHER), ms=6, alpha=0.7)
                paper = PAPER.path.get(name) if column == "path" else PAPER.estimation.get(name, {}).get(column)
                if paper is None:  # a scenario beside the paper's
                    continue
                axes.plot([i + 0.2] * 2, [paper["p25"], paper["p75"]], color="0.5", lw=4, solid_capstyle="butt")
                axes.plot(i + 0.2, paper["median"], "k_", ms=12, mew=2)
            axes.set_xticks(range(len(summaries)), [_label(name, rows) for name, rows in summaries.items()], fontsize=7)
            axes.set_yscale("log")
            axes.set_title("path following" if column == "path" else f"estimation, {column}")
        figure.axes[0].set_ylabel("MSE [m²]  (grey: the paper's quartiles, bar: its median)")
    return path
