"""Power and lumens of a source on both sides of every limit of the rule that settles them."""

import pytest

from lensforge.errors import InputError
from lensforge.optics.photopic import LARGEST_LM_PER_W
from lensforge.sources.source_flux import OwnFlux, SourceFlux, joined_flux, settled_flux, with_spectrum_compared
from lensforge.spec.emitter_section import FluxSection
from lensforge.spec.source_sections import SquareSource


@pytest.mark.parametrize(
    ("efficacy", "in_lumens", "shown"),
    [(1.0, False, True), (0.999, False, False), (0.999, True, True), (None, True, False), (None, False, False)],
)
def test_lumens_are_shown_where_the_light_has_any_or_the_spec_speaks_of_them(efficacy, in_lumens, shown) -> None:
    found = SourceFlux(2.0, efficacy, in_lumens)
    assert found.lumens_per_watt == (efficacy if shown else None)
    assert found.flux_lm == (None if efficacy is None else 2.0 * efficacy)


@pytest.mark.parametrize(
    ("lumens", "efficacy"),
    [(1e-6, 1e-6), (0.99e-6, None), (683.002, 683.002), (683.002 * 1.00009, 683.002), (683.002 * 1.0002, None)],
)
def test_both_totals_of_a_file_have_a_ratio_that_light_can_have(lumens: float, efficacy: float | None) -> None:
    found = settled_flux(FluxSection(), own=OwnFlux(1.0, lumens))
    assert found.efficacy == (None if efficacy is None else pytest.approx(efficacy, rel=1e-12))
    assert found.flux_w == 1.0 and found.in_lumens and len(found.warnings) == (efficacy is None)
    if efficacy is None:
        assert ("no light has more than 683" if lumens > 1.0 else "that is no visible light") in found.warnings[0]


def test_lumens_of_light_that_is_next_to_invisible_are_refused() -> None:
    assert settled_flux(FluxSection(flux_lm=2.0), spectral=1e-6).flux_w == pytest.approx(2e6)
    with pytest.raises(InputError, match="flux of 2 lm, but its spectrum has no visible light"):
        settled_flux(FluxSection(flux_lm=2.0), spectral=0.99e-6)
    least = settled_flux(FluxSection(flux_lm=2.0))
    assert (least.flux_w, least.in_lumens, least.least_power) == (2.0 / LARGEST_LM_PER_W, True, True)


@pytest.mark.parametrize(("stated", "warned"), [(104.99, False), (105.01, True), (95.01, False), (94.99, True)])
def test_a_spectrum_within_five_per_cent_of_the_stated_efficacy_is_taken_for_it(stated: float, warned: bool) -> None:
    spec = SquareSource(side_mm=1.0, luminous_efficacy_lm_per_w=stated)
    found = with_spectrum_compared(SourceFlux(1.0, warnings=("before",)), spec, 100.0)
    assert (len(found.warnings), found.warnings[0]) == (2 if warned else 1, "before")
    for spectral in (None, 0.0):
        assert len(with_spectrum_compared(SourceFlux(1.0), spec, spectral).warnings) == 0


def test_parts_are_joined_by_their_sums_and_their_warnings_are_told_once() -> None:
    parts = [SourceFlux(1.0, 100.0, warnings=("a", "b")), SourceFlux(3.0, 300.0, True, warnings=("b",))]
    found = joined_flux(FluxSection(), parts)
    assert (found.flux_w, found.efficacy, found.in_lumens, found.warnings) == (4.0, 250.0, True, ("a", "b"))
    found = joined_flux(FluxSection(), [parts[0], SourceFlux(3.0)])
    assert (found.flux_w, found.efficacy, found.in_lumens) == (4.0, None, False)
    assert (
        joined_flux(FluxSection(), [parts[0]], 120.0).in_lumens
        and joined_flux(FluxSection(flux_lm=5.0), parts).in_lumens
    )
