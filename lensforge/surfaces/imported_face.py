"""An imported face: exact from another result's ``lens.json``, or a spline through a face of a STEP or IGES file.

Each records its origin, and its largest error against the file. A CAD file is sampled by the CAD kernel in a child
process.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError, refused
from lensforge.results import Record
from lensforge.results.file_bounds import MOST_STEP_MIB, require_small_step
from lensforge.results.files import MIB, read_file, read_json, temporary_folder, write_json
from lensforge.results.json_npz import arrays_in
from lensforge.results.sandbox import ChildLimits, work_in_child
from lensforge.results.stage_result import CHECKSUM, require_checksum, validated
from lensforge.surfaces.chart_spline import ChartSpline
from lensforge.surfaces.surface import Surface, SurfaceRecord

# Files between the process that samples a CAD face and the one that asks for it.
JOB = "job.json"
FOUND = "found.json"
SPLINE = "spline.npz"


@dataclass(frozen=True)
class GivenFace:
    """An imported ``surface``, a phrase on its ``origin``, and its largest errors: nm along the normal, and urad.

    ``unit``: unit of the file.
    """

    surface: Surface
    origin: str
    form_error_nm: float
    normal_error_urad: float
    unit: str = "mm"


def place_of(direction: Float[np.ndarray, "3"]) -> str:
    """Phrase for a direction from the origin."""
    polar = np.degrees(np.arccos(np.clip(direction[2], -1.0, 1.0)))
    azimuth = np.degrees(np.arctan2(direction[1], direction[0])) % 360.0
    return f"{polar:.1f} degrees from the axis at azimuth {azimuth:.0f} degrees"


LENS_FILE = "lens.json"  # in a result folder
_LENS_REMEDY = "name the folder of a result, or its lens.json"


def lens_file(path: Path) -> Path:
    """The file of the lens in a result folder, or ``path`` itself."""
    return path / LENS_FILE if path.is_dir() else path


class _Face(Record):
    unions = ("face",)

    face: SurfaceRecord


def face_of_lens(path: Path, name: str) -> GivenFace:
    """The face ``name`` of the lens in ``path``.

    Raises :class:`InputError` for any other file, and for a face that the lens does not have.
    """
    content = read_json(path, _LENS_REMEDY)
    faces = content.get("faces") if isinstance(content, dict) else None
    names = [name for name, face in faces.items() if isinstance(face, dict)] if isinstance(faces, dict) else []
    if not isinstance(content, dict) or not isinstance(faces, dict) or not names:
        raise InputError(f"{path}: not a lens file; {_LENS_REMEDY}")
    if name not in names:
        raise InputError(f"{path}: face = {name!r}: the faces of this lens are {', '.join(names)}; give one of them")
    face = faces[name]
    if CHECKSUM in content:
        require_checksum(content, path, _LENS_REMEDY)
    record = validated(_Face, {"face": face}, path, _LENS_REMEDY)
    with refused(f"{path}: {name}", f"…; {_LENS_REMEDY}", InputError):
        surface = record.face.surface()
    return GivenFace(surface, f"{name} face of {path.parent.name}/{path.name}", 0.0, 0.0)


STEP_SUFFIXES = (".step", ".stp")
IGES_SUFFIXES = (".iges", ".igs")
_CAD_REMEDY = "repair it in CAD, and export it again"
_MEMORY_MIB = 1800
_SECONDS = 120.0  # up to 60,000 rays of 0.3 ms and the reading
_SECONDS_PER_MIB = 15.0  # on a slow core

Selection = str | int


def face_of_cad(path: Path, faces: Sequence[Selection], shift_mm: tuple[float, float, float]) -> GivenFace:
    """The named or numbered ``faces`` of ``path`` as one surface, in mm whatever its unit, moved by ``shift_mm``.

    "first": the one that the axis meets first above the origin. Numbers count from 1 in the order of the file. Raises
    :class:`InputError`, with the place, for a face that does not exist, has a hole, ends above z = 0, or is met twice
    from the origin.
    """
    suffix = path.suffix.lower()
    if suffix not in STEP_SUFFIXES + IGES_SUFFIXES:
        known = ", ".join(STEP_SUFFIXES + IGES_SUFFIXES)
        raise InputError(f"{path}: {suffix or 'no suffix'}, must be one of {known}; export the face as STEP or IGES")
    content = read_file(path, missing="give the CAD file of the face", most_bytes=MOST_STEP_MIB * MIB)
    return _sampled(content, str(path), path.name, suffix in IGES_SUFFIXES, tuple(faces), shift_mm)


@lru_cache(maxsize=4)  # a spec is made many times while it is read; the sampling takes seconds
def _sampled(
    content: bytes,
    origin: str,
    name: str,
    iges: bool,
    faces: tuple[Selection, ...],
    shift_mm: tuple[float, float, float],
) -> GivenFace:
    if not iges:
        require_small_step(content, origin, _CAD_REMEDY)
    limits = ChildLimits(_MEMORY_MIB, _SECONDS + _SECONDS_PER_MIB * len(content) / MIB)
    with temporary_folder("face") as folder:
        file = "face.igs" if iges else "face.step"
        (folder / file).write_bytes(content)
        job = {"file": file, "iges": iges, "faces": list(faces), "shift_mm": list(shift_mm), "origin": origin}
        write_json(folder / JOB, job)
        script = Path(__file__).with_name("cad_sampling.py").resolve()
        work_in_child(script, folder, limits, origin=origin, remedy=_CAD_REMEDY)
        described = json.loads((folder / FOUND).read_text(encoding="utf-8"))
        arrays = arrays_in((folder / SPLINE).read_bytes(), ("axis", "radius"), 64 * MIB)
    named = " and ".join(described["names"])
    surface = ChartSpline.through(np.asarray(arrays["axis"]), np.asarray(arrays["radius"]))
    return GivenFace(
        surface,
        f"{named} of {name}",
        described["form_error_nm"],
        described["normal_error_urad"],
        str(described["unit"]),
    )
