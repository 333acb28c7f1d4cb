"""Light that drafts reached: the stored drafts are met exactly, lie between their neighbours, and end at their hull."""

import re
import sys
from math import atan, degrees, pi, sqrt
from pathlib import Path

import pytest

from lensforge.light.lens_light import source_of
from lensforge.report.new_scene import NewScene
from lensforge.search.designed_light import DRAFTS, DesignedLight, DraftPlace, designed_light, series_of
from lensforge.search.lens_advice import LensAdvice, LensOption
from lensforge.spec import Spec, parse_spec
from lensforge.spec.lens_section import LensShape
from lensforge.spec.new_spec import source_in, target_in

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
import advice

ROWS = advice.rows_of(DRAFTS)


def scene(source: str, target: str, radius_mm: float = 14.0) -> NewScene:
    return NewScene.of("draft", {"target": target_in(target)}, source_in(source), radius_mm).of_material("PMMA")


def spec_of(source: str, target: str, radius_mm: float = 14.0) -> Spec:
    return parse_spec(scene(source, target, radius_mm).content("double"), "draft")


def place_of(source: str, target: str, radius_mm: float = 14.0) -> DraftPlace | None:
    spec = spec_of(source, target, radius_mm)
    return DraftPlace.of(spec, source_of(spec))


@pytest.mark.parametrize(
    ("source", "size"),
    [
        ("disc:1", 14.0 / 0.5),
        ("square:2", 14.0 / (2.0 / sqrt(pi))),
        ("rectangle:4x1", 14.0 / (2.0 / sqrt(pi))),
        ("3535 dome 1 mm", 14.0 / (1.41 / sqrt(pi))),
    ],
)
def test_the_size_is_that_over_a_disc_of_the_same_etendue(source: str, size: float) -> None:
    place = place_of(source, "disc:100@300")
    assert place is not None and place.size == pytest.approx(size, rel=1e-3)


@pytest.mark.parametrize(
    ("target", "half_angle_deg"),
    [
        ("disc:200@300", degrees(atan(100.0 / 300.0))),
        ("disc:600@300", 45.0),
        # a square whose side is seen under 2t has the solid angle 4 asin(sin² t)
        ("rectangle:600x600@300", 48.189685),  # 2 pi (1 - cos) = 4 asin(1/2)
    ],
)
def test_the_beam_is_that_of_a_cone_of_the_same_solid_angle(target: str, half_angle_deg: float) -> None:
    place = place_of("disc:1", target)
    assert place is not None and place.half_angle_deg == pytest.approx(half_angle_deg, rel=0.015), "to half a pixel"


def test_of_an_led_that_is_not_lambertian_no_drafts_tell() -> None:
    assert place_of("VCSEL array", "disc:100@300") is None
    assert place_of("CSP 1010", "disc:100@300") is None
    assert place_of("COB LES 4", "disc:100@300") is not None


def test_of_light_that_is_not_even_no_drafts_tell() -> None:
    """A Gaussian beam has a mean of 0.39 of its largest intensity where it is above a tenth of it.

    A rectangle whose edges are Gaussian integrals of 30 and of 35 mm has 0.513 and 0.480, by a sum over its product.
    """
    assert place_of("square:1", "beam:20") is None
    for edge_mm, is_even in ((0.0, True), (30.0, True), (35.0, False)):
        spec = spec_of("square:1", "rectangle:200x150@300")
        soft = spec.replace({"target.edge_mm": edge_mm, "target.receiver_mm": 500.0})
        assert (DraftPlace.of(soft, source_of(soft)) is not None) == is_even


def test_of_a_zoom_no_drafts_tell() -> None:
    zoom = scene("square:1", "zoom:15-45", 7.5).zoomed(15.0, 45.0)
    spec = parse_spec(zoom.content("double"), "draft")
    assert len(spec.by_state) == 2 and DraftPlace.of(spec, source_of(spec)) is None
    assert not zoom.advice().by_drafts


@pytest.mark.parametrize("row", ROWS, ids=[" ".join((row[0], row[6], row[7], row[8])) for row in ROWS])
def test_each_draft_is_met_exactly(row: list[str]) -> None:
    half_angle_deg, size, possible, efficiency, nmse = map(float, row[-5:])
    light = designed_light((row[0], row[6]), DraftPlace(half_angle_deg, size))
    if light is None:  # a corner of the hull, by rounding
        light = designed_light((row[0], row[6]), DraftPlace(half_angle_deg * 1.0001, size * 0.9999))
    assert 0.0 < efficiency < possible < 0.93 and nmse > 0.0
    assert light is not None
    assert light.of_possible * possible == pytest.approx(efficiency, rel=1e-3)
    assert light.nmse == pytest.approx(nmse, rel=0.02, abs=1e-4)


