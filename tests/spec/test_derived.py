"""Values that a spec leaves out: derived from source, target and size, and those of the shipped specs to a fifth."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

import lensforge as lf
from lensforge.errors import WrongFields
from lensforge.sources.build_source import build_source
from lensforge.spec import load_spec, parse_spec
from lensforge.spec.derived_values import WHY, LensSizes

EXAMPLES = Path(__file__).parents[2] / "examples"
SHORTEST = """
[source]
kind = "disc"
diameter_mm = 1.0
[target]
kind = "rectangle"
width_mm = 200.0
height_mm = 150.0
distance_mm = 300.0
[constraints]
max_radius_mm = 14.0
"""


def test_derived_values_follow_a_change_and_given_ones_stay() -> None:
    spec = parse_spec(tomllib.loads(SHORTEST), "lamp")
    wider = spec.replace({"constraints.max_radius_mm": 28.0, "source.diameter_mm": 2.0})
    assert wider.lens.start_mm == {"inner": 12.0, "outer": 27.4} and wider.constraints.cavity_radius_mm == 1.2
    fixed = spec.replace({"lens.inner.offset_mm": 7.0}).replace({"constraints.max_radius_mm": 28.0})
    assert fixed.lens.start_mm == {"inner": 7.0, "outer": 27.4}


LAMP = lf.DiscSource(diameter_mm=1.0)


def test_the_shortest_spec_of_objects_is_that_of_the_file(tmp_path: Path) -> None:
    target = lf.RectangleTarget(width_mm=200, height_mm=150, distance_mm=300)
    limits, lens = lf.ConstraintsSection(max_radius_mm=14), lf.LensSection(material="PC")
    spec = lf.Spec(source=LAMP, target=target, constraints=limits, lens=lens)
    short = lf.Spec(source=LAMP, target=target, constraints=limits)
    table = parse_spec(tomllib.loads(SHORTEST), "lens")
    assert short == table and spec == table.replace({"lens.material": "PC"})
    spec.save(tmp_path / "lens.toml")
    saved = (tmp_path / "lens.toml").read_text(encoding="utf-8")
    assert not any(name.rpartition(".")[2] in saved for name in WHY) and load_spec(tmp_path / "lens.toml") == spec
    assert limits.missing and hash(limits) != hash(spec.constraints), "a section by itself knows no source"


def test_sections_of_another_spec_bring_what_was_given_and_no_derived_value() -> None:
    first = parse_spec(tomllib.loads(SHORTEST), "lens").replace({"lens.inner.offset_mm": 7.0})
    wide = lf.DiscSource(diameter_mm=3.0, position_mm=(0.5, 0.0, 0.2))
    made = lf.Spec(source=wide, target=first.target, constraints=first.constraints, lens=first.lens)
    assert made.constraints.cavity_radius_mm == 2.4 and made.lens.start_mm == {"inner": 7.0, "outer": 13.7}
    assert made.constraints.cavity_height_mm == pytest.approx(0.6 * 2.4 + 0.2)
    leds = [{"name": f"led{number}", "source": {"kind": "disc", "diameter_mm": 1.0, "position_mm": [0.0, y, z]}}
            for number, (y, z) in enumerate(((0.0, 0.3), (1.4, 1.5), (0.2, -0.4)))]  # fmt: skip
    several = lf.Spec(sources=leds, target=first.target, constraints=first.constraints, lens=first.lens)
    assert several.constraints.cavity_radius_mm == pytest.approx(1.2 * (0.5 + 1.4), abs=0.1), "of the farthest"
    assert several.constraints.cavity_height_mm == pytest.approx(
        0.6 * several.constraints.cavity_radius_mm + 1.5, abs=0.1
    ), "above the highest"
    assert first.constraints.cavity_radius_mm == 0.6


def test_a_size_that_no_rule_gives_is_named() -> None:
    corners = ((0.0, 0.0), (80.0, 0.0), (0.0, 60.0))
    limits = lf.ConstraintsSection(max_radius_mm=14)
    with pytest.raises(lf.InputError, match=r"target\.receiver_mm: missing; give the side"):
        lf.Spec(source=LAMP, target=lf.PolygonTarget(corners_mm=corners, distance_mm=100), constraints=limits)
    spots = lf.SpotsTarget(columns=5, rows=7, pitch_mm=20, diameter_mm=10, distance_mm=100)
    assert lf.Spec(source=LAMP, target=spots, constraints=limits).all_receivers[0].size == (195.0, 195.0)


def test_limits_alone_say_that_the_search_needs_a_target() -> None:
    content = tomllib.loads(SHORTEST)
    del content["target"]
    content["limits"] = [{"kind": "points", "at_mm": [[0.0, 0.0]], "unit": "w_per_m2", "at_least": 1.0}]
    with pytest.raises(lf.InputError, match="limits judge the light, the search needs a target, too") as refusal:
        parse_spec(content, "lamp")
    assert len(str(refusal.value).splitlines()) == 1


@pytest.mark.parametrize("name", ["cross", "rectangle", "silicone", "chip_array", "batwing", "elliptical_beam"])
def test_the_rules_are_those_of_the_shipped_specs(name: str) -> None:
    """Of lenses in which the cavity was not widened for a fixed surface or a LED's stray light."""
    given = load_spec(EXAMPLES / f"{name}.toml")
    content = tomllib.loads((EXAMPLES / f"{name}.toml").read_text(encoding="utf-8"))
    for section, names in {
        "constraints": ("cavity_height_mm", "cavity_radius_mm", "min_thickness_mm"),
        "lens": ("inner", "outer"),
        "target": ("receiver_mm", "half_angle_deg"),
    }.items():
        for field in names:
            content[section].pop(field, None)
    derived = parse_spec(content, name)
    assert derived.lens.start_mm == pytest.approx(given.lens.start_mm, rel=0.05)
    for field in ("cavity_radius_mm", "cavity_height_mm"):
        assert getattr(derived.constraints, field) == pytest.approx(getattr(given.constraints, field), rel=0.2)
    for receiver, wanted in zip(derived.all_receivers, given.all_receivers, strict=True):
        assert receiver.size == pytest.approx(wanted.size, rel=0.12)


