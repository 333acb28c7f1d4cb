"""Verbs on a measured part, by photographs of its light or points on a face: ``compare``, ``correct``, ``infer``."""

from collections.abc import Mapping, Sequence
from math import isqrt
from pathlib import Path
from typing import TYPE_CHECKING, get_args, overload

from lensforge.addon import require_libraries
from lensforge.addons.measure.inference_result import Inference
from lensforge.addons.measure.measured_points import measured_parts
from lensforge.addons.measure.measurement_result import (
    Correction,
    PhotoComparison,
    Registration,
    SurfaceComparison,
)
from lensforge.errors import InputError
from lensforge.light.evaluation_result import Light
from lensforge.light.lens_light import unless_default
from lensforge.public import public
from lensforge.results.arguments import (
    count_of,
    number_of,
    path_of,
    require,
    require_choice,
    threads_of_torch,
    with_known_names,
)
from lensforge.scene.lens import Lens

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import Bool, Float


RAYS = 2**21  # of each picture of a model
PIXELS = 128  # along its longer side
FEWEST_PIXELS = 32
MOST_PIXELS = 512
_PICTURES = 2, 64
_MOST_PIXELS_IN_ALL = 2**21  # whose derivatives take three GiB


@overload
def compare(
    measured: Light,
    *,
    on: Path | str,
    off: Path | str | None = None,
    corners: Sequence[tuple[float, float]] | None = None,
    target_mm: float | None = None,
    gamma: float = 1.0,
    lens: Lens | None = None,
    led: str | None = None,
) -> PhotoComparison: ...


@overload
def compare(
    measured: Lens, *, points: Path | str, surface: str, registration: Registration = "rigid", rays: int | None = None
) -> SurfaceComparison: ...


@public
@with_known_names
def compare(
    measured: Light | Lens,
    *,
    on: Path | str | None = None,
    off: Path | str | None = None,
    corners: Sequence[tuple[float, float]] | None = None,
    target_mm: float | None = None,
    gamma: float = 1.0,
    lens: Lens | None = None,
    led: str | None = None,
    points: Path | str | None = None,
    surface: str | None = None,
    registration: Registration = "rigid",
    rays: int | None = None,
) -> PhotoComparison | SurfaceComparison:
    """Compare a machined part with its design: a photograph with the light, or measured points with the lens.

    Args:
        measured: the light, for a photograph; the lens, for points.
        on: photograph with the LED on, of the first receiver, a plane.
        off: photograph with the LED off, which is subtracted.
        corners: four pixels (column, row) of the target in them, from the top left clockwise; None: they are looked
            for.
        target_mm: side of the square that they span, in mm; None: they are the receiver's own.
        gamma: exponent of the camera: light is its value to this power.
        lens: the light's; uniformity is then compared in the region that its spec names.
        led: name of the LED in the photographs; None: the first.
        points: file of x, y, z (mm) on one face; or folder of such files of several parts, called CAVITY_PART.
        surface: name of that face.
        registration: motion that is fitted to bring the points onto the design.
        rays: number of rays of the light with the measured face, from 1; None: the preset's.
    Returns: The comparison of the photographs, or of the face and its light.
    Raises: :class:`InputError` for an argument that is not allowed, or a file that cannot be read.
    Example:
        >>> run = lf.load("cad_out/quickstart")
        >>> comparison = lf.compare(run.lens, points="cloud.csv", surface="inner", rays=2**12)
        >>> print(comparison.form_deviation_um.rms, comparison.nmse_between)
    """
    on = path_of("on", on)
    off = path_of("off", off)
    points = path_of("points", points)
    of_points = {"surface": surface, "registration": unless_default(registration, "rigid"), "rays": rays}
    of_photo: dict[str, object] = {"off": off, "corners": corners, "target_mm": target_mm, "lens": lens, "led": led}
    of_photo |= {"gamma": unless_default(gamma, 1.0)}
    if isinstance(measured, Light) and on is not None and points is None:
        _refuse_unused("a photograph", of_points)
        lit = measured.by_led[measured.led if led is None else require_choice("led", led, list(measured.by_led))]
        comparison = _compare_photo(lit, on, off, corners, target_mm, gamma, lens)
        inputs = {"lens": measured.inputs["lens"], "evaluate": measured.sha256}
        return comparison.changed(inputs=inputs, led=lit.led)
    if isinstance(measured, Lens) and points is not None and on is None:
        _refuse_unused("points", of_photo)
        measured.spec.lens.require_stage("compare")
        from lensforge.addons.measure.measured_surface import ChangedLens, compare_surface

        side = require_choice("surface", surface, [face.name for face in measured.body.faces if face.is_optical])
        traced, conditions = ChangedLens.of(measured, side, count_of("rays", rays))
        parts = measured_parts(points, measured, side)
        return compare_surface(parts, traced, registration).changed(conditions=conditions)
    raise InputError(
        "compare: give one of two: a photograph of the light, --on PHOTO, or points of a face, --points FILE "
        "--surface FACE; in Python compare(light, on=PHOTO) or compare(lens, points=FILE, surface=FACE)"
    )


