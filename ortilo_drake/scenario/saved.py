"""The scenario that a flight or a log carries: JSON with every default filled in, and the number of its format."""

import json
from typing import Any, Final

from ortilo_drake.model.typed_yaml import InputError, validate
from ortilo_drake.scenario.scenario import Scenario

FORMAT: Final = 2  # written beside a scenario's JSON


def scenario_from_json(text: str, version: Any, source: str) -> Scenario:
    """Return the scenario that a flight or a log carries.

    Args:
        text: its JSON.
        version: the format written beside it, None if there is none.
        source: what to call it in an error.

    Raises:
        InputError: if it is no scenario of this format.
        ValueError: if it is no JSON.
    """
    if version != FORMAT:
        raise InputError(f"{source}: is of format {version}, this version reads format {FORMAT}")
    return validate(Scenario, json.loads(text), source)
