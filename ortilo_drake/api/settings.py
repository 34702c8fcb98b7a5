"""Scenarios whose settings are Python's keywords and values."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from ortilo_drake.scenario import Scenario, with_settings
from ortilo_drake.scenario import load_scenario as load


def load_scenario(scenario: str | Path | Scenario, *, seed: int | None = None, **settings: Any) -> Scenario:
    """Return a scenario by name, from a file or as it is, with settings laid over it.

    Args:
        scenario: a ready-made scenario's name, the path of a .yaml file, or a scenario.
        seed: the seed of all noise, if not the scenario's own.
        settings: changes, `uwb__link__loss=0.3` for uwb.link.loss.

    Raises:
        InputError: naming the field, its value and what is allowed.
    """
    changes = tuple(f"{key.replace('__', '.')}={json.dumps(value, default=_plain)}" for key, value in settings.items())
    if not isinstance(scenario, Scenario):
        return load(scenario, changes, seed)
    return with_settings(scenario, changes, seed)


def _plain(value: Any) -> Any:
    """Return what JSON can hold of NumPy's numbers and arrays and of paths."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)
