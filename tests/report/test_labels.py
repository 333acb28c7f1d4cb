"""Labels of every figure of the page: none is cut off at the edge, and no two stand on each other."""

from dataclasses import replace

import pytest
from drawn_page import draw_page, faults
from nightly import first_by_day
from part_files import EXTRAS, verified
from result_folders import STAGES, make_results, small_lens

from lensforge.report.lens_figures import lens_section

# A floor 40 m wide: its places have five digits in mm. Pictures of the lens alone are those of the first lens.
FLOOR = {"kind": "rectangle", "width_mm": 3e4, "height_mm": 7e3, "distance_mm": 8e3, "receiver_mm": 4e4}
LENSES = {
    "one receiver": ({}, (*STAGES, *EXTRAS)),
    "a floor": ({"wanted": {"target": FLOOR}}, ("evaluate", "verify", *EXTRAS)),
}


def require_whole_labels(by_picture, least):
    assert len(by_picture) > least
    assert {name: wrong for name, wrong in by_picture.items() if wrong} == {}


def test_labels_are_whole_and_stand_alone(drawn_page):
    require_whole_labels(drawn_page.faults, 50)


@pytest.mark.nightly("ten seconds each")
@pytest.mark.parametrize(("wanted", "stages"), LENSES.values(), ids=LENSES)
def test_labels_of_other_receivers_are_whole(wanted, stages):
    by_picture = draw_page(make_results(stages, small_lens(**wanted), verify=verified())).faults
    require_whole_labels(by_picture, 30 if "design" in stages else 20)


@pytest.mark.parametrize("height_mm", first_by_day(2, [2.0, 2.5, 3.0, 5.0], "more heights"))
def test_the_label_below_a_base_of_any_height_is_whole(height_mm):
    lens = small_lens()
    lens = replace(lens, spec=lens.spec.replace(base={"height_mm": height_mm}))
    assert faults(lens_section(lens, 0.0, None)) == []
