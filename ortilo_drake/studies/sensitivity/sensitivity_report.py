"""The report of a sensitivity study: a table, the required knowledge, and a bar chart."""

from pathlib import Path
from textwrap import fill

from matplotlib.ticker import LogLocator, NullLocator

from ortilo_drake.flight.flight import AXES
from ortilo_drake.studies.sensitivity.loss_level import ERROR
from ortilo_drake.studies.sensitivity.mismatches import TOGETHER, known_mismatches
from ortilo_drake.studies.sensitivity.sensitivity_flights import LOST_SHARE, NONE, Limit, MismatchRow, Sensitivity
from ortilo_drake.views.numbers import count, number, of_all_and_kept, table, with_interval
from ortilo_drake.views.palette import BLUE, ORANGE
from ortilo_drake.views.pictures import figure_to

NO_LIMITS = (
    f"More than {LOST_SHARE:.0%} of the flights are lost without any mismatch (Wald's sequential test, error "
    f"{ERROR:.0%}): no mismatch has a value that loses just {LOST_SHARE:.0%}, so none was searched."
)
ALL_BEYOND = f"No mismatch was found to lose {LOST_SHARE:.0%} of the flights at any value up to the largest flown."
SAID = (
    "MSE: median over flights, a lost one worse than any that was kept, then that of the kept ones. NEES: mean of the "
    "kept, 3 if the filter is consistent, and of all with the lost up to their losses. In brackets 95 % intervals: "
    "Wilson's of the share lost, of medians between order statistics; [?]: too few flights."
)
_BAR, _UNKNOWN = BLUE, "#999999"


def sensitivity_text(found: Sensitivity) -> str:
    """Return the report in Markdown."""
    header = [
        "what the filter does not know",
        "value",
        "lost",
        *(f"MSE {axis} [m²]" for axis in AXES),
        "NEES",
        "with the lost",
    ]
    lines = [f"# What must you know, how well: {found.scenario}", ""]
    careful, said = of_careful_team(), f"Flown by {found.flown_by}. {SAID}"
    rows = [*table(header, [_cells(row) for row in found.rows]), said, ""]
    if is_lost_without(found):
        return "\n".join([*lines, "## In short", "", f"- {NO_LIMITS}", "", *rows])
    lines += [*sensitivity_summary(found), *rows]
    if all(limit.value is None for limit in found.limits):
        lines += [ALL_BEYOND, ""]
    lines += [f"{LOST_SHARE:.0%} of the flights are lost where a mismatch alone is", ""]
    lines += table(
        ["mismatch", "value", "95 % interval", "a careful team's"],
        [[limit.mismatch, _value(limit), _interval(limit), f"{careful[limit.mismatch]:g}"] for limit in found.limits],
    )
    return "\n".join(lines)


def of_careful_team() -> dict[str, float]:
    """Return the value of each mismatch that a careful team leaves, by name."""
    return {m.name: m.careful for m in known_mismatches()} | {TOGETHER: 1.0}


def is_lost_without(found: Sensitivity) -> bool:
    """Return whether the study found that too much is lost without any mismatch, so that no limit was searched."""
    return all((limit.value, *limit.interval) == (0.0, 0.0, 0.0) for limit in found.limits)


def _cells(row: MismatchRow) -> list[str]:
    errors = [of_all_and_kept(row.mse[axis], row.lost) for axis in AXES]
    nees = "-" if row.nees is None else with_interval(row.nees, row.nees_interval)
    every = [number(row.nees_with_lost) if row.lost else nees]
    return [row.mismatch, f"{row.value:g}", count(row.lost, row.flights), *errors, nees, *every]


def _value(limit: Limit) -> str:
    if limit.value == 0.0:
        return "below what was flown"
    return "beyond what was flown" if limit.value is None else f"{limit.value:.3g}"


