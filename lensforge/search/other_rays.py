"""Light of a finished lens by rays that neither its search has seen nor its evaluation will: by these a lens is chosen.

By rays that judge it afterwards the best of many would be the luckiest.
"""

from dataclasses import replace

from lensforge.light.evaluation import evaluate_traced
from lensforge.light.evaluation_result import Light
from lensforge.light.far_field import limits_by_intensities
from lensforge.light.simulation import TracedLens
from lensforge.scene.lens import Lens
from lensforge.scene.limit_readings import light_limits
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.sources.build_source import build_source
from lensforge.sources.joined_spectrum import efficacy_of
from lensforge.sources.measured_rays import searched, smoothed
from lensforge.spec.accuracy import preset_of


def light_by_other_rays(lens: Lens, seed: int) -> list[Light]:
    """The light of ``lens`` with each of its LEDs, by rays that judge none: measured ones are the search's, turned."""
    preset = preset_of(lens.accuracy).replace("choice", table_error=False)  # the same for all that are compared
    lights = []
    traced = TracedLens.of(lens, preset.evaluate_nodes_per_sigma)
    for spec in lens.spec.by_state.values():
        source = build_source(spec.source, lens.dispersion, facets=lens.media.scattering)
        efficacy = efficacy_of(source, spec.source, photons=spec.counts_photons)
        limits = light_limits(spec, receivers_of(spec, spec.evaluate.pixels), efficacy, source.flux_w)
        rays = spec.evaluate.rays or preset.evaluate_rays
        judged_source = smoothed(searched(source))
        lens_of_spec = replace(lens, spec=spec)
        far = tuple(limits_by_intensities(lens_of_spec, judged_source, preset, efficacy.lumens, rays=None, seed=seed))
        lights.append(
            evaluate_traced(
                traced, spec, judged_source, rays, seed, limits=limits, by_intensities=far, bounds_by=source
            )
        )
    return lights
