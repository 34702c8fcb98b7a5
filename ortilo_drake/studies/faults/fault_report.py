"""The report of a study of faults: a summary, a table and a heat map."""

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import LogNorm

from ortilo_drake.flight.intervals import Middle
from ortilo_drake.studies.faults.fault_flights import PASSES, WITHIN_3_SIGMA, FaultRow, FaultStudy, Phase
from ortilo_drake.views.numbers import count, number, of_all_and_kept, table, with_interval
from ortilo_drake.views.pictures import figure_to
from ortilo_drake.views.themes import SLIDE_SIZE, add_title, broken_name, for_slides


def fault_summary(found: FaultStudy) -> list[str]:
    """Return a summary of a study as a Markdown list of at most five lines."""
    lines = []
    for scenario, without in list(zip(found.scenarios, found.lost_without, strict=True))[:3]:
        its = [row for row in found.rows if row.scenario == scenario]
        passed, lost = sum(row.passed for row in its), sum(row.lost for row in its)
        flown = sum(row.flights for row in its)
        line = f"`{scenario}` passes {passed} of {len(its)} faults and loses {count(lost, flown)} flights"
        lines.append(f"{line}, {count(without, found.flights)} without a fault.")
    faults = dict.fromkeys(row.fault for row in found.rows)
    some, fails = ({row.fault for row in found.rows if row.passed is passed} for passed in (True, False))
    lines.append(f"Passed by none: {', '.join(name for name in faults if name not in some) or 'no fault'}.")
    lines.append(f"Passed by all: {', '.join(name for name in faults if name not in fails) or 'no fault'}.")
    return ["## In short", "", *(f"- {line}" for line in lines), ""]


_HEADER = [
    *("fault", "scenario", "lost", "before [mm]", "during [mm]", "after [mm]", "during, times", "after, times"),
    *("recovers in [s]", "NEES during", "NEES after", "passes"),
]
_MEDIANS = ["fault", "scenario", "during [mm]", "after [mm]", "during, times", "after, times"]
_WORST = 10.0  # a larger ratio is drawn in the same colour
_TICKS = (1.0, 2.0, 3.0, 5.0, 10.0)  # ticks of the colour bar
_WIDEST = 13  # most letters in a line of a column's label
_MOST_DIGITS = 9  # most digits of a ratio close to the limit
_LARGEST = 14.0  # largest font size of the numbers on a slide [pt]
_LOST = "#404040"  # colour where all flights are lost


def fault_text(found: FaultStudy) -> str:
    """Return the report in Markdown."""
    lines = [f"# Faults in flight: {' '.join(found.scenarios)}", ""]
    lines += fault_summary(found)
    lines += table(_HEADER, [_cells(row) for row in found.rows])
    lines += [
        f"Flown by {found.flown_by}.",
        "",
        f"Faults begin at {found.start:g} s; those that end last {found.length:g} s. Errors are root mean squares of "
        "the estimated position's distance from the true one, of all flights together that were not lost; times: over "
        "the same seeds without the fault. A fault is passed if no flight is lost, the error after it is at most "
        f"{PASSES:g} times the one without, and the estimate can be trusted while it lasts: its error is at most "
        f"{PASSES:g} times the one without, too, or the filter knows that it is larger: a mean NEES of at most "
        f"{WITHIN_3_SIGMA:.1f}, as of a position at the edge of 3 sigma (3 if the filter is consistent).",
        "",
        f"Recovers in: from a fault's end, or its start if it does not end, to the first 5 s in which the error is at "
        f"most {PASSES:g} times the one without; a fault is failed by what came before, too, or after it (then worse).",
        "",
        "## The faults",
        "",
        "As the list `faults` of a scenario has them: forces [N], lengths [m], times [s], angles [rad]; x east, "
        "y north, z up. A walk is x, y of one end, then of the other.",
        "",
        *_strengths(found),
        "",
        "## Flight by flight",
        "",
        "Medians over flights of the error of each, a lost one worse than any that was kept, then of the kept ones; in "
        "brackets 95 % intervals between order statistics, [?] of fewer than six flights.",
        "",
    ]
    lines += table(_MEDIANS, [_medians(row) for row in found.rows])
    return "\n".join(lines)


def _strengths(found: FaultStudy) -> list[str]:
    """Return a line for each fault and each of its settings, with the scenarios if they differ."""
    lines = []
    for fault in dict.fromkeys(row.fault for row in found.rows):
        said: dict[str, list[str]] = {}
        for row in (row for row in found.rows if row.fault == fault):
            told = ", ".join(f"{key} {value}" for key, value in row.settings.items() if key != "kind")
            said.setdefault(told, []).append(row.scenario)
        for told, of in said.items():
            where = f" of {', '.join(of)}" if len(said) > 1 else ""
            lines.append(f"- `{fault}`{where}: {told}.")
    return lines


def _times(ratio: float, text: str) -> str:
    """Return a ratio's text, with as many digits as tell the ratio from the limit PASSES."""
    digits = len(text)
    while float(text) == PASSES != ratio and digits < _MOST_DIGITS:
        text, digits = f"{ratio:.{digits}g}", digits + 1
    return text


