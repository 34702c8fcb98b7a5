"""Scenarios whose settings are Python's keywords and values."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from ortilo_drake.scenario import InputError, Scenario, with_settings
from ortilo_drake.scenario import load_scenario as load


def load_scenario(scenario: str | Path | Scenario, *, seed: int | None = None, **settings: Any) -> Scenario:
    """Return a scenario by name, from a file or as it is, with settings laid over it.

    Args:
        scenario: a ready-made scenario's name, the path of a .yaml file, or a scenario.
        seed: the seed of all noise, if not the scenario's own.
        settings: changes, `uwb__link__loss=0.3` for uwb.link.loss; values as in YAML, or paths, NumPy's numbers and
            arrays, and settings of a scenario such as `scenario.uwb`.

    Raises:
        InputError: naming the field, its value and what is allowed.
    """
    fields = {key.replace("__", "."): value for key, value in settings.items()}
    changes = tuple((field, plain_value(field, value)) for field, value in fields.items())
    seed = plain_value("seed", seed)
    if not isinstance(scenario, Scenario):
        return load(scenario, changes, seed)
    return with_settings(scenario, changes, seed)


def plain_value(field: str, value: Any) -> Any:
    """Return a value as YAML would give it; InputError, which names the field, if YAML has nothing like it."""
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain_value(f"{field}.{key}", part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain_value(f"{field}.{k}", part) for k, part in enumerate(value)]
    if isinstance(value, None | bool | int | float | str):
        return value
    raise InputError(
        f"{field}: {str(value)[:60]}: must be a number, text, list, dict, path, NumPy array or settings of a scenario, "
        f"not a {type(value).__name__}"
    )
