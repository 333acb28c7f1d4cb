"""Pages on lenses whose light falls on other receivers than one square: several of them, or the far field."""

import pytest
from drawn_page import TURNED as WALL
from page_text import Page, text_of
from part_files import whole_results
from result_folders import make_light, make_results, page_of, small_lens
from shown_folders import BEAM, SKY, lens_of
from shown_folders import WALL as PLAIN_WALL
from undrawn import undrawn

from lensforge.light.receiver_light import mask_words
from lensforge.proof.proof_facts import tracer_groups
from lensforge.report.compare import ComparedPictures, render_comparison
from lensforge.report.headline import required_facts
from lensforge.report.light_section import (
    first_picture,
    other_lights,
    other_pictures,
    receiver_pictures,
    shown_receivers,
    unit_of_light,
)
from lensforge.report.results import Results
from lensforge.results import Conditions, Metric


def far_lens(**changes):
    return small_lens(wanted={"target": {**BEAM, "half_angle_deg": 80.0}}, **changes)


def lens_with(*receivers):
    return small_lens(wanted={"receivers": receivers})


@pytest.fixture(scope="module")
def both():
    return make_results(("evaluate",), lens_with(WALL, SKY))


@pytest.fixture(scope="module")
def markup(drawn_page):
    return drawn_page.markup


@pytest.fixture(scope="module")
def pictures(drawn_page):
    return drawn_page.receivers


def test_every_receiver_has_its_pictures_under_its_name(pictures, markup):
    first, second = pictures
    assert (first.heading, second.heading) == ("wall, centred at (100, 0, 200) mm", "sky, in the far field, to 80°")
    for receiver in (first, second):
        assert [picture.title for picture in receiver.seen] == [receiver.heading], (
            "of several receivers the light is seen first"
        )
        assert [picture.title for picture in receiver.more[0]] == ["Target", "Simulated minus target"]
    with undrawn():
        (only,) = receiver_pictures(make_results(("evaluate",)))
    assert [picture.title for picture in only.seen] == ["Target", "Simulated", "Simulated minus target"]
    assert [len(group.seen) + sum(map(len, group.more)) for group in (first, second)] == [9, 9]
    text = Page(markup).text
    assert text.index("wall, centred at") < text.index("sky, in the far field")
    # the first, those of the receivers, photometry, sections, faces, proof, stray light, search, the measured part,
    # the yield, and light under other conditions
    assert markup.count("<svg") == 1 + 2 * 9 + 2 + 2 + 6 + 2 * 4 + 2 * 3 + 4 + 9 + 6 + 4


def test_ids_on_the_page_are_unique_and_those_of_the_first_receiver_have_no_number(markup):
    ids = Page(markup).ids
    assert len(ids) == len(set(ids))
    for name in ("target", "simulated", "difference", "line0", "isolines", "encircled", "flux"):
        assert f"{name}-figure_1" in ids and f"{name}-2-figure_1" in ids


def test_each_receiver_is_shown_in_its_own_unit(pictures):
    first, second = pictures
    assert "irradiance (W/m²)" in first.seen[0].svg
    assert "intensity (W/sr)" in second.seen[0].svg
    assert "position on the line (°)" in second.more[1][0].svg
    assert "16 × 8 pixels" in first.seen[0].caption and "16 × 16 pixels" in second.seen[0].caption


def test_several_receivers_have_a_row_each_for_every_figure(both):
    texts = {fact.label: fact.text for fact in required_facts(both)}
    assert texts["Pattern error (NMSE), wall"] == "0.01230 ± 0.00040"
    assert texts["Efficiency, sky"] == "85.000 ± 0.020\u2009%"
    alone = required_facts(make_results(("evaluate",)))
    assert alone and not any("," in fact.label for fact in alone)


def level_of(results):
    group, *_ = results.facts(results.light)
    return group.fact("level")


@pytest.mark.usefixtures("undrawn")
def test_one_receiver_in_the_far_field_is_shown_in_degrees_and_per_steradian():
    results = make_results(("evaluate",), far_lens())
    assert unit_of_light(results).symbol == "W/sr"
    assert unit_of_light(make_results((), far_lens())).symbol == "W/sr"
    assert first_picture(results).caption.startswith("Simulated intensity in the far field, to 80°.")
    (only,) = receiver_pictures(results)
    assert only.heading == ""
    assert only.more[1][2].caption == "Window: 80° from the axis."
    assert "within 80° from the axis" in text_of(results)
    assert level_of(results).unit == "W/sr"


def test_candela_where_the_lumens_are_known():
    results = make_results(("evaluate",), far_lens(lumens_per_watt=250.0))
    assert "luminous intensity (cd)" in first_picture(results).svg
    assert level_of(results).unit == "cd"


