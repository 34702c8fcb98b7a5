"""The mean of the samples that a sensor faster than the tick took within it."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from ortilo_drake.model.signals import ARRIVED, PAYLOAD, STAMP, samples_in, size_of_samples


class SampleMean(LeafSystem):
    """Turns a message of n samples into a message of one sample, their mean.

    The noise of the samples is white, so that of the mean has 1 / n of their covariance. Where a sample is missing
    there is no mean: it would be of another age and covariance.

    Ports:
        <name> (2 + n (2 + p)): n samples, see model/signals.py.
        mean (2 + p, output): [arrived, stamp of the newest sample, mean payload]; zeros where there is none.

    Args:
        name: the message's.
        size: 2 + p.
        n: samples in a message.
    """

    def __init__(self, name: str, size: int, n: int):
        super().__init__()
        self.set_name(f"{name}_mean")
        self._n = n
        self._samples = self.DeclareVectorInputPort(name, size_of_samples(size, n))
        self.DeclareVectorOutputPort("mean", size, self._calc, prerequisites_of_calc={self._samples.ticket()})

    def _calc(self, context: Context, output: BasicVector) -> None:
        message = self._samples.Eval(context)
        samples, mean = samples_in(message, self._n), np.zeros(output.size())
        if message[ARRIVED] and samples[:, ARRIVED].all():
            mean[ARRIVED], mean[STAMP] = 1.0, samples[-1, STAMP]
            mean[PAYLOAD:] = samples[:, PAYLOAD:].mean(axis=0)
        output.SetFromVector(mean)
