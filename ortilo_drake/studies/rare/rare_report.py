"""The report of `ortilo rare`, as Markdown."""

import numpy as np
from scipy import stats

from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.rare.estimate import Joined
from ortilo_drake.studies.rare.rare_flights import Event, Rare
from ortilo_drake.studies.rare.subset import CHAIN, FIRST, KEPT, most_levels
from ortilo_drake.views.numbers import table

WIDE = 100.0  # if the ratio of an interval's ends is larger, only the bound is told [1]
_MILLIARD = 1e9  # from this number on, flights are written with an exponent
OFTEN = 0.1  # a larger share of flights is given in percent [1]
APART = 0.25  # least difference of acceptances at one level that shows repetitions going different ways [1]
OF_CHAIN = 0.25  # standard deviation of a chain's share of accepted steps [1]; 0.2 was measured in hovering flights
BY_CHANCE = 0.99  # share of studies whose largest difference of acceptances at one level counts as chance [1]
CONFIRMS = 5  # with so many events in a count that agrees, the count has met every way to the event that matters
MOST_COUNTED = 1e6  # largest number of flights that a report advises to count
MORE = "; more --paths and --repetitions are needed to say more"


def verdict(scenario: Scenario, found: Rare) -> str:
    """Return the verdict in one line: how often the event happens, or the known bound."""
    return headline(scenario, found) + (MORE if bound_only(found) else "")


def headline(scenario: Scenario, found: Rare) -> str:
    """Return how often the event happens, without the advice for a better answer."""
    event, flown, (often, ends) = happening(found.event), found.independent, how_often(found)
    if found.probability is None and not flown.events:
        return f"{scenario.name} {event}: fewer than {found.high:.2g} (95 %), none in {flown.flights:,} flights"
    known, about = ("95 %", "") if bound_only(found) else (f"95 %: {ends}", "about ")
    by = f" ({known})"
    if found.probability is None:
        by = f", by counting: {flown.events} of {flown.flights:,}{by}"
    if "one flight" in often:
        return f"{scenario.name}: {about}{often} {event}{by}"
    return f"{scenario.name} {event} in {about}{often}{by}"


def spans_far(low: float, high: float) -> bool:
    """Return whether an interval is so wide that a figure within it would mislead."""
    return high > WIDE * low


def bound_only(found: Rare) -> bool:
    """Return whether only a bound of the probability is known; an event that never happened has words of its own."""
    return bool(found.probability or found.independent.events) and spans_far(found.low, found.high)


def how_often(found: Rare) -> tuple[str, str]:
    """Return how often the event happens and its 95 % interval, in words: a share if often, else one flight in n."""
    p, low, high = found.probability or found.independent.events / found.independent.flights, found.low, found.high
    if bound_only(found):
        rarer = f"{min(high, 1.0):.0%} of flights" if high > OFTEN else f"one flight in {_one_in(high)}"
        return f"fewer than {rarer}", f"one in {_one_in(high)} to {_one_in(low) if low else 'infinity'}"
    if p > OFTEN:
        return f"{p:.0%} of flights", f"{low:.0%} to {min(high, 1.0):.0%}"
    if not p:
        return f"none of {found.independent.flights:,} flights", f"fewer than one in {_one_in(high)}"
    return f"one flight in {_one_in(p)}", f"one in {_one_in(high)} to {_one_in(low) if low else 'infinity'}"


def happening(event: Event) -> str:
    """Return the event as the rest of a sentence that begins with the scenario."""
    if event.corridor is None:
        return "loses its vehicle"
    return f"strays {event.corridor:g} m or more from its {event.origin}"


def _one_in(probability: float) -> str:
    """Return n of "one flight in n" for a probability, in two digits."""
    return two_digits(1.0 / max(probability, 1e-99))


def two_digits(number: float) -> str:
    """Return a number in two digits, with an exponent if it is long."""
    rounded = float(f"{number:.2g}")
    return f"{rounded:,.0f}" if 10.0 <= rounded < _MILLIARD else f"{rounded:.2g}"


def rare_text(scenario: Scenario, found: Rare) -> str:
    """Return the report in Markdown."""
    return f"# {verdict(scenario, found)}\n\n{rare_body(found)}"


def rare_body(found: Rare) -> str:
    """Return the report without its verdict; a doubt about the verdict comes first."""
    lines = [doubt, ""] if (doubt := doubt_of(found)) else []
    lines += _by_counting(found) if found.probability is None else _by_repetitions(found, found.probability)
    if found.drawn:
        each = ", ".join(f"{name.removeprefix('truth/')} ({n})" for name, n in found.drawn.items())
        lines += ["", f"What is drawn at the start is moved with the noise, in so many normal numbers: {each}."]
    lines += ["", *table(["one flight in about", f"comes so far from its {found.event.origin} [m]"], _distances(found))]
    if found.plan.levels and found.repetitions:
        kept, accepted = _shares(found), _column_means([one.accepted for one in found.repetitions])
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
    return "\n".join(lines) + "\n"


def _distances(found: Rare) -> list[list[str]]:
    """Return rows with a distance's rarity and the distance, for the first climb's first flights and for its levels."""
    levels = list(zip(np.cumprod(_shares(found)), found.plan.levels, strict=False))
    nearest = levels[0][1] if levels else np.inf
    of_first = [(share, far) for share, far in zip(FIRST, found.plan.first, strict=False) if far < nearest]
    return [[_one_in(share), f"{far:.3g}"] for share, far in of_first + levels]


