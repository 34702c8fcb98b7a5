"""The smoother on a made-up linear model, against the whole covariance of all states given all rows (NumPy)."""

import numpy as np
import pytest
from plain_filter import run_plainly

from ortilo_drake.studies.recorded import run_tape
from ortilo_drake.studies.recorded.filter_types import ENTRIES, Run, Tape
from ortilo_drake.studies.recorded.run_tape import smooth

N, STEPS, ROWS = 18, 6, 3


def test_states_and_covariances_are_those_of_all_rows_at_once(monkeypatch) -> None:
    run_plainly(monkeypatch, run_tape, "_back")
    rng = np.random.default_rng(1)
    As = np.tile(np.eye(9, 16), (STEPS, 1, 1)) + 0.05 * rng.normal(size=(STEPS, 9, 16))  # the last column is by dk
    keeps = rng.uniform(0.8, 1.0, size=(STEPS, N - 9))
    Q, C = np.diag(rng.uniform(0.01, 0.1, N)), np.diag(rng.uniform(0.5, 1.0, N))
    C[6:9] = C[:, 6:9] = Q[6:9] = 0.0  # a known attitude, so that the error state is the state
    As[:, 6:9], As[:, :, 6:9] = 0.0, 0.0
    As[:, 6:9, 6:9] = np.eye(3)
    x = np.zeros(N)
    joint, mean = C.copy(), np.zeros(N)  # of all states so far
    tape = {name: [] for name in Tape._fields}
    states, covariances, rows_of_all = [], [], []
    for k in range(STEPS):
        F = np.zeros((N, N))
        F[:9, :15], F[:9, -1] = As[k, :, :15], As[k, :, 15]
        F[9:, 9:] += np.diag(keeps[k])
        cross = F @ joint[-N:]
        joint = np.block([[joint, cross.T], [cross, F @ joint[-N:, -N:] @ F.T + Q]])
        mean = np.append(mean, F @ mean[-N:])
        x, C = F @ x, F @ C @ F.T + Q
        tape["what"].append(0)
        for i in range(ROWS):
            where, row = np.zeros(ENTRIES, np.int64), np.zeros(ENTRIES)
            where[:4], row[:4] = rng.choice(np.r_[0:6, 9:N], 4, replace=False), rng.normal(size=4)
            H = np.zeros(N)
            np.add.at(H, where, row)
            y, r = rng.normal(), -60.0 if (k, i) == (3, 1) else 0.2  # one that widens, see anchor_trust.py
            S = H @ C @ H + r
            assert (S < 0.0) == (r < 0.0)
            K, e = C @ H / S, y - H @ x
            x, C = x + K * e, C - np.outer(K, K) * S
            for name, value in (("where", where), ("row", row), ("gain", K), ("e", e), ("S", S)):
                tape[name].append(value)
            tape["what"].append(1)
            rows_of_all.append((len(mean) - N, H, y, r))
        tape["what"].append(2)
        tape["C"].append(C[:9].copy())
        nominal = np.zeros(N + 1)
        nominal[:6], nominal[6] = x[:6], 1.0
        states.append(nominal)
        covariances.append(C[:3, :3].copy())
    for at, H, y, r in rows_of_all:
        H_all = np.zeros(len(mean))
        H_all[at : at + N] = H
        K = joint @ H_all / (H_all @ joint @ H_all + r)
        mean = mean + K * (y - H_all @ mean)
        joint = joint - np.outer(K, H_all @ joint)
    kept = {name: np.array(part) for name, part in tape.items()} | {"A": As, "keeps": keeps}
    kept["what"] = kept["what"].astype(np.int8)
    none = np.zeros(0)
    run = Run(np.array(states), np.array(covariances), none, none, none, Tape(**kept))
    found, P = smooth([run])
    for k in range(STEPS):
        at = (k + 1) * N
        np.testing.assert_allclose(found[k, :6], mean[at : at + 6], atol=1e-9)
        np.testing.assert_allclose(P[k], joint[at : at + 3, at : at + 3], atol=1e-9)
    assert found[0, 0] != pytest.approx(states[0][0], abs=1e-3)
