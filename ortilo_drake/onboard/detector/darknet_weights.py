"""Weights of a Darknet network: Darknet's own .weights files.

The header, little endian, has major, minor and revision (int32) and the number of images seen in training (int64 from
version 0.2 on, int32 before). Then follow float32 for each convolution in order: with batch normalisation beta, gamma,
mean and variance, without it the bias; then the kernels (filters, inputs, size, size).
"""

from pathlib import Path

import numpy as np
import torch

from ortilo_drake.model.input_files import open_file
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.detector.darknet_network import DarknetNetwork


def _tensors(network: DarknetNetwork) -> list[torch.Tensor]:
    """Return the network's tensors in the order of the file."""
    tensors: list[torch.Tensor | None] = []
    for layer in network.convolutions():
        norm = layer.norm
        ahead = (
            [layer.convolution.bias] if norm is None else [norm.bias, norm.weight, norm.running_mean, norm.running_var]
        )
        tensors += [*ahead, layer.convolution.weight]
    # None exists only in torch's types: a convolution without norm has a bias, and norms track their statistics.
    return [tensor for tensor in tensors if tensor is not None]


def check_values(path: Path, network: DarknetNetwork) -> None:
    """Refuse a network with weights that are not finite or with a negative variance.

    InputError naming the file of the weights and the convolution, counted from 0.
    """
    for number, layer in enumerate(network.convolutions()):
        for name, tensor in layer.state_dict().items():
            if not bool(torch.isfinite(tensor).all()):
                raise InputError(f"{path}: convolution {number} {name}: holds NaN or inf, must be finite")
            if name == "norm.running_var" and bool((tensor < 0).any()):
                raise InputError(f"{path}: convolution {number} {name}: holds {float(tensor.min())}, must be >= 0")


def _header_size(path: Path) -> int:
    """Return the number of bytes before the first weight."""
    with open_file(path) as file:
        start = file.read(20)
    major, minor = (int.from_bytes(start[i : i + 4], "little", signed=True) for i in (0, 4))
    if not (0 <= major < 1000 and 0 <= minor < 1000):  # Darknet marks transposed weights by a version of 1000 or more
        raise InputError(f"{path}: version {major}.{minor}: must be from 0.0 to 999.999; is it a .weights file?")
    size = 20 if 10 * major + minor >= 2 else 16
    if len(start) < size:
        raise InputError(f"{path}: {len(start)} bytes: must start with a header of {size}")
    return size


def read_weights(path: Path, network: DarknetNetwork) -> None:
    """Fill a network from a .weights file; the file is memory-mapped, so that only the network's copy takes memory.

    InputError if the file cannot be read, is shorter or longer than the network, or holds NaN or inf; the network's
    values are then undefined.
    """
    needed = network.cfg.weight_count
    try:
        header = _header_size(path)
        size = path.stat().st_size - header
        if size != 4 * needed:
            raise InputError(f"{path}: holds {size / 4:.12g} weights, this network needs {needed}")
        values = np.memmap(path, dtype="<f4", mode="r", offset=header, shape=(needed,))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    start = 0
    with torch.no_grad():
        for tensor in _tensors(network):
            part = np.array(values[start : start + tensor.numel()], dtype=np.float32)
            tensor.copy_(torch.from_numpy(part).reshape(tensor.shape))
            start += tensor.numel()
    check_values(path, network)
