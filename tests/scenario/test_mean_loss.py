"""The share of packets that a kind of loss loses in the long run."""

import numpy as np
import pytest

from ortilo_drake.scenario.link import BernoulliLoss, BurstLoss, GilbertElliottLoss, Loss, NoLoss
from ortilo_drake.scenario.loss_chain import loss_chain, mean_loss

H = 1.0 / 30.0


@pytest.mark.parametrize(
    ("loss", "share"),
    [
        (NoLoss(), 0.0),
        (BernoulliLoss(kind="bernoulli", probability=0.3), 0.3),
        (BurstLoss(kind="bursts", loss=0.7, mean_length=1.0), 0.7),
    ],
)
def test_a_share_that_is_named_is_the_mean(loss: Loss, share: float) -> None:
    assert mean_loss(loss, H) == pytest.approx(share, abs=1e-12)


def test_two_modes_are_weighted_by_their_stationary_probabilities() -> None:
    loss = GilbertElliottLoss(kind="gilbert_elliott", good_to_bad=0.02, bad_to_good=0.1, loss_good=0.05, loss_bad=0.8)
    T, lost = loss_chain(loss, H)
    stationary = np.linalg.matrix_power(T, 2000)[0]
    assert mean_loss(loss, H) == pytest.approx(stationary @ lost, abs=1e-12)
