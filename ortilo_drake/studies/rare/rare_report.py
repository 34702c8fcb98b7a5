"""The report of `ortilo rare`, as Markdown."""

from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.rare.rare_flights import Rare


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
        f"probability {found.probability:.3g}{interval}, by"
        f" {len(found.repetitions)} repetitions of adaptive multilevel splitting, {found.flights:,} flights in all.",
    ]
    if found.low == 0.0 and found.probability > 0.0:
        lines += ["", "The repetitions differ so much that the interval reaches to 0: give more --paths."]
    if counted := found.counted:
        lines += [
            "",
            f"Counted beside it: {counted.events} of {counted.flights:,} flights,"
            f" {counted.events / counted.flights:.3g}, 95 % interval {counted.low:.3g} to {counted.high:.3g}.",
        ]
    lines += ["", "| repetition | probability | rounds | flights |", "|---|---|---|---|"]
    lines += [f"| {i} | {r.probability:.3g} | {r.rounds} | {r.paths:,} |" for i, r in enumerate(found.repetitions)]
    return "\n".join(lines) + "\n"
