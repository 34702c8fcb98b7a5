"""Levenberg and Marquardt's method on a factor graph.

GTSAM's own optimizers (4.3.0) pass a copy of all values to each factor written in Python, which takes thirty times as
long on a flight as all else. Their parts, linearising and eliminating the whole graph, do not.

The elimination is by QR. GTSAM's Cholesky fails where one variable of a front is known four thousand times as well as
another, as with a bias known beforehand and a slow error.
"""

import gtsam
import numpy as np

_FIRST, _FACTOR, _LARGEST = 1e-5, 10.0, 1e5  # damping: first value, factor and largest value, as GTSAM's defaults


def minimum(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, relative: float = 1e-6, iterations: int = 60
) -> gtsam.Values:
    """Return values at a minimum of half the graph's sum of weighted squares.

    The method begins at `values`, which are not changed. It ends with a step that changes the sum by at most the share
    `relative`, or after `iterations`.
    """
    order = gtsam.Ordering.MetisNonlinearFactorGraph(graph)
    error, damping = graph.error(values), _FIRST
    for _ in range(iterations):
        linear = graph.linearize(values)
        while True:
            step = _damped(linear, values, damping).optimize(order, gtsam.EliminateQR)
            tried = values.retract(step)
            new = graph.error(tried)
            done = abs(new - error) <= relative * error
            if new <= error or done:
                break
            damping *= _FACTOR
            if damping > _LARGEST:  # no step, however short, lowers the sum
                return values
        if new <= error:
            values, error = tried, new
        if done:
            return values
        damping /= _FACTOR
    return values


def eliminated(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> gtsam.GaussianBayesTree:
    """Return the graph linearised at values and eliminated, which gives marginal covariances."""
    order = gtsam.Ordering.MetisNonlinearFactorGraph(graph)
    return graph.linearize(values).eliminateMultifrontal(order, gtsam.EliminateQR)


def _damped(linear: gtsam.GaussianFactorGraph, values: gtsam.Values, damping: float) -> gtsam.GaussianFactorGraph:
    """Return a linear graph with added damping factors, which pull each number of a step to 0."""
    damped, root = gtsam.GaussianFactorGraph(), float(np.sqrt(damping))
    damped.push_back(linear)
    for key, m in values.dims().items():
        damped.add(gtsam.JacobianFactor(key, root * np.eye(m), np.zeros(m), gtsam.noiseModel.Unit.Create(m)))
    return damped
