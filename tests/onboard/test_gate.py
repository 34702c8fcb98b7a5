from scipy.stats import chi2

from ortilo_drake.onboard.gate import squared_gate


def test_the_gate_is_chi_squares_quantile() -> None:
    for dimensions in (1, 2, 3, 6):
        for probability in (0.5, 0.95, 0.999, 1.0 - 1e-9):
            assert squared_gate(probability, dimensions) == chi2.ppf(probability, df=dimensions)
