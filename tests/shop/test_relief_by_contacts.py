"""Clearance at the base by a loop over the contacts of the ball, each with plain plane geometry."""

from dataclasses import replace
from math import hypot, inf, sqrt

import numpy as np
import pytest
from known_shapes import exported, sampled, sphere
from scenes import small_spec
from scenes import sphere as any_sphere

from lensforge.cad import cutter_room
from lensforge.cad.boundary import as_pair
from lensforge.cad.cutter_room import base_with_room
from lensforge.cad.plan import lay_out
from lensforge.scene.lens import Lens
from lensforge.shop.ball_clearance import check_ball_clearance, read_base_mesh, wall_retreat_mm
from lensforge.shop.face_check import MilledFace, milled_face
from lensforge.shop.face_samples import AirSide
from lensforge.shop.tool_reach import _obstacles
from lensforge.spec import BaseSection

BALL = 0.7
CLEAR_MM = 1e-6  # what lacks less than the error of the faces' form clears the ball
INNER = exported(sphere(1.2, (0.0, 0.0, -0.3)), AirSide.INSIDE)
OUTER = exported(sphere(2.7, (0.0, 0.0, 0.4)), AirSide.OUTSIDE)
RIM_IN = sqrt(1.2**2 - 0.3**2)
RIM_OUT = sqrt(2.7**2 - 0.4**2)


@pytest.fixture(scope="module")
def faces() -> tuple[MilledFace, MilledFace]:
    return milled_face(INNER, BALL, 25), milled_face(OUTER, BALL, 25)


def centres(face: MilledFace) -> list[tuple[float, float]]:
    """Distance from the axis and height of the ball that touches each sample."""
    points = face.samples.points + BALL * face.samples.normals
    return [(hypot(x, y), z) for x, y, z in points.tolist()]


def step(distance: float, height: float, base_mm: float) -> float:
    """Depth at which a disc of that radius clears the ball."""
    beside = max(distance - base_mm, 0.0)
    return -inf if beside >= BALL else sqrt(BALL**2 - beside**2) - height


def bore(distance: float, height: float, top_mm: float, bottom_mm: float) -> float:
    """Radius of a bore between two depths that clears the ball."""
    away = max(height + top_mm, -height - bottom_mm, 0.0)
    return 0.0 if away >= BALL else distance + sqrt(BALL**2 - away**2)


def wall(distance: float, height: float) -> float:
    """Radius of a wall from z = 0 down that clears the ball outside of it."""
    return inf if height >= BALL else distance - sqrt(BALL**2 - max(height, 0.0) ** 2)


def beyond(value: float) -> float:
    return value if value > CLEAR_MM else 0.0


def judged(face: MilledFace, *needs: list[float]) -> tuple[list[float], float]:
    """The largest of each need over what the ball reaches, and the share of the area that needs nothing."""
    reached = face.reached
    areas = face.samples.areas
    clear = reached & (np.max(needs, axis=0) == 0.0)
    assert reached.any()
    return [max(np.array(need)[reached]) for need in needs], float(areas[clear].sum() / areas.sum())


def by_name(faces):
    return dict(zip(("inner", "outer"), faces, strict=True))


OUTER_BASES = [
    {"height_mm": 1.2, "diameter_mm": 25.4},
    {"height_mm": 1.2, "diameter_mm": 5.6, "flange_diameter_mm": 6.4, "flange_height_mm": 0.9},
    {"height_mm": 3.0, "diameter_mm": 25.4, "relief_step_mm": 0.2},
    {"height_mm": 3.0, "diameter_mm": 25.4, "relief_step_mm": 0.5, "relief_setback_mm": 0.005},
    {"height_mm": 3.0, "diameter_mm": 25.4, "relief_step_mm": 0.9, "relief_setback_mm": 0.3},
    {"height_mm": 2.0, "diameter_mm": 4.0},  # below the dome only a step has a wall
    {"height_mm": 2.0, "diameter_mm": 4.0, "relief_step_mm": 0.5},
]