def _refuse_unused(measurement: str, options: Mapping[str, object]) -> None:
    """Raise :class:`InputError` for ``options``, by name, that are not None and do not belong to ``measurement``."""
    given = [name for name, value in options.items() if value is not None]
    if given:
        raise InputError(f"compare: {', '.join(given)}: of no use in a comparison with {measurement}; leave it out")


def _compare_photo(
    light: Light,
    on: Path,
    off: Path | None,
    corners: Sequence[tuple[float, float]] | None,
    target_mm: float | None,
    gamma: float,
    lens: Lens | None,
) -> PhotoComparison:
    require_libraries("measure", "skimage")

    from lensforge.addons.measure.photo_comparison import Shot, compare_photo
    from lensforge.scene.pixel_grid import PixelGrid

    given = _corners_of(corners)
    side = number_of("target_mm", target_mm)
    camera = number_of("gamma", gamma)
    shot = Shot(on, off, given, side, 1.0 if camera is None else camera)
    first = light.first
    (rows, columns) = light.map.shape
    if first.kind != "plane":
        raise InputError(
            f"receivers: the first, {first.name!r}, is a {first.kind}, must be a plane for a photograph; give the spec "
            "a plane as its first receiver, and evaluate again"
        )
    grid = PixelGrid(first.width, first.height, columns, rows)
    return compare_photo(shot, simulated=light.map, grid=grid, uniform=_uniform(light, lens))


def _corners_of(corners: Sequence[tuple[float, float]] | None) -> "Float[np.ndarray, '4 2'] | None":
    """Corners as an array; None if they are to be looked for. Raises :class:`InputError`."""
    import numpy as np

    if corners is None:
        return None
    try:
        given = np.array(corners, dtype=np.float64)
    except (TypeError, ValueError):
        given = np.empty(0)
    if given.shape != (4, 2):
        raise InputError(f"corners = {corners!r}: must be four pixels (column, row), clockwise from the top left")
    return given


def _uniform(light: Light, lens: Lens | None) -> "Bool[np.ndarray, 'h w'] | None":
    from lensforge.scene.receiver_shapes import receivers_of
    from lensforge.scene.target_pattern import uniform_region

    if lens is None:
        return None
    if lens.sha256 != light.inputs["lens"]:
        raise InputError("lens: the light was evaluated with another lens; give the lens of the light")
    spec = lens.spec.of_state(light.led)
    return uniform_region(spec.all_receivers[0].targets, receivers_of(spec, light.pixels)[0])


@public
@with_known_names
def correct(
    lens: Lens,
    *,
    surface: str,
    points: Path | str | None = None,
    inferred: Inference | Path | str | None = None,
    wavelength_mm: float | None = None,
    gain: float = 1.0,
    registration: Registration = "rigid",
    rays: int | None = None,
    threads: int | None = None,
) -> Correction:
    """Correct one face for its second cut by what was measured on the first, and simulate the light of the second.

    The new face is the design less ``gain`` times the measured deviation. Where it would be concave more tightly than
    the ball cutter of the spec, the wavelength is longer.

    Args:
        lens: the lens as designed.
        surface: name of the face.
        points: file of x, y, z (mm) on that face of the part, or of its mould insert in lens coordinates; or folder of
            such files of several parts, called CAVITY_PART, of which what the cavities have in common is corrected.
        inferred: in the place of points what :func:`infer` found, or its JSON file: errors that its pictures tell are
            corrected.
        wavelength_mm: shortest wave of the deviation that is corrected, in mm; None: the longest at which what is left
            of the points is noise alone.
        gain: share of the deviation that is corrected.
        registration: motion that is fitted to bring the points onto the design: pose, not form. Of inferred errors:
            "rigid" leaves decentre, gap and tilt of the face as they are, "shift" corrects its tilt, "none" all.
        rays: number of rays, from 1; None: the preset's.
        threads: number of threads, from 1; None: all cores.
    Returns: The correction: ``step`` is the file for the shop. The light is that with each LED, and of all lamps.
    Raises: :class:`InputError` for an argument that is not allowed, or points that do not cover the face.
    Example:
        >>> lens = lf.load("cad_out/quickstart").lens
        >>> correction = lf.correct(lens, points="cloud.csv", surface="inner", wavelength_mm=1.5, rays=2**12)
        >>> correction.save("second_cut.step")
    """
    from lensforge.addons.measure.correction import correct_face
    from lensforge.addons.measure.first_cut import Request
    from lensforge.addons.measure.inferred_form import inference_of, inferred_cut
    from lensforge.addons.measure.measured_surface import ChangedLens
    from lensforge.addons.measure.nominal_face import NominalFace
    from lensforge.addons.measure.several_parts import common_cut

    require(lens, Lens, "correct").spec.lens.require_stage("correct")
    file = path_of("points", points)
    made = inferred if isinstance(inferred, Inference) else path_of("inferred", inferred)
    if (file is None) == (made is None):
        raise InputError(
            "correct: give one of two: points measured on the first cut, --points FILE, or its errors by pictures, "
            "--inferred infer.json"
        )
    side = require_choice("surface", surface, [face.name for face in lens.body.faces if face.is_optical])
    require_choice("registration", registration, get_args(Registration))
    rays = count_of("rays", rays)
    factor = number_of("gain", gain)
    request = Request(number_of("wavelength_mm", wavelength_mm), 1.0 if factor is None else factor, registration)
    cuts, conditions = ChangedLens.of(lens, side, rays)
    face = NominalFace.of(lens, side)
    with threads_of_torch(threads):
        if made is not None:
            cut = inferred_cut(inference_of(made, lens), lens, face, request)
        else:
            assert file is not None
            cut = common_cut(measured_parts(file, lens, side), face, request)
        correction = correct_face(cut, face, cuts, request)
    return correction.changed(conditions=conditions)


