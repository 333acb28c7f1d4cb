"""Far field of a lens with its lamps, as its photometric files hold it and applications are judged: the same rays."""

from collections.abc import Iterator
from dataclasses import replace

from lensforge.light.angular_grid import FittedIntensity
from lensforge.light.by_intensities import limits_judged
from lensforge.light.exit_light import ExitLight, Goniophotometer, trace_exit_light
from lensforge.light.luminaire_classes import LampLight
from lensforge.light.simulation import TracedLens
from lensforge.results import Fact
from lensforge.scene.housing import Housing
from lensforge.scene.lens import Lens
from lensforge.sources.ray_bundle import Source
from lensforge.spec import Spec
from lensforge.spec.accuracy import Preset
from lensforge.spec.housing_sections import bodies_of
from lensforge.spec.lamps_section import ALONE, Lamps
from lensforge.surfaces.mirror_group import shared_symmetry
from lensforge.surfaces.placed_bodies import reach_mm

_SLACK = 1.001  # the sphere on which exit rays start, in radii of the lens
_LM_PER_1000 = 1000.0  # of a source whose lumens nothing states: then each application states those of its lamps


def lamps_of_files(spec: Spec) -> Lamps:
    """Lamps whose light the files hold: all of ``spec``, or one of an infinite lattice."""
    return ALONE if spec.all_lamps.period_mm is not None else spec.all_lamps


def trace_far_field(lens: Lens, source: Source, preset: Preset, *, rays: int | None, seed: int) -> ExitLight:
    """Light of ``lens`` and its lamps; without ``rays`` the noise of the table sets their number."""
    lamps = lamps_of_files(lens.spec)
    housing = Housing.of(bodies_of(lens.spec.scene, from_afar=True), lens.spec.scene_events)
    lens_mm = max(lens.body.largest_mm, reach_mm(lens.media.bodies))
    walls_mm = housing.reach_mm if housing is not None and housing.reflects else 0.0
    return trace_exit_light(
        TracedLens.of(lens, preset.evaluate_nodes_per_sigma),
        source,
        Goniophotometer(
            sphere_mm=_SLACK * max(lens_mm + lamps.reach_mm, walls_mm),
            symmetry=shared_symmetry(
                [source.symmetry, lens.symmetry],
                lambda group: lamps.in_far_field.has_mirrors(group) and (housing is None or housing.has_mirrors(group)),
            ),
            street_deg=lens.spec.photometry.street_side_deg,
            lamps=lamps,
            to_horizon=bool(lens.spec.applications),
            housing=housing,
        ),
        rays=rays,
        by_itself=preset.photometry_rays,
        seed=seed,
    )


def lamp_light(light: FittedIntensity, per_watt: float, street_deg: float) -> LampLight:
    """Intensities (cd) of the lamps; ``per_watt``: lumens of a watt of the source."""
    return LampLight(light.grid, per_watt * light.samples, street_deg)


def limits_by_intensities(
    lens: Lens, source: Source, preset: Preset, lumens_per_watt: float | None, *, rays: int | None, seed: int
) -> Iterator[Fact]:
    """Limits of applications, judged by the intensities in the files of ``lens``."""
    spec = lens.spec
    if not spec.applications:
        return
    source_w = len(lamps_of_files(spec)) * source.flux_w
    source_lm = _LM_PER_1000 if lumens_per_watt is None else lumens_per_watt * source_w
    light = trace_far_field(lens, source, preset, rays=rays, seed=seed)
    lamp = lamp_light(light.intensity, source_lm / source_w, spec.photometry.street_side_deg)
    receiver = next(section.name or section.kind for section in spec.all_receivers if section.unit == "deg")
    for limit in limits_judged(spec, lamp, source_lm):
        yield replace(limit, place=receiver)