def _interval(limit: Limit) -> str:
    low, high = limit.interval
    if low is None and high is None:
        return "not known"
    if high is None:
        return f"above {low:.3g}"
    return f"below {high:.3g}" if not low else f"{low:.3g} to {high:.3g}"


def sensitivity_figure(found: Sensitivity, path: Path) -> Path:
    """Draw the limits as bars, in multiples of what a careful team leaves."""
    limits, usual = found.limits[::-1], of_careful_team()
    ends = [end / usual[x.mismatch] for x in limits for end in (x.value, *x.interval) if end]
    least, most = min([0.2, *(0.5 * end for end in ends)]), max([5.0, *(2.0 * end for end in ends)])
    with figure_to(path, (9.0, 0.45 * len(limits) + 1.3)) as figure:
        axes = figure.add_subplot()
        for i, limit in enumerate(limits):
            careful = usual[limit.mismatch]
            low, high = (
                (end or edge * careful) / careful for end, edge in zip(limit.interval, (least, most), strict=True)
            )
            known = limit.value is not None
            axes.barh(i, limit.value / careful if limit.value is not None else low, color=_BAR if known else _UNKNOWN)
            axes.plot([low, high], [i, i], color="k", lw=1.2)
            text = f"{limit.value:.3g}  ({_interval(limit)})" if limit.value else _interval(limit)
            axes.text(1.01, i, text, va="center", transform=axes.get_yaxis_transform())
        axes.axvline(1.0, color=ORANGE, lw=1.2)
        axes.text(
            1.0, 1.0, "a careful team", color=ORANGE, ha="center", va="bottom", transform=axes.get_xaxis_transform()
        )
        axes.set(xscale="log", xlim=(least, most))
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set_yticks(range(len(limits)), [limit.mismatch for limit in limits])
        axes.set_xlabel(f"value at which {LOST_SHARE:.0%} of the flights are lost, over a careful team's")
        if is_lost_without(found):
            note = fill(NO_LIMITS, 60)
            axes.text(0.5, 0.5, note, ha="center", va="center", transform=axes.transAxes, bbox={"color": "white"})
        figure.suptitle(f"What must you know, how well: {found.scenario}")
    return path


def sensitivity_summary(found: Sensitivity) -> list[str]:
    """Return a summary of a study that searched limits, as a Markdown list of at most five lines."""
    careful = of_careful_team()
    calm = next(row for row in found.rows if row.mismatch == NONE)
    lines = [f"Without any mismatch {count(calm.lost, calm.flights)} flights are lost."]
    alone = [limit for limit in found.limits if limit.mismatch != TOGETHER]
    known = [limit for limit in alone if limit.value]

    def room(limit: Limit) -> float:
        return (limit.value or 0.0) / careful[limit.mismatch]

    below = [limit.mismatch for limit in alone if limit.value == 0.0]
    if below:
        lines.append(f"{LOST_SHARE:.0%} are lost at less than was flown of: {'; '.join(below)}.")
    if known:
        least = min(known, key=room)
        lines.append(
            f"Least room is left by '{least.mismatch}': {LOST_SHARE:.0%} are lost at {least.value:.3g}, "
            f"{room(least):.2g} times what a careful team leaves ({careful[least.mismatch]:g})."
        )
    beyond = sum(limit.value is None for limit in alone)
    lines.append(f"{beyond} of {len(alone)} mismatches were not found to lose that many at any value flown.")
    lines += [_together(limit) for limit in found.limits if limit.mismatch == TOGETHER]
    return ["## In short", "", *(f"- {line}" for line in lines), ""]


def _together(limit: Limit) -> str:
    if limit.value is None:
        return f"All together were not found to lose {LOST_SHARE:.0%} at any value flown."
    if limit.value == 0.0:
        return f"All together lose {LOST_SHARE:.0%} at less than was flown."
    return f"All together lose {LOST_SHARE:.0%} at {limit.value:.2g} times what a careful team leaves of each."
