"""Our own file format of a Darknet network: safetensors with the .cfg and the class names inside.

Kernels are float16, which halves the size for an error of a thousandth. Biases and normalisation, a hundredth of the
whole, stay float32, because a variance may leave float16's range. A safetensors file holds plain numbers and no code.
The .cfg has no key for the epsilon that batch normalisation adds to a variance: a value other than OWN_EPSILON is
stored beside the .cfg.
"""

import json
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from ortilo_drake.model.input_files import check_file
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.detector.darknet_cfg import parse_cfg
from ortilo_drake.onboard.detector.darknet_network import DarknetNetwork
from ortilo_drake.onboard.detector.darknet_weights import check_values

OWN_EPSILON = 1e-5  # torch's epsilon, with which our own network was trained


def _state(network: DarknetNetwork) -> dict[str, torch.Tensor]:
    """Return the weights to store: all but torch's count of training batches."""
    return {key: value for key, value in network.state_dict().items() if not key.endswith("num_batches_tracked")}


def _check_classes(source: str, classes: object, network: DarknetNetwork) -> list[str]:
    """Return the class names, checked against the network."""
    needed = network.cfg.heads[0].classes
    if not isinstance(classes, list) or not all(isinstance(name, str) and name for name in classes):
        raise InputError(f"{source}: classes: {str(classes)[:60]!r}: must be a list of names")
    if len(classes) != needed:
        raise InputError(f"{source}: classes: holds {len(classes)} names, this network needs {needed}")
    return classes


def network_bytes(network: DarknetNetwork, classes: list[str], source: str) -> bytes:
    """Return the bytes of a .safetensors file of a network, its .cfg and its class names.

    `source` is the network's name in errors. InputError if the class names do not fit, or a weight is not finite or too
    large for float16.
    """
    _check_classes(source, classes, network)
    tensors = {}
    for key, value in _state(network).items():
        tensors[key] = value.detach().cpu().to(torch.float16 if value.ndim > 1 else torch.float32).contiguous()
        if not bool(torch.isfinite(tensors[key]).all()):
            raise InputError(f"{source}: {key}: holds NaN, inf or more than float16's 65504")
    metadata = {"cfg": network.cfg.text, "classes": json.dumps(classes)}
    if network.epsilon != OWN_EPSILON:
        metadata["epsilon"] = repr(network.epsilon)
    return save(tensors, metadata=metadata)


def read_network(path: Path) -> tuple[DarknetNetwork, list[str]]:
    """Return the network of a file, ready to infer, and its class names.

    InputError if the file cannot be read, is damaged, or holds other tensors than its own .cfg needs.
    """
    check_file(path)
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            for key in ("cfg", "classes"):
                if key not in metadata:
                    raise InputError(f"{path}: metadata '{key}': is missing, must be there")
            epsilon = _json(metadata.get("epsilon", repr(OWN_EPSILON)))
            if not isinstance(epsilon, float) or not 0.0 < epsilon < 1.0:
                raise InputError(f"{path}: epsilon: {repr(epsilon)[:60]}: must be a number between 0 and 1")
            network = DarknetNetwork(parse_cfg(metadata["cfg"], f"{path}: cfg"), epsilon)
            classes = _check_classes(str(path), _json(metadata["classes"]), network)
            state = _state(network)
            odd = sorted(set(state) ^ set(file.keys()))
            if odd:
                raise InputError(f"{path}: tensor '{odd[0]}': is {'missing' if odd[0] in state else 'not of its cfg'}")
            for key, tensor in state.items():
                found = file.get_slice(key)
                shape, kind = tuple(found.get_shape()), found.get_dtype()
                if shape != tuple(tensor.shape) or kind not in ("F16", "F32"):
                    raise InputError(
                        f"{path}: tensor '{key}': is {kind} {shape}, must be F16 or F32 {tuple(tensor.shape)}"
                    )
                tensor.copy_(file.get_tensor(key))
    except (SafetensorError, OSError) as error:
        raise InputError(f"{path}: cannot be read: {' '.join(str(error).split())}") from None
    check_values(path, network)
    return network.eval(), classes


def _json(text: str) -> object:
    """Return a JSON text's value, or the text itself if it is not JSON."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text
