"""Complaints of libtiff, which writes them to the process's standard error and then gives what it has."""

import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress

_STANDARD_ERROR = 2  # of the process: Python's own may be another
# "TIFFFillStrip: Read error on strip 0": the name of a function of libtiff or of one of its codecs, or of the file.
_COMPLAINT = re.compile(
    rb"^(?:tempfile\.tif|\w*(?:TIFF|Decode|Setup|Predictor|Required|Fax|JPEG|LZW|LZMA|ZIP|ZSTD|LogL)\w*): .*",
    re.MULTILINE,
)


@contextmanager
def as_errors() -> Iterator[None]:
    """Turn what libtiff complains of inside the block into a :class:`ValueError`; other text goes on its way.

    Other threads may write to the standard error at the same time: what has not the form of a complaint is theirs.
    """
    with _held_back() as held:
        yield
    if complaint := _COMPLAINT.search(bytes(held)):
        raise ValueError(f"damaged: {complaint.group().decode('ascii', 'replace').strip()}")


@contextmanager
def _held_back() -> Iterator[bytearray]:
    """Hold back the text that goes to the standard error in the block; pass it on after it, but for complaints."""
    held = bytearray()
    try:
        before = os.dup(_STANDARD_ERROR)
    except OSError:  # it is closed, and nobody reads it
        yield held
        return
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), _STANDARD_ERROR)
        try:
            yield held
        finally:
            os.dup2(before, _STANDARD_ERROR)
            file.seek(0)
            held += file.read()
            with suppress(OSError):  # a standard error that nobody can write to any more
                os.write(before, _COMPLAINT.sub(b"", bytes(held)).lstrip(b"\n"))
            os.close(before)
