"""The outlier gate of a measurement: its largest distance from the prediction."""

from scipy.special import gammaincinv


def squared_gate(probability: float, dimensions: int) -> float:
    """Return the chi-square quantile: the squared Mahalanobis distance that a Gaussian keeps with this probability.

    scipy.stats.chi2.ppf computes the same, but its import takes a second.
    """
    return float(2.0 * gammaincinv(dimensions / 2, probability))
