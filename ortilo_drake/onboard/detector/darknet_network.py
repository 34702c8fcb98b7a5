"""A Darknet network of the YOLOv3 kind in torch, built from its .cfg."""

from collections.abc import Callable

import torch
from torch import Tensor, nn
from torch.nn import functional

from ortilo_drake.onboard.detector.darknet_layers import (
    Convolutional,
    DarknetCfg,
    Maxpool,
    Route,
    Shortcut,
    Upsample,
    Yolo,
)

LEAK = 0.1  # slope of Darknet's leaky activation below 0
# EPSILON is added to a variance before its root, as in OpenCV's importer (darknet_io.cpp, setBatchNorm). Darknet itself
# adds 1e-6 to the root (blas.c, normalize_cpu); its later code for graphics cards adds 1e-5 to the variance
# (blas_kernels.cu).
EPSILON = 1e-6


# The constants are Darknet's (activations.h), also where torch's have more digits.
ACTIVATION_OF: dict[str, Callable[[Tensor], Tensor]] = {
    "linear": lambda x: x,
    "leaky": lambda x: functional.leaky_relu(x, LEAK),
    "logistic": torch.sigmoid,
    "mish": functional.mish,
    "hard_mish": lambda x: torch.where(x > 0.0, x, torch.where(x > -2.0, 0.5 * x * x + x, 0.0)),
    "swish": functional.silu,
    "relu": functional.relu,
    "relu6": functional.relu6,
    "elu": functional.elu,
    "selu": lambda x: 1.0507 * functional.elu(x, 1.6732),
    "gelu": lambda x: functional.gelu(x, approximate="tanh"),
    "tanh": torch.tanh,
    "hardtan": lambda x: x.clamp(-1.0, 1.0),
    "loggy": lambda x: 2.0 * torch.sigmoid(x) - 1.0,
    "relie": lambda x: functional.leaky_relu(x, 0.01),
    "ramp": lambda x: functional.relu(x) + 0.1 * x,
}


class Activation(nn.Module):
    """Darknet's activation with this name, one of ACTIVATIONS."""

    def __init__(self, name: str):
        super().__init__()
        self._name = name

    def forward(self, x: Tensor) -> Tensor:
        """Return the activation of every value."""
        return ACTIVATION_OF[self._name](x)


class Convolution(nn.Module):
    """A convolution, batch normalisation if the .cfg has it, and the activation."""

    def __init__(self, layer: Convolutional, epsilon: float = EPSILON):
        super().__init__()
        self.convolution = nn.Conv2d(
            layer.inputs,
            layer.filters,
            layer.size,
            layer.stride,
            layer.padding,
            groups=layer.groups,
            bias=not layer.batch_normalize,
        )
        self.norm = nn.BatchNorm2d(layer.filters, eps=epsilon) if layer.batch_normalize else None
        self.activation = Activation(layer.activation)

    def forward(self, x: Tensor) -> Tensor:
        """Return the layer's output."""
        x = self.convolution(x)
        return self.activation(x if self.norm is None else self.norm(x))


class Pool(nn.Module):
    """The maximum over size x size cells, padded as in Darknet: a cell outside is never the maximum."""

    def __init__(self, layer: Maxpool):
        super().__init__()
        self._size, self._stride = layer.size, layer.stride
        self._before = layer.padding // 2
        self._behind = layer.padding - self._before

    def forward(self, x: Tensor) -> Tensor:
        """Return the layer's output."""
        if self._before == self._behind <= self._size // 2:
            return functional.max_pool2d(x, self._size, self._stride, self._before)
        sides = (self._before, self._behind, self._before, self._behind)
        return functional.max_pool2d(functional.pad(x, sides, value=-float("inf")), self._size, self._stride)


class DarknetNetwork(nn.Module):
    """A network of the YOLOv3 kind; its weights are random until read (darknet_weights.py) or trained.

    `cfg` comes from darknet_cfg.py; `epsilon` is added to the variance in batch normalisation.
    """

    def __init__(self, cfg: DarknetCfg, epsilon: float = EPSILON):
        super().__init__()
        self.cfg, self.epsilon = cfg, epsilon
        named = [layer.sources for layer in cfg.layers if isinstance(layer, Route)]
        named += [(layer.source,) for layer in cfg.layers if isinstance(layer, Shortcut)]
        self._kept = {n for sources in named for n in sources}
        self.layers = nn.ModuleList()
        for layer in cfg.layers:
            match layer:
                case Convolutional():
                    self.layers.append(Convolution(layer, epsilon))
                case Maxpool():
                    self.layers.append(Pool(layer))
                case Shortcut():
                    self.layers.append(Activation(layer.activation))
                case Upsample():
                    self.layers.append(nn.Upsample(scale_factor=layer.stride, mode="nearest"))
                case _:
                    self.layers.append(nn.Identity())

    def convolutions(self) -> list[Convolution]:
        """Return the convolutions, in their order."""
        return [layer for layer in self.layers if isinstance(layer, Convolution)]

    def forward(self, images: Tensor) -> tuple[Tensor, ...]:
        """Return the raw heads, each (n, anchors (5 + classes), n_y, n_x), before any sigmoid.

        The images are RGB in [0, 1] (n, 3, height, width), with the height and width of [net].
        """
        x, heads = images, []
        kept: dict[int, Tensor] = {}
        for number, (layer, module) in enumerate(zip(self.cfg.layers, self.layers, strict=True)):
            match layer:
                case Yolo():
                    heads.append(x)
                case Route():
                    parts = [kept[n].chunk(layer.groups, dim=1)[layer.group] for n in layer.sources]  # splits channels
                    x = parts[0] if len(parts) == 1 else torch.cat(parts, dim=1)
                case Shortcut():
                    x = module(x + kept[layer.source])
                case _:
                    x = module(x)
            if number in self._kept:
                kept[number] = x
        return tuple(heads)
