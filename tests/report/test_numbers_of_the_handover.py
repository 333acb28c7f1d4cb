"""The handover to the shop: each number on page, PDF and drawing is that of a record; rows of tables lie on a face."""

import numpy as np
import pytest
from handover_places import REQUEST, seen, table_of
from shown_folders import based_on, folder_of
from shown_numbers import problems
from wanted_handover import handover_numbers
from wanted_heads import head_numbers

FOLDERS = ("every stage", "limits missed", "moulded")
_ROOM = {"relief_step_mm": 0.375, "relief_setback_mm": 0.75, "bore_setback_mm": 0.625}
BASES = {
    "none": {"kind": "none"},
    "square": {"kind": "square", "side_mm": 27.5, "height_mm": 2.25, "relief_step_mm": 0.3},
    "square with room": {
        "kind": "square",
        "side_mm": 23.25,
        "pocket_diameter_mm": 13.5,
        "pocket_depth_mm": 0.8,
        **_ROOM,
    },
    "narrow": {"diameter_mm": 17.5, "height_mm": 2.75},
    "cylinder with a flat": {"diameter_mm": 24.5, "flat_mm": 11.75, "flange_diameter_mm": 29.0, **_ROOM},
}


@pytest.fixture(scope="module", params=FOLDERS)
def results(request):
    return folder_of(request.param)


@pytest.fixture(scope="module")
def made(results):
    return seen(results)


def test_every_number_of_page_pdf_and_drawing_is_that_of_a_record(results, made):
    assert "\n".join(problems(made.places, handover_numbers(results, made))) == ""


@pytest.mark.parametrize("base", BASES)
def test_every_number_on_a_base_of_any_shape_is_that_of_the_spec(base):
    results = based_on(BASES[base])
    made = seen(results, dense=False)
    assert "\n".join(problems(made.places, handover_numbers(results, made))) == ""


def test_every_number_on_a_base_of_a_file_is_that_of_its_solid(tmp_path):
    import cadquery as cq

    block = cq.Workplane("XY").rect(26.5, 21.25).circle(6.5).extrude(-2.375)
    cq.exporters.export(block, str(tmp_path / "clamp.step"))
    results = based_on({"kind": "step", "file": str(tmp_path / "clamp.step")})
    made = seen(results, dense=False)
    assert "\n".join(problems(made.places, handover_numbers(results, made))) == ""


def test_every_number_above_a_table_is_that_of_its_record(results, made):
    assert "\n".join(problems(made.heads, head_numbers(results, made))) == ""


def test_every_row_of_a_table_lies_on_its_face(results, made):
    """Places by the surfaces of the lens, as large as they are cut; the departure is the distance from the sphere."""
    shop = results.spec.manufacture
    scale = 1.0 + shop.shrinkage if shop.make == "insert" else 1.0
    for name in ("inner", "outer"):
        face, sphere = getattr(results.lens, name), getattr(results.check, name).best_fit_sphere
        sag = _rows_of(table_of(made.handover.sag_csv), name)
        polar, azimuth = (np.radians(sag[f"{each}_deg"]) for each in ("polar", "azimuth"))
        points = sag["radius_mm"][:, None] * _direction(polar, azimuth)
        _require_on(face, scale, points)
        away = np.linalg.norm(points - np.array(sphere.centre_mm), axis=1)
        np.testing.assert_allclose(sag["departure_mm"], away - sphere.radius_mm, atol=3e-9)
        listed = _rows_of(table_of(made.handover.points_csv), name)
        np.testing.assert_allclose(np.stack([listed[f"{each}_mm"] for each in "xyz"], axis=1), points, atol=3e-9)
        for grid in made.handover.grids:
            if grid.face == name:
                _require_on(face, scale, _points_of(table_of(grid.content)), REQUEST.error_nm)


def _rows_of(table, name):
    at = np.array(table.pop("surface")) == name
    return {column: values[at] for column, values in table.items()}


def _direction(polar, azimuth):
    return np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1)


def _points_of(table):
    """Places of the nodes above the rim; below it the face is continued."""
    if "x_mm" in table:
        points = np.stack([table[f"{each}_mm"] for each in "xyz"], axis=1)
    else:
        turn = np.radians(table["azimuth_deg"])
        points = np.stack([table["r_mm"] * np.cos(turn), table["r_mm"] * np.sin(turn), table["z_mm"]], axis=1)
        np.testing.assert_allclose(np.degrees(np.arctan2(table["r_mm"], table["z_mm"])), table["polar_deg"], atol=1e-6)
    return points[points[:, 2] > 0.0]


def _require_on(face, scale, points, error_nm=0.01):
    radius = np.linalg.norm(points, axis=1)
    assert len(points) > 30
    np.testing.assert_allclose(radius, scale * face.radius(points / radius[:, None]), atol=1e-6 * error_nm)
