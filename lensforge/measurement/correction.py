"""Correction of a face for its second cut: mended by the mirrored, filtered deviation of its first cut."""

import numpy as np
from jaxtyping import Float

from lensforge.accuracy import Preset
from lensforge.geometry.part import stamp_of
from lensforge.geometry.patch import fit_patch
from lensforge.lens import Lens
from lensforge.manufacturing.face import AirSide, OpticalFace, sample_face
from lensforge.manufacturing.face_check import SAMPLE_NODES, bounded
from lensforge.measurement.changed_lens import ChangedLens
from lensforge.measurement.comparison import Side
from lensforge.measurement.corrected_step import corrected_step
from lensforge.measurement.correction_result import Correction, CutterLimit, correction_criteria
from lensforge.measurement.cutter_limit import CutFace, limited_by_cutter
from lensforge.measurement.face_pixels import FacePixels
from lensforge.measurement.first_cut import FirstCut, Request
from lensforge.measurement.radial_change import ChangedSurface
from lensforge.measurement.surface import pose_of
from lensforge.receivers.build import receivers_of
from lensforge.records import Extent
from lensforge.sources.bundle import Source
from lensforge.spec.part import ManufactureSection
from lensforge.surfaces.surface import Surface

_SEED = 0  # of the noise of the points that is drawn anew


def correct_face(
    cloud: Float[np.ndarray, "k 3"],
    *,
    lens: Lens,
    side: Side,
    source: Source,
    preset: Preset,
    request: Request,
    rays: int,
) -> Correction:
    """Correct one face of ``lens`` by the points ``cloud`` (mm) of its first cut, and simulate the second cut.

    New nominal: the design less ``gain`` times the deviation that the filter passes, limited by the ball cutter of the
    spec. Raises :class:`InputError` for points that cannot be registered, or settings that they do not allow.
    """
    surface: Surface = getattr(lens, side)
    patch = fit_patch(surface)
    cut = FirstCut.of(surface, patch, cloud, request)
    face, pixels = OpticalFace(patch, _air_side(lens, side)), FacePixels.of(patch)
    cutter_mm, scale = lens.spec.manufacture.cutter_radius_mm, lens.spec.manufacture.scale
    made = limited_by_cutter(surface, face, cut.chosen, request.gain, cutter_mm / scale)
    corrected = ChangedSurface(surface, made.change)
    built = corrected_step(lens, side, corrected)
    limit = _limit(face, corrected, cut, made, pixels, request.gain, lens.spec.manufacture)
    first, second = cut.likeliest.change, _expected(cut, made, request.gain)
    cuts = ChangedLens(lens, side, source, preset.evaluate_nodes_per_sigma, rays)
    design, before, after = cuts.lights(None, first, second)
    section, receiver = lens.spec.all_receivers[0], receivers_of(lens.spec, lens.spec.evaluate.pixels)[0]
    left = cut.points.deviations - made.filtered.values
    error = built.error
    return Correction(
        inputs={"lens": lens.sha256},
        surface=side,
        registration=request.registration,
        make=lens.spec.manufacture.make,
        scale=scale,
        point_count=len(cloud),
        point_spacing_mm=cut.span.spacing_mm,
        used_share=cut.used,
        covered_share=cut.covered,
        pose=pose_of(cut.motion),
        gain=request.gain,
        wavelength_mm=cut.chosen.areal.wavelength_mm,
        wavelength_given=request.wavelength_mm is not None,
        noise_rms_um=1e3 * cut.noise_mm,
        residual_rms_um=1e3 * float(np.sqrt(cut.points.mean_square(left))),
        deviation_um=pixels.extent_um(first),
        correction_um=pixels.extent_um(made.change),
        expected_um=pixels.extent_um(second),
        cutter=limit,
        nodes=built.nodes,
        step_schema=built.schema,
        step_volume_change=built.volume_change,
        form_error_nm=Extent(max=error.form_max_nm, rms=error.form_rms_nm),
        normal_error_mrad=Extent(max=error.normal_max_mrad, rms=error.normal_rms_mrad),
        rays=rays,
        receiver=section.name or section.kind,
        far_field=section.kind == "far_field",
        width=receiver.grid.width,
        height=receiver.grid.height,
        design=design.metrics,
        first_cut=before.metrics,
        second_cut=after.metrics,
        change=after.replicates.change_from(design.replicates, rays),
        criteria=correction_criteria(
            cut.used, cut.covered, error.form_max_nm, error.normal_max_mrad, built.volume_change, limit
        ),
        file=stamp_of(built.step),
        chart=pixels.axis,
        area_mm2=pixels.area_mm2,
        deviation_map_um=pixels.map_um(first),
        correction_map_um=pixels.map_um(made.change),
        expected_map_um=pixels.map_um(second),
        irradiance_design=design.map,
        irradiance_first_cut=before.map,
        irradiance_second_cut=after.map,
        step=built.step,
    )


def _expected(cut: FirstCut, made: CutFace, gain: float) -> ChangedSurface:
    """Radial error of a second cut: that of the first, corrected by a measurement of it with noise of its own.

    The points of the first measurement decided on the correction, so that what it leaves of them is too small (a
    parametric bootstrap: Efron & Tibshirani 1993).
    """
    noise = cut.noise_mm * np.random.default_rng(_SEED).normal(size=len(cut.points.deviations)) / cut.points.cosines
    measured_again = made.filtered.again(cut.likeliest.values + noise)
    return ChangedSurface(cut.likeliest.change, measured_again.times(-gain))


def _air_side(lens: Lens, side: Side) -> AirSide:
    """The side from which a face is cut; a mould insert has air where the lens has material."""
    outside = (side == "outer") == (lens.spec.manufacture.make == "part")
    return AirSide.OUTSIDE if outside else AirSide.INSIDE


def _limit(
    face: OpticalFace,
    corrected: Surface,
    cut: FirstCut,
    made: CutFace,
    pixels: FacePixels,
    gain: float,
    shop: ManufactureSection,
) -> CutterLimit:
    """Record of the cutter's limit: concave radii of the face that is cut, and what it took from the correction."""
    taken = ChangedSurface(cut.chosen.change.times(gain), made.change)
    return CutterLimit(
        cutter_radius_mm=shop.cutter_radius_mm,
        concave_radius_before_mm=_concave_mm(face, shop.scale),
        concave_radius_mm=_concave_mm(OpticalFace(fit_patch(corrected), face.air), shop.scale),
        smoothed_more_share=made.smoothed_more_share,
        cut_back_um=pixels.extent_um(taken),
    )


def _concave_mm(face: OpticalFace, scale: float) -> float | None:
    """Smallest concave radius (mm) of ``face`` times ``scale``; None for a face that is convex everywhere."""
    lowest = sample_face(face, SAMPLE_NODES).lowest_curvature()
    return bounded(-scale / lowest) if lowest < 0.0 else None
