"""Critical arrival rates of published examples, and closed forms for where the fixed point begins to exist."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag
from scipy.stats import ortho_group

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.theory.arrivals.arrivals import check_model
from ortilo_drake.theory.arrivals.critical_rate import critical_rate, critical_recovery
from ortilo_drake.theory.arrivals.expected_riccati import vehicle_model

VEHICLE = vehicle_model(np.eye(12), np.eye(9), 1.0 / 30.0)


def test_scalar() -> None:
    found = critical_rate(np.array([[1.25]]), np.array([[1.0]]))
    assert (found.rate, found.lower, found.upper) == pytest.approx((0.36, 0.36, 0.36), abs=1e-12)


def test_complex_matrices_are_refused_not_cut() -> None:
    with pytest.raises(InputError, match=r"^A: is complex: must be a matrix of real numbers$"):
        critical_rate(np.array([[1.25 + 1.0j]]), np.array([[1.0]]))
    with pytest.raises(InputError, match=r"^V: is complex"):
        check_model(VEHICLE._replace(V=VEHICLE.V * (1.0 + 0.1j)))


@pytest.mark.parametrize("A", [[[1.25, 0.0], [1.0, 1.1]], [[1.25, 1.0], [0.0, 1.1]]])
def test_two_states_one_output(A: list) -> None:
    """One output: g's fixed point exists above 1 - 1 / prod |s_u|^2 (Schenato et al., 2007); E[P] above 0.36."""
    found = critical_rate(np.array(A), np.array([[1.0, 1.0]]))
    assert found.lower == pytest.approx(0.36, abs=1e-12)
    assert found.upper == pytest.approx(1.0 - 1.0 / (1.25 * 1.1) ** 2, abs=2e-6)
    assert found.rate == found.lower


def test_one_unstable_eigenvalue_among_three() -> None:
    """Sinopoli et al. (2004): A = [1.25 1 0; 0 0.9 7; 0 0 0.6], C = [1 0 2]: both bounds are 0.36."""
    A = np.array([[1.25, 1.0, 0.0], [0.0, 0.9, 7.0], [0.0, 0.0, 0.6]])
    found = critical_rate(A, np.array([[1.0, 0.0, 2.0]]))
    assert (found.rate, found.lower, found.upper) == pytest.approx((0.36, 0.36, 0.36), abs=1e-12)


def test_invertible_output() -> None:
    found = critical_rate(np.array([[1.25, 0.0], [1.0, 1.1]]), np.array([[1.0, 1.0], [0.0, 1.0]]))
    assert found.rate == found.upper == pytest.approx(0.36, abs=1e-12)
    assert found.hypotheses["C has full column rank on the unstable subspace"]


@pytest.mark.long
def test_two_outputs_that_share_three_modes() -> None:
    """Decoupled: 1.3 and 1.2 by one output, 1.1 by another; the fixed point needs the worse of the two."""
    C = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    found = critical_rate(np.diag([1.3, 1.2, 1.1]), C)
    assert found.upper == pytest.approx(1.0 - 1.0 / (1.3 * 1.2) ** 2, abs=2e-6)
    # A third output that repeats the first changes nothing.
    assert critical_rate(np.diag([1.3, 1.2, 1.1]), np.vstack([C, C[0]])).upper == pytest.approx(found.upper, abs=2e-6)


@pytest.mark.long
@settings(max_examples=8)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(2, 4))
def test_one_output_and_any_state_basis(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    moduli = 1.05 + 0.1 * np.arange(n) + 0.05 * rng.random(n)
    S = np.linalg.qr(rng.normal(size=(n, n)))[0] + 0.1 * np.eye(n)
    A = S @ np.diag(moduli * rng.choice([-1.0, 1.0], n)) @ np.linalg.inv(S)
    c = rng.choice([-1.0, 1.0], (1, n)) @ np.linalg.inv(S)
    found = critical_rate(A, c)
    assert found.upper == pytest.approx(1.0 - 1.0 / np.prod(moduli) ** 2, abs=2e-5)
    assert found.rate == pytest.approx(1.0 - 1.0 / moduli.max() ** 2, abs=1e-6)


def test_two_modes_that_differ_in_sign() -> None:
    """A = diag(a, -a), C = [1 1]: l_c = 1 - a^-4, which is also where g's fixed point begins to exist."""
    found = critical_rate(np.diag([1.2, -1.2]), np.array([[1.0, 1.0]]))
    assert found.rate == pytest.approx(1.0 - 1.2**-4, abs=1e-12)
    assert found.lower == pytest.approx(1.0 - 1.2**-2, abs=1e-12)
    assert found.upper == pytest.approx(found.rate, abs=2e-6)
    assert "1 - 1/1.2^4 = 0.517747: C shows the same combination of the two unstable modes again every 2 ticks" in (
        found.sentence
    )


@pytest.mark.parametrize(
    ("A", "power"),
    [([[0.0, 1.2], [-1.2, 0.0]], 4.0), ([[0.0, -1.44], [1.0, -1.2]], 3.0), ([[1.2, 1.0], [0.0, 1.2]], 2.0)],
    ids=["a quarter turn", "a third of a turn", "a Jordan block"],
)
def test_degenerate_second_order_systems_beside_a_mode_that_decays(A: list, power: float) -> None:
    """A third of a turn a tick: s^2 + 1.2 s + 1.44, the conjugate pair two thirds of a turn apart, so d = 3."""
    turned = ortho_group.rvs(3, random_state=5)
    found = critical_rate(turned @ block_diag(A, 0.7) @ turned.T, np.array([[1.0, 0.0, 1.0]]) @ turned.T)
    assert found.rate == pytest.approx(1.0 - 1.2**-power, abs=1e-7)
    assert found.lower - 1e-7 <= found.rate <= found.upper + 1e-7


def test_three_modes_of_one_modulus_keep_their_bounds_only() -> None:
    """No theorem named here closes the gap where more than two unstable modes are confused."""
    A = block_diag([[0.0, 1.2], [-1.2, 0.0]], 1.2)
    found = critical_rate(A, np.array([[1.0, 0.0, 1.0]]))
    assert found.rate is None
    assert found.lower == pytest.approx(1.0 - 1.2**-2, abs=1e-9)
    assert found.upper == pytest.approx(1.0 - 1.2**-6, abs=2e-6)
    assert "between" in found.sentence


def test_the_vehicles_is_zero_since_every_eigenvalue_is_one() -> None:
    found = critical_rate(VEHICLE.A, VEHICLE.C)
    assert (found.rate, found.lower, found.upper) == (0.0, 0.0, 0.0)
    assert not found.hypotheses["A has eigenvalues outside the unit circle"]
    assert "0" in found.sentence


def test_an_undetectable_pair_names_its_modes() -> None:
    with pytest.raises(InputError, match=r"eigenvalue 1 \(6 times\) in x, y, z, x_dot, y_dot, z_dot"):
        critical_rate(VEHICLE.A, VEHICLE.C[6:])
    with pytest.raises(InputError, match=r"not detectable: C never sees eigenvalue 2 in state 2"):
        critical_rate(np.diag([1.5, 2.0, 0.3]), np.array([[1.0, 0.0, 1.0]]))


def test_critical_recovery_rate() -> None:
    assert critical_recovery(np.array([[1.25]])) == pytest.approx(0.36)
    assert critical_recovery(np.diag([0.5, -2.0])) == pytest.approx(0.75)
    assert critical_recovery(np.array([[0.5]])) == 0.0
