"""Lamps together in a spec: where they stand, which mirrors they have, and what cannot be."""

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from manifold3d import CrossSection
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.spec import Spec, parse_spec
from lensforge.spec.lamps_section import Lamps

GRID = {"kind": "grid", "columns": 3, "rows": 2, "pitch_mm": [20.0, 30.0]}
DISC = {"kind": "disc", "diameter_mm": 9.0}
RING = {"kind": "ring", "count": 4, "diameter_mm": 60.0}
SQUARE = {"kind": "square", "side_mm": 16.0}


def lamps_of(lamps: dict[str, Any]) -> Lamps:
    return small_spec(lamps=lamps, base={"kind": "none"}, target__receiver_mm=200.0).all_lamps


CORNERS = {
    "kind": "table",
    "places_mm": [[30, 30, -5], [-30, 30, -5], [-30, -30, -5], [30, -30, -5]],
    "aims_mm": [[0, 0, 90]] * 4,
}


def test_lamps_on_poles_have_heights_and_aims() -> None:
    poles = lamps_of(
        {"kind": "table", "places_mm": [[0, 0, 5], [30, 0]], "aims_mm": [[0, -4, 8], [30, 0, 9]], "turns_deg": [5, 6]}
    )
    assert poles.places_mm == ((0.0, 0.0), (30.0, 0.0)) and [lamp.place_mm[2] for lamp in poles.lamps] == [5.0, 0.0]
    assert poles.posed and poles.turns_deg == (5.0 - 90.0, 6.0)
    np.testing.assert_allclose([lamp.axis for lamp in poles.lamps], [(0.0, -0.8, 0.6), (0.0, 0.0, 1.0)], atol=1e-15)
    assert poles.nearest_mm() == pytest.approx(925.0**0.5) and poles.reach_mm == 30.0
    assert poles.in_far_field.lamps == tuple(lamp._replace(place_mm=(0.0, 0.0, 0.0)) for lamp in poles.lamps)
    assert not lamps_of({"kind": "table", "places_mm": [[0, 0], [19, 0, 0]], "aims_mm": [[0, 0, 8], [19, 0, 1]]}).posed


def test_lamps_stand_about_the_origin() -> None:
    grid = lamps_of(GRID).places_mm
    assert sorted(grid) == [(x, y) for x in (-20.0, 0.0, 20.0) for y in (-15.0, 15.0)]
    hexagon = lamps_of({"kind": "hexagon", "rings": 2, "pitch_mm": 20.0})
    away = np.sort(np.hypot(*np.array(hexagon.places_mm).T))
    np.testing.assert_allclose(away, [0.0] + 6 * [20.0] + 6 * [20.0 * 3.0**0.5] + 6 * [40.0], atol=1e-12)
    assert hexagon.nearest_mm() == pytest.approx(20.0)
    ring = lamps_of(RING)
    np.testing.assert_allclose(ring.places_mm, [(30.0, 0.0), (0.0, 30.0), (-30.0, 0.0), (0.0, -30.0)], atol=1e-12)
    assert ring.turns_deg == (0.0, 90.0, 180.0, 270.0) and lamps_of({**RING, "turned": False}).turns_deg == (0.0,) * 4
    assert (
        small_spec().all_lamps.is_single
        and lamps_of({"kind": "grid", "columns": 1, "rows": 1, "pitch_mm": 9.0}).is_single
    )
    period = small_spec(lamps={"kind": "endless", "pitch_mm": 200.0}).all_lamps
    assert period.period_mm == (200.0, 200.0) and len(period) == 1 and period.nearest_mm() == 200.0


@pytest.mark.parametrize(
    ("lamps", "groups"),
    [
        (GRID, ["none", "mirror_x", "mirror_y", "rectangle"]),
        ({**GRID, "rows": 3, "pitch_mm": 20.0}, ["none", "mirror_x", "mirror_y", "rectangle", "square"]),
        (RING, ["none", "mirror_y"]),  # across the y axis the +x of each would point to the origin
        ({**RING, "count": 5}, ["none", "mirror_y"]),
        ({"kind": "hexagon", "rings": 1, "pitch_mm": 20.0}, ["none", "mirror_x", "mirror_y", "rectangle"]),
        ({"kind": "table", "places_mm": [[9, 9], [-9, -9]], "turns_deg": [10.0, 190.0]}, ["none"]),
        (CORNERS, ["none", "mirror_y"]),  # across the y axis the +x of each would point to the other side
        (
            {**CORNERS, "turns_deg": [-225.0, -315.0, -45.0, -135.0]},
            ["none", "mirror_x", "mirror_y", "rectangle", "square"],
        ),
        ({**CORNERS, "aims_mm": [[0, 0, 90], [0, 0, 90], [0, 0, 90], [0, 9, 90]]}, ["none"]),
        ({"kind": "table", "places_mm": [[9, 20, 5], [9, -20, 5]]}, ["none", "mirror_y"]),
        ({"kind": "table", "places_mm": [[9, 20, 5], [9, -20, 6]]}, ["none"]),
    ],
)
def test_lamps_have_the_mirrors_that_move_each_onto_another_one(lamps: dict[str, Any], groups: list[str]) -> None:
    board = lamps_of(lamps)
    assert [
        name for name in ("none", "mirror_x", "mirror_y", "rectangle", "square") if board.has_mirrors(name)
    ] == groups


