"""The gate of a measurement: how far it may be from what was predicted."""

from scipy.special import gammaincinv


def squared_gate(probability: float, dimensions: int) -> float:
    """Return the squared Mahalanobis distance within which a Gaussian stays with a probability: chi-square's quantile.

    scipy.stats.chi2.ppf computes the same, but takes a second to import.
    """
    return float(2.0 * gammaincinv(dimensions / 2, probability))
