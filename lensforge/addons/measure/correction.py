"""Correction of a face for its second cut by the mirrored, filtered deviation of its first cut, and its STEP file.

Where the corrected face would be too tightly concave for the ball cutter, the correction is smoothed more. The errors
of the STEP file are measured by reading it back.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from lensforge.addons.measure.areal_filter import ChangedSurface, FilteredPoints, RadialChange
from lensforge.addons.measure.first_cut import FirstCut, Request
from lensforge.addons.measure.measured_surface import ChangedLens, pose_of
from lensforge.addons.measure.measurement_result import KEPT, Correction, CutterLimit, area_extent
from lensforge.addons.measure.nominal_face import FacePixels, NominalFace
from lensforge.addons.measure.part_series import PartSeries
from lensforge.cad.body_export import solid_on_base
from lensforge.cad.boundary import boundaries
from lensforge.cad.custom_base import read_custom_base
from lensforge.cad.cutter_room import base_with_room
from lensforge.cad.form_error import FormError, face_error, fit_boundaries, worst
from lensforge.cad.part import SplineNodes, stamp_of
from lensforge.cad.patch import fit_patch, principal_curvatures
from lensforge.cad.plan import make_plan
from lensforge.cad.step import parse_step, signed_step
from lensforge.results import Extent
from lensforge.scene.body import Body
from lensforge.scene.lens import Lens
from lensforge.shop.face_check import SAMPLE_NODES, bounded
from lensforge.shop.face_samples import OpticalFace, air_side, sample_face
from lensforge.spec.part_section import ManufactureSection
from lensforge.surfaces.step_file import Schema
from lensforge.surfaces.surface import HALF_WIDTH, Surface, to_sphere

_STIFFER = 16.0  # doubles the wavelength there
_ROUNDS = 8  # then it is 256 times as long: the change is straight there, and the face has the design's curvature
_REACH = 0.5  # wavelengths around a tight place are smoothed with it, so that the tightness does not move aside


@dataclass(frozen=True)
class CutFace:
    """The change (mm) that a cutter allows, the filtered deviation, and the area share smoothed more for the cutter."""

    change: RadialChange
    filtered: FilteredPoints
    smoothed_more_share: float


def limited_by_cutter(
    surface: Surface, face: OpticalFace, filtered: FilteredPoints, gain: float, cutter_radius_mm: float
) -> CutFace:
    """Mirror the filtered deviation times ``gain``, with a longer wavelength where the cutter needs it.

    No place may be concave more tightly than the ball, or than the design where that is already tighter, by more than
    :data:`KEPT`. ``face``: the design's, from its air side.
    """
    areal = filtered.areal
    inside = np.sum(areal.places**2, axis=1) <= HALF_WIDTH**2  # the rim too
    places = areal.places[inside]
    allowed = np.minimum(_lowest(face, places), -1.0 / cutter_radius_mm) * (1.0 + KEPT)
    points = surface.radius(to_sphere(places))[:, None] * to_sphere(places)
    stiffness = np.ones(len(inside))
    change = filtered.change.times(-gain)
    for _ in range(_ROUNDS):
        corrected = OpticalFace(fit_patch(ChangedSurface(surface, change)), face.air, face.domain)
        tight = _lowest(corrected, places) < allowed
        if not tight.any():
            break
        distance, _ = cKDTree(points[tight]).query(points)
        stiffness[inside] *= np.where(distance <= _REACH * areal.wavelength_mm, _STIFFER, 1.0)
        filtered = areal.solve(stiffness)
        change = filtered.change.times(-gain)
    areas = areal.place_areas[inside]
    return CutFace(change, filtered, float(areas[stiffness[inside] > 1.0].sum() / areas.sum()))


def _lowest(face: OpticalFace, places: Float[np.ndarray, "p 2"]) -> Float[np.ndarray, " p"]:
    """Lowest curvature (1/mm) at chart points, from the air side: concave is negative."""
    jet = face.patch.jet(places)
    return principal_curvatures(jet, face.air_normal(jet)).minimum


@dataclass(frozen=True)
class CorrectedStep:
    """The bytes of the file, the nodes of its faces, the worst of the faces' errors and the volume as read back.

    ``volume_change``: relative, of what was written.
    """

    step: bytes
    schema: Schema
    nodes: SplineNodes
    error: FormError
    volume_change: float


def corrected_step(lens: Lens, side: str, corrected: Surface) -> CorrectedStep:
    """Build ``lens`` with the ``corrected`` surface of one face, on the base of its spec, by the builder of the export.

    The file is signed as the export's; where the spec has a form tolerance, it is AP242 and carries it.
    Raises :class:`InputError` where the body cannot be built, as the export does.
    """
    faces = (replace(face, surface=corrected) if face.name == side else face for face in lens.body.faces)
    body = Body(tuple(faces))
    pair = fit_boundaries(boundaries(body), {})
    fitted = [face for boundary in pair for face in boundary.of_material]
    base = base_with_room(lens)
    custom = None if base.file is None else read_custom_base(base.file)
    solid = solid_on_base(make_plan(*pair, base), custom)
    schema: Schema = "AP214" if lens.spec.manufacture.form_tolerance_um is None else "AP242"
    step = signed_step(solid, lens.spec, f"{lens.spec.name} corrected {side}", schema).content
    read = parse_step(step)
    change = abs(read.default_volume_mm3 / solid.default_volume_mm3 - 1.0)
    errors = [face_error(body.face(face.name).surface, read.faces[face.label], domain=face.domain) for face in fitted]
    nodes = {face.name: face.shape.nodes for face in fitted}
    return CorrectedStep(step, schema, nodes, worst(errors), change)


def correct_face(cut: FirstCut, designed: NominalFace, cuts: ChangedLens, request: Request) -> Correction:
    """Correct the ``designed`` face by its first ``cut``, and simulate the second cut.

    New nominal: the design less ``gain`` times the deviation that the filter passes, limited by the ball cutter of the
    spec; of several parts that which they have in common. Raises :class:`InputError` where the body cannot be built.
    """
    lens = cuts.lens
    side = designed.name
    shop = lens.spec.manufacture
    surface = designed.surface
    pixels = designed.pixels
    face = OpticalFace(designed.patch, air_side(lens.body.face(side), shop), designed.domain)
    made = limited_by_cutter(surface, face, cut.chosen, request.gain, shop.cutter_radius_mm / shop.scale)
    corrected = ChangedSurface(surface, made.change)
    built = corrected_step(lens, side, corrected)
    limit = _limit(face, corrected, cut, made, pixels, request.gain, shop)
    first, second = cut.likeliest.change, _expected(cut, made, request.gain)
    lights = cuts.by_led(cuts.lights(None, first, second))
    light = next(iter(lights.values()))
    error = built.error
    return Correction(
        inputs={"lens": lens.sha256, **cut.inputs},
        surface=side,
        registration=request.registration,
        process=shop.process,
        scale=shop.scale,
        inferred=cut.inferred,
        point_count=cut.count,
        point_spacing_mm=cut.span.spacing_mm,
        used_share=cut.placed.share,
        covered_share=cut.covered,
        pose=pose_of(cut.placed.motion),
        gain=request.gain,
        wavelength_mm=cut.chosen.areal.wavelength_mm,
        wavelength_given=request.wavelength_mm is not None,
        noise_rms_um=1e3 * cut.noise_mm,
        residual_rms_um=cut.left_um(made.filtered),
        deviation_um=pixels.extent_um(first),
        correction_um=pixels.extent_um(made.change),
        expected_um=pixels.extent_um(second),
        cutter=limit,
        nodes=built.nodes,
        step_schema=built.schema,
        step_volume_change=built.volume_change,
        form_error_nm=Extent(max=error.form_max_nm, rms=error.form_rms_nm),
        normal_error_mrad=Extent(max=error.normal_max_mrad, rms=error.normal_rms_mrad),
        rays=cuts.rays,
        design=light.design,
        first_cut=light.measured,
        second_cut=light.corrected or light.measured,
        change=light.change,
        by_led=lights if len(lights) > 1 else {},
        series=None if cut.series is None else _with_left(cut.series, pixels.map_um(second), pixels.area_mm2),
        file=stamp_of(built.step),
        chart=pixels.axis,
        area_mm2=pixels.area_mm2,
        deviation_map_um=pixels.map_um(first),
        correction_map_um=pixels.map_um(made.change),
        expected_map_um=pixels.map_um(second),
        step=built.step,
    )


def _expected(cut: FirstCut, made: CutFace, gain: float) -> ChangedSurface:
    """Radial error of a second cut: the error of the first, corrected by a measurement of it with noise of its own.

    The points of the first measurement determined the correction, so that its residual at them is too small.
    """
    measured_again = made.filtered.refilter(cut.measured_again())
    return ChangedSurface(cut.likeliest.change, measured_again.times(-gain))


def _with_left(
    series: PartSeries, expected_um: Float[np.ndarray, "m m"], areas: Float[np.ndarray, "m m"]
) -> PartSeries:
    """The ``series`` with the rms that each cavity keeps after a correction that leaves ``expected_um`` in common."""
    common = np.mean([cavity.map_um for cavity in series.cavities], axis=0)
    lefts = (area_extent(cavity.map_um - common + expected_um, areas).rms for cavity in series.cavities)
    cavities = (cavity.changed(left_um=left) for cavity, left in zip(series.cavities, lefts, strict=True))
    return series.changed(cavities=tuple(cavities))


def _limit(
    face: OpticalFace,
    corrected: Surface,
    cut: FirstCut,
    made: CutFace,
    pixels: FacePixels,
    gain: float,
    shop: ManufactureSection,
) -> CutterLimit:
    """Record of the cutter's limit: concave radii of the cut face, and the part of the correction lost to it."""
    taken = ChangedSurface(cut.chosen.change.times(gain), made.change)
    return CutterLimit(
        cutter_radius_mm=shop.cutter_radius_mm,
        concave_radius_before_mm=_concave_mm(face, shop.scale),
        concave_radius_mm=_concave_mm(OpticalFace(fit_patch(corrected), face.air, face.domain), shop.scale),
        smoothed_more_share=made.smoothed_more_share,
        cut_back_um=pixels.extent_um(taken),
    )


def _concave_mm(face: OpticalFace, scale: float) -> float | None:
    """Smallest concave radius (mm) of ``face`` times ``scale``; None for a face that is convex everywhere."""
    lowest = sample_face(face, SAMPLE_NODES).lowest_curvature()
    return bounded(-scale / lowest) if lowest < 0.0 else None
