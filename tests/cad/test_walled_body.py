"""The body of a linear lens with walls, its check and its handover: against polygons of its section."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from walled_lenses import section_of, walled_lens

import lensforge as lf
from lensforge.cad.section import body_outlines
from lensforge.cad.wall import thinnest_of
from lensforge.errors import InputError
from lensforge.proof.step_body import StepBody
from lensforge.report.results import Results
from lensforge.shop.drawn_tables import drawn_point_tables
from lensforge.shop.drawn_views import WIDTH, drawn_dimensions
from lensforge.shop.point_tables import GridRequest
from lensforge.shop.profile_table import profiles_of
from lensforge.shop.shop_files import make_handover

LENGTH_MM = 40.0
CAVITY = "cap", "side"
ENVELOPE = "wall", "exit"


@pytest.fixture(scope="module")
def part() -> lf.Part:
    return lf.build(walled_lens())


@pytest.fixture(scope="module")
def check(part: lf.Part) -> lf.Check:
    return lf.check(part.lens)


def area_mm2(points: np.ndarray) -> float:
    x, z = points.T
    return 0.5 * abs(float(np.sum(x * np.roll(z, -1) - z * np.roll(x, -1))))


def corners(points: np.ndarray, least_deg: float = 5.0) -> np.ndarray:
    """Points of a polygon at which it turns at once."""
    ways = np.diff(points, axis=0)
    turned = np.abs(np.diff(np.unwrap(np.arctan2(ways[:, 1], ways[:, 0]))))
    turned = turned[1:] + turned[:-1]  # a corner lies between two points
    corners = np.flatnonzero(turned > np.radians(least_deg))
    return points[corners[np.diff(corners, prepend=-9) > 3] + 2]


def test_the_lens_has_no_symmetry(part: lf.Part) -> None:
    left, right = np.abs(section_of(part.lens, ENVELOPE)[[0, -1], 0])
    assert abs(left - right) > 0.02


def test_its_volume_is_the_area_of_the_section_times_its_length(part: lf.Part) -> None:
    area = area_mm2(section_of(part.lens, ENVELOPE)) - area_mm2(section_of(part.lens, CAVITY))
    assert part.volume_mm3 == pytest.approx(LENGTH_MM * area, rel=1e-6)
    assert part.volume_mesh_mm3 == pytest.approx(part.volume_mm3, rel=1e-4)


def test_each_arc_is_a_surface_of_linear_extrusion(part: lf.Part) -> None:
    assert part.step.count(b"SURFACE_OF_LINEAR_EXTRUSION") == 6
    sides = [f"OPTICAL_{name}_{k}" for name in ("SIDE", "WALL") for k in (1, 2)]
    assert sorted(part.faces.names) == sorted(
        ["END_1", "END_2", "RIM_1", "RIM_2", "OPTICAL_CAP", "OPTICAL_EXIT", *sides]
    )
    assert part.step_valid and part.watertight and part.genus == 0
    assert part.form_error_nm.max < 50.0 and part.normal_error_mrad.max < 0.2
    (x0, _, z0), (x1, _, z1) = StepBody(part.step).size().bounds_mm
    outline = section_of(part.lens, ENVELOPE)
    assert (x0, x1, z0, z1) == pytest.approx((*outline[:, 0][[outline[:, 0].argmin(), outline[:, 0].argmax()]], 0.0,
                                              outline[:, 1].max()), abs=1e-3)  # fmt: skip


def test_its_sections_have_the_creases(part: lf.Part) -> None:
    (across,) = body_outlines(part.lens, 0.0)
    for faces in (CAVITY, ENVELOPE):
        for corner in corners(section_of(part.lens, faces)):
            assert np.linalg.norm(across - corner, axis=1).min() < 3e-3
    assert area_mm2(across) == pytest.approx(part.volume_mm3 / LENGTH_MM, rel=1e-4)


def test_walls_and_edges_of_the_check_are_those_of_the_section(check: lf.Check) -> None:
    cavity, envelope = (section_of(check.lens, faces, 8001) for faces in (CAVITY, ENVELOPE))
    assert check.walls.thinnest.thickness_mm == pytest.approx(cKDTree(envelope).query(cavity)[0].min(), abs=2e-3)
    assert {verdict.place for verdict in check.verdicts if verdict.key == "wire"} == {*CAVITY, *ENVELOPE}
    for points, faces in ((cavity, CAVITY), (envelope, ENVELOPE)):
        length = np.linalg.norm(np.diff(points, axis=0), axis=1)
        middle = np.linalg.norm(points[1:] + points[:-1], axis=1) / 2.0
        nearest = np.array([np.linalg.norm(section_of(check.lens, (name,), 8001), axis=1) for name in faces])
        nearest = 0.5 * (nearest[:, 1:] + nearest[:, :-1])
        for row, name in enumerate(faces):
            mine = np.abs(nearest[row] - middle) < 1e-3
            assert check.faces[name].area_mm2 == pytest.approx(length[mine].sum() * LENGTH_MM, rel=2e-3)


def test_it_is_handed_over_arc_by_arc(part: lf.Part, check: lf.Check) -> None:
    lens = part.lens
    outline = section_of(lens, ENVELOPE)
    sizes = {size.name: size.value_mm for size in drawn_dimensions(lens)}
    assert sizes[WIDTH] == pytest.approx(np.ptp(outline[[0, -1], 0]), abs=1e-4)
    rim = corners(outline)
    assert sizes["crease of wall and exit, along x"] == pytest.approx(np.ptp(rim[:, 0]), abs=2e-3)
    tables = drawn_point_tables(lens, [], GridRequest(spacing_mm=0.5))
    assert [grid.face for grid in tables.grids] == ["side_1", "cap", "side_2", "wall_1", "exit", "wall_2"]
    for grid in tables.grids:
        rows = [line.split(",") for line in grid.content.decode().splitlines() if not re.match("#|x_mm", line)]
        points = np.array(rows, dtype=float)[1:-1, :2]
        assert cKDTree(np.concatenate([outline, section_of(lens, CAVITY)])).query(points)[0].max() < 2e-3
    assert [len(profiles_of(lens, name)) for name in lens.surfaces] == [1, 2, 2, 1]
    results = Results(lens, {"export": part, "check": check})
    page = re.sub(r"<[^>]+>", " ", make_handover(results.part, results.check, []).html.decode())
    assert "Side face, x &lt; 0: x" in page or "Side face, x < 0: x" in page


def test_faces_that_cross_have_no_body() -> None:
    lens = walled_lens()
    low = lens.surfaces["exit"]
    below = type(low)(low.reach_mm, tuple(6.0 * k for k in low.coefficients))
    with pytest.raises(InputError, match=r"^wall = -.*: the faces wall, exit must lie outside of cap, side$"):
        lf.build(lf.Lens({**lens.surfaces, "exit": below}, lens.spec, 0, "draft"))


def test_a_cap_narrower_than_its_band_has_the_wall_of_its_section() -> None:
    """Its spline was extrapolated beside the section: the wall was 2 m short, and the search ended in an error."""
    lens = walled_lens()
    factors = {"cap": 0.35, "side": 1.0}
    raised = {
        name: replace(lens.surfaces[name], coefficients=tuple(factor * np.array(lens.surfaces[name].coefficients)),
                      reach_mm=20.0)
        for name, factor in factors.items()
    }  # fmt: skip
    lens = replace(lens, surfaces={**lens.surfaces, **raised})
    arc = next(arc for arc in lens.body.arcs("cavity") if arc.name == "cap")
    assert max(abs(arc.low_rad), abs(arc.high_rad)) < np.radians(10.0)
    apart = cKDTree(section_of(lens, ENVELOPE)).query(section_of(lens, CAVITY))[0].min()
    assert thinnest_of(lens).thickness_mm == pytest.approx(apart, abs=1e-5)