def _recovery(row: FaultRow) -> str:
    if row.during is None or row.recovery is None:
        return "-" if row.during is None else "never"
    return f"{row.recovery:.1f}" + ("" if row.passed_after else ", then worse") + (" (kept)" if row.lost else "")


def _medians(row: FaultRow) -> list[str]:
    cells = []
    for scale, of in ((1e3, "errors"), (1.0, "ratios")):
        for phase in (row.during, row.after):
            cells.append("lost" if phase is None else of_all_and_kept(_scaled(getattr(phase, of), scale), row.lost))
    return [row.fault, row.scenario, *cells]


def _scaled(middle: Middle, scale: float) -> Middle:
    def times(value: Any) -> Any:
        return None if value is None else tuple(map(times, value)) if isinstance(value, tuple) else scale * value

    return Middle(*map(times, vars(middle).values()))


def _cells(row: FaultRow) -> list[str]:
    phases = (row.before, row.during, row.after)
    errors = ["-" if phase is None else f"{1e3 * phase.error:.0f}" for phase in phases]
    ratios = ["-" if phase is None else _times(phase.ratio, f"{phase.ratio:.2f}") for phase in phases[1:]]
    nees = ["-" if phase is None else with_interval(phase.nees, phase.nees_interval) for phase in phases[1:]]
    lost = count(row.lost, row.flights)
    return [row.fault, row.scenario, lost, *errors, *ratios, _recovery(row), *nees, _verdict(row)]


def _verdict(row: FaultRow) -> str:
    """Return 'yes' if a fault is passed, else 'no' and the criteria that fail."""
    if row.during is None:
        return "no: lost"
    good = {"lost": row.lost == 0, "during": row.passed_during, "after": row.passed_after}
    fails = [name for name, passed in good.items() if not passed]
    return f"no: {', '.join(fails)}" if fails else "yes"


def _size(found: FaultStudy, faults: int) -> float:
    """Return the font size of the numbers on a slide [pt], as large as their cells allow."""
    letters = 15 if any(row.lost for row in found.rows) else 6
    width, height = 0.75 * SLIDE_SIZE[0] / (2 * len(found.scenarios)), 0.72 * SLIDE_SIZE[1] / faults
    return min(max(72.0 * min(width / (0.6 * letters), 0.5 * height), 8.0), _LARGEST)


def fault_figure(found: FaultStudy, path: Path) -> Path:
    """Draw how many times the error grows during and after each fault, whether it is passed, and the flights lost."""
    faults = list(dict.fromkeys(row.fault for row in found.rows))
    with figure_to(path, (4.6 + 1.7 * len(found.scenarios), 0.28 * len(faults) + 1.6)) as figure:
        panels = figure.subplots(1, 2, sharey=True)
        size = _size(found, len(faults)) if for_slides() else 8.0
        colors = mpl.colormaps["YlOrRd"].with_extremes(over=_LOST)
        for axes, part in zip(panels, ("during", "after"), strict=True):
            values = np.full((len(faults), len(found.scenarios)), np.nan)
            for row in found.rows:
                i, j = faults.index(row.fault), found.scenarios.index(row.scenario)
                phase: Phase | None = getattr(row, part)
                values[i, j] = 2.0 * _WORST if phase is None else min(phase.ratio, _WORST)
                text = "all lost" if phase is None else _times(phase.ratio, number(phase.ratio))
                text += f", {row.lost} lost" if phase is not None and row.lost else ""
                passed = row.passed_during if part == "during" else row.passed_after
                text += " ✓" if passed and not row.lost else " ✗"
                dark = values[i, j] > _WORST**0.6
                axes.text(j, i, text, ha="center", va="center", color="w" if dark else "k", fontsize=size)
            drawn = axes.imshow(values, aspect="auto", cmap=colors, norm=LogNorm(1.0, _WORST))
            axes.set_xticks(range(len(found.scenarios)), [broken_name(name, _WIDEST) for name in found.scenarios])
            axes.set_yticks(range(len(faults)), faults)
            axes.set_title(f"{part} the fault")
            axes.tick_params(length=0)
            axes.spines[:].set_visible(False)
        bar = figure.colorbar(drawn, ax=panels, label="error with the fault / error without it [-]", pad=0.01)
        bar.set_ticks(_TICKS, labels=[f"{tick:g}" for tick in _TICKS[:-1]] + [f"≥ {_WORST:g}"])
        bar.minorticks_off()
        flown = "1 flight" if found.flights == 1 else f"{found.flights} flights"
        add_title(
            figure,
            "Error of the estimated position with a fault, divided by that without it",
            f"{flown} with each fault, which begins at {found.start:g} s. ✓: passed, no flight lost and the error at "
            f"most {PASSES:g} times; during the fault more, if the filter knows it (NEES up to {WITHIN_3_SIGMA:.1f}). "
            "✗: failed.",
        )
    return path
