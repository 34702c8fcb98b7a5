"""Messages older than the estimator's history. The estimator drops them, and a flight warns of them at its start."""

import math
from typing import Any

from ortilo_drake.onboard.estimator.measurement_handler import oldest_used
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.described import described


def late_messages(scenario: Scenario) -> list[str]:
    """Return a line for each sensor some of whose messages come too late to be used; it begins with the setting."""
    found = []
    for sensor in scenario.sensors:
        oldest = _oldest(scenario, sensor)
        if oldest is None:
            continue
        link, latency = scenario.link_of(sensor), scenario.latency_of(sensor)
        least, most = link.delay + latency, link.delay + latency + link.random_delay
        if most <= oldest[0]:
            continue
        seen = scenario.measurement
        if scenario.estimator.kind == "tight" and sensor == seen.sensors[seen.inertial]:  # an earlier sample is used
            found.append(
                f"{sensor}.link.delay: samples come up to {_ticks(most)} late; the tight filter ignores late samples"
            )
            continue
        share = min(1.0, (most - oldest[0]) / (link.random_delay + 1))
        how_late = _ticks(most) if least == most else f"{least} to {_ticks(most)}"
        whose = f"{sensor}.link.delay" + (f", {sensor}.latency" if latency else "")
        lost = "not one message is used" if share == 1.0 else f"{share:.0%} of the messages are not used"
        found.append(
            f"{whose}: messages come {how_late} late, at most {most * scenario.h:.3g} s; {oldest[1]}: {lost}"
            + _mend(scenario, sensor, most)
        )
    return found


def _oldest(scenario: Scenario, sensor: str) -> tuple[int, str] | None:
    """Return the greatest usable age of a sensor's messages [ticks] and the reason; None if every age is usable."""
    settings: Any = scenario.estimator
    if settings.kind == "tight":
        if not _is_aid(sensor):
            return 0, f"the tight filter uses no late message of {sensor}"
        return round(settings.horizon / scenario.h), f"estimator.horizon is {settings.horizon:g} s"
    delay = getattr(settings, "delay", "ignore")
    if settings.kind != "intermittent" or delay == "ignore":
        return None
    oldest = oldest_used(delay, settings.horizon, scenario.h)
    return oldest, f"estimator.{'delay drop uses' if delay == 'drop' else 'horizon goes back'} at most {_ticks(oldest)}"


def _is_aid(sensor: str) -> bool:
    """Return whether the tight filter uses a sensor's raw messages, also late ones, in place of its fixes."""
    return described(sensor).solver is not None


def _ticks(n: int) -> str:
    return f"{n} tick" + "s" * (n != 1)


def _mend(scenario: Scenario, sensor: str, most: int) -> str:
    """Return a clause with the settings under which all messages are used; empty if there are none."""
    settings: Any = scenario.estimator
    horizon = math.ceil(1e3 * most * scenario.h) / 1e3
    if settings.kind == "tight" and not _is_aid(sensor):
        return ""
    if horizon > (1.0 if settings.kind == "tight" else 2.0):
        return ""
    replays = " estimator.delay=replay and" if getattr(settings, "delay", "replay") == "drop" else ""
    return f"; with{replays} estimator.horizon={horizon:g} all are"
