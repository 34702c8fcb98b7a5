"""Parts of one's own, registered so that scenarios may name them."""

from collections.abc import Callable

import numpy as np
from pydrake.systems.framework import System

from ortilo_drake.model.parts import CompiledEstimator, Part, register_part
from ortilo_drake.model.typed_yaml import Frozen
from ortilo_drake.onboard.planner.planned import Planned
from ortilo_drake.scenario import Belief


def register_estimator(
    kind: str,
    settings: type[Frozen],
    make: Callable[[Belief, np.ndarray], System],
    compiled: CompiledEstimator | None = None,
) -> None:
    """Let scenarios name an estimator: `estimator: {kind: mine, ...}`.

    Args:
        kind: its name there.
        settings: its group of a scenario, a frozen model with the field `kind: Literal[...]`.
        make: (scenario, first estimate xbar_0 (15)) -> System, see diagrams/onboard.py.
        compiled: its share in compiled flights; without one Drake flies it.

    Raises:
        InputError: if the settings have no kind.
    """
    register_part("estimator", Part(kind, settings, make, compiled))


def register_servo(kind: str, settings: type[Frozen], make: Callable[[Belief], System]) -> None:
    """Let scenarios name a servo: `servo: {kind: mine, ...}`; arguments and errors as register_estimator."""
    register_part("servo", Part(kind, settings, make))


def register_planner(kind: str, settings: type[Frozen], make: Callable[[Belief], Planned]) -> None:
    """Let scenarios name a planner: `planner: {kind: mine, ...}`.

    It returns a Trajectory p_WB(t) (3 rows) [m], or a System with an output reference (9), whose settings then have a
    field `duration` [s].
    """
    register_part("planner", Part(kind, settings, make))