@pytest.mark.parametrize("sizes", OUTER_BASES)
def test_the_dome_needs_a_step_and_a_wall_and_a_low_flange(sizes: dict[str, float], faces) -> None:
    plan = lay_out(INNER.patch, OUTER.patch, BaseSection(**sizes))
    relief = check_ball_clearance(plan, None, by_name(faces)).faces["outer"]
    present = sizes.get("relief_step_mm", 0.0)
    contacts = centres(faces[1])
    steps = [beyond(step(*contact, sizes["diameter_mm"] / 2.0) - present) for contact in contacts]
    steps = [height + present if height > 0.0 else 0.0 for height in steps]
    flange = [0.0] * len(contacts)
    if "flange_diameter_mm" in sizes:
        shoulder = sizes["height_mm"] - sizes["flange_height_mm"]
        flange = [beyond(step(*contact, sizes["flange_diameter_mm"] / 2.0) - shoulder) for contact in contacts]
    if "relief_setback_mm" in sizes:
        at = RIM_OUT - sizes["relief_setback_mm"]
        set_back = [RIM_OUT - wall(*contact) if wall(*contact) < at - CLEAR_MM else 0.0 for contact in contacts]
    else:
        depth = present or (sizes["height_mm"] if sizes["diameter_mm"] / 2.0 > RIM_OUT else 0.0)
        set_back = wall_retreat_mm(faces[1].samples, BALL, depth).tolist() if depth else [0.0] * len(contacts)
    (one, two, three), clear = judged(faces[1], steps, set_back, flange)
    assert relief.smallest_step_mm == pytest.approx(one, abs=2e-6)
    assert relief.step_clearance_mm == pytest.approx(two, abs=2e-6)
    assert relief.flange_clearance_mm == pytest.approx(three, abs=2e-6)
    assert relief.flush_fraction == pytest.approx(clear, abs=1e-9)


INNER_BASES = [
    {"bore_setback_mm": 0.0},
    {"bore_setback_mm": 0.01},
    {"bore_setback_mm": 0.5},
    {"bore_setback_mm": 0.02, "pocket_diameter_mm": 3.0, "pocket_depth_mm": 2.7},
    {"bore_setback_mm": 0.0, "pocket_diameter_mm": 2.34, "pocket_depth_mm": 2.95},
]


@pytest.mark.parametrize("aside", [(0.0, 0.0), (0.16, -0.12)])
@pytest.mark.parametrize("sizes", INNER_BASES)
def test_the_cavity_needs_a_bore_and_a_pocket(sizes: dict[str, float], aside: tuple[float, float], faces) -> None:
    """A bore goes round the place of the rim that is farthest from the axis: of a cavity aside 0.2 mm farther."""
    if aside != (0.0, 0.0):
        inner = exported(sphere(1.2, (*aside, -0.3)), AirSide.INSIDE)
        faces = milled_face(inner, BALL, 25), faces[1]
    RIM_IN = sqrt(1.2**2 - 0.3**2) + hypot(*aside)
    plan = lay_out(faces[0].samples.face.patch, OUTER.patch, BaseSection(height_mm=3.0, **sizes))
    relief = check_ball_clearance(plan, None, by_name(faces)).faces["inner"]
    contacts = centres(faces[0])
    pocket_mm = sizes.get("pocket_diameter_mm")
    depth = 3.0 - sizes.get("pocket_depth_mm", 0.0)
    if sizes["bore_setback_mm"] > 0.0:
        mouth = RIM_IN + sizes["bore_setback_mm"]
        radii = [bore(*contact, 0.0, depth) for contact in contacts]
        bores = [radius - RIM_IN if radius > mouth + CLEAR_MM else 0.0 for radius in radii]
    else:
        bores = wall_retreat_mm(faces[0].samples, BALL, depth).tolist()
    pockets = [0.0] * len(contacts)
    if pocket_mm is not None:
        radii = [bore(*contact, depth, 3.0) for contact in contacts]
        pockets = [2.0 * radius if radius > pocket_mm / 2.0 + CLEAR_MM else 0.0 for radius in radii]
    (one, two), clear = judged(faces[0], bores, pockets)
    assert relief.bore_clearance_mm == pytest.approx(one, abs=2e-6)
    assert relief.pocket_diameter_mm == pytest.approx(two, abs=4e-6)
    assert relief.flush_fraction == pytest.approx(clear, abs=1e-9)


@pytest.mark.parametrize("depth_mm", [0.0, 0.05, 0.3, 10.0])
def test_a_round_wall_enters_the_ball_by_what_is_missing_across_it(depth_mm: float, faces) -> None:
    """The rim is a circle: the distance of a centre from it is the difference of two radii."""
    for face, rim in zip(faces, (RIM_IN, RIM_OUT), strict=True):
        retreats = wall_retreat_mm(face.samples, BALL, depth_mm)
        for retreat, (distance, height) in zip(retreats, centres(face), strict=True):
            below = max(-height - depth_mm, 0.0)
            enters = height < 0.0 and below < BALL
            expected = sqrt(BALL**2 - below**2) - abs(rim - distance) if enters else 0.0
            assert retreat == pytest.approx(beyond(expected), abs=1e-5), "4096 points of the rim"


def test_without_a_base_there_is_nothing_to_clear_and_a_note_says_why(faces) -> None:
    insert = check_ball_clearance(None, None, by_name(faces))
    assert (insert.faces, insert.note) == ({}, "a mould insert has no base")
    none = check_ball_clearance(lay_out(INNER.patch, OUTER.patch, BaseSection(kind="none")), None, by_name(faces))
    assert (none.faces, none.note) == ({}, "there is no base")


