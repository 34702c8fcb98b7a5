"""The backends that compute a network, from pixels to raw heads: onnxruntime, OpenCV or torch.

Each uses one core: a vehicle has no more to spare, and the result has the same bits whatever the number of workers.
OpenCV and torch have one number of threads for the whole process.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ortilo_drake.model.optional import check_installed, later
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.detector.darknet_layers import DarknetCfg

cv2 = later("cv2")

# A function from RGB in [0, 1] (1, 3, height, width), float32, to the raw heads in the order of the .cfg.
Compute = Callable[[np.ndarray], Sequence[np.ndarray]]


def onnxruntime_session(path: Path) -> Any:
    """Return the onnxruntime session of a file; InputError if onnxruntime is missing or the file is damaged."""
    check_installed("onnxruntime", "onnx")
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    try:
        return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime has no base class for its errors
        raise InputError(f"{path}: not an ONNX network: {' '.join(str(error).split())[:120]}") from None


def onnxruntime_network(path: Path) -> Compute:
    """Return a network that onnxruntime computes; InputError as in onnxruntime_session."""
    session = onnxruntime_session(path)
    name = session.get_inputs()[0].name
    return lambda pixels: session.run(None, {name: pixels})


def opencv_network(path: Path) -> Compute:
    """Return a network that OpenCV computes; InputError if the file is damaged."""
    cv2.setNumThreads(1)
    try:
        network = cv2.dnn.readNetFromONNX(str(path))
    except cv2.error as error:
        raise InputError(f"{path}: not an ONNX network: {' '.join(str(error).split())[:120]}") from None
    names = network.getUnconnectedOutLayersNames()

    def compute(pixels: np.ndarray) -> Sequence[np.ndarray]:
        network.setInput(pixels)
        return network.forward(names)

    return compute


def torch_network(path: Path, cfg: DarknetCfg) -> Compute:
    """Return a network that torch computes, from Darknet's .weights or our .safetensors.

    InputError if torch is not installed, or the file is damaged or does not fit this .cfg.
    """
    check_installed("torch", "torch")
    check_installed("safetensors", "torch")
    import torch

    from ortilo_drake.onboard.detector.darknet_file import read_network
    from ortilo_drake.onboard.detector.darknet_network import DarknetNetwork
    from ortilo_drake.onboard.detector.darknet_weights import read_weights

    if path.suffix == ".safetensors":
        network, _ = read_network(path)
        if (network.cfg.net, network.cfg.layers) != (cfg.net, cfg.layers):
            raise InputError(f"{path}: holds a network of another .cfg")
    else:
        network = DarknetNetwork(cfg)
        read_weights(path, network)
    network.eval()
    torch.set_num_threads(1)

    def compute(pixels: np.ndarray) -> Sequence[np.ndarray]:
        with torch.inference_mode():
            return [head.numpy() for head in network(torch.from_numpy(pixels))]

    return compute