def _shares(found: Rare) -> list[float]:
    """Return the share of each level's flights that reached the next: as found, or as planned without repetitions."""
    return (
        _column_means([one.kept for one in found.repetitions]) if found.repetitions else [KEPT] * len(found.plan.levels)
    )


def _by_repetitions(found: Rare, probability: float) -> list[str]:
    interval = f"probability {probability:.3g}, 95 % interval {found.low:.3g} to {found.high:.3g}"
    if (joined := found.joined) is None:
        return [
            f"{interval} (Wilson), by counting: the event is so frequent that it needs no levels."
            f" {found.flights:,} flights in all; those of the first run, which decided that, are not counted."
        ]
    lines = [f"{interval}: {_carried(found, joined)} {found.flights:,} flights of subset simulation in all.", ""]
    flown, (low, high), of_count = found.independent, joined.by_repetitions, joined.by_count
    share = flown.events / flown.flights
    if joined.agree and probability not in (share, joined.mean):
        lines += ["Each figure lies outside the other's interval: the two hardly agree. Give more --paths.", ""]
    cells = [
        [f"{len(found.repetitions)} repetitions of subset simulation", f"{joined.mean:.3g}", _ends(low, high, "96")],
        [f"a count: {flown.events} of {flown.flights:,} flights", f"{share:.3g}", _ends(*of_count, "99")],
    ]
    if joined.agree:
        cells.append(["**both together**", f"{probability:.3g}", _ends(found.low, found.high, "95")])
    return lines + table(["by", "probability", "interval"], cells)[:-1]


def _ends(low: float, high: float, percent: str) -> str:
    return f"{low:.3g} to {high:.3g} ({percent} %)"


def _carried(found: Rare, joined: Joined) -> str:
    """Return words that say whether the repetitions or the count give the answer."""
    if not joined.agree:
        return (
            "the count's, because no probability is in both intervals below. The repetitions miss a cause of the event,"
            " or found it too often by chance: give more --paths."
        )
    low = "repetitions" if found.low == joined.by_repetitions[0] else "count"
    high = "repetitions" if found.high == joined.by_repetitions[1] else "count"
    if low == high:
        return f"both ends are of the {low}."
    return f"its lower end is of the {low}, its upper end of the {high}."


def _by_counting(found: Rare) -> list[str]:
    """Return the text for a study whose answer is a count alone."""
    flown, came = found.independent, sum(one.probability > 0.0 for one in found.repetitions)
    if found.joined:
        why = f"The repetitions' mean, {found.joined.mean:.2g}, is not used: the count contradicts it."
    elif found.repetitions:
        of = f"Of {len(found.repetitions)} repetitions of subset simulation {came or 'none'} came to the event"
        why = f"{of}, and an estimate of its own needs two."
    elif len(found.plan.levels) < most_levels(found.least):
        why = "Subset simulation found no flight that goes farther than its last level, and stopped."
    else:
        why = f"Subset simulation came to no such flight down to a probability of about {found.least:g}, and stopped."
    return [
        f"The answer is a count of the {flown.flights:,} flights whose noise is independent: it happened in"
        f" {flown.events} of them, interval {found.low:.2g} to {found.high:.2g}"
        f" ({'Clopper and Pearson, 99 %' if found.joined else 'Wilson, 95 %'}). {why}"
        f" Subset simulation flew {found.flights:,}. To know more, give more --paths, --repetitions or --count."
    ]


def doubt_of(found: Rare) -> str | None:
    """Return a line on why the interval may miss the answer, and what to do; None without such a doubt.

    A count that agrees and saw the event CONFIRMS times has met every way to the event that matters.
    """
    at, flown, joined = level_apart(found), found.independent, found.joined
    if at is None or (joined and joined.agree and flown.events >= CONFIRMS):
        return None
    each = [one.probability for one in found.repetitions]
    return (
        f"**Doubtful**: from {at:.3g} m on the repetitions go different ways ({min(each):.2g} to {max(each):.2g}). Some"
        " found a way to the event that others did not see, and the interval may miss the answer. Fly again with"
        f" --paths {4 * found.paths}{_count_to_confirm(found)}."
    )


def _count_to_confirm(found: Rare) -> str:
    """Return the option to count twice the events that confirm an answer, if this takes less than a million flights."""
    flights = 2 * CONFIRMS / max(found.probability or found.high, 1e-99)
    return f" and --count {int(two_digits(flights).replace(',', ''))}" if 10.0 < flights < MOST_COUNTED else ""


def level_apart(found: Rare) -> float | None:
    """Return the first level at which the repetitions' acceptances differ by more than chance; None if there is none.

    Steps are accepted far more often than planned if flights got there by other noise: a few ticks' instead of many,
    or one draw at the start. By chance, the difference has the studentized range of means over as many chains.
    """
    if len(found.repetitions) < 2:
        return None
    of_mean = OF_CHAIN / np.sqrt(found.paths / CHAIN)
    by_chance = float(stats.studentized_range.ppf(BY_CHANCE, len(found.repetitions), np.inf)) * of_mean
    for i, level in enumerate(found.plan.levels):
        taken = [one.accepted[i] for one in found.repetitions if len(one.accepted) > i]
        if taken and max(taken) - min(taken) > max(APART, by_chance):
            return level
    return None


def _column_means(rows: list[tuple[float, ...]]) -> list[float]:
    """Return the mean of each column over the rows that reach it."""
    return [float(np.mean([row[i] for row in rows if len(row) > i])) for i in range(max(map(len, rows)))]
