"""The turning tool by closed forms, against a tool sampled by rays, and on lenses that are turned or printed."""

from dataclasses import replace

import numpy as np
import pytest
from known_shapes import OfRadius, exported, sphere
from presets import CHECKED, FEW
from scenes import random_surface, small_spec
from shop_lenses import OfSpheres
from tir_lenses import TIR, spot

from lensforge.scene.lens import Lens
from lensforge.shop.check import check_lens
from lensforge.shop.check_facts import check_facts
from lensforge.shop.check_measures import TurningTool
from lensforge.shop.check_result import Check
from lensforge.shop.face_check import measured_face
from lensforge.shop.face_samples import AirSide
from lensforge.shop.turning import LatheTool, Meridian, turned_face
from lensforge.shop.turning_findings import MOST_CORNER, _corner, layer_findings, turning_findings
from lensforge.surfaces.asphere import Asphere
from lensforge.surfaces.surface import Surface

NOTHING = np.empty((0, 2))
WIDE = 1e3  # mm: of a tool without a shank of its own


def tool(radius_mm: float, flank_deg: float, most_tilt_deg: float = 90.0, width_mm: float = WIDE) -> LatheTool:
    return LatheTool(radius_mm, width_mm, *np.deg2rad([flank_deg, most_tilt_deg]).tolist())


def turned(surface: Surface, air: AirSide, lathe: LatheTool, fixture: np.ndarray = NOTHING):
    return turned_face(measured_face(exported(surface, air), 41), lathe, fixture).tool


@pytest.mark.parametrize(("flank_deg", "whole"), [(22.0, True), (23.5, False)])
def test_a_hemisphere_is_bored_by_a_tool_of_45_degrees(flank_deg: float, whole: bool) -> None:
    """At its rim the axis leans over by the flank, and at its apex the other flank meets the far rim at 45 degrees."""
    cutter = turned(sphere(3.0), AirSide.INSIDE, tool(1e-3, flank_deg))
    assert cutter.largest_radius_mm == pytest.approx(3.0, rel=1e-5)
    assert cutter.slope_deg == pytest.approx(45.0, abs=1e-4)
    assert (cutter.reachable_fraction == 1.0) == whole and cutter.corner_fraction == 0.0
    assert cutter.residual_mm == 0.0 or not whole


@pytest.mark.parametrize(("most_tilt_deg", "share"), [(90.0, 1.0), (0.0, 1.0 - np.cos(np.deg2rad(60.0)))])
def test_a_dome_is_turned_down_to_the_slope_of_the_flank(most_tilt_deg: float, share: float) -> None:
    cutter = turned(sphere(3.0), AirSide.OUTSIDE, tool(0.1, 30.0, most_tilt_deg))
    assert cutter.reachable_fraction == pytest.approx(share, abs=5e-3) and cutter.largest_radius_mm is None
    assert cutter.slope_deg == pytest.approx(45.0 if most_tilt_deg else 90.0, abs=1e-4)


@pytest.mark.parametrize(("radius_mm", "share"), [(1.98, 1.0), (2.02, 0.0)])
def test_a_nose_fits_a_sphere_of_a_larger_radius(radius_mm: float, share: float) -> None:
    """The cavity is shallow, a cap of 30 degrees: a tool of no flank leaves it everywhere."""
    surface = sphere(2.0, (0.0, 0.0, -1.0 + 1e-9))
    cutter = turned(surface, AirSide.INSIDE, tool(radius_mm, 0.0))
    assert cutter.largest_radius_mm == pytest.approx(2.0, rel=1e-5)
    assert cutter.reachable_fraction == share


def line(
    start: tuple[float, float], end: tuple[float, float], normal: tuple[float, float], count: int = 801
) -> Meridian:
    """The meridian of a cone or a plane."""
    points = np.linspace(start, end, count)
    areas = np.gradient(points[:, 0]) if start[0] != end[0] else np.ones(count)
    normals = np.tile(normal, (count, 1))
    return Meridian(np.linspace(0.0, 1.0, count), points, normals, np.abs(points[:, 0] * areas), np.zeros(count))


@pytest.mark.parametrize(("draft_deg", "clear"), [(14.9, False), (15.1, True)])
def test_a_cone_is_turned_where_its_draft_is_that_of_the_flank(draft_deg: float, clear: bool) -> None:
    """A wide cone, bored along its axis from below: the flank has 15 degrees with its clearance."""
    slope = np.deg2rad(draft_deg)
    cone = line((20.0, 5.0), (20.0 + 5.0 * np.tan(slope), 0.0), (-np.cos(slope), -np.sin(slope)))
    reached = tool(0.1, 15.0).is_clear(cone, -1.0, 0.0, cone.points)
    assert reached[:-1].all() if clear else not reached[:-10].any()


