"""The report of `ortilo rare`, as Markdown."""

import numpy as np

from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.rare.rare_flights import Rare
from ortilo_drake.studies.rare.subset import KEPT, most_levels
from ortilo_drake.views.markdown import table

FAR_APART = 30.0  # of the interval's ends, from which the figure is said to be a magnitude [1]
_MILLIARD = 1e9  # flights, from which their number is written with an exponent
OFTEN = 0.1  # a larger share of flights is given in percent [1]
APART = 0.25  # of acceptances at one level, from which repetitions are said to have gone different ways [1]


def verdict(scenario: Scenario, found: Rare) -> str:
    """Return the verdict in one line: how often it happens."""
    event = "loses its vehicle" if found.corridor is None else f"strays {found.corridor:g} m or more from its reference"
    flown = found.independent
    if found.probability is not None:
        p, low, high = found.probability, found.low, found.high
        if p > OFTEN:
            return f"{scenario.name} {event} in about {p:.0%} of flights (95 %: {low:.0%} to {min(high, 1.0):.0%})"
        one_in = [_one_in(p) for p in (p, high, low)]
        return f"{scenario.name}: about one flight in {one_in[0]} {event} (95 %: one in {one_in[1]} to {one_in[2]})"
    if flown.events:
        p, counted = flown.events / flown.flights, f"by counting: {flown.events} of {flown.flights:,}"
        if p > OFTEN:
            return f"{scenario.name} {event} in about {p:.0%} of flights, {counted}"
        return f"{scenario.name}: about one flight in {1.0 / p:,.0f} {event}, {counted}"
    return f"{scenario.name} {event}: fewer than {flown.high:.2g} (95 %), none in {flown.flights:,} flights"


def _one_in(probability: float) -> str:
    """Return of how many flights it is one, in two digits."""
    flights = float(f"{1.0 / max(probability, 1e-99):.2g}")
    return f"{flights:,.0f}" if flights < _MILLIARD else f"{flights:.2g}"


def rare_text(scenario: Scenario, found: Rare) -> str:
    """Return the report."""
    lines = [f"# {verdict(scenario, found)}", ""]
    lines += _by_counting(found) if found.probability is None else _by_repetitions(found, found.probability)
    if found.drawn:
        lines += ["", f"What is drawn at the start is moved with the noise: {found.drawn} normal numbers of `truth`."]
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
    if found.plan.levels and found.repetitions:
        kept = _column_means([one.kept for one in found.repetitions])
        accepted = _column_means([one.accepted for one in found.repetitions])
        cells = [
            [f"{level:.3g}", f"{share:.3g}", f"{step[0]:.3g}", f"{step[1]:.3g}", f"{taken:.2f}"]
            for level, share, step, taken in zip(found.plan.levels, kept, found.plan.steps, accepted, strict=False)
        ]
        lines += table(["level [m]", "share that reached it", "step", "share redrawn", "steps accepted"], cells)
    if found.repetitions:
        cells = [
            [str(i), f"{r.probability:.3g}" if r.probability else "none found", f"{r.flights:,}"]
            for i, r in enumerate(found.repetitions)
        ]
        lines += table(["repetition", "probability", "flights"], cells)
    elif found.plan.levels:
        cells = [[f"{KEPT**-n:,.0f}", f"{level:.3g}"] for n, level in enumerate(found.plan.levels, 1)]
        lines += table(["one flight in about", "comes so far from its reference [m]"], cells)
    return "\n".join(lines) + "\n"


def _by_repetitions(found: Rare, probability: float) -> list[str]:
    if not found.plan.levels:
        return [
            f"probability {probability:.3g}, 95 % interval {found.low:.3g} to {found.high:.3g} (Wilson), by counting:"
            f" the event is so frequent that it needs no levels. {found.flights:,} flights in all; those of the first"
            " run, which decided that, are not counted."
        ]
    lines = [
        f"probability {probability:.3g}, 95 % interval {found.low:.3g} to {found.high:.3g},"
        f" by {len(found.repetitions)} repetitions of subset simulation,"
        f" {found.flights:,} flights in all, those that chose the levels among them."
    ]
    if found.high > FAR_APART * found.low:
        lines += ["", "The repetitions differ by so much that this is no more than a magnitude: give more --paths."]
    return lines


def _by_counting(found: Rare) -> list[str]:
    """Return the text for a study in which no climb, or only a discarded one, reached the event."""
    if found.repetitions:
        came = sum(one.probability > 0.0 for one in found.repetitions) or "none"
        of = f"{came} of {len(found.repetitions)} repetitions"
        why = f"Subset simulation gives no interval: {of} came to such a flight."
    elif len(found.plan.levels) < most_levels(found.least):
        why = "Subset simulation found no flight that goes farther than its last level, and stopped."
    else:
        why = f"Subset simulation came to no such flight down to a probability of about {found.least:g}, and stopped."
    flown = found.independent
    return [
        f"{why} It flew {found.flights:,}. The figure above is what counting says: of flights with noise of their own"
        f" it happened in {flown.events} of {flown.flights:,}, 95 % interval {flown.low:.2g} to {flown.high:.2g}"
        " (Wilson). To know more, give more --paths or --count."
    ]


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
