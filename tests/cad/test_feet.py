"""Feet below the base: solid, mesh, section and sizes against closed forms."""

import numpy as np
import pytest
from geometry_lenses import make_lens

from lensforge.cad.body_export import BuiltBody, on_base
from lensforge.cad.form_error import fit_lens
from lensforge.cad.mesh import check_closed
from lensforge.cad.section import body_outlines, other_section_deg
from lensforge.cad.step import parse_step, step_bytes
from lensforge.errors import InputError
from lensforge.shop.dimensions import dimensions
from lensforge.shop.view_lines import end_lines
from lensforge.spec import BaseSection

FEET = {"number": 4, "diameter_mm": 1.5, "height_mm": 0.8, "circle_diameter_mm": 20.0, "first_deg": 30.0}
OWN = 4.0 * np.pi * 0.75**2 * 0.8
BASES = {
    "plain": {"feet": FEET},
    "flange and pocket": {"flange_diameter_mm": 30.0, "pocket_diameter_mm": 14.0, "feet": FEET},
    "square": {"kind": "square", "side_mm": 24.0, "feet": FEET},
}


def built(base: dict) -> BuiltBody:
    lens = make_lens(4.0, 9.0, base=base)
    return on_base(lens.surfaces, fit_lens(lens), lens.spec.base, 16, 0.0)


@pytest.mark.parametrize("name", BASES)
def test_feet_add_their_own_volume_to_one_closed_named_body(name: str) -> None:
    with_feet, without = (built({**BASES[name], **changes}) for changes in ({}, {"feet": None}))
    solid = parse_step(step_bytes(with_feet.solid, "feet"))
    assert solid.valid and solid.genus == 0
    assert solid.default_volume_mm3 - without.solid.default_volume_mm3 == pytest.approx(OWN, rel=1e-3)
    assert set(solid.faces) - set(without.solid.faces) == {
        f"{face}_{number}" for face in ("FOOT_SIDE", "FOOT_END") for number in (1, 2, 3, 4)
    }
    mesh = with_feet.mesh
    closed = check_closed(mesh.vertices, mesh.triangles)
    assert closed.watertight and closed.genus == 0
    assert mesh.volume() - without.mesh.volume() == pytest.approx(OWN, rel=5e-3)
    assert mesh.bounds_mm[0][2] == pytest.approx(-2.8, abs=1e-12)
    ends = mesh.vertices[np.unique(mesh.part("FOOT_END"))]
    assert np.abs(np.hypot(*(ends[:, :2] - _nearest(ends)).T) - 0.75).max() < 1e-12


def _nearest(points: np.ndarray) -> np.ndarray:
    """Axes of the feet that are nearest to points, by their definition."""
    turns = np.radians(30.0 + 90.0 * np.arange(4))
    axes = 10.0 * np.column_stack([np.cos(turns), np.sin(turns)])
    return axes[np.linalg.norm(points[:, None, :2] - axes, axis=2).argmin(axis=1)]


def test_sections_views_and_sizes_show_them() -> None:
    lens = make_lens(4.0, 9.0, base=BASES["plain"])
    assert len(body_outlines(lens, 0.0)) == 1 and other_section_deg(lens) is None, "at 0, 45 and 90 degrees is none"
    _, *feet = body_outlines(lens, 30.0)
    assert sorted(foot[:, 0].min() for foot in feet) == pytest.approx([-10.75, 9.25])
    assert {tuple(np.unique(foot[:, 1].round(9))) for foot in feet} == {(-2.8, -2.0)}
    aside = body_outlines(lens, 32.0)[1][:, 0]
    assert np.ptp(aside) == pytest.approx(2.0 * np.sqrt(0.75**2 - (10.0 * np.sin(np.radians(2.0))) ** 2))
    sizes = {dimension.name: dimension.value_mm for dimension in dimensions(lens)}
    assert (sizes["height of the 4 feet"], sizes["diameter of the 4 feet"]) == (0.8, 1.5)
    assert sizes["circle of the 4 feet"] == 20.0 and sizes["overall length"] == pytest.approx(11.8, abs=1e-3)
    middles = [line.points.mean(axis=0) for line in end_lines(lens) if np.ptp(line.points, axis=0).max() < 1.6]
    turns = np.radians(30.0 + 90.0 * np.arange(4))
    assert np.array(middles) == pytest.approx(10.0 * np.column_stack([np.sin(turns), np.cos(turns)]), abs=0.1)


@pytest.mark.parametrize(
    ("base", "message"),
    [
        ({"feet": {**FEET, "circle_diameter_mm": 2.0}}, "4 feet of diameter_mm = 1.5 overlap .* must be above 2.12"),
        ({"feet": {**FEET, "circle_diameter_mm": 24.0}}, "they reach 25.5 mm across, and must stand within 25.4"),
        ({"kind": "none", "feet": FEET}, "feet go with kind"),
        ({"feet": {**FEET, "number": 0}}, "number"),
    ],
)
def test_feet_that_cannot_stand_are_refused_in_one_line(base: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        BaseSection.model_validate(base)


def test_feet_in_the_opening_are_refused() -> None:
    with pytest.raises(InputError, match=r"circle_diameter_mm = 8: .* opening .* 8 mm wide; at least"):
        built({"feet": {**FEET, "circle_diameter_mm": 8.0}})


def test_a_part_grows_from_its_feet() -> None:
    assert BaseSection.model_validate(BASES["plain"]).seat_mm == pytest.approx(2.8)
