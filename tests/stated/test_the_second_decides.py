"""Numbers of lists of which the second of two unlike entries decides; branches that the designs do not take."""

import json
from collections.abc import Callable
from math import hypot
from pathlib import Path

import numpy as np
import page_road
import pytest
from addon_rows import needs_addon
from crooked import FILES, Case, spec_of
from in_this_process import lensforge
from oracle_far import bilinear, ies
from scenes import small_spec

import lensforge as lf
from lensforge.light.lens_light import searched_source
from lensforge.search.profiles import ProfileParameters
from lensforge.sources.photometric.photometric_io import photometric_of
from lensforge.spec import parse_spec
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface


@needs_addon("road")
def test_roads_of_a_file_each_with_its_own_lumens(case: Callable[[str], Case], tmp_path: Path) -> None:
    """``lensforge road``: of an IES file, whose numbers are read anew."""
    scene = case("roads")
    roads = [road | {"lamp_lm": lm} for road, lm in zip(scene.lens["spec"]["roads"], (8100.0, 2300.0), strict=True)]
    text = "".join(
        "[[roads]]\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in road.items() if value is not None)
        for road in roads
    )
    (tmp_path / "roads.toml").write_text(text, encoding="utf-8")
    side = scene.lens["spec"]["photometry"]["street_side_deg"]
    ended = lensforge(
        "road", scene.folder / "lens.ies", "--road", tmp_path / "roads.toml", "--street-c", -side, "--json"
    )  # fmt: skip
    records = json.loads(ended.stdout)["roads"]
    c, gamma, candela, head = ies((scene.folder / "lens.ies").read_text(encoding="utf-8"))
    assert (c[0], c[-1], gamma[0], gamma[-1]) == (0, 360, 0, 90)
    for record, road in zip(records, roads, strict=True):
        factor = road["lamp_lm"] / abs(head["lamps"] * head["lumens"])

        def seen(lateral, down, factor=factor):
            values = bilinear(c[:-1], gamma, candela[:-1], (-lateral - side) % 360, np.minimum(down, 90))
            return np.tile(factor * values, (16, 1))

        expected = page_road.figures(road, seen)
        for driver, lane in zip(record["drivers"], expected["lanes"], strict=True):
            assert driver["mean_cd_per_m2"]["value"] == pytest.approx(lane["mean"][0], rel=1e-6)
            assert driver["uniformity"]["value"] == pytest.approx(lane["uniformity"][0], rel=1e-6)
            assert driver["glare_percent"]["value"] == pytest.approx(lane["glare"][0], rel=1e-6)
        assert record["mean_lx"]["value"] == pytest.approx(expected["mean_lx"][0], rel=1e-6)
        assert record["power_density"]["value"] == pytest.approx(expected["power"][0], rel=1e-6)
        assert record["reached"] == page_road.reached(road, expected)
    assert records[0]["mean_lx"]["value"] > 3 * records[1]["mean_lx"]["value"]


IES = """IESNA:LM-63-2002
TILT=NONE
2 700 1.7 3 2 1 2 0.1 0.2 0.3
0.8 1 13
0 45 90
0 90
100 70 30
100 50 10
"""


def test_candela_of_an_ies_file_by_its_multiplier_and_its_ballast_factor() -> None:
    intensity = photometric_of(IES.encode(), "lamp.ies").intensity
    _, _, values, _ = ies(IES)
    assert values[1].tolist() == pytest.approx([136.0, 68.0, 13.6])
    assert intensity.values[0] == pytest.approx(values[0]) and intensity.values[1] == pytest.approx(values[1])


