"""The mean of the samples that a sensor faster than the tick takes in one tick."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from ortilo_drake.model.signals import ARRIVED, PAYLOAD, STAMP, samples_in, size_of_samples


class SampleMean(LeafSystem):
    """A system that turns a message of n samples into a message of one sample, their mean.

    The samples' noise is white, so the mean's noise has 1 / n of their covariance. If a sample is missing, there is no
    mean, because its age and covariance would differ.

    Ports:
        <name> (2 + n (2 + p)): n samples, see model/signals.py.
        mean (2 + p, output): [arrived, stamp of the newest sample, mean payload]; zeros if there is no mean.

    Args:
        name: name of the message.
        size: 2 + p, size of one sample.
        n: number of samples in a message.
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
