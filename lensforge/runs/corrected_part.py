"""Correction of a measured face for its second cut: the verb."""

from pathlib import Path
from typing import get_args

from lensforge.errors import InputError
from lensforge.made.correction_result import Correction
from lensforge.made.measurement_result import Registration, Side
from lensforge.runs.arguments import count_of, judging_source, number_of, path_of, preset_of, require, threads_of_torch
from lensforge.runs.other_conditions import rays_of
from lensforge.scene.lens import Lens
from lensforge.surfaces.point_cloud import read_cloud


def correct(
    lens: Lens,
    *,
    points: Path | str,
    surface: Side,
    wavelength_mm: float | None = None,
    gain: float = 1.0,
    registration: Registration = "rigid",
    rays: int | None = None,
    threads: int | None = None,
) -> Correction:
    """Correct one face for its second cut by points measured on the first, and simulate the light of the second.

    The new nominal face is the design less ``gain`` times the measured deviation, of which only waves longer than about
    ``wavelength_mm`` pass; None: the longest at which the points show no more than noise of what is left out. Where the
    face would be concave more tightly than the ball cutter of the spec, the wavelength is longer. ``points``: a file of
    x, y, z (mm) on one ``surface`` of the part, or of its mould insert in lens coordinates; ``registration``: motion
    that is fitted to bring them onto the design, which is pose, not form. ``result.step`` is the file for the shop.
    Raises :class:`InputError`; its message names the argument.
    """
    from lensforge.made.correction import correct_face
    from lensforge.made.first_cut import Request
    from lensforge.made.measured_surface import default_rays

    require(lens, Lens, "correct")
    file = path_of("points", points)
    if file is None:
        raise InputError("points = None: give the file of the points measured on the first cut")
    for name, value, allowed in (
        ("surface", surface, get_args(Side)),
        ("registration", registration, get_args(Registration)),
    ):
        if value not in allowed:
            raise InputError(f"{name} = {value!r}: must be one of {', '.join(allowed)}")
    rays, preset, factor = count_of("rays", rays), preset_of(lens.accuracy), number_of("gain", gain)
    request = Request(number_of("wavelength_mm", wavelength_mm), 1.0 if factor is None else factor, registration)
    source = judging_source(lens.spec)
    count, conditions = rays_of(rays, default_rays(lens, preset), source)
    with threads_of_torch(threads):
        found = correct_face(
            read_cloud(file),
            lens=lens,
            side=surface,
            source=source,
            preset=preset,
            request=request,
            rays=count,
        )
    return found.model_copy(update={"conditions": conditions})