@pytest.mark.usefixtures("undrawn")
def test_lights_under_other_conditions_have_a_row_and_a_picture_for_each_receiver(both):
    other = make_light(both.lens, conditions=Conditions.of(rays=64), nmse=Metric(value=0.5))
    results = Results(both.lens, both.found, {}, {"evaluate_64rays": other})
    assert [row.title for row in other_lights(results)] == [
        "nominal, wall", "nominal, sky", "64rays, wall", "64rays, sky",
    ]  # fmt: skip
    assert [row.fact("pixels").text for row in other_lights(results)][:2] == ["16 × 8", "16 × 16"]
    pictures = other_pictures(results)
    assert [picture.title for picture in pictures][2:] == ["64rays, wall", "64rays, sky"]
    ids = Page(page_of(results)).ids
    assert len(ids) == len(set(ids))


@pytest.mark.usefixtures("undrawn")
def test_designs_on_receivers_of_different_kinds_have_no_common_scale():
    designs = [make_results(("evaluate",)), make_results(("evaluate",), far_lens())]
    pictures = ComparedPictures(("near", "far"), designs)
    assert not pictures.one_scale and "the designs differ too much for one scale" in pictures.scale_words
    assert [picture.caption for picture in pictures.maps] == ["At 150 mm.", "In the far field, to 80°."]
    curves = ("Along y = 0", "Along x = 0", "Encircled energy")
    assert [picture.title for picture in pictures.curves] == [
        f"{curve}, {where}" for where in ("at a distance", "in the far field") for curve in curves
    ]
    markup = render_comparison(designs, ["near", "far"])
    ids = Page(markup).ids
    assert len(ids) == len(set(ids)) and markup.count("<svg") == 2 + 6 + 2


def test_far_fields_are_compared_on_one_scale_in_degrees():
    narrow = small_lens(wanted={"target": {**BEAM, "half_angle_deg": 60.0}})
    designs = [make_results(("evaluate",), lens) for lens in (narrow, far_lens())]
    pictures = ComparedPictures(("narrow", "wide"), designs)
    assert pictures.one_scale and pictures.scale_words == "All maps have the same colours and the same angles."
    assert all("position on the line (°)" in picture.svg for picture in pictures.curves[:2])
    with undrawn():
        assert "the same angles" in render_comparison(designs)


@pytest.mark.usefixtures("undrawn")
def test_every_receiver_is_compared(both):
    designs = [both, make_results(("evaluate",))]
    pictures = ComparedPictures(("both", "one"), designs)
    assert [picture.title for picture in pictures.maps] == ["both, wall", "both, sky", "one"]
    assert pictures.maps[0].caption == "Centred at (100, 0, 200) mm."
    text = Page(render_comparison(designs)).text
    assert "Pattern error (NMSE), sky" in text and "Efficiency, wall" in text


@pytest.mark.usefixtures("undrawn")
def test_verification_and_stray_light_are_shown_on_every_receiver():
    results = whole_results(lens=lens_with(WALL, SKY))
    page = Page(page_of(results))
    assert len(page.ids) == len(set(page.ids))
    for phrase in (
        "Exported part, wall", "Exported part, sky", "Part minus design, sky", "rms, at 1 m, part against design",
        "Ray displacement, sky", "Stray light on the receiver, sky", "for directions at 1 m", "Stray light, wall",
        "of the part; ray noise alone: ",
    ):  # fmt: skip
        assert phrase in page.text, phrase
    names = [group.title.rpartition(", ")[2] for group in tracer_groups(results.proof)]
    assert names == ["wall", "Plain ray cast by trimesh", "wall", "wall", "wall", "sky", "sky"]


def test_the_even_region_of_each_receiver_is_drawn_on_its_own_pixels():
    """The second one is a quarter as wide as the first: 40 of its 100 mm, and 40 of its 50 mm."""
    wall = {"kind": "plane", "name": "wall", "centre_mm": [0.0, 0.0, 200.0], "width_mm": 400.0, "height_mm": 400.0}
    sheet = {"kind": "plane", "name": "sheet", "centre_mm": [0.0, 0.0, 90.0], "width_mm": 100.0, "height_mm": 50.0}
    targets = [{"kind": "disc", "diameter_mm": 48.0, "uniform_mm": 40.0}]
    results = make_results(("evaluate",), lens_with(*({**receiver, "targets": targets} for receiver in (wall, sheet))))
    for shown, shape, share in zip(shown_receivers(results), ((200, 200), (100, 200)), (0.01, 0.32), strict=True):
        mask = shown.mask(200)
        assert mask.shape == shape and mask.mean() == pytest.approx(share, rel=1e-9), shown.name


def test_the_size_of_a_mask_has_the_unit_of_its_receiver():
    spec = lens_of(wanted={"receivers": (PLAIN_WALL, SKY)}).spec
    oblong = {**PLAIN_WALL, "targets": ({**PLAIN_WALL["targets"][0], "uniform_mm": (40.0, 25.0)},)}
    wide = lens_of(wanted={"receivers": (oblong, SKY)}).spec
    assert [mask_words(wanted, "wall") for wanted in (spec, wide)] == ["of 40 mm", "of 40 × 25 mm"]
    assert mask_words(spec, "sky") == "of 10°"
