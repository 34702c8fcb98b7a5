"""The interval of the mean of positive estimates whose logarithms scatter, as those of repeated climbs do.

Estimates that are a product of many shares tend to a lognormal law (J. Bérard, P. Del Moral, A. Doucet, "A lognormal
central limit theorem for particle approximations of normalizing constants", Electronic Journal of Probability 19,
2014). Its mean has the logarithm mu + s^2 / 2, of which n logarithms of variance s^2 give an estimate with the variance
s^2 / n + s^4 / (2 (n - 1)); with Student's t that makes an interval (D. R. Cox's, in U. Olsson, "Confidence intervals
for the mean of a log-normal distribution", Journal of Statistics Education 13, 2005). Here it is laid about the
arithmetic mean, which has no bias.

Of N estimates of which n are not 0 the share n / N adds the variance (N - n) / (n N) of its logarithm.
"""

import numpy as np
from scipy import stats

LEAST = 2  # estimates above 0, without which there is no interval


def log_interval(estimates: np.ndarray, level: float) -> tuple[float, float] | None:
    """Return the ends of the interval of the mean of estimates (N), None if fewer than LEAST are above 0."""
    logs = np.log(estimates[estimates > 0.0])
    n, N = len(logs), len(estimates)
    if n < LEAST:
        return None
    s2 = float(logs.var(ddof=1))
    of_logs = s2 / n + s2**2 / (2.0 * (n - 1)) + (N - n) / (n * N)
    half = float(stats.t.ppf(0.5 + level / 2.0, n - 1)) * np.sqrt(of_logs)
    mean = float(estimates.mean())
    return mean * float(np.exp(-half)), min(mean * float(np.exp(half)), 1.0)
