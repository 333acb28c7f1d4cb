"""Check and handover of a linear lens: figures of its faces, tables of points, and its drawing."""

import csv
import io
import re

import numpy as np
import pytest
import trimesh
from ezdxf import readfile
from scenes import small_spec
from scipy.optimize import minimize_scalar

import lensforge as lf
from lensforge.errors import InputError
from lensforge.light.light_facts import photometry_facts
from lensforge.report.results import Results
from lensforge.results import Fact
from lensforge.shop import point_tables
from lensforge.shop.check import check_lens
from lensforge.shop.check_facts import check_facts
from lensforge.shop.datums import datum_scheme
from lensforge.shop.drawing import drawing_content
from lensforge.shop.drawn_tables import drawn_point_tables
from lensforge.shop.drawn_views import LENGTH, WIDTH, drawn_dimensions
from lensforge.shop.part_models import models_of
from lensforge.shop.point_tables import GridRequest, PointTables, origin_lines
from lensforge.shop.profile_table import profiles_of
from lensforge.shop.sheet_tables import optical_table, tolerance_table
from lensforge.shop.shop_files import make_handover
from lensforge.surfaces.drawn_profile import DrawnFace, round_profile

LENGTH_MM = 137.0
INNER = DrawnFace(12.0, (0.34, 0.33, 0.335, 0.32, 0.33, 0.325, 0.315, 0.33, 0.34))
OUTER = DrawnFace(12.0, (0.16, 0.162, 0.159, 0.158, 0.157, 0.155, 0.157, 0.16, 0.162))
FACES = {"inner": INNER, "outer": OUTER}


def lens_of(inner: DrawnFace, outer: DrawnFace, length_mm: float = LENGTH_MM, **changes: object) -> lf.Lens:
    kind = {"kind": "extruded", "length_mm": length_mm, "profile": 9, "symmetry": "none"}
    spec = small_spec(lens=kind, optimise__steps_per_level=[1], base={"kind": "none"}, **changes)
    return lf.Lens({"inner": inner, "outer": outer}, spec, 0, "draft")


@pytest.fixture(scope="module")
def results() -> Results:
    lens = lens_of(INNER, OUTER)
    part = lf.build(lens)
    return Results(lens, {"export": part, "check": check_lens(part.lens)})


def tables(results: Results, request: GridRequest | None = None) -> PointTables:
    return drawn_point_tables(results.lens, origin_lines(results.lens, results.part), request or GridRequest())


def profile_points(face: DrawnFace, count: int = 20001) -> np.ndarray:
    return face.points(np.linspace(-0.5 * np.pi, 0.5 * np.pi, count))


def table(content: bytes) -> list[dict[str, str]]:
    lines = [line for line in content.decode().splitlines(keepends=True) if not line.startswith("#")]
    return list(csv.DictReader(io.StringIO("".join(lines))))


@pytest.mark.parametrize("name", FACES)
def test_its_area_is_the_length_of_the_profile_times_that_of_the_lens(results: Results, name: str) -> None:
    around = np.linalg.norm(np.diff(profile_points(FACES[name]), axis=0), axis=1).sum()
    assert results.check.faces[name].area_mm2 == pytest.approx(around * LENGTH_MM, rel=1e-6)


def test_the_area_of_an_insert_is_that_of_the_lens_times_its_scale_squared() -> None:
    moulded = lens_of(INNER, OUTER, manufacture={"process": "moulded", "shrinkage": 0.02})
    around = np.linalg.norm(np.diff(profile_points(OUTER), axis=0), axis=1).sum()
    scale = moulded.spec.manufacture.scale
    assert scale == 1.02
    assert check_lens(moulded).faces["outer"].area_mm2 == pytest.approx(around * LENGTH_MM * scale**2, rel=1e-6)


@pytest.mark.parametrize("name", FACES)
def test_its_best_fit_is_the_circle_of_least_squares_about_the_z_axis(results: Results, name: str) -> None:
    points = profile_points(FACES[name])
    lengths = np.linalg.norm(np.gradient(points, axis=0), axis=1)
    shares = lengths / lengths.sum()

    def spread(height: float) -> float:
        away = np.hypot(points[:, 0], points[:, 1] - height)
        return float(shares @ (away - shares @ away) ** 2)

    height = minimize_scalar(spread, bounds=(-5.0, 5.0), method="bounded", options={"xatol": 1e-9}).x
    away = np.hypot(points[:, 0], points[:, 1] - height)
    fit = results.check.faces[name].best_fit_sphere
    assert fit.radius_mm == pytest.approx(shares @ away, abs=1e-4)
    assert fit.centre_mm == pytest.approx((0.0, 0.0, height), abs=1e-4)
    assert fit.rms_mm == pytest.approx(np.sqrt(spread(height)), rel=1e-3)
    assert fit.pv_mm == pytest.approx(np.ptp(away), rel=2e-3)


