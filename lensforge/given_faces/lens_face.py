"""A face of another result: the inner or the outer surface of a ``lens.json``, exactly."""

from pathlib import Path
from typing import Literal

from lensforge.errors import InputError
from lensforge.files import read_json
from lensforge.given_faces.face import GivenFace
from lensforge.records import Record
from lensforge.records.stored import CHECKSUM, require_checksum, validated
from lensforge.surfaces.records import SurfaceRecord

LENS_FILE = "lens.json"  # in a result folder
_REMEDY = "name the folder of a result, or its lens.json"


def lens_file(path: Path) -> Path:
    """The file of the lens in a result folder, or ``path`` itself."""
    return path / LENS_FILE if path.is_dir() else path


class _Face(Record):
    """The one entry of a lens file that is needed."""

    unions = ("face",)

    face: SurfaceRecord


def face_of_lens(path: Path, side: Literal["inner", "outer"]) -> GivenFace:
    """The ``side`` of the lens in ``path``. Raises :class:`InputError` for any other file."""
    content = read_json(path, _REMEDY)
    if not isinstance(content, dict) or not isinstance(content.get(side), dict):
        raise InputError(f"{path}: not a lens file; {_REMEDY}")
    if CHECKSUM in content:
        require_checksum(content, path, _REMEDY)
    # files of version 0.1.0 state no kind: they knew one
    record = validated(_Face, {"face": {"kind": "srbf", **content[side]}}, path, _REMEDY)
    try:
        surface = record.face.surface()
    except InputError as error:
        raise InputError(f"{path}: {side}: {error}; {_REMEDY}") from None
    return GivenFace(surface, f"{side} face of {path.parent.name}/{path.name}", 0.0, 0.0)
