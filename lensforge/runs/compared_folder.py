"""The machined part in a result folder: comparison with the design, and correction of a face for its second cut."""

from pathlib import Path
from typing import Literal

from lensforge.made.correction_result import Correction
from lensforge.made.measurement_result import PhotoComparison, SurfaceComparison, photo_png, surface_png
from lensforge.results.files import replacing
from lensforge.results.folder_lock import in_locked_folder
from lensforge.runs.corrected_part import correct
from lensforge.runs.measured_part import compare
from lensforge.runs.results import stem_of
from lensforge.runs.run_folder import open_run, write_result
from lensforge.scene.lens import load_lens
from lensforge.surfaces.imported_face import LENS_FILE


@in_locked_folder
def run_compare_photo(
    folder: Path,
    *,
    on: Path,
    off: Path | None,
    corners: list[tuple[float, float]] | None,
    target_mm: float | None = None,
    gamma: float = 1.0,
) -> PhotoComparison:
    """Compare a photograph with the simulation; also draws ``compare.png``."""
    light = open_run(folder).light
    lens = load_lens(folder / LENS_FILE)
    result = compare(light, on=on, off=off, corners=corners, target_mm=target_mm, gamma=gamma, lens=lens)
    with replacing(folder / "compare.png") as temporary:
        temporary.write_bytes(photo_png(result))
    return write_result(result, folder)


@in_locked_folder
def run_compare_surface(
    folder: Path,
    *,
    points: Path,
    surface: Literal["inner", "outer"],
    registration: Literal["rigid", "shift", "none"] = "rigid",
    rays: int | None = None,
) -> SurfaceComparison:
    """Compare measured points with one surface of the lens; also draws ``compare_<surface>.png``."""
    lens = load_lens(folder / LENS_FILE)
    result = compare(lens, points=points, surface=surface, registration=registration, rays=rays)
    with replacing(folder / f"{stem_of(result)}.png") as temporary:
        temporary.write_bytes(surface_png(result))
    return write_result(result, folder)


@in_locked_folder
def run_correct(
    folder: Path,
    *,
    points: Path,
    surface: Literal["inner", "outer"],
    wavelength_mm: float | None = None,
    gain: float = 1.0,
    registration: Literal["rigid", "shift", "none"] = "rigid",
    rays: int | None = None,
) -> Correction:
    """Correct one face for its second cut; also writes ``lens_corrected_<surface>.step``."""
    result = correct(
        load_lens(folder / LENS_FILE),
        points=points,
        surface=surface,
        wavelength_mm=wavelength_mm,
        gain=gain,
        registration=registration,
        rays=rays,
    )
    return write_result(result, folder)