def test_a_half_pipe_departs_from_no_cylinder() -> None:
    check = check_lens(lens_of(round_profile(3.0, 7.0, 9), round_profile(6.0, 7.0, 9)))
    for name, radius_mm in (("inner", 3.0), ("outer", 6.0)):
        assert check.faces[name].best_fit_sphere.radius_mm == pytest.approx(radius_mm, abs=1e-6)
        assert check.faces[name].best_fit_sphere.pv_mm < 1e-5
    groups = {group.key: group for group in check_facts(check)}
    mark = groups["orientation"].fact("azimuth_mark")
    assert (mark.value, mark.notice) == ("length", ""), "no base holds a flat that would mark it"
    assert groups["outer"].fact("outer_sphere").note == "radius, of a cylinder along y"


@pytest.mark.parametrize("name", FACES)
def test_places_to_measure_lie_on_the_face_with_its_normal_all_along_the_part(results: Results, name: str) -> None:
    rows = [row for row in table(tables(results).measured) if row["surface"] == name]
    x, y, z, nx, ny, nz, angle = (np.array([float(row[key]) for row in rows]) for key in list(rows[0])[1:])
    assert set(y.tolist()) == {share * LENGTH_MM for share in (-0.45, -0.225, 0.0, 0.225, 0.45)}
    assert np.column_stack([x, z]) == pytest.approx(FACES[name].points(np.radians(angle)), abs=2e-9)
    dense = profile_points(FACES[name])
    tangents = np.gradient(dense, axis=0)
    at = np.argmin(np.abs(np.linspace(-90.0, 90.0, len(dense))[:, None] - angle), axis=0)
    along = tangents[at] / np.linalg.norm(tangents[at], axis=1, keepdims=True)
    air = 1.0 if name == "outer" else -1.0
    assert np.column_stack([nx, nz]) == pytest.approx(air * np.column_stack([-along[:, 1], along[:, 0]]), abs=2e-4)
    assert not ny.any()


def test_places_to_measure_of_an_insert_are_those_of_the_lens_times_its_scale(results: Results) -> None:
    moulded = lens_of(INNER, OUTER, manufacture={"process": "moulded", "shrinkage": 0.02})
    of_insert = drawn_point_tables(moulded, [], GridRequest()).measured
    of_lens = tables(results).measured
    for insert_row, lens_row in zip(table(of_insert), table(of_lens), strict=True):
        for key in ("x_mm", "y_mm", "z_mm"):
            assert float(insert_row[key]) == pytest.approx(1.02 * float(lens_row[key]), abs=1e-8)
        assert float(insert_row["nz"]) == pytest.approx(-float(lens_row["nz"]), abs=1e-8), "the insert is the air"


@pytest.mark.parametrize("interpolation", ["bicubic", "linear"])
@pytest.mark.parametrize("name", FACES)
def test_a_dense_profile_is_interpolated_within_the_error_that_it_states(
    results: Results, name: str, interpolation: str
) -> None:
    """By the polynomial through 4 or 2 nodes at places that no table has."""
    request = GridRequest(error_nm=25.0, interpolation=interpolation)
    grid = next(grid for grid in tables(results, request).grids if grid.face == name)
    rows = table(grid.content)
    angles, x, z = (np.array([float(row[key]) for row in rows]) for key in ("angle_deg", "x_mm", "z_mm"))
    assert grid.points == len(rows) and 1.0 < grid.error_nm <= 25.0
    beyond = 1 if interpolation == "bicubic" else 0
    assert angles[beyond] == pytest.approx(-90.0) and angles[-1 - beyond] == pytest.approx(90.0)
    between = np.random.default_rng(3).uniform(-90.0, 90.0, 4000)
    first = np.clip(np.searchsorted(angles, between) - 1 - beyond, 0, len(angles) - 2 - 2 * beyond)
    nodes = first[:, None] + np.arange(2 + 2 * beyond)
    weights = np.ones(nodes.shape)
    for k in range(nodes.shape[1]):
        for j in range(nodes.shape[1]):
            if j != k:
                weights[:, k] *= (between - angles[nodes[:, j]]) / (angles[nodes[:, k]] - angles[nodes[:, j]])
    made = np.column_stack([np.sum(weights * values[nodes], axis=1) for values in (x, z)])
    exact = FACES[name].points(np.radians(between))
    off_nm = 1e6 * np.linalg.norm(made - exact, axis=1)
    assert 0.5 * grid.error_nm < off_nm.max() < 1.3 * grid.error_nm, "in all directions, at other places"


