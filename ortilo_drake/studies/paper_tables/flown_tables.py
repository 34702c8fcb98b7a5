"""The flights behind the paper's tables: which scenarios fly, and their summaries."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from ortilo_drake.flight.ensemble import fly_many
from ortilo_drake.flight.processes.workers import kept_workers
from ortilo_drake.flight.summary import Summary
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.scenario.load import Setting
from ortilo_drake.studies.paper_tables.tables import PRESETS, SCENARIOS


def scenarios_of_tables(
    preset: str,
    settings: Iterable[Setting] = (),
    of_cameras: Iterable[Setting] = (),
    beside: Iterable[str | Path] = (),
    only: str | None = None,
) -> dict[str, Scenario]:
    """Return the scenarios of the tables by their name there: the paper's two in a preset, and those named by `beside`.

    `settings` are laid over all of them, then `of_cameras` over those that fly a camera. `only` names one of SCENARIOS
    and leaves out the other. InputError if a scenario is wrong, or appears twice.
    """
    if preset not in PRESETS:
        raise InputError(f"preset: {preset!r}: must be one of {', '.join(PRESETS)}")
    if only not in (None, *SCENARIOS):
        raise InputError(f"only: {only!r}: must be one of {', '.join(SCENARIOS)}")
    prefix, settings = "" if preset == "tuned" else f"{preset}_", tuple(settings)

    def chosen(name: str | Path) -> Scenario:
        flown = load_scenario(name, settings)
        return load_scenario(name, (*settings, *of_cameras)) if flown.sees_landmarks else flown

    found = {name: chosen(prefix + name) for name in SCENARIOS if only in (None, name)}
    for further in beside:
        flown = chosen(further)
        if flown.name in found:
            raise InputError(f"--beside {further}: '{flown.name}' is in the tables already")
        found[flown.name] = flown
    return found


def fly_tables(
    scenarios: Mapping[str, Scenario],
    flights: int,
    out: Path,
    workers: int,
    progress: Callable[[str], None],
    player: str = "fastest",
) -> dict[str, list[Summary]]:
    """Fly each scenario on the same seeds, from 0, and return the summaries; flights that are kept are not flown again.

    Flights are kept in the folder `out`; 1 worker flies in this process; progress gets the scenario's name after each
    flight; the player is as in players.choose. InputError as fly_many.
    """
    found = {}
    with kept_workers():
        for name, flown in scenarios.items():

            def tell(_: Summary, name: str = name) -> None:
                progress(name)

            found[name] = fly_many(flown, range(flights), out, workers, tell, player)
    return found
