"""The page and the screen of a sweep: each number on them is that of the design in whose row it stands."""

from dataclasses import replace

import pytest
from page_places import places_of
from result_folders import criterion, make_results, small_lens
from screen_places import places_of as lines_of
from shown_folders import SKY, WALL, lens_of
from shown_numbers import problems
from told_apart import told_apart
from undrawn import undrawn
from wanted_sweep import sweep_lines, sweep_numbers

from lensforge.cli.screen import print_screen
from lensforge.cli.sweep_blocks import sweep_block
from lensforge.results import Metric
from lensforge.runs.sweep import sweep_of, variation_of
from lensforge.runs.sweep_page import sweep_page

_EVEN = {"uniformity": Metric(value=0.8, standard_error=0.01), "rsd": Metric(value=0.09, standard_error=0.002)}
_MISSED = {"criteria": (criterion("form margin", 0.5, 0.25), criterion("wall margin", 0.5, 0.001))}

_FAILED = {"criteria": _MISSED["criteria"][:1]}


def size_of_the_lens():
    """Radii with both offsets in proportion; light with a uniformity, criteria that the second design misses."""
    field, scaled = "constraints.max_radius_mm", ("lens.inner_offset_mm", "lens.outer_offset_mm")
    return _swept(
        small_lens(), variation_of(field, (12.0, 13.25, 11.125), scaled), {0: _FAILED, 1: _MISSED}, evaluate=_EVEN
    )


def distance_of_the_target():
    """Each design has its light elsewhere."""
    return _swept(small_lens(), variation_of("target.distance_mm", (120.0, 150.0, 162.5)), {})


def side_of_the_led():
    """Light on two receivers, and no field in proportion; only the last design has a uniformity."""
    lens = lens_of({"receivers": (WALL, SKY)})
    return _swept(lens, variation_of("source.side_mm", (2.0, 0.125)), {}, last=_EVEN)


def _swept(lens, variation, of_design, evaluate=None, last=None):
    """The sweep of small lenses, and their results by value; those of each design differ from those of the others."""
    variants, designs = variation.variants(lens.spec), {}
    for times, variant in enumerate(variants, start=1):
        own = replace(lens, spec=variant.spec)
        light = last if last and times == len(variants) else evaluate or {}
        results = make_results((), own, design=of_design.get(times - 1, {}), evaluate=light)
        for _ in range(times):
            results = replace(results, found={stem: told_apart(each) for stem, each in results.found.items()})
        designs[variant.value] = results
    return sweep_of(lens.spec, variation, list(zip(variants, designs.values(), strict=True))), designs


@pytest.mark.parametrize(
    ("make", "scale"),
    [
        (size_of_the_lens, "All maps have the same"), (distance_of_the_target, "All maps have the same"),
        (side_of_the_led, "Each map has its own"),
    ],
)  # fmt: skip
def test_every_number_of_a_sweep_is_that_of_its_own_design(make, scale, capsys):
    sweep, designs = make()
    with undrawn():
        places = places_of(sweep_page(sweep, list(designs.values())))
    assert "\n".join(problems(places, sweep_numbers(sweep, designs))) == ""
    assert [each.text.startswith(scale) for each in places if each.label == "Light / p"] == [True]
    print_screen([sweep_block(sweep)])
    assert "\n".join(problems(lines_of(capsys.readouterr().out), sweep_lines(sweep, designs))) == ""