def test_a_stated_spacing_is_kept_by_the_widest_cell(results: Results) -> None:
    for grid in tables(results, GridRequest(spacing_mm=0.17)).grids:
        rows = table(grid.content)[1:-1]
        places = np.array([[float(row["x_mm"]), float(row["z_mm"])] for row in rows])
        widest = np.linalg.norm(np.diff(places, axis=0), axis=1).max()
        assert widest <= 0.17 and grid.spacing_mm == pytest.approx(widest, abs=1e-8)


def test_too_many_nodes_are_refused_by_the_profile_that_needs_them(results: Results, monkeypatch) -> None:
    """Around the inner one it is 9.7 mm, around the outer one 20."""
    monkeypatch.setattr(point_tables, "MOST_POINTS", 500)
    with pytest.raises(InputError, match=r"^spacing = 0.03 mm: the table of the outer face would have 6"):
        tables(results, GridRequest(spacing_mm=0.03))
    with pytest.raises(
        InputError, match=r"^error = 0.01 nm: .* at most 500; give a larger error, or bicubic interpolation$"
    ):
        tables(results, GridRequest(error_nm=0.01, interpolation="linear"))


def test_its_sizes_are_those_of_the_profiles(results: Results) -> None:
    sizes = {size.name: size for size in drawn_dimensions(results.lens)}
    inner, outer = (profile_points(face) for face in (INNER, OUTER))
    apex = {face: 1.0 / FACES[face].value(np.array([[0.0, 0.0, 1.0]]))[0] for face in FACES}
    expected = {
        "outer apex above z = 0": apex["outer"],
        "apex of the cavity above z = 0": apex["inner"],
        "thickness on the axis": apex["outer"] - apex["inner"],
        "overall height": outer[:, 1].max(),
        WIDTH: np.ptp(outer[[0, -1], 0]),
        "opening of the cavity in z = 0, along x": np.ptp(inner[[0, -1], 0]),
        "largest width, along x": np.ptp(outer[:, 0]),
        LENGTH: LENGTH_MM,
    }
    assert {name: size.value_mm for name, size in sizes.items()} == pytest.approx(expected, abs=1e-4)
    assert sizes[LENGTH].tolerance == "general" and sizes[WIDTH].tolerance == "auxiliary"


def test_a_drawing_has_the_length_three_datums_and_both_profiles(results: Results, tmp_path) -> None:
    made = make_handover(results.part, results.check, [])
    datums = datum_scheme(results.lens, results.part)
    assert [(datum.letter, datum.dimension, datum.z_mm) for datum in datums.datums] == [
        ("A", "", 0.0), ("B", WIDTH, None), ("C", LENGTH, None),
    ]  # fmt: skip
    (tmp_path / "drawing.dxf").write_bytes(made.dxf)
    drawn = readfile(tmp_path / "drawing.dxf").modelspace().query("DIMENSION")
    lengths = [size.get_measurement() * size.override().get("dimlfac", 1.0) for size in drawn]
    assert sum(abs(length_mm - LENGTH_MM) < 1e-6 for length_mm in lengths) == 1, "interrupted, and its true length"
    page = re.sub(r"<[^>]+>", " ", made.html.decode())
    for text in ("Datum A: plane z = 0", "Datum B: middle plane of the feet", "Datum C: middle plane of the ends"):
        assert text in page
    for name, face in FACES.items():
        profile = profiles_of(results.lens, name)[0]
        angles = np.arctan2(*profile.places_mm.T)
        assert profile.places_mm == pytest.approx(face.points(angles), abs=1e-4)
        assert angles[[0, -1]] == pytest.approx([-0.5 * np.pi, 0.5 * np.pi], abs=1e-4)
        assert f"{profile.places_mm[3, 0]:.4f}" in page
        assert profile.rows[0][0] == f"{name.capitalize()} face: x" and profile.rows[1][0].startswith("z; spline")
    across = {name: np.ptp(profile_points(face)[:, 0]) for name, face in FACES.items()}
    columns = optical_table(results.lens, results.part, results.check, results.lens.spec.drawing).columns
    apertures = [column["aperture"] for column in columns.values() if "aperture" in column]
    assert apertures == [
        f"Effective aperture: {across[name]:.3f} × {LENGTH_MM:.3f}, whole face" for name in ("outer", "inner")
    ]


