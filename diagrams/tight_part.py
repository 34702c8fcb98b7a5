"""The estimator `kind: tight` as a registered part; its System is imported when one is made, which takes a second."""

from typing import Any

import numpy as np

from ortilo_drake.model.parts import Part, register_part
from ortilo_drake.scenario.tight import TightFilter


def _make(scenario: Any, xbar_0: np.ndarray) -> Any:
    from ortilo_drake.diagrams.estimator import Estimator

    return Estimator(scenario, xbar_0)


register_part("estimator", Part("tight", TightFilter, _make))
