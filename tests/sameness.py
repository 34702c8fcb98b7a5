"""Proof that two flights are one: bit for bit, in every variable."""

import numpy as np
import xarray as xr


def assert_same_bits(one: xr.Dataset, other: xr.Dataset, within: float = 0.0) -> None:
    """Assert that two flights ended alike and have the same variables, with the same arrivals and values.

    Args:
        one: a flight.
        other: another one.
        within: how far values may be apart, in the unit of each: 0 is bit for bit.
    """
    assert one.attrs["lost"] == other.attrs["lost"]
    assert set(one.variables) == set(other.variables)
    for name in one.variables:
        a, b = one[name].values, other[name].values
        if within and a.dtype.kind == "f":
            np.testing.assert_allclose(a, b, rtol=0.0, atol=within, err_msg=str(name))
        else:
            np.testing.assert_array_equal(a, b, err_msg=str(name))
