"""A measured surface against the design's: registration, form deviation, and the light of the lens with it.

The lens with the changed face and the design are simulated with the same rays.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
from jaxtyping import Float

from lensforge.addons.measure.first_cut import Request
from lensforge.addons.measure.measured_points import PartPoints
from lensforge.addons.measure.measurement_result import (
    DeviationExtent,
    MeasuredLight,
    RegisteredPose,
    Registration,
    SurfaceComparison,
)
from lensforge.addons.measure.nominal_face import NominalFace
from lensforge.addons.measure.registration import RigidMotion, distances
from lensforge.addons.measure.several_parts import common_cut
from lensforge.light.lens_light import judging_source, rays_of
from lensforge.light.simulation import TracedLens, TracedLight, traced_light
from lensforge.light.table_trace import Scene
from lensforge.results import Conditions, Metric
from lensforge.results.arguments import require_choice
from lensforge.results.estimates import relative_square
from lensforge.scene.lens import Lens
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.sources.ray_bundle import Source
from lensforge.spec.accuracy import preset_of
from lensforge.surfaces.bicubic_table import grid_for, tabulate
from lensforge.surfaces.surface import Surface

# A change is a thousandth of the radius: five nodes for its shortest wave keep its slopes to some hundredths.
_WIDER = 2.0


@dataclass(frozen=True)
class ChangedLens:
    """Simulation of a lens with changed radii of one face, ``side``, always with the same rays of each of its LEDs.

    If lamps have lenses of several kinds, this kind is changed in all its lamps, and the light is that of all lamps.
    """

    lens: Lens
    side: str
    leds: Mapping[str, Source]
    nodes_per_sigma: float
    rays: int

    @staticmethod
    def of(lens: Lens, side: str, rays: int | None) -> "tuple[ChangedLens, Conditions | None]":
        """Simulation by the rays that judge ``lens``, and its conditions.

        By default as many as evaluate it, up to the preset's number for comparisons.
        """
        preset = preset_of(lens.accuracy)
        leds = {led: judging_source(lens_of_led.spec) for led, lens_of_led in lens.by_state.items()}
        usual = min(lens.spec.evaluate.rays or preset.evaluate_rays, preset.studies.compared_rays)
        count, conditions = min(
            (rays_of(rays, usual, source) for source in leds.values()),
            key=lambda count_and_conditions: count_and_conditions[0],
        )
        return ChangedLens(lens, side, leds, preset.evaluate_nodes_per_sigma, count), conditions

    def lights(self, *changes: Surface | None) -> dict[str, list[TracedLight]]:
        """Light of the lens with each of ``changes`` (mm) added to the radius, by the LED; None: the design."""
        details = [_WIDER * change.detail_rad for change in changes if change is not None]
        grid = grid_for(min(self.lens.detail_rad, *details), self.nodes_per_sigma)
        tables = {name: tabulate(grid, surface) for name, surface in self.lens.surfaces.items()}
        scene = Scene.of_lens(self.lens.spec.lens, self.lens.media, grid)
        kinds = self._of_all_kinds()
        lenses = []
        for change in changes:
            free_tables = dict(tables)
            if change is not None:
                free_tables[self.side] = free_tables[self.side] + tabulate(
                    grid, change
                )  # tables are linear in the radius
            traced = TracedLens(scene, np.stack([*free_tables.values()]), {})
            lenses.append(
                replace(traced, kinds=tuple((kinds | {self.lens.kind: traced}).values())) if kinds else traced
            )
        spec = self.lens.spec
        return {
            led: [traced_light(lens, spec.of_state(led), source, self.rays, self.lens.seed) for lens in lenses]
            for led, source in self.leds.items()
        }

    def _of_all_kinds(self) -> dict[str, TracedLens]:
        """The lens of each kind as designed, by name; empty if all lamps have the same."""
        traced = TracedLens.of(self.lens, self.nodes_per_sigma).kinds if self.lens.others else ()
        return {kind.kind: traced_lens for kind, traced_lens in zip(self.lens.kinds, traced, strict=bool(traced))}

    def by_led(self, lights: Mapping[str, Sequence[TracedLight]]) -> dict[str, MeasuredLight]:
        """Metrics of :meth:`lights`: as designed, with the measured face, and with the corrected one; by the LED."""
        by_led = dict[str, MeasuredLight]()
        for led, (design, measured, *corrected) in lights.items():
            last = corrected[0] if corrected else measured
            by_led[led] = MeasuredLight(
                design=design.metrics,
                measured=measured.metrics,
                corrected=last.metrics if corrected else None,
                change=last.replicates.change_from(design.replicates),
            )
        return by_led


def compare_surface(
    parts: Sequence[PartPoints], traced: ChangedLens, registration: Registration = "rigid"
) -> SurfaceComparison:
    """Register the points of ``parts`` to the face of ``traced``, map its form deviation, and simulate the lens.

    Deviations are along the normal, positive away from the origin: too much material on the envelope, too little on the
    cavity. The motion that ``registration`` allows is removed, the rest is form; the other surfaces are the design's.
    Of several parts it is the deviation that they have in common. Raises :class:`InputError` for points that cannot be
    registered, for parts that are not of one lens, and for an unknown ``registration``.
    """
    require_choice("registration", registration, get_args(Registration))
    lens = traced.lens
    face = NominalFace.of(lens, traced.side)
    cut = common_cut(parts, face, Request(registration=registration))
    form = cut.likeliest
    lights = traced.lights(None, form.change)
    (first, (before, after)), *further = lights.items()
    by_led = traced.by_led(lights)
    distance_um = 1e3 * distances(face.patch, cut.placed.points)[0]
    spec = lens.spec.in_first_state
    section = spec.all_receivers[0]
    receiver = receivers_of(spec, spec.evaluate.pixels)[0]
    pixels = face.pixels
    form_um = pixels.map_um(form.change)
    inside = np.isfinite(form_um)
    return SurfaceComparison(
        inputs={"lens": lens.sha256},
        surface=traced.side,
        registration=registration,
        point_count=cut.count,
        used_share=cut.placed.share,
        covered_share=cut.covered,
        pose=pose_of(cut.placed.motion),
        point_deviation_um=DeviationExtent.of(distance_um),
        form_deviation_um=DeviationExtent.of(form_um[inside], pixels.area_mm2[inside]),
        residual_rms_um=cut.left_um(form),
        rays=traced.rays,
        receiver=section.name or section.kind,
        far_field=section.is_far_field,
        width=receiver.grid.width,
        height=receiver.grid.height,
        design=by_led[first].design,
        measured=by_led[first].measured,
        change=by_led[first].change,
        by_led=by_led if further else {},
        series=cut.series,
        nmse_between=relative_square(np.stack([after.map, before.map])),
        points=cut.placed.points,
        distance_um=distance_um,
        chart=pixels.axis,
        deviation_um=form_um,
        area_mm2=pixels.area_mm2,
        irradiance_design=before.map,
        irradiance_measured=after.map,
    )


def pose_of(motion: RigidMotion) -> RegisteredPose:
    """The record of a motion."""
    rotation = np.degrees([motion.rotation_rad, motion.rotation_error_rad])
    translation = np.array([motion.translation_mm, motion.translation_error_mm])
    return RegisteredPose(
        **{f"rotation_{axis}_deg": _fitted(pair, "deg") for axis, pair in zip("xyz", rotation.T, strict=True)},
        **{f"translation_{axis}_mm": _fitted(pair, "mm") for axis, pair in zip("xyz", translation.T, strict=True)},
    )


def _fitted(pair: Float[np.ndarray, "2"], unit: str) -> Metric:
    """Parameter of the motion and its error, left out where it is 0 (not fitted) or infinite (not determined)."""
    value, error = pair
    known = 0.0 < error < np.inf
    return Metric(value=float(value), unit=unit, standard_error=float(error) if known else None)
