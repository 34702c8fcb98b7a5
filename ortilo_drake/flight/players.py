"""The players of a scenario: compiled code, or Drake's simulator. The flight is the same to the last bit."""

from collections.abc import Callable
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
    """Return the player of a scenario: 'engine', 'drake' or 'drake-elements'.

    Of a single flight of a scenario never flown before, engine and 'drake' take about as long: both compile the same
    elements, which takes longer than the flight. 'engine' is compiled code, which needs all parts to be elements.
    'drake' is a Diagram in which the elements of each half are one system, 'drake-elements' one in which each is its
    own. 'fastest' takes the engine where it can, else 'drake'. The parts are estimator, servo and planner in place of
    the scenario's, which only Drake takes. InputError if there is no such player, or it cannot fly this.
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
    """Return the reason why the engine cannot fly this, in a line that names the field; None if it can."""
    for role, make in parts._asdict().items():
        if make is not None:
            return f"{role}: is given as a System"
    return why_not(scenario)


def player_of(scenario: Scenario, player: str = "fastest", parts: Parts = NO_PARTS) -> Engine | FlightSimulator:
    """Return the player of a scenario; its seed is not used. Arguments and errors as choose's, and as the player's."""
    chosen = choose(scenario, player, parts)
    if chosen == "engine":
        return Engine(scenario)
    return FlightSimulator(scenario, parts=parts, fused=chosen == "drake")


@lru_cache(maxsize=1)
def kept_player(scenario_json: str, folder: str, player: str = "fastest") -> Engine | FlightSimulator:
    """Return the player of a scenario. The last one is reused while the folder is the same: its name has the digest."""
    return player_of(Scenario.model_validate_json(scenario_json), player)


def fly(
    scenario: Scenario,
    progress: Callable[[int], None] | None = None,
    player: str = "fastest",
    parts: Parts = NO_PARTS,
) -> xr.Dataset:
    """Fly one scenario, its seed included.

    InputError as player_of.

    Args:
        scenario: the scenario.
        progress: called with the number of ticks flown.
        player: as choose.
        parts: as choose.

    Returns:
        A Dataset over ticks; see flight.flight_dataset.
    """
    return player_of(scenario, player, parts).fly(scenario.seed, progress)
