"""The kind of a file that was given as an ONNX network but is not one, found by its first bytes."""

import re
import zipfile
from pathlib import Path

from ortilo_drake.model.input_files import open_file
from ortilo_drake.model.typed_yaml import InputError

_EXPORT = "write it as ONNX where it was trained: yolo export model=FILE format=onnx"
_DARKNET = "give it as detector.cfg and detector.weights"
_BEGINNINGS = (
    (b"version https://git-lfs", "a Git LFS pointer", "git lfs pull fetches the file itself"),
    (b"\x89HDF", "a Keras network (HDF5)", "write it as ONNX"),
    (b"<?xml", "an OpenVINO network (.xml)", "write it as ONNX"),
    (b"<!DOCTYPE", "a web page", "download the file itself"),
    (b"<html", "a web page", "download the file itself"),
    (b"ftrt", "a TensorRT engine", "give the ONNX file that it was made of"),
)


def _in_zip(path: Path) -> tuple[str, str]:
    try:
        with zipfile.ZipFile(path) as archive:
            names = [name.rpartition("/")[2] for name in archive.namelist()]
    except (zipfile.BadZipFile, OSError, ValueError):
        return "a damaged zip archive", "must be ONNX"
    if "constants.pkl" in names:
        return "a TorchScript network", _EXPORT
    return ("a PyTorch checkpoint (.pt)", _EXPORT) if "data.pkl" in names else ("a zip archive", "must be ONNX")


def _by_beginning(path: Path, start: bytes, size: int) -> tuple[str, str] | None:
    for beginning, what, advice in _BEGINNINGS:
        if start.lstrip().startswith(beginning):
            return what, advice
    if re.search(rb"^\s*\[net(work)?\]", start, re.MULTILINE):
        return "a Darknet .cfg", _DARKNET
    number = int.from_bytes(start[:8], "little")
    if not start:
        return "an empty file", "must be ONNX"
    if start[:2] == b"PK":
        return _in_zip(path)
    if start[4:8] == b"TFL3":
        return "a TensorFlow Lite network (.tflite)", "write it as ONNX"
    if start[0] == 0x80 and start[1:2] in (b"\x02", b"\x03", b"\x04", b"\x05"):
        return "a PyTorch checkpoint (.pt)", _EXPORT
    if start[8:9] == b"{" and number < size:
        return "a safetensors file", "write it as ONNX"
    if start[4:5] == b"{" and number & 0xFFFFFFFF < size:
        return "a TensorRT engine", "give the ONNX file that it was made of"
    if len(start) > 12 and number in ((1 << 32), (2 << 32)):  # major 0, minor 1 or 2
        return "Darknet's .weights", _DARKNET
    return None


def check_onnx_file(path: Path) -> None:
    """Refuse a file in another known format for networks, before onnxruntime reads it.

    InputError saying what the file is and what to do, or that it cannot be read.
    """
    with open_file(path) as file:
        start = file.read(4096)
        size = file.seek(0, 2)
    found = _by_beginning(path, start, size)
    if found is not None:
        raise InputError(f"{path}: not an ONNX network but {found[0]}: {found[1]}")
