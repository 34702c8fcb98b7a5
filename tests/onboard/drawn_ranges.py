"""Ranges with drawn errors, of the ranges and of the anchors' survey, and what is learned of them."""

import numpy as np
from plain_box import PlainBox
from scipy.linalg import block_diag, null_space

from ortilo_drake.model.room import ORTILO_ROOM, load_room
from ortilo_drake.onboard.ranging.bank_element import SCALE, bank_box
from ortilo_drake.onboard.ranging.fix_element import fix_box
from ortilo_drake.onboard.ranging.survey_bank import gather
from ortilo_drake.scenario import Multilateration

ANCHORS = load_room(ORTILO_ROOM).anchor_positions
N = len(ANCHORS)
FRACTION, SD, WORTH = 0.0075, 0.05, 10.0
NOISE = np.array([0.0, FRACTION, SD])
BANK = (0.0, 0.4, 1.0)
LEARNS_BOTH = Multilateration(bias_sd=SD, bias_bank=BANK, noise_scale=WORTH)


def residuals_of(fixes: int, white: float, seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return what fixes gather, q and nu, and the residuals densely: values, their covariance by what is told, and A.

    Args:
        fixes: how many.
        white: sd of the ranges' errors [m].
        seed: of them.
    """
    generator, gathered, sums = np.random.default_rng(seed), np.zeros((N, N + 1)), np.zeros(2)
    values, V, A = [], [], []
    for k in range(fixes):
        p, there = np.array([5.0 + k, 0.3 * k, 1.5]), np.ones(N)
        there[7:] = float(k > 0)
        away = p - ANCHORS
        d = np.linalg.norm(away, axis=1)
        ranges = d + generator.normal(0.0, white, N)
        message = np.concatenate(([1.0, 0.0], ranges, there))
        nu, q = gather(gathered, p, message, ANCHORS, NOISE, np.zeros((N, 3)))
        some = there > 0.0
        B = null_space((away / d[:, None])[some].T).T  # what residuals say whatever the position
        values.append(B @ (ranges - d)[some])
        V.append(B @ np.diag((FRACTION * ranges[some]) ** 2) @ B.T)
        A.append(B @ np.eye(N)[some])
        sums += q, nu
    return gathered, np.concatenate((sums, [1.0])), np.concatenate(values), block_diag(*V), np.vstack(A)


def flown(
    c: float, sd: float, seed: int, seconds: float = 6.0, its: Multilateration = LEARNS_BOTH, far: float = 0.0
) -> tuple[float, np.ndarray]:
    """Return c and what is learned on a straight line at 0.5 m/s, with fixes at 10 Hz.

    Args:
        c: how much larger the noise is than told.
        sd: of the survey [m].
        seed: of both.
        seconds: how long.
        its: which learn.
        far: how much longer one range is for half a second [m].
    """
    generator = np.random.default_rng(seed)
    true = ANCHORS + generator.normal(0.0, 1.0, ANCHORS.shape) * sd
    solver, bank = PlainBox(fix_box(its, ANCHORS)), PlainBox(bank_box(its, ANCHORS, 0.1))
    for k in range(int(10 * seconds)):
        p = np.array([0.05 * k, 0.02 * k, 1.5])
        d = np.linalg.norm(p - true, axis=1)
        ranges = d * (1.0 + c * FRACTION * generator.normal(size=N))
        ranges[0] += far * (25 <= k < 30)
        uwb = np.concatenate(([1.0, 0.0], ranges, np.ones(N)))
        said = bank.state["learned"]
        learned = {"learned": said[:-3]} if its.bias_bank else {}
        fix = solver.say(message=uwb, belief=np.concatenate((p, np.zeros(237))), noise=said[-3:], **learned)
        bank.step(message=uwb, fix=fix)
    return float(np.sqrt(bank.state["scale"][SCALE])), bank.state["learned"].copy()
