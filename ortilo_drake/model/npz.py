"""NumPy's .npz as this package writes it: arrays that are not packed, so that a file holds no more than its size."""

import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import BinaryIO

import numpy as np


@contextmanager
def arrays_of(file: BinaryIO) -> Iterator[Mapping[str, np.ndarray]]:
    """Give the arrays of a .npz file.

    ValueError if one is packed, as numpy.savez does not: a few kB may unpack to gigabytes. NumPy and zipfile raise
    errors of a dozen kinds besides.
    """
    loaded = np.load(file, allow_pickle=False)
    if not isinstance(loaded, np.lib.npyio.NpzFile):
        raise ValueError("holds one array, not several by name")
    with loaded as found:
        assert found.zip  # until it is closed
        for part in found.zip.infolist():
            if part.compress_type != zipfile.ZIP_STORED:
                raise ValueError(f"{part.filename} is packed; arrays are read that are not")
        yield found
