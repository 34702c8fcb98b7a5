"""A rare event with and without faults, side by side: the faults flown, and the ratio of the event's probabilities."""

import math
from dataclasses import dataclass
from typing import Any, Final

from ortilo_drake.flight.flyable import check_flyable
from ortilo_drake.model.typed_yaml import InputError, nearest, parse_yaml
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.faults.catalogue import NAMES, catalogue
from ortilo_drake.studies.rare.rare_flights import Rare
from ortilo_drake.studies.rare.rare_report import (
    MORE,
    bound_only,
    happening,
    headline,
    how_often,
    rare_body,
    spans_far,
    two_digits,
)
from ortilo_drake.views.numbers import table

OWN: Final = "own"  # the faults of the scenario itself


@dataclass(frozen=True)
class Times:
    """The ratio of an event's probability to that without a fault, with its 95 % interval [1].

    times: None if only a bound is known of one of the two probabilities; low is then the least possible ratio; high:
    None without an upper end.
    """

    times: float | None
    low: float
    high: float | None


def times_as_often(found: Rare, without: Rare) -> Times:
    """Return the ratio of an event's probability p with a fault to its probability q without.

    The interval of p / q follows from those of p and q: in the logarithm, the distance of each end from the ratio is
    the hypotenuse of the distances of p and of q (G. Y. Zou, A. Donner, "Construction of confidence limits about effect
    measures: a general approach", Statistics in Medicine 27, 2008). This holds for independent estimates. Flights with
    and without a fault share noise, so both probabilities err together, and the ratio is better known than this.
    If one of the two events never happened, only the ends p_low / q_high and p_high / q_low are known.
    """
    p, q = _share(found), _share(without)
    if min(p, q, found.low, without.low) > 0.0:
        down = math.hypot(math.log(p / found.low), math.log(without.high / q))
        up = math.hypot(math.log(found.high / p), math.log(q / without.low))
        return Times(p / q, p / q * math.exp(-down), p / q * math.exp(up))
    return Times(None, found.low / without.high, found.high / without.low if without.low else None)


def _share(found: Rare) -> float:
    return found.probability or found.independent.events / found.independent.flights


def faults_of(given: list[str], own: Scenario) -> dict[str, list[Any]]:
    """Return lists of faults by the names that reports use.

    given: the values of --fault, each a name of the catalogue, a fault in YAML, or OWN for the faults of the scenario
    `own`; InputError names the value and what is allowed.
    """
    found = {text: _faults(text, own) for text in given}
    kinds = [faults[0]["kind"] for text, faults in found.items() if text != OWN]

    def name(text: str, kind: str) -> str:
        if text == OWN:
            return "own faults"
        return text if text in NAMES or kinds.count(kind) > 1 else kind

    return {name(text, faults[0]["kind"]): faults for text, faults in found.items()}


def _faults(text: str, own: Scenario) -> list[Any]:
    shown = f"--fault {text!r}"
    if text == OWN:
        if not own.faults:
            raise InputError(f"{shown}: {own.name} has no faults of its own")
        return [fault.model_dump(mode="json") for fault in own.faults]
    if text in NAMES:
        case = next((case for case in catalogue(own) if case.name == text), None)
        if case is None:
            raise InputError(f"{shown}: concerns a sensor that {own.name} does not fly: {', '.join(own.sensors)}")
        return [case.fault]
    fault = parse_yaml(text, shown) if text.startswith("{") else None
    if not isinstance(fault, dict) or not isinstance(fault.get("kind"), str):
        raise InputError(
            f"{shown}: must be a fault such as '{{kind: gust, start: 5.0, end: 10.0, force: [0.0, 2.0, 0.0]}}', {OWN!r}"
            f" for those of the scenario, or one of {', '.join(NAMES)}{nearest(text, NAMES)}"
        )
    return [fault]


def check_in_flight(scenario: Scenario, name: str) -> None:
    """Raise InputError for a fault that begins after the flight's end; it names both times."""
    end = check_flyable(scenario) * scenario.h
    of = "`seconds`" if scenario.seconds is not None else f"its plan and {scenario.settle:g} s to settle"
    for fault in scenario.faults:
        if fault.start >= end:
            raise InputError(
                f"--fault {name}: begins at {fault.start:g} s, must be before the flight's end at {end:.1f} s ({of}):"
                " give its start, as in '{kind: gust, start: 5.0, end: 10.0, force: [0.0, 2.0, 0.0]}'"
            )


def faults_verdict(scenario: Scenario, without: Rare, under: dict[str, Rare]) -> str:
    """Return the verdict in one line: how often the event happens without a fault, and with each fault."""
    line, more = headline(scenario, without), bound_only(without)
    for name, found in under.items():
        times, known = times_as_often(found, without), " (95 %)" if bound_only(found) else ""
        line += f"; with {name} {how_often(found)[0]}{known}, {_in_words(times)}"
        more = more or bound_only(found) or _far(times)
    return line + (MORE if more else "")


def faults_text(scenario: Scenario, without: Rare, under: dict[str, Rare]) -> str:
    """Return the report in Markdown: the verdict, a table of all cases, and each case's own report."""
    every = {"no fault": without, **under}
    cells = [
        [name, *how_often(found), "1" if found is without else _in_words(times_as_often(found, without))]
        for name, found in every.items()
    ]
    lines = [
        f"# {faults_verdict(scenario, without, under)}",
        "",
        f"How often {scenario.name} {happening(without.event)}:",
    ]
    lines += ["", *table(["flights with", "how often", "95 % interval", "times as often (95 %)"], cells)]
    for name, found in every.items():
        lines += [f"## {name}", "", rare_body(found)]
    return "\n".join(lines)


def _far(times: Times) -> bool:
    return times.high is None or spans_far(times.low, times.high)


def _in_words(times: Times) -> str:
    if times.times is not None and times.high is not None and not _far(times):
        low, high = two_digits(times.low), two_digits(times.high)
        unclear = ": no clear difference" if times.low <= 1.0 <= times.high else ""
        return f"{two_digits(times.times)} times as often ({low} to {high}{unclear})"
    if times.low > 1.0:
        return f"at least {two_digits(times.low)} times as often"
    if times.high is not None and times.high < 1.0:
        return f"at most {two_digits(times.high)} times as often"
    return "how much more often is not known"
