"""Pages and PDFs that this program wrote, told from those of others: only its own are overwritten or deleted.

A page carries its generator as HTML has it, ``<meta name="generator">``. A PDF gets a comment of one line at its
end, where readers of PDF look for the last thousand bytes only.
"""

from pathlib import Path

from lensforge.errors import InputError
from lensforge.version import __version__

PAGE_MARK = b'<meta name="generator" content="lensforge'
PDF_MARK = b"% printed by lensforge"
_HEAD_BYTES = 4096  # of a page: the mark stands before the styles
_TAIL_BYTES = 256


def require_own(path: Path) -> None:
    """Raise :class:`InputError` where ``path`` holds a page, a PDF or anything else that this program did not write."""
    if not is_free_or_own(path):
        raise InputError(
            f"{path}: not a page of lensforge's, so it is not overwritten; move it away, or give another name"
        )


def is_free_or_own(path: Path) -> bool:
    """True where nothing is lost if ``path`` is overwritten: no file, an empty one, or one of this program's."""
    try:
        if not path.is_file():
            return not path.exists() and not path.is_symlink()
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
            file.seek(max(0, path.stat().st_size - _TAIL_BYTES))
            tail = file.read(_TAIL_BYTES)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        raise InputError(f"{path}: cannot be read ({error}); give another name") from None
    return not head or PAGE_MARK in head or (head.startswith(b"%PDF") and PDF_MARK in tail)


def pdf_mark() -> bytes:
    """The last line of a PDF that this program made."""
    return b"\n%s %s\n" % (PDF_MARK, __version__.encode())