def test_of_a_face_that_the_ball_does_not_reach_nothing_is_known(faces) -> None:
    both = [replace(face, ball_mm=np.zeros(len(face.ball_mm))) for face in faces]
    plan = lay_out(INNER.patch, OUTER.patch, BaseSection(height_mm=3.0))
    relief = check_ball_clearance(plan, None, by_name(both)).faces["inner"]
    assert (relief.bore_clearance_mm, relief.pocket_diameter_mm, relief.flush_fraction) == (None, None, 0.0)


DOME = 2.45


def plate(tmp_path, bore, step=0.0):
    """A wide plate under the dome: its ring at the bore rises to z = 0, the rest lies ``step`` lower."""
    import cadquery as cq

    body = cq.Workplane("XY").workplane(offset=-3.0).rect(30.0, 30.0).extrude(3.0 - step)
    body = body.union(cq.Workplane("XY").circle(DOME - 0.2).extrude(-3.0))
    body = body.cut(cq.Workplane("XY").circle(bore / 2.0).extrude(-3.0))
    cq.exporters.export(body, str(tmp_path / "clamp.step"))
    return read_base_mesh(tmp_path / "clamp.step")


@pytest.mark.usefixtures("cad_read_here")
def test_a_narrow_bore_is_in_the_ball_s_way_in_the_cavity(tmp_path):
    # At the rim of a hemisphere the ball's centre is in z = 0, R inside the cavity; the bore's edge is 0.2 closer.
    samples = sampled(sphere(1.5), AirSide.INSIDE, 41)
    retreat = plate(tmp_path, 2.0 * (1.5 - 0.2)).retreat_mm(samples, 0.5)
    assert retreat.max() == pytest.approx(0.2, abs=1e-3)  # the chord of the base's mesh
    assert (plate(tmp_path, 3.0).retreat_mm(samples, 0.5) < 1e-3).all()


@pytest.mark.usefixtures("cad_read_here")
def test_obstacles_lie_on_the_base(tmp_path):
    points = plate(tmp_path, 2.0, step=1.0).points()
    assert points.shape == (4000, 3)
    assert (points[:, 2].max(), points[:, 2].min()) == pytest.approx((0.0, -3.0), abs=1e-9)


@pytest.mark.usefixtures("cad_read_here")
def test_shank_and_holder_are_kept_off_the_face_itself_and_off_a_base_from_a_file(tmp_path):
    base = plate(tmp_path, 2.0, step=1.0)
    obstacles = _obstacles(milled_face(INNER, BALL, 25), None, base)
    on_base = obstacles[len(obstacles) - len(base.points()) :]
    assert np.array_equal(on_base, base.points())
    away = np.linalg.norm(obstacles[: -len(on_base)] - [0.0, 0.0, -0.3], axis=1)
    assert len(away) > 1000 and away == pytest.approx(1.2, abs=1e-6)


@pytest.mark.parametrize("pocket", [{}, {"pocket_diameter_mm": 2.78}])
def test_derived_room_clears_the_ball_and_2_hundredths_less_do_not(pocket, monkeypatch) -> None:
    """Faces whose rims are aside; a pocket of 2.78 mm leaves a bore no more than its half, less the wall."""
    inner = exported(sphere(1.2, (0.16, -0.12, -0.3)), AirSide.INSIDE)
    outer = exported(sphere(2.7, (-0.2, 0.1, 0.4)), AirSide.OUTSIDE)
    monkeypatch.setattr(cutter_room, "fit_lens", lambda _: as_pair(inner.patch, outer.patch))
    lens = {
        "inner": {"offset_mm": 1.0, "concave_radius_mm": 0.7},
        "outer": {"offset_mm": 2.5, "concave_radius_mm": 0.7},
    }
    spec = small_spec(lens=small_spec().lens.model_dump(exclude_unset=True) | lens, constraints__min_thickness_mm=1e-3,
                      base={"diameter_mm": 12.0, "height_mm": 3.0, **pocket})  # fmt: skip
    spec = spec.replace({"manufacture.cutter_radius_mm": 0.7})
    base = base_with_room(Lens.double(any_sphere(1.0), any_sphere(2.5), spec, 0, "draft"))
    faces = by_name((milled_face(inner, BALL, 25), milled_face(outer, BALL, 25)))
    if pocket:
        half = 0.5 * pocket["pocket_diameter_mm"]
        assert base.bore_setback_mm == pytest.approx(half - 0.015 - (sqrt(1.2**2 - 0.3**2) + 0.2), abs=1e-4)
        return
    for field in (None, "bore_setback_mm", "relief_step_mm", "relief_setback_mm"):
        less = {} if field is None else {field: getattr(base, field) - 0.02}
        clearance = check_ball_clearance(lay_out(inner.patch, outer.patch, base.model_copy(update=less)), None, faces)
        shares = [clearance.faces[name].flush_fraction for name in ("inner", "outer")]
        touched = {None: [], "bore_setback_mm": [0]}.get(field, [1])
        assert [number for number, share in enumerate(shares) if share < 1.0 - 1e-9] == touched, field