def test_a_lattice_has_the_mirrors_of_its_cell() -> None:
    hexagons = Lamps.level(((0.0, 0.0), (10.0, 10.0 * 3.0**0.5)), (0.0, 0.0), (20.0, 20.0 * 3.0**0.5))
    assert hexagons.has_mirrors("rectangle") and not hexagons.has_mirrors("square")
    assert Lamps(period_mm=(20.0, 20.0)).has_mirrors("square") and not Lamps(period_mm=(20.0, 30.0)).has_mirrors(
        "square"
    )


def plane(**changes: Any) -> dict[str, Any]:
    whole = {"kind": "plane", "centre_mm": [0.0, 0.0, 30.0], "width_mm": 60.0, "height_mm": 60.0, "targets": [DISC]}
    return {"target": None, "receivers": [{**whole, **changes}]}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"lamps": {**GRID, "pitch_mm": 13.0}}, "13 mm apart, lenses of constraints.max_radius_mm = 7 overlap; .* 14"),
        ({"lamps": {**GRID, "pitch_mm": 15.0}}, "15 mm apart, their rims of base.kind = 'cylinder' are 16 mm wide"),
        ({"lamps": {"kind": "table", "places_mm": [[0, 0], [18, 0]], "turns_deg": [45, 0]}, "base": SQUARE},
         "18 mm apart, their rims of base.kind = 'square' are 16 mm wide; allowed: at least 19.32"),
        ({"lamps": GRID, **plane(centre_mm=[8.0, 0.0, 3.0], normal=[1.0, 0.0, 0.3])}, "between the lamps: .* needs"),
        ({"lamps": RING, "target": None, "receivers": [
            {"kind": "sphere", "radius_mm": 35.0, "half_angle_deg": 60.0, "targets": [DISC]}
        ]}, r"'sphere' is between the lamps: that at \(30, 0\) mm has 5 mm to it"),
        ({"lamps": {"kind": "endless", "pitch_mm": 20.0}}, "light level planes that are one period .* 20 x 20 mm"),
        ({"lamps": {"kind": "endless", "pitch_mm": 60.0}, **plane(rotation_deg=30.0)}, "light level planes"),
        ({"lamps": {"kind": "endless", "lattice": "hexagon", "pitch_mm": [20.0, 30.0]}}, "a hexagonal lattice has one"),
        ({"lamps": {"kind": "table", "places_mm": [[0, 0], [20, 0]], "turns_deg": [3.0]}}, "turns_deg has 1 numbers"),
        ({"lamps": {"kind": "table", "places_mm": [[0, 0], [20, 0]], "aims_mm": [[3, 0, 9]]}}, "aims_mm has 1 points"),
        ({"lamps": {"kind": "table", "places_mm": [[0, 0]], "aims_mm": [[0, 0, 0]]}}, r"aims_mm.0 = \(.*is the place"),
        ({"lamps": {"kind": "table", "places_mm": [[0, 0, 5], [3, 4, 17]]}}, "the nearest two stand 13 mm apart"),
        ({"lamps": {"kind": "table", "places_mm": [[0, 0], [0, 0, 95]]}}, r"that at \(0, 0, 95\) mm has 5 mm to it"),
        ({"lamps": {**CORNERS, "places_mm": [[x, y, 0] for x, y, _ in CORNERS["places_mm"]]},
          "plate": {"thickness_mm": 2}}, r"plate: its lenses stand on z = 0 with their axes along z, \[lamps\] have"),
        ({"lamps": {**GRID, "columns": 60, "rows": 60}}, "3600 lamps, at most 2000"),
        ({"lamps": GRID, "evaluate__window_mm": 100.0}, "evaluate.window_mm: of lamps together"),
        ({"lamps": GRID, **plane(window_mm=[20.0, 20.0])}, "receivers.window_mm: of lamps together"),
        ({"lamps": GRID, "photometry__lenses": 6}, r"photometry.lenses = 6: \[lamps\] are 6 already"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_one_line(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        small_spec(**changes)
    assert len(str(caught.value).splitlines()) == 1


def test_a_written_spec_has_its_lamps() -> None:
    spec = small_spec(lamps=GRID, base={"kind": "none"})
    assert spec.lamps is not None and spec.replace({"lamps.rows": 3}).all_lamps.places_mm[0] == (-20.0, -30.0)
    assert isinstance(parse_spec(spec.model_dump(mode="json", exclude_unset=True), "again"), Spec)
    assert spec.of_one_lamp.all_lamps.is_single and "lamps" not in spec.of_one_lamp.to_toml()


BY_PLACE = {"kind": "grid", "columns": 6, "rows": 6, "pitch_mm": 20.0, "kinds": "place"}
WIDE = {"kind": "table", "places_mm": [[-30.0, 0.0], [0.0, 0.0], [30.0, 0.0]], "kinds": ["wide", "narrow", "wide"]}


@pytest.mark.parametrize(
    ("lamps", "counts"),
    [
        ({**BY_PLACE, "columns": 3, "rows": 3}, {"middle": 1, "edge": 4, "corner": 4}),
        (BY_PLACE, {"middle": 16, "edge": 16, "corner": 4}),
        ({**BY_PLACE, "rim_rings": 2}, {"middle": 4, "corner_2": 4, "edge_2": 8, "edge": 16, "corner": 4}),
        ({**BY_PLACE, "rows": 1}, {"middle": 4, "edge": 2}),
        ({**BY_PLACE, "rows": 2}, {"edge": 8, "corner": 4}),
        ({"kind": "hexagon", "rings": 2, "pitch_mm": 20.0, "kinds": "place"}, {"middle": 7, "edge": 6, "corner": 6}),
        (WIDE, {"narrow": 1, "wide": 2}),
    ],
)
def test_places_are_shared_out_to_kinds_from_the_middle_on(lamps: dict[str, Any], counts: dict[str, int]) -> None:
    board = lamps_of(lamps)
    assert {kind.name: len(kind.numbers) for kind in board.kinds} == counts and len(board) == sum(counts.values())
    assert sorted(k for kind in board.kinds for k in kind.numbers) == list(range(len(board)))


@pytest.mark.parametrize("rings", [1, 2])
def test_lamps_at_the_rim_face_outwards_and_are_their_own_mirror_images(rings: int) -> None:
    """Each mirror of the grid takes a turned lens to the same one at another place, by matrices alone."""
    board = lamps_of({**BY_PLACE, "rim_rings": rings})
    diagonal, along_x = np.array([[0.0, 1.0], [1.0, 0.0]]), np.diag([1.0, -1.0])
    for kind in board.kinds[1:]:
        mirror = diagonal if "corner" in kind.name else along_x
        turns = np.radians(board.turns_deg)
        turned = {k: np.array([[np.cos(t), -np.sin(t)], [np.sin(t), np.cos(t)]]) for k, t in enumerate(turns)}
        by_place = {tuple(np.round(board.places_mm[k], 6)): turned[k] for k in kind.numbers}
        for place, turn in by_place.items():
            axis = turn @ ([1.0, 1.0] if "corner" in kind.name else [1.0, 0.0])
            assert np.allclose(axis, np.sign(place)) if "corner" in kind.name else axis @ place > 40.0 - 20.0 * rings
            for of_scene in (np.diag([-1.0, 1.0]), along_x, diagonal):
                np.testing.assert_allclose(of_scene @ turn @ mirror, by_place[tuple(of_scene @ place)], atol=1e-9)
    assert board.has_mirrors("square") and not board.of_kind(board.kinds[-1]).has_mirrors("mirror_x")


@pytest.mark.parametrize("lamps", [BY_PLACE, {"kind": "hexagon", "rings": 2, "pitch_mm": 20.0, "kinds": "place"}, WIDE])
def test_the_same_places_may_have_one_lens(lamps: dict[str, Any]) -> None:
    section = small_spec(lamps=lamps, base={"kind": "none"}).lamps
    assert section is not None and section.lamps.kinds
    single = section.of_one_kind.lamps
    assert single.kinds == () and single.places_mm == section.lamps.places_mm and set(single.turns_deg) == {0.0}


def test_kinds_of_a_table_have_the_mirrors_that_keep_them() -> None:
    assert lamps_of(WIDE).has_mirrors("rectangle")
    one_side = lamps_of({**WIDE, "kinds": ["wide", "wide", "narrow"]})
    assert one_side.has_mirrors("mirror_y") and not one_side.has_mirrors("mirror_x")
    assert lamps_of(WIDE).phrase.endswith("lit by 3 lamps with lenses of 2 kinds")


@pytest.mark.parametrize(
    ("lamps", "message"),
    [
        ({**BY_PLACE, "columns": 2, "rows": 2}, "all 4 lamps are of the kind 'corner'"),
        ({**WIDE, "kinds": ["wide", "narrow"]}, "kinds has 2 names, places_mm 3 places"),
        ({**WIDE, "kinds": ["wide", "wide", "wide"]}, "1 names; give 2 to 7"),
        ({**WIDE, "kinds": ["../x", "b", "b"]}, "kinds"),
    ],
)
def test_kinds_that_cannot_be(lamps: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        lamps_of(lamps)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"optimise__robust": True, "plate": {"thickness_mm": 2.0}}, "optimise.robust goes with"),
        ({"limits": [{"kind": "luminance", "eyes_mm": [[0, 0, 900]], "unit": "cd_per_m2", "at_most": 1.0}]},
         "a limit of kind luminance goes with lamps of one lens"),
        (
            {"target": None, "receivers": [{"kind": "far_field", "half_angle_deg": 60.0, "targets": [
                {"kind": "disc", "diameter_deg": 40.0}]}]},
            "in the far field all 36 lamps are at one place",
        ),
    ],
)  # fmt: skip
def test_what_goes_with_one_lens_alone(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        small_spec(**{"lamps": BY_PLACE, "base": {"kind": "none"}, "target__receiver_mm": 200.0, **changes})


def test_kinds_by_place_need_one_receiver_that_is_near() -> None:
    """The second of two: in the far field, which is the first, all lamps are at one place."""
    far = {"kind": "far_field", "half_angle_deg": 60.0, "targets": [{"kind": "disc", "diameter_deg": 40.0}]}
    near = {**plane(centre_mm=[0.0, 0.0, 300.0])["receivers"][0], "name": "near"}
    spec = small_spec(lamps=BY_PLACE, base={"kind": "none"}, target=None, receivers=[{**far, "name": "far"}, near])
    assert len(spec.all_lamps.kinds) == 3


def squares(lamps: Lamps, side_mm: float) -> list[CrossSection]:
    corners = 0.5 * side_mm * np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    return [CrossSection([corners]).rotate(lamp.turn_deg).translate(lamp.place_mm[:2]) for lamp in lamps.lamps]


def overlap(lamps: Lamps, side_mm: float) -> bool:
    return any((a ^ b).area() > 0.0 for a, b in combinations(squares(lamps, side_mm), 2))


@pytest.mark.parametrize("turns", [(0.0, 0.0, 0.0), (90.0, -90.0, 0.0), (45.0, 45.0, 45.0), (10.0, 20.0, 230.0)])
def test_square_bases_have_room_until_the_first_two_overlap(turns: tuple[float, ...]) -> None:
    """By another program's areas of what two turned squares share; the nearest two do not always decide."""
    rng = np.random.default_rng(7)
    the_second = 0
    for _ in range(20):
        first, second = rng.uniform([0.0, np.pi], [0.5 * np.pi, 1.5 * np.pi])
        places = (
            (0.0, 0.0),
            (20.0 * np.cos(first), 20.0 * np.sin(first)),
            (22.0 * np.cos(second), 22.0 * np.sin(second)),
        )
        lamps = Lamps.level(places, turns)
        widest_mm = lamps.widest_square_mm()
        assert not overlap(lamps, widest_mm * (1.0 - 1e-6)) and overlap(lamps, widest_mm * (1.0 + 1e-4))
        the_second += Lamps(lamps.lamps[:2]).widest_square_mm() > widest_mm * (1.0 + 1e-9)
    assert 2 < the_second < 18


def test_square_bases_of_a_lattice_have_the_room_of_its_lamps_side_by_side() -> None:
    cell = ((3.0, -2.0), (12.0, 9.0)), (15.0, 70.0)
    shifts = [(20.0 * i, 26.0 * j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    table = Lamps.level([(x + dx, y + dy) for dx, dy in shifts for x, y in cell[0]], cell[1] * 9)
    lattice = Lamps.level(*cell, (20.0, 26.0))
    assert lattice.widest_square_mm() == pytest.approx(table.widest_square_mm(), rel=1e-12)
    assert lattice.nearest_mm() == pytest.approx(table.nearest_mm(), rel=1e-12)


def test_square_bases_of_lamps_on_poles_have_more_room_if_they_turn_away_from_each_other() -> None:
    """Two that are tilted away by t at places d apart meet with their inner edges: at d / cos t."""
    up = 30.0 * np.sqrt(3.0)
    poles = {"kind": "table", "places_mm": [[-15, 0, 0], [15, 0, 0]], "aims_mm": [[-45, 0, up], [45, 0, up]]}
    assert lamps_of(poles).widest_square_mm() == pytest.approx(30.0 / np.cos(np.radians(30.0)))
    above = {"kind": "table", "places_mm": [[0, 0], [0, 0, 40]]}
    assert lamps_of(above).widest_square_mm() > 1e6
