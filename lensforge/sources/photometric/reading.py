"""Reading and writing of photometric files; the format is recognised by the content."""

from pathlib import Path

from lensforge.errors import InputError
from lensforge.files import replacing
from lensforge.sources.photometric.eulumdat import FORMAT as EULUMDAT
from lensforge.sources.photometric.ies import FORMAT as IES
from lensforge.sources.photometric.record import PhotometricFile

_FORMATS = {entry.suffix: entry for entry in (IES, EULUMDAT)}
_MOST_BYTES = 50_000_000


def read_photometric(path: Path) -> PhotometricFile:
    """Read an IES LM-63 or EULUMDAT file. Raises :class:`InputError`, one line, if it cannot be used."""
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; give an IES LM-63 or EULUMDAT file")
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError(f"{path}: larger than {_MOST_BYTES // 10**6} MB; not a photometric file")
        text = path.read_bytes().removeprefix(b"\xef\xbb\xbf").decode("latin-1")
    except OSError as error:
        raise InputError(f"{path}: not readable ({error.strerror})") from None
    for entry in _FORMATS.values():
        if entry.matches(text):
            return entry.decode(text, str(path))
    raise InputError(f"{path}: neither IES LM-63 nor EULUMDAT; export one of these")


def write_photometric(path: Path, photometric: PhotometricFile) -> None:
    """Write ``path``; its suffix, .ies or .ldt, chooses the format."""
    entry = _FORMATS.get(Path(path).suffix.lower())
    if entry is None:
        raise InputError(f"{path}: its suffix must be one of {', '.join(_FORMATS)}")
    with replacing(Path(path)) as temporary:
        temporary.write_bytes(entry.encode(photometric).encode("latin-1", "replace"))
