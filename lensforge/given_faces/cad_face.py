"""A face of a STEP or IGES file as a spline over the chart, sampled by the CAD kernel in a child process."""

import json
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from lensforge.errors import InputError
from lensforge.files import MIB, read_file, temporary_folder, write_json
from lensforge.given_faces.face import FOUND, JOB, SPLINE, GivenFace
from lensforge.npz_file import arrays_in
from lensforge.surfaces.chart_spline import ChartSpline
from lensforge.untrusted.archives import MOST_STEP_MIB, require_small_step
from lensforge.untrusted.child import ChildLimits, work_in_child

STEP_SUFFIXES, IGES_SUFFIXES = (".step", ".stp"), (".iges", ".igs")
_REMEDY = "repair it in CAD, and export it again"
_MEMORY_MIB = 1800
_SECONDS, _SECONDS_PER_MIB = 120.0, 15.0  # up to 60,000 rays of 0.3 ms and the reading, on a slow core

Selection = str | int


def face_of_cad(path: Path, faces: Sequence[Selection], shift_mm: tuple[float, float, float]) -> GivenFace:
    """The named or numbered ``faces`` of ``path`` as one surface, in mm whatever its unit, moved by ``shift_mm``.

    "first": the one that the axis meets first above the origin. Numbers count from 1 in the order of the file.
    Raises :class:`InputError` for a face that is not there, has a hole, ends above z = 0, or is met twice from the
    origin, with the place.
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
        require_small_step(content, origin, _REMEDY)
    limits = ChildLimits(_MEMORY_MIB, _SECONDS + _SECONDS_PER_MIB * len(content) / MIB)
    with temporary_folder("face") as folder:
        file = "face.igs" if iges else "face.step"
        (folder / file).write_bytes(content)
        job = {"file": file, "iges": iges, "faces": list(faces), "shift_mm": list(shift_mm), "origin": origin}
        write_json(folder / JOB, job)
        script = Path(__file__).with_name("cad_sampling.py").resolve()
        work_in_child(script, folder, limits, origin=origin, remedy=_REMEDY)
        found = json.loads((folder / FOUND).read_text(encoding="utf-8"))
        arrays = arrays_in((folder / SPLINE).read_bytes(), ("axis", "radius"), 64 * MIB)
    named = " and ".join(found["names"])
    surface = ChartSpline.through(np.asarray(arrays["axis"]), np.asarray(arrays["radius"]))
    return GivenFace(
        surface, f"{named} of {name}", found["form_error_nm"], found["normal_error_urad"], str(found["unit"])
    )
