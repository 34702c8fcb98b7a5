"""The report of `ortilo rare`, as Markdown."""

import numpy as np

from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.rare.rare_flights import Rare
from ortilo_drake.views.markdown import table

APART = 0.25  # of acceptances at one level, from which repetitions are said to have gone different ways [1]


def rare_text(scenario: Scenario, found: Rare) -> str:
    """Return the report."""
    event = "loses its vehicle" if found.corridor is None else f"strays {found.corridor:g} m or more from its reference"
    if found.probability > 0.0:
        says = f"about one flight in {1.0 / found.probability:,.0f} {event}"
    else:
        says = f"no repetition came to a flight that {event}: give more --paths"
    interval = f", 95 % interval {found.low:.3g} to {found.high:.3g}" if found.probability > 0.0 else ""
    lines = [
        f"# {scenario.name}: {says}",
        "",
        f"probability {found.probability:.3g}{interval}, by {len(found.repetitions)} repetitions of subset simulation,"
        f" {found.flights:,} flights in all, those that chose the levels among them.",
    ]
    if found.drawn:
        lines += ["", f"What is drawn at the start is moved with the noise: {found.drawn} normal numbers of `truth`."]
    if found.low == 0.0 and found.probability > 0.0:
        lines += ["", "The repetitions differ so much that the interval reaches to 0: give more --paths."]
    if at := level_apart(found):
        lines += [
            "",
            f"From {at:.3g} m on the repetitions go different ways: some found a way to the event that others did not"
            " see, and an interval may miss it. Give more --paths, and compare with --count.",
        ]
    if counted := found.counted:
        lines += [
            "",
            f"Counted beside it: {counted.events} of {counted.flights:,} flights,"
            f" {counted.events / counted.flights:.3g}, 95 % interval {counted.low:.3g} to {counted.high:.3g}.",
        ]
    lines.append("")
    if found.plan.levels:
        kept = _column_means([one.kept for one in found.repetitions])
        accepted = _column_means([one.accepted for one in found.repetitions])
        cells = [
            [f"{level:.3g}", f"{share:.3g}", f"{step:.3g}", f"{taken:.2f}"]
            for level, share, step, taken in zip(found.plan.levels, kept, found.plan.steps, accepted, strict=False)
        ]
        lines += table(["level [m]", "of those before it", "step", "steps taken"], cells)
    cells = [[str(i), f"{r.probability:.3g}", f"{r.flights:,}"] for i, r in enumerate(found.repetitions)]
    lines += table(["repetition", "probability", "flights"], cells)
    return "\n".join(lines) + "\n"


def level_apart(found: Rare) -> float | None:
    """Return the first level at which the repetitions' acceptances lie farther apart than APART; None for none.

    Steps that are taken far more often than planned are those of flights that got there by other noise: a few ticks'
    instead of many, or one draw at the start.
    """
    for i, level in enumerate(found.plan.levels):
        taken = [one.accepted[i] for one in found.repetitions if len(one.accepted) > i]
        if taken and max(taken) - min(taken) > APART:
            return level
    return None


def _column_means(rows: list[tuple[float, ...]]) -> list[float]:
    """Return the mean of each column over the rows that reach it."""
    return [float(np.mean([row[i] for row in rows if len(row) > i])) for i in range(max(map(len, rows)))]
