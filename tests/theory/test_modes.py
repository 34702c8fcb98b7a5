"""Modes and what sensors see of them against rational arithmetic and constructed pairs."""

import re
from fractions import Fraction as Q
from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag
from scipy.stats import ortho_group

from ortilo_drake.model.hover import discretize, hover_A, hover_B
from ortilo_drake.model.signals import STATE_NAMES
from ortilo_drake.model.vehicle import M100
from ortilo_drake.onboard.servo.lq_gain import augmented_pair
from ortilo_drake.scenario import Camera, InputError, Link, Scenario, Uwb
from ortilo_drake.studies.linearization.linearization_report import unobservable_states
from ortilo_drake.studies.linearization.operating_point import check_sensors, rows_of
from ortilo_drake.studies.loop.hover_loop import sensor_subsets
from ortilo_drake.theory.modes.modes import check_detectable, modes, tick_scaling, unreached_modes, unseen_modes

H = 1.0 / 30.0
PHI, GAMMA = discretize(hover_A(), hover_B(M100), H)
ROWS = {"uwb": [0, 1, 2], "camera": [0, 1, 2], "imu": [3, 4, 5]}  # the states that each sensor sees
SUBSETS = [some for k in range(4) for some in combinations(("uwb", "camera", "imu"), k)]
Matrix = list[list[Q]]


def product(M: Matrix, N: Matrix) -> Matrix:
    return [
        [sum((a * b for a, b in zip(row, column, strict=True)), Q(0)) for column in zip(*N, strict=True)] for row in M
    ]


def exact_phi(h: Q = Q(1, 30)) -> Matrix:
    """Phi in rational numbers, from the paper's equations: four chains of integrators."""
    Phi = [[Q(i == j) for j in range(12)] for i in range(12)]
    for i in range(6):
        Phi[i][i + 6] = h
    for position, angle, g in ((0, 4, Q(981, 100)), (1, 3, -Q(981, 100))):
        Phi[position][angle], Phi[position][angle + 6] = g * h**2 / 2, g * h**3 / 6
        Phi[position + 6][angle], Phi[position + 6][angle + 6] = g * h, g * h**2 / 2
    return Phi


def less_one(M: Matrix) -> Matrix:
    return [[v - (i == j) for j, v in enumerate(row)] for i, row in enumerate(M)]


def kernel(M: Matrix, n: int = 12) -> list[list[Q]]:
    """A basis of the kernel, by exact elimination to reduced row echelon form."""
    M, pivots = [row[:] for row in M], []
    for column in range(n):
        r = len(pivots)
        pivot = next((i for i in range(r, len(M)) if M[i][column]), None)
        if pivot is None:
            continue
        M[r], M[pivot] = M[pivot], M[r]
        M[r] = [v / M[r][column] for v in M[r]]
        for i in range(len(M)):
            if i != r and M[i][column]:
                M[i] = [v - M[i][column] * w for v, w in zip(M[i], M[r], strict=True)]
        pivots.append(column)
    basis = []
    for free in sorted(set(range(n)) - set(pivots)):
        v = [Q(j == free) for j in range(n)]
        for row, column in zip(M, pivots, strict=False):
            v[column] = -row[free]
        basis.append(v)
    return basis


def exact_C(sensors: tuple[str, ...]) -> Matrix:
    return [[Q(j == state) for j in range(12)] for s in sensors for state in ROWS[s]]


def exact_unobservable(Phi: Matrix, C: Matrix) -> list[list[Q]]:
    rows, block = [], C
    for _ in range(12):
        rows += block
        block = product(block, Phi) if block else []
    return kernel(rows)


@pytest.mark.family
@pytest.mark.parametrize("rate", [5.0, 30.0, 1000.0])
def test_unobservable_states_of_every_subset_are_the_exact_ones(rate: float) -> None:
    each = Link()  # every tick
    table = unobservable_states(Scenario(control_rate=rate, uwb=Uwb(link=each), camera=Camera(link=each)))
    assert len(table) == 8
    for some in SUBSETS:
        basis = exact_unobservable(exact_phi(Q(1, int(rate))), exact_C(some))
        expected = [name for j, name in enumerate(STATE_NAMES) if any(v[j] for v in basis)]
        assert table["+".join(some) or "none"] == expected
    assert table["imu"] == ["x", "y", "z", "x_dot", "y_dot", "z_dot"]
    assert table["uwb"] == table["camera"] == table["uwb+camera"] == ["psi", "psi_dot"]
    assert table["uwb+imu"] == table["camera+imu"] == []


