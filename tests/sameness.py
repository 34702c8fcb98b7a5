"""The check that two flights are the same, bit for bit, in every variable."""

import numpy as np
import xarray as xr


def assert_same_bits(one: xr.Dataset, other: xr.Dataset, within: float = 0.0) -> None:
    """Assert that two flights ended in the same way and have the same variables with the same values.

    Args:
        one: a flight.
        other: another flight.
        within: largest difference of two values, in the values' unit; 0 means bit for bit.
    """
    assert one.attrs["lost"] == other.attrs["lost"]
    assert set(one.variables) == set(other.variables)
    for name in one.variables:
        a, b = one[name].values, other[name].values
        if within and a.dtype.kind == "f":
            np.testing.assert_allclose(a, b, rtol=0.0, atol=within, err_msg=str(name))
        else:
            np.testing.assert_array_equal(a, b, err_msg=str(name))
