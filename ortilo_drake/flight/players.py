"""The players of a scenario: compiled code, or Drake's simulator. Both give the same flight to the last bit."""

from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import Final

import xarray as xr

from ortilo_drake.diagrams.onboard import NO_PARTS, Parts
from ortilo_drake.diagrams.wiring.whole import why_not
from ortilo_drake.flight.engine import Engine
from ortilo_drake.flight.flight import FlightSimulator
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario

CHOICES: Final = ("fastest", "engine", "drake", "drake-elements")


def choose(scenario: Scenario, player: str = "fastest", parts: Parts = NO_PARTS) -> str:
    """Return the name of the player of a scenario: 'engine', 'drake' or 'drake-elements'.

    'engine' is compiled code, which needs all parts to be elements. 'drake' is a Diagram in which the elements of each
    half are one system, 'drake-elements' a Diagram in which each element is a system. 'fastest' means the engine where
    it can fly the scenario, else 'drake'. A first flight of a new scenario takes about as long with both: both compile
    the same elements, which takes longer than the flight. `parts` are an estimator, servo and planner in place of the
    scenario's; only Drake takes them. InputError if there is no such player, or it cannot fly the scenario.
    """
    if player not in CHOICES:
        raise InputError(f"player: {player!r}: must be one of {', '.join(CHOICES)}")
    if player not in ("fastest", "engine"):
        return str(player)
    reason = why_not_engine(scenario, parts)
    if player == "engine" and reason is not None:
        raise InputError(f"player: engine: {scenario.name}: {reason}: Drake flies it")
    return "engine" if reason is None else "drake"


def why_not_engine(scenario: Scenario, parts: Parts = NO_PARTS) -> str | None:
    """Return why the engine cannot fly a scenario with parts, in a line that names the field; None if it can."""
    for role, make in parts._asdict().items():
        if make is not None:
            return f"{role}: is given as a System"
    return why_not(scenario)


def flown_by(scenarios: Iterable[Scenario], players: Iterable[str]) -> str:
    """Return a report's text on the players that flew scenarios, with why it was Drake where the engine cannot."""
    why = next((f" ({why})" for scenario in scenarios if (why := why_not_engine(scenario))), "")
    return ", ".join(name + why * (name == "drake") for name in sorted(set(players)))


def player_of(scenario: Scenario, player: str = "fastest", parts: Parts = NO_PARTS) -> Engine | FlightSimulator:
    """Return a scenario's player; the seed is not used. Arguments as in choose, InputError also of the player."""
    chosen = choose(scenario, player, parts)
    if chosen == "engine":
        return Engine(scenario)
    return FlightSimulator(scenario, parts=parts, fused=chosen == "drake")


@lru_cache(maxsize=1)
def kept_player(scenario_json: str, folder: str, player: str = "fastest") -> Engine | FlightSimulator:
    """Return a scenario's player; the last one is reused while the folder, whose name has a digest, is the same."""
    return player_of(Scenario.model_validate_json(scenario_json), player)


def fly(
    scenario: Scenario,
    progress: Callable[[int], None] | None = None,
    player: str = "fastest",
    parts: Parts = NO_PARTS,
) -> xr.Dataset:
    """Fly one scenario with its own seed.

    InputError as in player_of.

    Args:
        scenario: the scenario.
        progress: called with the number of ticks flown.
        player: as in choose.
        parts: as in choose.

    Returns:
        A Dataset over ticks; see flight.flight_dataset.
    """
    return player_of(scenario, player, parts).fly(scenario.seed, progress)
