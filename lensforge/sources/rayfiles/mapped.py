"""Memory of mapped files: pages that were read are given back, so that a file of any size needs little of it."""

import mmap

import numpy as np


def give_back(*arrays: np.ndarray | None) -> None:
    """Tell the system that the pages under ``arrays`` are not needed now; what is read again comes from the file.

    Only views of mapped files have such pages; nothing happens to other arrays, nor where the system cannot do it.
    """
    mappings = {id(base): base for base in map(_owner, arrays) if isinstance(base, mmap.mmap)}
    for mapping in mappings.values():
        if hasattr(mapping, "madvise"):
            mapping.madvise(mmap.MADV_DONTNEED)


def _owner(array: np.ndarray | None) -> object:
    owner: object = array
    while isinstance(owner, np.ndarray):
        owner = owner.base
    return owner
