"""Fly an estimator of your own: an alpha-beta filter on UWB positions, carried by the IMU between them.

    python examples/alpha_beta.py

An estimator is any Drake System whose inputs are named after the messages that it wants (layouts: model/signals.py),
with outputs `estimate` (p_WB, rpy, v_WB, Euler rates) and `covariance`.
"""