@pytest.mark.parametrize("radius_mm", [0.05, 0.2])
def test_a_nose_leaves_its_fillet_in_a_corner(radius_mm: float) -> None:
    """A disc that ends at a cylinder: the nose stops a radius before it."""
    disc = line((0.0, 4.0), (2.0, 4.0), (0.0, -1.0))
    wall = line((2.0, 4.0), (2.0, 0.0), (-1.0, 0.0), 4001)
    corner = tool(radius_mm, 10.0).nose_enters(disc, wall.points)
    np.testing.assert_array_equal(corner, disc.points[:, 0] > 2.0 - radius_mm + 1e-3)
    assert not tool(radius_mm, 10.0).nose_enters(disc, NOTHING).any()


@pytest.mark.parametrize(("width_mm", "whole"), [(1.7, True), (2.3, False)])
def test_a_shank_must_have_room_beside_the_axis(width_mm: float, whole: bool) -> None:
    """In a bore of 2 mm, the shank beside a nose that is at the axis."""
    disc = line((0.0, 4.0), (2.0, 4.0), (0.0, -1.0))
    wall = line((2.0, 4.0), (2.0, 0.0), (-1.0, 0.0), 4001)
    both = np.concatenate([wall.points, wall.points * (-1.0, 1.0)])
    reached = tool(0.01, 40.0, width_mm=width_mm).is_clear(disc, -1.0, np.deg2rad(-40.0), both)
    inside = disc.points[:, 0] < 2.0 - 0.01
    assert (reached[inside].all() if whole else not reached[0]) and reached[len(reached) // 2]


def by_rays(face: Meridian, lathe: LatheTool, axis: np.ndarray, obstacles: np.ndarray, k: int) -> bool:
    """True where no obstacle is in the tool at contact ``k``: a fan of rays from the nose, each as thick as it."""
    centre = face.points[k] + lathe.radius_mm * face.normals[k]
    turn = np.linspace(-1.0, 1.0, 2001) * lathe.flank_rad
    rays = np.stack(
        [np.cos(turn) * axis[0] - np.sin(turn) * axis[1], np.sin(turn) * axis[0] + np.cos(turn) * axis[1]], 1
    )
    away = obstacles - centre
    along = np.maximum(away @ rays.T, 0.0).max(axis=1)  # the nearest ray is the one along which an obstacle is farthest
    return bool((np.sum(away**2, axis=1) - along**2 >= (lathe.radius_mm - 1e-4) ** 2).all())


def test_a_crooked_profile_is_reached_where_no_ray_of_the_tool_is_in_the_way() -> None:
    rng = np.random.default_rng(3)
    lathe = tool(0.15, 25.0)
    r = np.linspace(0.0, 4.0, 161)
    z = 5.0 + sum(
        a * np.cos(k * r + p) for k, a, p in zip((1, 2, 5), (0.8, 0.5, 0.3), rng.uniform(0, 6, 3), strict=True)
    )
    slope = np.gradient(z, r)
    normals = np.column_stack([-slope, np.ones_like(r)]) / np.hypot(slope, 1.0)[:, None]
    face = Meridian(r, np.column_stack([r, z]), normals, r, np.zeros_like(r))
    both = np.concatenate([face.points, face.points * (-1.0, 1.0)])
    for tilt in np.deg2rad([-30.0, 0.0, 20.0]):
        reached = lathe.is_clear(face, 1.0, tilt, both) & ~lathe.nose_enters(face, both)
        axis = np.array([np.sin(tilt), np.cos(tilt)])
        wanted = [by_rays(face, lathe, axis, both, k) for k in range(161)]
        assert 10 < sum(wanted) < 161 and np.count_nonzero(reached != wanted) <= 3, "but where a flank just touches"


def test_tilts_that_are_tried_have_the_nose_on_all_normals() -> None:
    """Normals from -20 to 40 degrees, a flank of 30: the axis is within 60 of each, from -20 to 40."""
    slopes = np.deg2rad([10.0, 40.0, -20.0])
    first, *even = np.degrees(tool(0.1, 30.0).tilts_rad(slopes))
    assert first == pytest.approx(10.0)
    np.testing.assert_allclose(sorted(even), np.linspace(-20.0, 40.0, 13), atol=1e-9)
    assert np.degrees(tool(0.1, 30.0, 25.0).tilts_rad(slopes)).max() == pytest.approx(25.0)


def test_the_rings_of_a_meridian_add_up_to_the_face() -> None:
    """A sphere of 3 mm about a centre at 1 mm: above z = 0 it has 2 pi R (R + c)."""
    meridian = Meridian.of(exported(sphere(3.0, (0.0, 0.0, 1.0)), AirSide.OUTSIDE), 481)
    assert meridian.areas.sum() == pytest.approx(24.0 * np.pi, rel=1e-5)


def test_the_hollows_of_the_meridian_count_alone() -> None:
    """A dome with a ring of a hollow, rho = 4 + 0.25 cos(6 polar angle)."""
    grooved = OfRadius(lambda u: 4.0 + 0.25 * np.cos(6.0 * np.arccos(np.clip(u[:, 2], -1.0, 1.0))))
    polar = np.linspace(0.0, np.pi / 2.0, 200_001)
    rho = 4.0 + 0.25 * np.cos(6.0 * polar)
    first = -1.5 * np.sin(6.0 * polar)
    second = -9.0 * np.cos(6.0 * polar)
    kappa = (rho**2 + 2.0 * first**2 - rho * second) / (rho**2 + first**2) ** 1.5
    face = turned_face(measured_face(exported(grooved, AirSide.OUTSIDE), 41), tool(0.1, 20.0), NOTHING)
    assert face.tool.largest_radius_mm == pytest.approx(-1.0 / kappa.min(), rel=2e-4)
    tightest = polar[kappa.argmin()]
    place = rho[kappa.argmin()] * np.array([np.sin(tightest), 0.0, np.cos(tightest)])
    np.testing.assert_allclose(face.worst_places()["nose"], place, atol=0.02)


def test_what_stands_around_the_work_is_in_the_way_and_is_told_apart() -> None:
    """A disc in z = 0 of 6 mm around a dome of 3 mm: a nose of 0.5 mm ends where its centre is so high above it."""
    ring = np.column_stack([np.linspace(3.0, 6.0, 3001), np.zeros(3001)])
    cutter = turned(sphere(3.0), AirSide.OUTSIDE, tool(0.5, 10.0), ring)
    assert cutter.bare_fraction == 1.0
    assert cutter.reachable_fraction == pytest.approx(1.0 - 0.5 / 3.5, abs=5e-3), "a zone's area is its height"


CAVITY = ((2.0, -0.5), (1.8, 0.0))
WALL = (12.0, 6.0)
EXIT = (40.0, -35.0)


def of_spheres(**sections: object) -> Lens:
    shapes = zip(TIR, (*CAVITY, WALL, EXIT), strict=True)
    faces = {name: sphere(radius, (0.0, 0.0, height)) for name, (radius, height) in shapes}
    return OfSpheres(faces, spot().replace({"base": {"kind": "none"}, **sections}), 0, CHECKED)


def test_inserts_of_a_lens_of_revolution_are_turned_each_half_by_itself() -> None:
    """The core is convex, and the bowl of the wall is not under the lid of the exit's insert."""
    lens = of_spheres(manufacture={"process": "moulded"})
    check = check_lens(lens, dict.fromkeys(TIR, 81))
    for name, radius in zip(TIR, (None, None, 12.0, 40.0), strict=True):
        cutter = check.faces[name].cutter
        assert cutter.largest_radius_mm == (None if radius is None else pytest.approx(radius, rel=1e-4))
        assert (cutter.reachable_fraction, cutter.corner_fraction) == (1.0, 0.0), name
    assert {verdict.key for verdict in check.verdicts} == {"nose", "slope", "turning", "wall", "draft", "undercut"}
    assert all(verdict.holds for verdict in check.verdicts if verdict.key in ("nose", "slope", "turning"))


def note_on_edge(check: Check, process: str) -> str:
    spec = spot().replace({"manufacture.process": process})
    made = check.model_copy(update={"lens": replace(check.lens, spec=spec)})
    (edge,) = (group for group in check_facts(made) if group.key == "edges")
    return next(fact.note for fact in edge.facts if fact.label.startswith("Cap"))


@pytest.mark.parametrize(("radius_mm", "largest"), [(9_900.0, pytest.approx(9_900.0, rel=1e-5)), (10_100.0, None)])
def test_a_hollow_that_is_as_good_as_straight_limits_no_nose(radius_mm: float, largest: float | None) -> None:
    assert turned(sphere(radius_mm), AirSide.INSIDE, tool(1e-3, 20.0)).largest_radius_mm == largest


def test_a_lens_that_is_turned_says_what_its_nose_leaves() -> None:
    """Cap and side meet at 3.9 degrees less than 180: the fillet is that of a nose in so blunt a corner."""
    check = check_lens(of_spheres(manufacture={"nose_radius_mm": 0.5}), dict.fromkeys(TIR, 81))
    findings = {(verdict.key, verdict.place): verdict for verdict in check.verdicts}
    assert ("tilt", "cap") not in findings and ("cutter", "cap") not in findings
    assert not check.relief.faces and check.relief.note == "no face is milled"
    assert findings["nose", "cap"].limit == pytest.approx(2.0, rel=1e-4) and findings["nose", "cap"].holds
    facts = {fact.key: fact for group in check_facts(check) for fact in group.facts}
    assert facts["cap_slope"].limit == 90.0 - 35.0 / 2.0 - 2.0 and facts["cap_slope"].state == "pass"
    assert facts["wall_nose"].value == "any" and facts["wall_nose"].note == "no concave region limits the nose"
    assert facts["cap_nose"].note.endswith("concave parts of the meridian")
    told = [note_on_edge(check, process) for process in ("turned", "printed", "moulded")]
    assert ["core" in note for note in told] == [False, False, True]
    assert "cap_ball" not in facts and "cap_tilt" not in facts
    tight = spot().replace({"manufacture.nose_radius_mm": 2.1, "manufacture.shank_width_mm": 5.0})
    nose = next(turning_findings(tight, check.faces))
    assert nose.limit == pytest.approx(2.0, rel=1e-4)


@pytest.mark.parametrize(("radius_mm", "left"), [(0.5, 1.0 - 0.75**2), (0.2, 1.0 - 0.9**2)])
def test_the_nose_that_is_advised_leaves_fillets_within_the_limit(radius_mm: float, left: float) -> None:
    """In a disc of 2 mm that ends at a wall; the nose of the advice is put in the place of the first."""
    disc = line((0.0, 4.0), (2.0, 4.0), (0.0, -1.0), 8001)
    wall = line((2.0, 4.0), (2.0, 0.0), (-1.0, 0.0), 8001)

    def share(nose_mm: float) -> float:
        return float(disc.areas[tool(nose_mm, 10.0).nose_enters(disc, wall.points)].sum() / disc.areas.sum())

    assert share(radius_mm) == pytest.approx(left, abs=2e-3)
    told = _corner("cap", TurningTool.model_construct(corner_fraction=left, radius_mm=radius_mm, residual_mm=None))
    advised = float(told.remedy.removeprefix("manufacture.nose_radius_mm = "))
    assert not told.holds and advised < radius_mm
    assert 0.9 * MOST_CORNER < share(advised) <= MOST_CORNER


def test_a_freeform_face_is_not_turned_and_a_print_has_layers() -> None:
    shapes = random_surface(1, 3.2, 0.02, (9, 25)), random_surface(2, 6.5, 0.02, (9, 25))
    for process, more in (("turned", {}), ("printed", {"layer_um": 10.0, "form_tolerance_um": 12.0})):
        spec = small_spec(base={"kind": "none"}, manufacture={"process": process, **more})
        check = check_lens(Lens.double(*shapes, spec, 0, FEW))
        assert all(face.cutter is None for face in check.faces.values()) and not check.relief.faces
        named = {(verdict.key, verdict.place): verdict for verdict in check.verdicts}
        if process == "turned":
            assert {key for key, _ in named} == {"nose", "wall"} and not named["nose", "outer"].holds
            assert named["nose", "outer"].remedy == 'manufacture.process = "milled"'
            assert "not of revolution" in named["nose", "inner"].note
            continue
        assert {key for key, _ in named} == {"layer", "wall"}
        steps = [face.layer_step_um for face in check.faces.values()]
        assert all(9.0 < step <= 10.0 for step in steps), "the apex is nearly level"
        assert [named["layer", name].holds for name in ("inner", "outer")] == [False, False]
        finer = spec.replace({"manufacture.layer_um": 6.0})
        half = {name: face.changed(layer_step_um=0.6 * face.layer_step_um) for name, face in check.faces.items()}
        assert all(finding.holds for finding in layer_findings(finer, half))


def test_a_given_face_has_the_curvature_of_its_meridian() -> None:
    """By differences along its section, of a face that is hollow from inside."""
    shape = {"kind": "asphere", "vertex_z_mm": 4.0, "radius_mm": -3.0, "conic_constant": -0.5}
    polar = np.linspace(0.0, np.pi / 2.0, 20_001)
    surface = Asphere(4.0, -3.0, -0.5)
    u = np.column_stack([np.sin(polar), np.zeros_like(polar), np.cos(polar)])
    r, z = (surface.radius(u)[:, None] * u)[:, ::2].T
    dr = np.gradient(r, polar)
    dz = np.gradient(z, polar)
    tightest = np.max(((-np.gradient(dz, polar) * dr + np.gradient(dr, polar) * dz) / np.hypot(dr, dz) ** 3)[5:-5])
    given = small_spec(lens__inner={"fixed": shape}).lens.faces["inner"].fixed.shape
    assert given.meridian_curvatures_per_mm[1] == pytest.approx(tightest, rel=1e-4)
