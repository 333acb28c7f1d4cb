"""Where a face cannot be made, on spheres off the LED: maps by closed forms, places, and what a finding says."""

from math import asin, degrees

import numpy as np
import pytest
from known_shapes import sphere
from presets import CHECKED
from scenes import small_spec
from shop_lenses import OfSpheres

from lensforge.scene.lens import Lens
from lensforge.shop.check import check_lens
from lensforge.shop.check_measures import FaceFaults
from lensforge.shop.check_result import Check
from lensforge.shop.face_faults import Fault
from lensforge.shop.surface_figures import fault_map

CENTRE_MM = 2.0  # height of the outer face's centre, whose radius is 5 mm
RADIUS_MM = 5.0
WIDE = {"kind": "cylinder", "diameter_mm": 14.0, "height_mm": 2.0}
MILLED = {"process": "milled", "cutter_radius_mm": 0.5}
MOULDED = {"process": "moulded", "shrinkage": 0.02}


def checked(shop: dict[str, object], base: dict[str, object] | None = None) -> Check:
    faces = {"inner": sphere(2.0), "outer": sphere(RADIUS_MM, (0.0, 0.0, CENTRE_MM))}
    lens: Lens = OfSpheres(faces, small_spec(base=base or {"kind": "none"}, manufacture=shop), 0, CHECKED)
    return check_lens(lens)


def faults(check: Check, face: str) -> FaceFaults:
    return next(fault for fault in check.faults if fault.face == face)


def note(check: Check, key: str, face: str) -> str:
    finding = next(verdict for verdict in check.verdicts if (verdict.key, verdict.place) == (key, face))
    return finding.note.replace("\u2009", " ").replace("−", "-")


@pytest.mark.parametrize(("tilt_deg", "fails"), [(10.0, True), (23.0, True), (24.0, False)])
def test_the_map_of_a_milled_dome_is_steep_below_the_height_at_which_the_axis_tilts_no_farther(tilt_deg, fails) -> None:
    """A sphere is undercut by asin((c - z) / R); at its rim, in the plane of the LED, by 23.6 degrees."""
    check = checked({**MILLED, "max_tilt_deg": tilt_deg})
    assert [fault.face for fault in check.faults] == (["outer"] if fails else [])
    if not fails:
        return
    face_map = faults(check, "outer")
    steep_mm = CENTRE_MM - RADIUS_MM * np.sin(np.radians(tilt_deg))
    inside = np.isfinite(face_map.kinds)
    np.testing.assert_array_equal(face_map.kinds[inside] == Fault.STEEP, check.outer.xyz[inside, 2] < steep_mm)
    assert set(np.unique(face_map.kinds[inside])) == {float(Fault.NONE), float(Fault.STEEP)}
    assert degrees(asin(CENTRE_MM / RADIUS_MM)) == pytest.approx(23.58, abs=0.01)
    x, y, z = face_map.places_mm["tilt"]
    assert (np.hypot(x, y), z) == (pytest.approx(np.sqrt(21.0), abs=1e-5), pytest.approx(0.0, abs=1e-5))
    assert note(check, "tilt", "outer").endswith(" mm") and "worst at (" in note(check, "tilt", "outer")


def test_what_neither_half_releases_is_what_lies_below_the_equator_over_a_base_and_places_are_on_the_lens() -> None:
    """The insert is larger than the lens by the shrinkage, its map that of the lens all the same."""
    check = checked(MOULDED, WIDE)
    face_map = faults(check, "outer")
    height_mm = check.outer.xyz[..., 2] / 1.02
    certain = np.abs(height_mm - CENTRE_MM) > 0.03  # of sections 0.02 mm apart, and NaN beside the face
    np.testing.assert_array_equal(face_map.kinds[certain] == Fault.UNDERCUT, height_mm[certain] < CENTRE_MM)
    x, y, z = face_map.places_mm["undercut"]
    assert np.linalg.norm((x, y, z - CENTRE_MM)) == pytest.approx(RADIUS_MM, abs=1e-4)
    assert 0.0 <= z < 0.06, "the steepest undercut is at the rim"
    x, y, z = face_map.places_mm["draft"]
    assert z == pytest.approx(CENTRE_MM, abs=0.1), "what is released has its least draft at the equator"
    assert "28.5 % of the outer face is undercut" in note(check, "undercut", "outer")
    assert f"worst at ({face_map.places_mm['undercut'][0]:.4g}, " in note(check, "undercut", "outer")


def test_the_map_of_the_base_in_the_way_has_the_share_that_the_clearance_states() -> None:
    """The rim leans over the base, 0.3 mm below: a ball of 0.5 mm, normal to the face, enters it below z = 0.364 mm.

    Its centre is at z (R + r) / R - r c / R, and must be 0.2 mm above the plane of the LED.
    """
    check = checked({**MILLED, "max_tilt_deg": 90.0}, {**WIDE, "relief_step_mm": 0.3})
    face_map = faults(check, "outer")
    inside = np.isfinite(face_map.kinds)
    highest_mm = (0.2 + 0.5 * CENTRE_MM / RADIUS_MM) / (1.0 + 0.5 / RADIUS_MM)
    np.testing.assert_array_equal(face_map.kinds[inside] == Fault.BASE, check.outer.xyz[inside, 2] < highest_mm)
    assert face_map.places_mm["relief"][2] == pytest.approx(0.0, abs=1e-5)
    share = highest_mm / (RADIUS_MM + CENTRE_MM)
    assert check.relief.faces["outer"].flush_fraction == pytest.approx(1.0 - share, abs=0.01)
    assert "worst at (" in note(check, "relief", "outer")


def test_a_cavity_tighter_than_the_ball_is_out_of_reach_and_its_ball_is_where_it_is_tightest() -> None:
    check = checked({**MILLED, "cutter_radius_mm": 2.5, "max_tilt_deg": 90.0})
    (face_map,) = check.faults
    assert face_map.face == "inner", "the second of two faces is free"
    inside = np.isfinite(face_map.kinds)
    assert (face_map.kinds[inside] == Fault.TOOL).all()
    assert np.linalg.norm(face_map.places_mm["cutter"]) == pytest.approx(2.0, abs=1e-5)
    assert "worst at (" in note(check, "cutter", "inner")
    assert "worst" not in note(check, "cutter", "outer")


def test_a_study_of_light_has_no_faults_and_a_map_has_a_legend_of_what_it_shows() -> None:
    assert checked({"process": "none"}).faults == ()
    drawn = fault_map(faults(checked(MOULDED, WIDE), "outer").kinds)
    labels = [text.get_text() for text in drawn.axes[0].get_legend().get_texts()]
    assert "undercut" in labels and "base in the way" not in labels
