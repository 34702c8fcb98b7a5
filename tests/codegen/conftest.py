"""What the tests of exports share: exports that are made once."""

import hashlib
from collections.abc import Callable
from pathlib import Path

import pytest
from exports import SHORT
from filelock import FileLock

from ortilo_drake.codegen.export import export
from ortilo_drake.scenario import Scenario, load_scenario


@pytest.fixture(scope="session")
def exported(workers_folder: Path) -> Callable[..., Path]:
    """A function that returns the folder of an export, made once whichever worker asks first; nobody writes there."""

    def folder_of(scenario: Scenario, target: str = "x86-64", ticks: int = 60, precision: str = "double") -> Path:
        asked = f"{scenario.model_dump_json()} {target} {ticks} {precision}"
        folder = workers_folder / f"export_{hashlib.sha256(asked.encode()).hexdigest()[:16]}"
        with FileLock(f"{folder}.lock"):
            if not (folder / "manifest.json").exists():
                export(scenario, target, folder, ticks, precision)
        return folder

    return folder_of


@pytest.fixture(scope="session")
def short() -> Scenario:
    """A flight of a step to the side, whose export for this processor the quick tests share."""
    return load_scenario("nominal_imu_uwb", SHORT)