@pytest.mark.parametrize("radius_mm", [0.5, 2.45, 14.0, 40.0, 1000.0])
@pytest.mark.parametrize("share", [0.0, 0.05, 0.3, 0.5])
def test_a_lens_of_any_size_holds_its_source_and_starts_with_a_wall(radius_mm: float, share: float) -> None:
    sizes = LensSizes(radius_mm, share * radius_mm)
    inner_mm, outer_mm = lf.LensSection().derived_offsets_mm(sizes).values()
    assert sizes.cavity_radius_mm >= 1.19 * share * radius_mm and sizes.cavity_radius_mm > 0.0
    assert sizes.cavity_radius_mm < inner_mm < outer_mm <= radius_mm
    assert outer_mm - inner_mm > sizes.min_thickness_mm > 0.0


def test_all_that_is_wrong_is_named_at_once_and_nothing_that_follows_from_it(tmp_path: Path) -> None:
    """Three files are not there and a number is wrong; the room for the LED would follow from its file."""
    spec = tmp_path / "lamp.toml"
    spec.write_text(
        '[source]\nkind = "rayfile"\nfile = "led.ray"\n[constraints]\nmax_radius_mm = -9.0\nkeep_out = "clip.step"\n'
        '[target]\nkind = "image"\nfile = "cat.png"\nwidth_mm = 80.0\ndistance_mm = 100.0\n'
    )
    with pytest.raises(WrongFields) as refusal:
        lf.load_spec(spec)
    source, radius, keep_out, target = refusal.value.lines
    assert source == f"{spec}: source.file = 'led.ray': no such file in {tmp_path}"
    assert keep_out == f"{spec}: constraints.keep_out = 'clip.step': no such file in {tmp_path}"
    assert target == f"{spec}: target.file = 'cat.png': no such file in {tmp_path}"
    assert radius.startswith(f"{spec}: constraints.max_radius_mm = -9.0: ")
    for name in ("led.ray", "clip.step", "cat.png"):
        (tmp_path / name).touch()
    spec.write_text(spec.read_text().replace("-9.0", "9.0"))
    with pytest.raises(WrongFields) as refusal:
        lf.load_spec(spec)
    missing = "constraints.cavity_height_mm and constraints.cavity_radius_mm: missing: room for the LED"
    assert [line.partition(", which")[0] for line in refusal.value.lines] == [f"{spec}: {missing}"]


def test_chips_have_the_cavity_of_the_circle_that_holds_all_of_them() -> None:
    """The farthest corner decides: of the second chip, whose centre is nearer than that of the first."""
    chips = [
        {"x_mm": 0.0, "y_mm": 1.0, "width_mm": 0.2, "height_mm": 0.2},
        {"x_mm": -0.7, "y_mm": -0.4, "width_mm": 1.0, "height_mm": 2.0},
    ]
    content = tomllib.loads(SHORTEST) | {"source": {"kind": "chips", "chips": chips, "position_mm": [0.3, 0.4, 0.1]}}
    limits = parse_spec(content, "lamp").constraints
    assert 0.0 <= limits.cavity_radius_mm - 1.2 * (np.hypot(1.2, 1.4) + 0.5) < 0.01  # rounded up to three digits
    assert 0.0 <= limits.cavity_height_mm - (0.6 * limits.cavity_radius_mm + 0.1) < 0.01


