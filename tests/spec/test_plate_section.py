"""The plate of a spec: its size, its lenses, and what is refused."""

from typing import Any

import numpy as np
import pytest
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.spec import Spec

GRID = {"kind": "grid", "columns": 3, "rows": 2, "pitch_mm": [20.0, 30.0]}
ENDLESS = {"kind": "endless", "pitch_mm": 200.0}
MIDDLE = {"place_mm": [10.0, 0.0], "diameter_mm": 4.0}
BOSS = {**MIDDLE, "height_mm": 3.0, "bore_diameter_mm": 2.0, "bore_depth_mm": 4.0}
GATE = {"place_mm": [29.0, 0.0], "width_mm": 6.0}


def plated(plate: dict[str, Any], lamps: dict[str, Any] | None = None) -> Spec:
    changes = {} if lamps is None else {"lamps": lamps}
    return small_spec(plate={"thickness_mm": 2.0, **plate}, **changes)


def size(spec: Spec) -> tuple[float, float]:
    assert spec.plate is not None
    return spec.plate.size_mm(spec.plate.lenses(spec.lamps), spec.constraints.max_radius_mm)


def test_left_out_a_size_follows_from_the_lenses() -> None:
    assert size(plated({}, GRID)) == (2.0 * (20.0 + 7.0 + 2.0), 2.0 * (15.0 + 7.0 + 2.0))
    assert size(plated({"margin_mm": 0.0}, GRID)) == (54.0, 44.0)
    assert size(plated({"kind": "round"}, GRID)) == (2.0 * (25.0 + 9.0),) * 2
    assert size(plated({})) == (18.0, 18.0)


def test_the_plate_takes_the_place_of_the_bases() -> None:
    close = {**GRID, "pitch_mm": 15.0}  # the bases of 16 mm would overlap
    with pytest.raises(InputError, match=r"their rims of base\.kind"):
        small_spec(lamps=close)
    assert plated({}, close).plate is not None