def test_cavity_has_room_for_the_second_led_and_for_each_chip() -> None:
    """Of section 2 of the spec's page: 1.2 times the circle around the source, and 0.6 of that above the highest."""
    second = {
        "kind": "chip_array", "columns": 3, "rows": 1, "pitch_mm": [2.0, 0.7], "width_mm": 0.5, "height_mm": 0.3,
        "position_mm": [0.3, 0.4, 1.5],
    }  # fmt: skip
    first = {"kind": "rectangle", "width_mm": 2.0, "height_mm": 0.4}
    content = {
        "sources": [{"name": "a", "source": first}, {"name": "b", "source": second}],
        "constraints": {"max_radius_mm": 14.0},
        "target": {"kind": "disc", "diameter_mm": 60.0, "distance_mm": 90.0},
    }
    limits = parse_spec(content, "two").constraints
    extent = hypot(2 * 2.0 + 0.5, 0.3) / 2
    assert limits.cavity_radius_mm == pytest.approx(1.2 * (extent + 0.5), rel=0.01)
    assert limits.cavity_height_mm == pytest.approx(0.6 * limits.cavity_radius_mm + 1.5, abs=0.02)


def test_rays_of_each_kind_of_lens_by_the_root_of_its_lamps(case: Callable[[str], Case]) -> None:
    """One lamp and two: 1 and sqrt 2 of the rays of each of 16 samples."""
    one, two = (len(call[0][2]) for call in case("kinds").rays["evaluate"])
    whole = 8192 / (1 + 2**0.5)
    assert (one, two) == (int(whole / 16), int(2**0.5 * whole / 16))


def test_a_search_asks_each_file_for_no_more_rays_than_the_smallest_has(tmp_path: Path) -> None:
    source = searched_source(spec_of("leds", tmp_path))
    assert source.ray_count == 2 * FILES["near"]  # the other LED has those of both files
    drawn = source.sample(400, 3)
    assert [int((drawn.of_source == k).sum()) for k in (0, 1)] == [200, 200]


def test_cup_begins_with_the_radius_that_is_given(tmp_path: Path) -> None:
    spec = spec_of("cup", tmp_path)
    faces = ProfileParameters.of(spec, 2.5).start_surfaces
    assert faces["cup"].radius(np.array([[1.0, 0.0, 0.0]]))[0] == pytest.approx(3.3, rel=0.02)


def test_back_of_a_reflector_moves_by_its_own_offset(tmp_path: Path) -> None:
    parameters = ProfileParameters.of(spec_of("cup", tmp_path), 2.5)
    weights, offsets = parameters.start()
    both = parameters.tables(weights, offsets)
    moved = offsets.clone()
    moved[1] *= 1.03
    ratio = parameters.tables(weights, moved) / both
    middle = ratio.shape[1] // 2
    assert ratio[0].allclose(ratio[0] * 0 + 1)
    assert float(ratio[1, middle, -1]) == pytest.approx(1.03, rel=0.01)


@pytest.mark.parametrize("turn_deg", [0.0, 20.0])
def test_far_field_of_a_square_lens_has_the_symmetry_of_its_led_alone(turn_deg: float) -> None:
    """An LED of 2 x 0.4 mm has two mirrors along its sides, and turned none that the lens has."""
    content = small_spec().model_dump(mode="json", exclude_unset=True)
    content["source"] = {"kind": "rectangle", "width_mm": 2.0, "height_mm": 0.4, "rotate_z_deg": turn_deg}
    spec = parse_spec(content | {"lens": {"levels": [9, 25], "symmetry": "none"}}, "square")
    faces = {name: SrbfSurface(SrbfBasis((4,), 1.75, "square"), np.zeros(4), mm) for name, mm in DOME.items()}
    photometry = lf.photometry(lf.Lens(faces, spec, 0, "draft"), rays=2**12)
    by_c = photometry.candela[:-1]
    planes = len(photometry.candela) - 1
    mirrored = {
        "x": np.roll(by_c[::-1], planes // 2 + 1, axis=0), "y": np.roll(by_c[::-1], 1, axis=0),
        "diagonal": np.roll(by_c[::-1], planes // 4 + 1, axis=0),
    }  # fmt: skip
    same = {name for name, table in mirrored.items() if np.allclose(table, by_c, rtol=1e-6, atol=1e-6 * by_c.max())}
    assert same == ({"x", "y"} if turn_deg == 0.0 else set())


DOME = {"inner": 3.0, "outer": 6.0}