@pytest.mark.family
@pytest.mark.parametrize("rate", [5.0, 30.0, 1000.0])
def test_hidden_modes_have_the_exact_dimensions_and_deficiencies(rate: float) -> None:
    h = Q(1, int(rate))
    Phi, _ = discretize(hover_A(), hover_B(M100), 1.0 / rate)
    for some in SUBSETS:
        found = unseen_modes(Phi, rows_of(some), scale=tick_scaling(1.0 / rate))
        basis = exact_unobservable(exact_phi(h), exact_C(some))
        assert [m.multiplicity for m in found] == ([len(basis)] if basis else [])
        for mode in found:
            assert mode.eigenvalue == pytest.approx(1.0, abs=1e-12)
            assert mode.deficiency == len(kernel(less_one(exact_phi(h)) + exact_C(some)))


@pytest.mark.long
def test_a_sensor_on_every_third_tick_sees_the_same_states() -> None:
    Phi = exact_phi()
    cubed = product(Phi, product(Phi, Phi))
    for some in SUBSETS:
        assert exact_unobservable(cubed, exact_C(some)) == exact_unobservable(Phi, exact_C(some))
        slow = unseen_modes(np.linalg.matrix_power(PHI, 3), rows_of(some), scale=tick_scaling(H))
        fast = unseen_modes(PHI, rows_of(some), scale=tick_scaling(H))
        assert [m.states for m in slow] == [m.states for m in fast]


@pytest.mark.parametrize("rate", [5.0, 30.0, 1000.0])
def test_jordan_blocks_follow_from_exact_ranks(rate: float) -> None:
    N = less_one(exact_phi(Q(1, int(rate))))
    power, nullities = [[Q(i == j) for j in range(12)] for i in range(12)], [0]
    for _ in range(5):
        power = product(power, N)
        nullities.append(len(kernel(power)))
    at_least = [b - a for a, b in pairwise(nullities)]  # blocks of size 1, 2, ... or more
    expected = tuple(sum(count > j for count in at_least) for j in range(at_least[0]))
    assert expected == (4, 4, 2, 2)
    Phi, _ = discretize(hover_A(), hover_B(M100), 1.0 / rate)
    (mode,) = modes(Phi, tick_scaling(1.0 / rate))
    assert (mode.eigenvalue, mode.multiplicity, mode.blocks) == (1.0, 12, expected)


def test_modes_of_a_matrix_with_distinct_eigenvalues() -> None:
    A = block_diag([[0.6, 0.3], [-0.3, 0.6]], 0.9, [[0.5, 1.0], [0.0, 0.5]])
    found = {np.round(m.eigenvalue, 9): (m.multiplicity, m.blocks) for m in modes(A)}
    assert found == {0.9: (1, (1,)), 0.6 + 0.3j: (1, (1,)), 0.6 - 0.3j: (1, (1,)), 0.5: (2, (2,))}


def test_scaling_takes_tick_and_gravity_out() -> None:
    for h in (1.0, H, 1e-3):
        Phi, _ = discretize(hover_A(), hover_B(M100), h)
        T = tick_scaling(h)
        N = Phi * T / T[:, None] - np.eye(12)
        values = {round(abs(v), 9) for v in N.ravel()}
        assert values == {0.0, 1.0, 0.5, round(1 / 6, 9)}


@pytest.mark.long
@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1.0, 1.2, 0.5]))
def test_a_built_in_hidden_part_is_found_with_its_eigenvalues(seed: int, size: float) -> None:
    """Kalman's decomposition: seen [A_1 0; A_21 A_2] with C = [C_1 0], in coordinates turned at random."""
    rng = np.random.default_rng(seed)
    seen, hidden = int(rng.integers(1, 5)), 3
    angle = rng.uniform(0.3, 2.8)
    pair = size * np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    A_2 = block_diag(pair, 0.3)
    A_1, A_21, C_1 = (rng.normal(size=shape) for shape in ((seen, seen), (hidden, seen), (2, seen)))
    T = ortho_group.rvs(seen + hidden, random_state=rng)
    A = T @ np.block([[A_1, np.zeros((seen, hidden))], [A_21, A_2]]) @ T.T
    C = np.hstack([C_1, np.zeros((2, hidden))]) @ T.T
    found = unseen_modes(A, C, radius=0.0)
    expected = [size * np.exp(1j * angle), size * np.exp(-1j * angle), 0.3]
    np.testing.assert_allclose([m.eigenvalue for m in found], expected, atol=1e-8)
    assert [m.multiplicity for m in found] == [1, 1, 1]
    assert all(m.deficiency >= 1 for m in found)
    dual = unreached_modes(A.T, C.T, radius=0.0)
    np.testing.assert_allclose([m.eigenvalue for m in dual], expected, atol=1e-8)
    if size < 1.0:
        check_detectable(A, C, "pair")
    else:
        with pytest.raises(InputError, match=r"pair: \(Phi, C\) is not detectable, no measurement sees eigenvalue"):
            check_detectable(A, C, "pair")


