"""Colour as a term of the merit: by hand, without the noise of the rays, and followed by a search."""

from typing import Any

import numpy as np
import pytest
import torch
from presets import FEW
from scenes import small_spec
from scipy.ndimage import gaussian_filter

from lensforge.light.lens_light import searched_source, source_of
from lensforge.optics.colorimetry import denominator, tristimulus_at, uv_of
from lensforge.scene.pixel_grid import splat_flux
from lensforge.search.image_terms import SourceColour
from lensforge.search.light_path import landed_through
from lensforge.search.merit import MeritFunction
from lensforge.search.optimiser import search
from lensforge.search.parameters import SphereParameters
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec
from lensforge.surfaces.bicubic_table import tabulate

WAVES = (630.0, 460.0)
ONE = torch.ones(2, dtype=torch.float64)


def spec_of(apart_mm: float, weight: float = 20.0, **changes: Any) -> Spec:
    """Two chips of a line each, so far apart along x; red has twice the power of blue."""
    chips = [
        {
            "x_mm": sign * 0.5 * apart_mm, "y_mm": 0.0, "width_mm": 0.5, "height_mm": 0.5, "flux_w": flux,
            "spectrum": {"kind": "line", "wavelength_nm": wave},
        }
        for sign, flux, wave in zip((-1.0, 1.0), (2.0, 1.0), WAVES, strict=True)
    ]  # fmt: skip
    colour = {"within": "tenth", "weight": weight}
    return small_spec(source={"kind": "chips", "chips": chips}, colour=colour, **changes)


def merit_of(spec: Spec) -> tuple[MeritFunction, Any]:
    source = build_source(spec.source, coloured=True)
    parameters = SphereParameters.of(spec, 4.0)
    tables = parameters.tables(torch.zeros((parameters.basis.size, 2), dtype=torch.float64), ONE)
    return MeritFunction.of(spec, source, parameters), lambda rays: (tables, source.sample(rays, 5))


def test_the_term_is_that_of_the_pictures_by_hand() -> None:
    merit, sample = merit_of(spec_of(1.2))
    tables, rays = sample(2**14)
    (landings,), _ = landed_through(tables, merit.light.scene, rays, merit.light.receivers)
    assert rays.tristimulus is not None
    pictures = np.stack([
        splat_flux(landings.hits.numpy(), landings.flux.numpy() * column, merit.light.receivers[0].grid)
        for column in rays.tristimulus.T
    ], axis=-1)  # fmt: skip
    whole = (2.0 * tristimulus_at(np.array(WAVES[:1]))[0] + tristimulus_at(np.array(WAVES[1:]))[0]) / 3.0
    u0, v0 = uv_of(whole)
    below = denominator(pictures)
    away = (4.0 * pictures[..., 0] - u0 * below, 9.0 * pictures[..., 1] - v0 * below)
    both = sum(gaussian_filter(image, 2.0, mode="constant", truncate=3.0) ** 2 for image in away)
    wanted = merit.terms[0].wanted.numpy()
    by_hand = both.sum() / np.sum((wanted * denominator(whole)) ** 2)
    light = merit.light_of(tables, rays)
    assert merit.colour is not None
    assert merit.colour.error(light.colours, light.colours).item() == pytest.approx(20.0 * by_hand, rel=2e-3)
    without = MeritFunction(merit.spec, merit.parametrisation, merit.light, merit.terms, merit.limits)
    more = merit.training_loss(light, False).loss - without.training_loss(light, False).loss
    assert more.item() == pytest.approx(20.0 * by_hand, rel=2e-3)


def test_two_samples_judge_without_the_noise_of_their_rays() -> None:
    """Superposed chips have one colour everywhere: the squares of their pictures are noise, the products are 0."""
    merit, _ = merit_of(spec_of(0.0, weight=1.0))
    tables = merit.parametrisation.tables(torch.zeros((merit.parametrisation.basis.size, 2), dtype=torch.float64), ONE)
    source = build_source(merit.spec.source, coloured=True)
    lights = [merit.light_of(tables, source.sample(2**10, seed)) for seed in range(24)]
    term = merit.colour
    assert term is not None
    squares = np.mean([term.error(light.colours, light.colours).item() for light in lights])
    pairs = np.array([term.error(a.colours, b.colours).item() for a, b in zip(lights[::2], lights[1::2], strict=True)])
    assert abs(pairs.mean()) < 3.0 * pairs.std(ddof=1) / np.sqrt(len(pairs)) < 0.5 * squares
    first, second = lights[:2]
    judged = merit.unbiased_merit(first, second, False)[0]
    without = MeritFunction(merit.spec, merit.parametrisation, merit.light, merit.terms).unbiased_merit(
        first, second, False
    )[0]
    assert judged - without == pytest.approx(term.error(first.colours, second.colours).item())


def test_without_a_weight_nothing_is_collected() -> None:
    merit, sample = merit_of(spec_of(1.0, weight=0.0))
    assert (merit.colour, merit.light.colour) == (None, None)
    assert len(merit.light_of(*sample(64)).colours) == 0


def test_the_colour_of_a_source_is_that_of_its_light() -> None:
    colour = SourceColour.of(build_source(spec_of(1.0).source, coloured=True))
    red, blue = tristimulus_at(np.array(WAVES))
    assert colour.uv == pytest.approx(uv_of(2.0 * red + blue), abs=1e-4)
    assert colour.per_watt == pytest.approx(denominator((2.0 * red + blue) / 3.0), rel=1e-3)


def test_a_search_mixes_colours() -> None:
    """Chips far apart for a lens so small: with the term the colours of the found lens are closer to the source's."""
    left = []
    for weight in (0.0, 300.0):
        steps = {"optimise__steps_per_level": [15, 15], "optimise__rays": 2048}
        spec = spec_of(1.6, weight, constraints__cavity_radius_mm=1.5, **steps)
        lens = search(spec, searched_source(spec), accuracy=FEW).lens
        merit = MeritFunction.of(spec_of(1.6, 1.0), source_of(spec), SphereParameters.of(spec, 4.0))
        tables = np.stack([tabulate(merit.parametrisation.grid, surface) for surface in lens.surfaces.values()])
        lights = [merit.light_of(torch.from_numpy(tables), source_of(spec).sample(2**16, seed)) for seed in (1, 2)]
        assert merit.colour is not None
        left.append(merit.colour.error(lights[0].colours, lights[1].colours).item())
    assert left[1] < 0.7 * left[0]


def test_rays_of_a_source_without_colours_say_so() -> None:
    with pytest.raises(ValueError, match="build their source with them"):
        SourceColour.of(build_source(spec_of(1.2).source))