def test_a_plate_of_a_lattice_has_its_rows_and_columns() -> None:
    spec = plated({"columns": 3, "rows": 2}, ENDLESS)
    assert spec.plate is not None
    places = spec.plate.lenses(spec.lamps).places_mm
    assert sorted(places) == [(x, y) for x in (-200.0, 0.0, 200.0) for y in (-100.0, 100.0)]
    staggered = small_spec(
        plate={"thickness_mm": 2.0, "columns": 4, "rows": 5},
        lamps={"kind": "endless", "lattice": "hexagon", "pitch_mm": 100.0},
        target=None,
        receivers=[
            {
                "kind": "plane",
                "centre_mm": [0.0, 0.0, 30.0],
                "width_mm": 100.0,
                "height_mm": 100.0 * 3.0**0.5,
                "targets": [{"kind": "disc", "diameter_mm": 9.0}],
            }
        ],
    )
    assert staggered.plate is not None
    found = np.array(staggered.plate.lenses(staggered.lamps).places_mm)
    away = np.sort(np.linalg.norm(found[:, None] - found, axis=2), axis=1)
    assert len(found) == 20
    np.testing.assert_allclose(found.mean(axis=0), [-5.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(away[:, 1:3], 100.0)
    assert (np.isclose(away, 100.0).sum(axis=1) == 6).any(), "a lens inside has six neighbours"


def test_a_plate_is_read_as_it_was_written(tmp_path: Any) -> None:
    pin = {"place_mm": [0.0, 0.0], "diameter_mm": 2.0, "height_mm": 1.0}
    boss = {**BOSS, "place_mm": [-10.0, 0.0]}
    spec = plated({"corner_radius_mm": 3.0, "holes": [MIDDLE], "pins": [pin], "bosses": [boss], "gate": GATE}, GRID)
    spec.save(tmp_path / "plate.toml")
    assert Spec.model_validate({**spec.model_dump(exclude_unset=True)}).plate == spec.plate
    assert "[plate]" in (tmp_path / "plate.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("plate", "lamps", "words"),
    [
        ({}, ENDLESS, "plate.columns and plate.rows: a lattice without an end needs them; give both"),
        ({"columns": 3, "rows": 3}, GRID, 'they go with lamps of kind = "endless"; leave them out'),
        ({"columns": 3}, ENDLESS, "columns and rows go together"),
        ({"columns": 30, "rows": 30}, ENDLESS, "plate: 900 lenses, at most 400"),
        ({}, {**GRID, "pitch_mm": 13.0}, "13 mm apart, lenses of constraints.max_radius_mm = 7 overlap"),
        ({"width_mm": 50.0, "height_mm": 44.0}, GRID, r"50 x 44: smaller than its lenses, .* 2 mm outside; .* add 4$"),
        ({"kind": "round", "diameter_mm": 60.0}, GRID, "plate.diameter_mm = 60: smaller than its lenses, .* 2 mm outs"),
        ({"margin_mm": 0.0, "corner_radius_mm": 12.0}, GRID, "54 x 44: smaller than its lenses, .* 2.071 mm outside"),
        ({"corner_radius_mm": 25.0}, GRID, "plate.corner_radius_mm = 25: at most 24"),
        ({"kind": "round", "corner_radius_mm": 1.0}, GRID, 'corner_radius_mm = 1 does not go with kind = "round"'),
        ({"diameter_mm": 90.0}, GRID, 'diameter_mm = 90 does not go with kind = "rectangle"'),
        ({"width_mm": 90.0}, GRID, "width_mm and height_mm go together"),
        ({"width_mm": 90.0, "height_mm": 90.0, "margin_mm": 2.0}, GRID, "margin_mm = 2: the size says where"),
        ({"holes": [{**MIDDLE, "place_mm": [28.0, 0.0]}]}, GRID, r"holes.0: .* at \(28, 0\) mm crosses the edge"),
        ({"holes": [{**MIDDLE, "place_mm": [14.0, 12.0]}]}, GRID, r"holes.0: .* a lens of 7 mm .*, 6.708 mm away"),
        ({"pins": [{**MIDDLE, "height_mm": 1.0, "place_mm": [20, 12]}]}, GRID, "pins.0: .* meets a cavity of .* 3 mm"),
        ({"holes": [MIDDLE, {**MIDDLE, "place_mm": [12.0, 0.0]}]}, GRID, "holes.1: .* meets plate.holes.0; move one"),
        ({"thickness_mm": 0.0}, GRID, "plate.thickness_mm = 0"),
        ({"bosses": [{**BOSS, "bore_diameter_mm": 4.0}]}, GRID, "bore_diameter_mm = 4: must be below diameter_mm = 4"),
        ({"bosses": [{**BOSS, "bore_depth_mm": 5.0}]}, GRID, "bore_depth_mm = 5: goes through the plate; .* 5,"),
        ({"bosses": [{**BOSS, "place_mm": [20.0, 8.0]}]}, GRID, "bosses.0: .* meets a lens of 7 mm radius, 7 mm away"),
        ({"gate": {"place_mm": [25.0, 0.0], "width_mm": 6.0}}, GRID, r"place_mm = \(25, 0\): 4 mm inside the outline"),
        ({"gate": {"place_mm": [29.0, 14.0], "width_mm": 6.0}}, GRID, "gate: 2.055 mm from a lens, but clear_mm = 3;"),
        ({"gate": GATE, "holes": [{**MIDDLE, "place_mm": [25, 0]}]}, GRID, "gate: 2 mm from plate.holes.0, but"),
    ],
)  # fmt: skip
def test_a_plate_that_cannot_be_is_refused_in_one_line(
    plate: dict[str, Any], lamps: dict[str, Any], words: str
) -> None:
    with pytest.raises(InputError, match=words) as caught:
        plated(plate, lamps)
    assert "\n" not in str(caught.value)
