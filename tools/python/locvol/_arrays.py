"""Arrays of a mesh, in memory or in a file that is mapped."""
import os
import tempfile

import numpy as np


def make(shape, dtype, directory):
    """An array to be filled: in memory, or in a nameless file in `directory`, if that is given.

    The file goes with the array, and with the process whatever ends it. Raises OSError where there
    is no room for it."""
    num_bytes = int(np.prod(shape)) * np.dtype(dtype).itemsize
    if directory is None or num_bytes == 0:
        return np.empty(shape, dtype)
    with tempfile.TemporaryFile(dir=directory) as file:
        # Before: who writes to a map is killed by a full disk.
        os.posix_fallocate(file.fileno(), 0, num_bytes)
        return np.memmap(file, dtype, "r+", shape=shape)


def finished(array):
    """The array, which nobody is to change from here on."""
    array.flags.writeable = False
    return array