def test_a_short_part_is_drawn_whole() -> None:
    lens = lens_of(INNER, OUTER, length_mm=30.0)
    part = lf.build(lens)
    tolerances = tolerance_table(lens)
    content = drawing_content(lens, part, check_lens(lens), drawn_dimensions(lens), tolerances, lens.spec.drawing)
    assert content.views.base_box[0] == -15.0 and content.views.base_box[2] == 15.0
    whole = [line for line in content.views.base if np.ptp(line.points[:, 0]) == 30.0]
    across = sorted(line.points[0, 1] for line in whole)
    feet = sorted(float(x) for face in (INNER, OUTER) for x in profile_points(face)[[0, -1], 0])
    widest = profile_points(OUTER)[:, 0]
    assert across == pytest.approx(sorted([*feet, widest.min(), widest.max()]), abs=1e-4)
    assert not any(line.pen == "thin" for line in content.views.base)


def finding(check: lf.Check, name: str, place: str) -> Fact:
    return next(verdict for verdict in check.verdicts if (verdict.key, verdict.place) == (name, place))


def test_a_die_is_cut_by_a_wire_that_fits_all_convex_places(results: Results) -> None:
    """Of the outer profile by its curvature in differences; the inner one is hollow everywhere."""
    points = profile_points(OUTER)
    x, z = points.T
    dx, dz = np.gradient(x), np.gradient(z)
    curvature = (np.gradient(dx) * dz - dx * np.gradient(dz)) / np.hypot(dx, dz) ** 3
    tightest_mm = 1.0 / np.abs(curvature[5:-5]).max()
    advised_mm = [0.999 * tightest_mm]
    for factor, holds in ((None, True), (1.001, False), (1.4, False), (None, True)):
        radius_mm = advised_mm[-1] if factor is None else factor * tightest_mm
        wire = {"manufacture.wire_radius_mm": radius_mm}
        check = check_lens(lf.Lens(FACES, results.lens.spec.replace(wire), 0, "draft"))
        judged = finding(check, "wire", "outer")
        assert judged.holds == holds and judged.limit == pytest.approx(tightest_mm, rel=2e-4)
        if not holds:
            advised_mm.append(float(judged.remedy.removeprefix("manufacture.wire_radius_mm = ")))
            assert advised_mm[-1] == pytest.approx(tightest_mm, rel=0.01)
        assert finding(check, "wire", "inner").holds and finding(check, "wire", "inner").limit is None
        assert [verdict for verdict in check.verdicts if verdict.key in ("cutter", "tilt", "relief", "even")] == []


def test_walls_are_as_even_as_the_spec_asks_where_it_does(results: Results) -> None:
    walls = results.check.walls
    ratio = walls.thickest.thickness_mm / walls.thinnest.thickness_mm
    assert ratio > 1.01
    for factor, holds in ((1.001, True), (0.97, False)):
        spec = results.lens.spec.replace({"manufacture.most_wall_ratio": factor * ratio})
        judged = finding(check_lens(lf.Lens(FACES, spec, 0, "draft")), "even", "body")
        assert judged.holds == holds and judged.value == pytest.approx(ratio)
        advised = [float(number) for number in re.findall(r"manufacture\.most_wall_ratio = ([0-9.]+)", judged.remedy)]
        assert len(advised) == (not holds) and all(ratio <= number < 1.05 * ratio for number in advised)


def test_flux_per_metre_is_that_of_the_lens_over_its_length(results: Results) -> None:
    light = lf.photometry(results.lens, rays=2**10)
    facts = {fact.key: fact for group in photometry_facts(light, results.lens.spec) for fact in group.facts}
    assert facts["exit_lm_per_m"].value == pytest.approx(light.exit_lm.value / 0.137)
    assert facts["exit_lm_per_m"].standard_error == pytest.approx(light.exit_lm.standard_error / 0.137)
    assert facts["exit_lm_per_m"].unit == "lm/m"


def test_one_lens_stands_over_a_whole_row_of_lamps(results: Results) -> None:
    kind = {"kind": "extruded", "length_mm": 60.0, "profile": 9, "ends": "free"}
    for columns, models in ((1, ["lens.glb"]), (2, ["lens.glb", "lamps.glb"])):
        lamps = {"kind": "grid", "columns": columns, "rows": 5, "pitch_mm": [30.0, 12.0]}
        spec = small_spec(lens=kind, optimise__steps_per_level=[1], base={"kind": "none"}, lamps=lamps)
        part = results.part.changed(lens=lf.Lens(FACES, spec, 0, "draft"))
        made = dict(models_of(part, 0))
        assert list(made) == models
    bodies = trimesh.load_scene(io.BytesIO(made["lamps.glb"]), file_type="glb").dump()
    left_mm = [1e3 * float(body.bounds[0, 0]) for body in bodies]
    half = len(bodies) // 2
    assert np.subtract(sorted(left_mm)[half:], sorted(left_mm)[:half]) == pytest.approx(30.0, abs=1e-3)
