"""Files of a result folder as the report lists them: what each is for, its size, its hash, and a link to it."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from lensforge.cad.part import Part
from lensforge.errors import InputError
from lensforge.report.numerals import size
from lensforge.runs.results import REPORT_FILE, Results

_PURPOSES = {
    ".step": "solid for CAD and CAM",
    ".stl": "mesh",
    ".3mf": "mesh for printers",
    ".ies": "intensity, IES LM-63",
    ".iesxml": "intensity, ANSI/IES TM-33",
    ".ldt": "intensity, EULUMDAT",
    ".tm25ray": "rays that leave the lens, ANSI/IES TM-25",
    ".pdf": "page to print",
    ".html": "page",
    ".csv": "table",
}


@dataclass(frozen=True)
class FileRow:
    """One file: its name, size and SHA-256; ``purpose`` and ``link`` are empty where there is none."""

    name: str
    size: str
    sha256: str
    purpose: str
    link: str = ""


def exported_files(results: Results) -> list[FileRow]:
    """Files of the part, as they were exported."""
    part = results.find(Part)
    stamps = {} if part is None else part.files
    return [FileRow(name, size(stamp.bytes), stamp.sha256, _purpose(name)) for name, stamp in stamps.items()]


def folder_files(folder: Path, linked: bool) -> list[FileRow]:
    """Files in ``folder``, without this report (HTML or PDF) and hidden files; ``linked``: relative to the folder.

    Raises :class:`InputError` for a file that cannot be read.
    """
    found = []
    for path in sorted(folder.iterdir()):
        if path.is_file() and path.name not in (REPORT_FILE, "report.pdf") and not path.name.startswith("."):
            try:
                with path.open("rb") as file:
                    digest = hashlib.file_digest(file, "sha256").hexdigest()
                length = size(path.stat().st_size)
            except OSError as error:
                raise InputError(f"{path}: cannot be read ({error.strerror})") from None
            link = quote(path.name) if linked else ""
            found.append(FileRow(path.name, length, digest, _purpose(path.name), link))
    return found


def _purpose(name: str) -> str:
    return _PURPOSES.get(Path(name).suffix.lower(), "")