@pytest.mark.parametrize(
    ("source", "corner", "sides"),
    [
        ({"kind": "square", "side_mm": 1.4}, (0.7, 0.7), (1.4, 1.4)),
        ({"kind": "disc", "diameter_mm": 1.4}, (0.7, 0.0), (1.4, 1.4)),
        ({"kind": "rectangle", "width_mm": 2.0, "height_mm": 0.4}, (1.0, 0.2), (2.0, 0.4)),
        ({"kind": "chip_array", "columns": 3, "rows": 2, "pitch_mm": [2.0, 0.7], "width_mm": 0.5, "height_mm": 0.3},
         (2.25, 0.5), (4.5, 1.0)),
        ({"kind": "chips", "chips": [{"x_mm": 0.4, "y_mm": 0.0, "width_mm": 0.5, "height_mm": 0.5},
                                     {"x_mm": 0.0, "y_mm": -1.2, "width_mm": 0.6, "height_mm": 0.2}]},
         (0.3, 1.3), (0.95, 1.55)),
    ],
    ids=lambda case: case["kind"] if isinstance(case, dict) else "",
)  # fmt: skip
def test_the_extent_of_an_emitter_is_the_way_to_its_farthest_corner(
    source: dict, corner: tuple[float, float], sides: tuple[float, float]
) -> None:
    """And its rays start on all of the rectangle around it."""
    spec = parse_spec({**tomllib.loads(SHORTEST), "source": source}, "lamp")
    assert spec.source.extent_mm == pytest.approx(float(np.hypot(*corner)), rel=1e-12)
    starts = build_source(spec.source).sample(2**13, 0).origins[:, :2]
    assert np.ptp(starts, axis=0) == pytest.approx(sides, rel=0.02)


@pytest.mark.parametrize(
    ("target", "size"),
    [
        ({"kind": "rectangle", "width_mm": 200.0, "height_mm": 150.0}, 300.0),
        ({"kind": "rectangle", "width_mm": 100.0, "height_mm": 151.0}, 227.0),  # 226.5 rounded up
        ({"kind": "disc", "diameter_mm": 60.0, "centre_mm": [10.0, -25.0]}, 1.5 * (60.0 + 2.0 * 25.0)),
        ({"kind": "ellipse", "width_mm": 30.0, "height_mm": 90.0, "centre_mm": [-40.0, 10.0]}, 1.5 * (90.0 + 80.0)),
        ({"kind": "ring", "inner_diameter_mm": 40.0, "outer_diameter_mm": 80.0}, 120.0),
        ({"kind": "cross", "length_mm": 70.0, "stroke_mm": 20.0}, 105.0),
        ({"kind": "text", "text": "AB", "width_mm": 50.0}, 75.0),
        ({"kind": "text", "text": "I", "width_mm": 50.0}, 1.5 * 80.0),  # a glyph may be 1.6 times as high as wide
        ({"kind": "spots", "columns": 5, "rows": 7, "pitch_mm": 20.0, "diameter_mm": 10.0}, 1.5 * 130.0),
        ({"kind": "spots", "columns": 9, "rows": 2, "pitch_mm": 20.0, "diameter_mm": 10.0}, 1.5 * 170.0),
        ({"kind": "beam", "fwhm_deg": [30.0, 60.0]}, 80.0), ({"kind": "beam", "fwhm_deg": [60.0, 30.0]}, 80.0),
        ({"kind": "beam", "fwhm_deg": 75.0}, 85.0), ({"kind": "batwing", "to_deg": 45.0}, 60.0),
    ],
    ids=lambda case: case["kind"] if isinstance(case, dict) else "",
)  # fmt: skip
def test_the_receiver_of_a_pattern_has_room_around_it(target: dict, size: float) -> None:
    """One and a half of the square about the axis that holds it; of a beam four thirds of its wider side."""
    place = {} if target["kind"] in ("beam", "batwing") else {"distance_mm": 300.0}
    section = parse_spec({**tomllib.loads(SHORTEST), "target": target | place}, "lamp").target
    assert (section.receiver_mm if place else section.half_angle_deg) == pytest.approx(size, rel=1e-9)


def test_a_turned_pattern_has_room_for_its_corners() -> None:
    turned = {"kind": "rectangle", "width_mm": 100.0, "height_mm": 150.0, "distance_mm": 300.0, "rotation_deg": 20.0}
    section = parse_spec({**tomllib.loads(SHORTEST), "target": turned}, "lamp").target
    across, up = (abs(np.cos(np.radians(20.0 + 90.0 * k))) for k in (0, 1))
    assert 1.5 * (150.0 * across + 100.0 * up) <= section.receiver_mm <= 1.5 * 150.0 * 2.0**0.5 + 1.0


@pytest.mark.parametrize(
    ("radius_mm", "base", "sizes"),
    [
        (24.0, {}, (25.4, 25.4, 2.0)),
        (24.1, {}, (43.38, 25.4, 3.0125)),
        (50.0, {"kind": "square"}, (25.4, 90.0, 6.25)),
        (50.0, {"diameter_mm": 70.0}, (70.0, 25.4, 6.25)),
        (50.0, {"height_mm": 3.0}, (90.0, 25.4, 3.0)),
    ],
)
def test_the_base_of_a_large_lens_is_as_wide_as_its_cavity_needs(
    radius_mm: float, base: dict[str, object], sizes: tuple[float, float, float]
) -> None:
    changes = {"constraints.max_radius_mm": radius_mm, "base": base, "manufacture.process": "none"}
    spec = parse_spec(tomllib.loads(SHORTEST), "lamp").replace(changes)
    assert (spec.base.diameter_mm, spec.base.side_mm, spec.base.height_mm) == pytest.approx(sizes)
    assert spec.base.model_fields_set == set(base), "what is derived follows the lens"
