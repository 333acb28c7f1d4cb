"""Lenses on which the bounds of the verdict are calibrated: what is known of them without a search."""

import verdicts

import lensforge as lf
from lensforge.optics.two_refractions import normal_transmittance
from lensforge.optimisation.scene_check import SceneCheck
from lensforge.sources.build import build_source
from lensforge.verdict import LEAST_SHARE


def test_every_shipped_spec_is_expected_to_pass_and_every_useless_lens_to_fail() -> None:
    expected = {name: state for name, _, state in verdicts.cases()}
    assert expected["pi"] == expected["flat_top_compact"] == "pass"
    assert [name for name, state in expected.items() if state == "fail"] == [name for name, _ in verdicts.useless()]


def test_no_lens_brings_the_light_of_the_large_source_into_the_small_far_rectangle() -> None:
    """Étendue alone leaves less than the verdict asks for: it fails whatever the search finds."""
    spec = dict(verdicts.useless())["3 mm COB onto 60 x 40 mm at 500 mm"]
    assert isinstance(spec, lf.Spec)
    possible = SceneCheck.of(spec, build_source(spec.source)).targets[0].bounds.value
    assert possible < 0.3 < LEAST_SHARE * normal_transmittance(spec.lens.refractive_index) ** 2
