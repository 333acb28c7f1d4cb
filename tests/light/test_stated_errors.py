"""Standard errors that are stated, against the scatter of the values over the seeds of the rays."""

import numpy as np
import pytest
from nightly import NIGHTLY
from presets import FEW
from scenes import random_surface, small_spec
from stated_errors import stated_errors
from tir_lenses import spot_lens

import lensforge as lf

SEEDS, WITHIN = (60, (0.75, 1.3)) if NIGHTLY else (16, (0.55, 1.7))  # a ratio of n seeds is known to 1/root(2n)
BY_RAYS = ("exit_w", "axis_cd", "peak_cd", "beam_c0.beam_angle_deg")


def uneven(**changes: object) -> lf.Lens:
    """A lens of two uneven faces, whose light in the mask has a darkest place."""
    faces = random_surface(1, 3.0), random_surface(2, 6.0, roughness=0.01)
    return lf.Lens.double(*faces, small_spec(**changes), 0, FEW)


@pytest.mark.parametrize("rays", [2**12, pytest.param(2**15, marks=pytest.mark.nightly("a minute"))])
def test_figures_of_the_light_scatter_by_what_is_stated(rays: int) -> None:
    lens = uneven()
    errors = stated_errors([lf.evaluate(lens, rays=rays, seed=100 + seed) for seed in range(SEEDS)])
    figures = ("nmse", "efficiency", "share_in_target", "uniformity", "rsd", "in_region.mean", "in_region.u0")
    (receiver,) = lens.spec.all_receivers
    for name in (*figures, "in_region.u1", "in_region.peak"):
        assert WITHIN[0] < errors[f"receivers.{receiver.name}.{name}"].ratio < WITHIN[1], name


@pytest.mark.nightly("two minutes")
def test_figures_of_the_far_field_scatter_by_what_is_stated() -> None:
    lens = uneven()
    errors = stated_errors([lf.photometry(lens, rays=2**14, seed=100 + seed) for seed in range(SEEDS)])
    for name in BY_RAYS:
        assert 0.6 < errors[name].ratio < 1.6, name


def test_one_circle_has_one_share_whatever_the_pixels() -> None:
    """The target and the zone of the limit are the same disc; both count its rays exactly, on few pixels, too."""
    lens = spot_lens()
    lights = [lf.evaluate(lens, rays=2**12, pixels=pixels) for pixels in (16, 61)]
    shares = [light.share_in_target for light in lights] + [light.limits[0].metric for light in lights]
    for share in shares[1:]:
        assert (share.value, share.standard_error) == pytest.approx((shares[0].value, shares[0].standard_error))


def test_photometry_takes_a_seed_and_says_so() -> None:
    lens = uneven()
    unseeded, same, other = (lf.photometry(lens, rays=2**10, seed=seed) for seed in (None, 0, 7))
    np.testing.assert_array_equal(unseeded.candela, same.candela)
    assert unseeded.exit_w.value != other.exit_w.value
    assert same.conditions == unseeded.conditions
    assert (other.conditions.seed, other.conditions.rays) == (7, 2**10)
    assert lf.photometry(lens, seed=7, rays=2**10).exit_w == other.exit_w
