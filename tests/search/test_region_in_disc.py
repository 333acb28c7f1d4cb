"""A region of uniform light within a soft disc: more even light there, and the disc stays a disc."""

from dataclasses import replace

import pytest
import torch
from scenes import small_spec

import lensforge as lf
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.search.image_terms import ImageTerms, nmse_loss, uniformity_loss

DISC = {"kind": "disc", "diameter_mm": 600.0, "edge_mm": 60.0, "distance_mm": 500.0, "receiver_mm": 1100.0}


def disc(region_mm: float | None) -> lf.Spec:
    lens = {"levels": "auto", "material": "PMMA"}
    limits = {"max_radius_mm": 14.0, "cavity_height_mm": 1.0, "cavity_radius_mm": 1.8, "min_thickness_mm": 1.0}
    scene = {"source": {"kind": "square", "side_mm": 1.6}, "lens": lens, "constraints": limits}
    return lf.Spec.model_validate({"name": "disc", **scene, "target": {**DISC, "uniform_mm": region_mm}})


def test_a_bright_square_in_a_disc_is_no_gain() -> None:
    """Even light in the square that costs an NMSE of a few hundredths is worse than the disc as it is wanted."""
    spec = small_spec(target={**DISC, "uniform_mm": 280.0})
    (receiver,) = receivers_of(spec, 64)
    (section,) = spec.all_receivers
    terms = ImageTerms.of(section.targets, receiver, 1.0, "none", 1.0)
    mask = terms.mask
    wanted = terms.wanted
    assert mask is not None and uniformity_loss(wanted, mask).sqrt() < 0.02
    wider = torch.nn.functional.max_pool2d(mask.double()[None], 3, stride=1, padding=1)[0] > 0.0  # seen blurred
    square = torch.where(wider, 1.15 * wanted[mask].mean(), 0.9 * wanted)
    assert uniformity_loss(square, mask) < 1e-12 and 0.012 < nmse_loss(square, wanted) < 0.025
    assert terms.loss(wanted, True) < terms.loss(square, True)


@pytest.mark.nightly("a minute; by day the merit of such pictures")
def test_a_region_of_uniform_light_is_more_even_and_costs_little() -> None:
    bare, region = (lf.design(disc(diameter_mm), accuracy="draft").lens for diameter_mm in (None, 280.0))
    asked = disc(280.0)
    before, after = (lf.evaluate(replace(lens, spec=asked), rays=2**20) for lens in (bare, region))
    assert before.rsd is not None and after.rsd is not None
    assert after.rsd.value <= before.rsd.value
    assert after.nmse.value <= 1.5 * before.nmse.value + 1e-3
    assert after.share_in_target.value > before.share_in_target.value - 0.04
