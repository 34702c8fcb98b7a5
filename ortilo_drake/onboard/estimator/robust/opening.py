"""The variances by which the filter's P is opened."""

import numpy as np

from ortilo_drake.model.signals import N_I
from ortilo_drake.onboard.estimator.extra_states import C as GYROSCOPE
from ortilo_drake.scenario.robust import Opening


def opening_variances(opening: Opening, extra: tuple[str, ...]) -> np.ndarray:
    """Return the variances added to P's diagonal of [x; e; i] when each part is opened (3, n); e has those names."""
    none = np.zeros(3)
    angle, gyroscope = np.full(3, opening.angle), [opening.gyroscope if name in GYROSCOPE else 0.0 for name in extra]
    others = np.repeat([opening.velocity, opening.rate], 3)
    rates = np.concatenate((none, angle, none, none, gyroscope, np.zeros(N_I)))
    whole = np.concatenate((np.full(3, opening.position), angle, others, gyroscope, np.zeros(N_I)))
    return np.square(np.array([np.zeros(whole.size), rates, whole]))