@public
@with_known_names
def infer(
    lens: Lens,
    *,
    pictures: Sequence[Path | str],
    poses: Path | str,
    off: Path | str | None = None,
    corners: Sequence[tuple[float, float]] | None = None,
    gamma: float = 1.0,
    expected_um: float = 5.0,
    rays: int | None = None,
    pixels: int | None = None,
    threads: int | None = None,
) -> Inference:
    """Infer low-order errors of a made lens from pictures of its light with the LED moved.

    The form of both faces, the place of the outer one, of LED and lens, and the index, each with its standard error;
    which of them the pictures do not tell, and which further picture would tell most.

    Args:
        lens: the lens as designed, of two freeform faces, whose first receiver is a plane.
        pictures: photographs of the target by a camera that stays where it is, 2 to 64.
        poses: table of the LED's x, y, z (mm) from its place in the design, a row for each picture.
        off: photograph with the LED off, which is subtracted.
        corners: four pixels (column, row) of the receiver in the pictures, from the top left clockwise; None: they are
            looked for.
        gamma: exponent of the camera: light is its value to this power.
        expected_um: rms over a face of the form errors that are expected, in um; larger ones are found, too, if seen.
        rays: number of rays for each picture of the model, from 16; None: 2^21. Their noise is in the standard errors.
        pixels: number along the longer side of the model's pictures, 32 to 512; None: 128.
        threads: number of threads, from 1; None: all cores.
    Returns: The errors of the lens.
    Raises: :class:`InputError` for an argument that is not allowed, and for pictures that are not of this lens.
    Example:
        >>> lens = lf.load("cad_out/quickstart").lens
        >>> target = [(9.5, 9.5), (137.5, 9.5), (137.5, 137.5), (9.5, 137.5)]
        >>> made = lf.infer(lens, pictures=["on.png", "moved.png"], poses="poses.csv", corners=target, rays=2**12)
        >>> print(made.inner_form_um, made.not_seen)
    """
    require_libraries("measure", "skimage")
    from lensforge.addons.measure.inference import Shots, infer_errors, led_places, require_pictures_of

    made = require(lens, Lens, "infer").of_state("")
    require_pictures_of(made)
    files = tuple(path for picture in pictures if (path := path_of("pictures", picture)) is not None)
    least, most = _PICTURES
    if not least <= len(files) <= most:
        raise InputError(f"pictures: {len(files)} given, must be {least} to {most}, with the LED in different places")
    table = path_of("poses", poses)
    if table is None:
        raise InputError("poses = None: give the table of the LED's places, x, y, z in mm, a row for each picture")
    camera = number_of("gamma", gamma)
    amount = number_of("expected_um", expected_um)
    count = count_of("rays", rays) or RAYS
    side = count_of("pixels", pixels) or PIXELS
    if amount is None or not amount > 0.0:
        raise InputError(f"expected_um = {expected_um!r}: must be above 0")
    if not FEWEST_PIXELS <= side <= MOST_PIXELS:
        raise InputError(f"pixels = {side}: must be {FEWEST_PIXELS} to {MOST_PIXELS}")
    if len(files) * side**2 > _MOST_PIXELS_IN_ALL:
        fitting = isqrt(_MOST_PIXELS_IN_ALL // len(files))
        raise InputError(f"pixels = {side}: must be at most {fitting} with {len(files)} pictures")
    shots = Shots(
        files,
        led_places(table, len(files)),
        path_of("off", off),
        _corners_of(corners),
        1.0 if camera is None else camera,
    )
    with threads_of_torch(threads):
        return infer_errors(made, shots, expected_um=amount, pixels=side, rays=count, seed=made.seed)