def test_between_two_drafts_is_the_mean_of_both() -> None:
    """On the line between two corners of the hull, half way in the logarithms of both; beyond it nothing is known."""
    for series in {(row[0], row[6]) for row in ROWS}:
        rows = [[float(number) for number in row[-5:]] for row in ROWS if (row[0], row[6]) == series]
        first = min(rows, key=lambda row: row[0])
        last = max(rows, key=lambda row: row[0] * row[1])
        middle = DraftPlace(sqrt(first[0] * last[0]), sqrt(first[1] * last[1]) * 0.99999)
        light = designed_light(series, middle)
        assert light is not None
        assert light.of_possible == pytest.approx(0.5 * (first[3] / first[2] + last[3] / last[2]), abs=2e-4)
        assert light.nmse == pytest.approx(sqrt(first[4] * last[4]), rel=1e-3)
        assert designed_light(series, DraftPlace(first[0] * 0.99, first[1])) is None
        assert designed_light(series, DraftPlace(last[0] * 1.01, last[1])) is None


def test_other_drafts_are_as_near_to_the_table_as_the_page_says() -> None:
    """The efficiency by the table against that of a draft, and the number of drafts, some of each kind."""
    errors: dict[str, list[float]] = {"double": [], "tir": []}
    for _, series, draft in advice.held_out():
        errors[series[0]].append(abs(advice.by_table(series, draft)[0] - draft.efficiency))
    page = (Path(__file__).parents[2] / "docs" / "choosing.md").read_text(encoding="utf-8")
    count, most = re.findall(r"Of (\d+) other drafts.*? by ([\d.]+) at most", page, re.DOTALL)[0]
    assert len(errors["double"]) + len(errors["tir"]) == int(count) >= 10 and len(errors["tir"]) >= 2
    assert max(errors["double"] + errors["tir"]) == pytest.approx(float(most), abs=0.0015)


def option(kind: str, possible: float, of_possible: float, nmse: float) -> LensOption:
    return LensOption(LensShape.kinds[kind], possible, DesignedLight(of_possible, nmse))


def test_the_simplest_kind_with_nearly_the_most_designed_light_is_advised() -> None:
    """On each side of 0.97 of the most light, whatever bounds say; a reflector suits no light, and does not count."""
    tir = option("tir", 0.923, 0.96, 0.01)
    for share, kind in ((0.969, "tir"), (0.971, "double")):
        double = option("double", 0.8, share * 0.923 * 0.96 / 0.8, 0.01)
        mirror = option("reflector", 0.99, 0.99, 0.01)
        advice = LensAdvice.among({"double": double, "tir": tir, "reflector": mirror}, "patch")
        assert advice.advised == kind and advice.by_drafts
        assert advice.shares == pytest.approx({"double": share, "tir": 1.0})
    assert "drafts like this reached an efficiency of 0.98 with a reflector (NMSE 0.01), 0.89 with" in advice.phrase
    assert advice.why.startswith("double is used, the simplest with 0.97 of the most or more: double has 0.971")


def test_a_kind_whose_drafts_fail_by_their_pattern_is_not_advised_for_its_light() -> None:
    """On each side of the pattern error that a verdict allows; where all fail the light decides."""
    for nmse, others, kind in ((0.099, 0.01, "tir"), (0.101, 0.01, "double"), (0.3, 0.2, "tir")):
        options = {"double": option("double", 0.9, 0.9, others), "tir": option("tir", 0.923, 0.97, nmse)}
        advice = LensAdvice.among(options, "patch")
        assert advice.advised == kind
        only = "double is used, the only kind whose drafts have an NMSE of 0.1 or less"
        assert (advice.why == only) == (kind == "double")


def test_where_one_kind_has_no_drafts_the_bounds_decide() -> None:
    options = {"double": LensOption(LensShape.kinds["double"], 0.9), "tir": option("tir", 0.923, 0.97, 0.01)}
    advice = LensAdvice.among(options, "patch")
    assert advice.advised == "double" and not advice.by_drafts
    assert "reached" not in advice.phrase and advice.why.endswith("; drafts like this are not known")
    assert LensAdvice.among(options, "picture").why == "double is used, the only kind that suits this light"


def test_the_first_lens_is_advised_by_what_drafts_reached() -> None:
    """Bounds have 0.979 of each other, and would take two faces; drafts reached 0.84 by these, and 0.89 by a mirror."""
    advice = scene("disc:1", "rectangle:200x150@300").advice()
    double, tir = advice.options["double"], advice.options["tir"]
    assert double.possible / tir.possible == pytest.approx(0.979, abs=2e-3)
    assert double.reached == pytest.approx(0.838, abs=0.02) and tir.reached == pytest.approx(0.890, abs=0.02)
    assert advice.advised == "tir" and advice.by_drafts


@pytest.mark.parametrize("cutter", ["usual", "0.7", "mould", "none"])
def test_the_series_is_that_of_the_faces(cutter: str) -> None:
    made = scene("disc:1", "rectangle:200x150@300")
    specs = {
        (kind, shape): parse_spec(made.tables(kind, cutter, shape), "draft")  # type: ignore[arg-type]
        for kind, shape in (("double", "patch"), ("double", "round"), ("tir", "patch"), ("tir", "round"))
    }
    assert [series_of(spec) for spec in specs.values()] == [
        ("double", "freeform"), ("double", "freeform"), ("tir", "freeform"), ("tir", "round"),
    ]  # fmt: skip