def test_a_hidden_defective_eigenvalue_keeps_its_value_when_turned() -> None:
    """Four integrators in a row, turned: eigvals splits the 1 by some 1e-4, the cluster's mean does not."""
    rng = np.random.default_rng(7)
    chain = np.eye(4) + np.eye(4, k=1)
    T = ortho_group.rvs(6, random_state=rng)
    A, C = T @ block_diag(chain, np.diag([0.2, 0.4])) @ T.T, np.array([[0, 0, 0, 0, 1.0, 1.0]]) @ T.T
    assert np.max(np.abs(np.linalg.eigvals(A) - 1.0)[np.abs(np.linalg.eigvals(A)) > 0.5]) > 1e-6
    (mode,) = unseen_modes(A, C, radius=0.0)
    assert mode.eigenvalue == pytest.approx(1.0, abs=1e-10)
    assert (mode.multiplicity, mode.deficiency) == (4, 1)


def test_hidden_eigenvalues_near_each_other_stay_two() -> None:
    """Of 1 and 0.9985 the mean would decay; a slow defective pair that decays is one mode and does."""
    near = np.array([[1.0, 1.0], [0.0, 0.9985]])
    (mode,) = unseen_modes(near, np.zeros((0, 2)))
    assert mode.eigenvalue == pytest.approx(1.0, abs=1e-12)
    assert [m.blocks for m in modes(near)] == [(1,), (1,)]
    slow = np.array([[0.99999, 1.0], [0.0, 0.99999]])
    assert unseen_modes(slow, np.zeros((0, 2))) == []
    assert [m.blocks for m in modes(slow)] == [(2,)]


def test_a_row_of_rounding_is_no_sensor_but_a_small_unit_is() -> None:
    assert len(unseen_modes(np.eye(2), np.diag([1.0, 1e-16]))) == 1
    assert unseen_modes(np.eye(2), np.diag([1.0, 1e-9])) == []


def test_the_vehicle_is_controllable_and_needs_every_control() -> None:
    T = tick_scaling(H)
    assert unreached_modes(PHI, GAMMA, radius=0.0, scale=T) == []
    assert unreached_modes(*augmented_pair(M100, H)) == []
    lost = {0: "z, z_dot", 1: "y, phi, y_dot, phi_dot", 2: "x, theta, x_dot, theta_dot", 3: "psi, psi_dot"}
    for k, states in lost.items():
        (mode,) = unreached_modes(PHI, np.delete(GAMMA, k, axis=1), scale=T)
        assert re.fullmatch(rf"eigenvalue 1 \(\d+ times\) in {states}", str(mode))
    Phibar, Gammabar = augmented_pair(M100, H)
    (mode,) = unreached_modes(Phibar, Gammabar[:, 1:])
    assert str(mode) == "eigenvalue 1 (3 times) in z, z_dot, i_z"


@pytest.mark.parametrize(
    ("sensors", "states"),
    [
        ((), ", ".join(STATE_NAMES)),
        (("imu",), "x, y, z, x_dot, y_dot, z_dot"),
        (("uwb", "camera"), "psi, psi_dot"),
    ],
)
def test_sensors_that_leave_modes_unseen_are_refused(sensors: tuple[str, ...], states: str) -> None:
    listed = ", ".join(sensors)
    with pytest.raises(InputError, match=rf"^sensors: \[{listed}\]: .* sees eigenvalue 1 \(\d+ times\) in {states}$"):
        check_sensors(Scenario(sensors=sensors))
    check_sensors(Scenario(sensors=("uwb", "imu")))


def test_subsets_are_those_of_the_scenarios_sensors() -> None:
    assert list(sensor_subsets(("imu", "uwb"))) == ["none", "uwb", "imu", "uwb+imu"]
    assert len(sensor_subsets(Scenario().sensors)) == 8
