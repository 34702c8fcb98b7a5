"""The command that repeats a flight, found from the scenario that the flight carries."""

import json
import shlex
from typing import Any

from ortilo_drake.model.input_error import InputError
from ortilo_drake.scenario import Scenario, load_scenario


def repeat_command(scenario: Scenario) -> str | None:
    """Return the `ortilo fly` command that flies a scenario again, its seed included.

    The differences from the ready-made scenario of that name stand in --set. The command is checked: it loads this very
    scenario, or none is returned.

    Returns:
        The command; None if the scenario is of a file of the user's, whose place a flight does not know.
    """
    try:
        base = load_scenario(scenario.name).model_dump(mode="json")
        wanted = scenario.model_dump(mode="json")
        settings = tuple(f"{key}={json.dumps(value)}" for key, value in _differences(base, wanted) if key != "seed")
        if load_scenario(scenario.name, settings, scenario.seed) != scenario:
            return None
    except InputError:
        return None
    words = ["ortilo", "fly", scenario.name, "--seed", str(scenario.seed)]
    for setting in settings:
        words += ["--set", setting]
    return shlex.join(words)


def _differences(base: dict[str, Any], wanted: dict[str, Any], path: str = "") -> list[tuple[str, Any]]:
    """Return the keys, dotted, and the values of what is not in base."""
    found: list[tuple[str, Any]] = []
    for name, value in wanted.items():
        before = base.get(name)
        if value == before:
            continue
        if isinstance(value, dict) and isinstance(before, dict) and value.keys() == before.keys():
            found += _differences(before, value, f"{path}{name}.")
        else:
            found.append((path + name, value))
    return found
