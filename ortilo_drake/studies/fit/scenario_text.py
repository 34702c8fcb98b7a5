"""A scenario whose ranges and IMU err as a NOISE.yaml describes them."""

import os
from pathlib import Path

import yaml

from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.load import resolve
from ortilo_drake.scenario.noise_file import NoiseFile, settings_of


def base_seen_from(file: Path, base: str) -> str:
    """Return a base, a ready-made scenario's name or a file, as the scenario in `file` must name it."""
    at = resolve(base, "--base")
    return base if at.stem == base else seen_from(file, at)


def seen_from(file: Path, other: Path) -> str:
    """Return another file's name relative to `file`'s folder."""
    return os.path.relpath(os.path.realpath(other), os.path.realpath(file.parent))


def scenario_text(noise: NoiseFile, noise_file: str, base: str, below: Scenario) -> str:
    """Return a scenario's text, laid over `base`, what is `below`, whose own errors of ranges and IMU it replaces.

    Files are named as the scenario must name them.
    """
    return yaml.safe_dump({"base": base} | settings_of(noise, noise_file, below.truth), sort_keys=False)
