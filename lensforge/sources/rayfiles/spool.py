"""Numbers too many for the memory: written to a temporary file, and mapped from there like those of a ray file."""

from collections.abc import Iterable
from tempfile import TemporaryFile, gettempdir

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError

IN_MEMORY = 2**27  # bytes of numbers that stay in memory


def spooled(blocks: Iterable[Float[np.ndarray, "m ..."]], name: str) -> Float[np.ndarray, "n ..."]:
    """Join ``blocks`` of float64 along their first axis as a read-only map of a file that is gone when Python ends.

    Raises :class:`InputError`, ``name`` in front, where the temporary folder has no room.
    """
    shape: tuple[int, ...] = ()
    try:
        with TemporaryFile() as spool:
            for block in blocks:
                shape = block.shape[1:]
                spool.write(np.ascontiguousarray(block).data)
            spool.flush()
            return np.asarray(np.memmap(spool, dtype=np.float64, mode="r")).reshape(-1, *shape)
    except OSError as error:
        raise InputError(f"{name}: no room for its numbers in {gettempdir()} ({error.strerror}); set TMPDIR") from error
