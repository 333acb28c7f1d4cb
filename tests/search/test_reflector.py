"""A reflector from its spec: its light in closed form, derivatives, limits, and a short search."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from chains import upwards
from landed import exactly
from PIL import Image
from presets import FEW

import lensforge as lf
from lensforge.kernels.fate import Fate
from lensforge.light.simulation import TracedLens
from lensforge.light.table_trace import Scene
from lensforge.scene.body import Chain
from lensforge.scene.lens import Lens
from lensforge.search.constraints import AugmentedLagrangian
from lensforge.search.feasibility import measure_constraints
from lensforge.search.merit import MeritFunction
from lensforge.search.profiles import ProfileParameters
from lensforge.search.start_faces import start_faces
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec, parse_spec
from lensforge.surfaces.bicubic_table import TableGrid
from lensforge.surfaces.reciprocal import ConicFace
from lensforge.surfaces.reflector_cup import OPEN_RAD, LeaningCup, best_cup, best_leaning_cup, reflector_faces

BEAM: dict[str, Any] = {
    "source": {"kind": "square", "side_mm": 1.0},
    "lens": {"kind": "reflector", "profile": 8},
    "constraints": {"max_radius_mm": 12.0, "max_height_mm": 14.0},
    "target": {"kind": "disc", "diameter_deg": 24.0, "half_angle_deg": 80.0},
    "base": {"kind": "none"},
    "optimise": {"aim": "share", "steps_per_level": [25], "rays": 4096},
}
FOCAL = 2.5
HEIGHT = 15.0
MIRROR = 0.88
GLASS = {"refractive_index": 1.5, "thickness_mm": 2.0}
RIM = 2.0 * np.sqrt(FOCAL * (HEIGHT + FOCAL))  # radius of the paraboloid at its mouth
DIRECT = RIM**2 / (RIM**2 + HEIGHT**2)  # of Lambertian light from the focus: squared sine of the angle to the rim


def reflector(lens: dict[str, Any] | None = None, **changes: Any) -> Spec:
    return parse_spec({**BEAM, "lens": {**BEAM["lens"], **(lens or {})}, **changes}, "beam")


def given(second_focus_mm: float | None = None, **changes: Any) -> Lens:
    conic = {"kind": "focal_conic", "vertex_mm": FOCAL, "second_focus_mm": second_focus_mm}
    lens = {"cup": {"mirror": MIRROR, "fixed": conic}, "mouth": {"offset_mm": HEIGHT}}
    spec = reflector(lens, constraints={"max_radius_mm": 16.0}, **changes)
    return Lens(ProfileParameters.of(spec, 2.5).start_surfaces, spec, 0, FEW)


def traced_exactly(lens: Lens, rays: Any) -> Any:
    return exactly(lens.surfaces, Scene(lens.media, TableGrid(24), chain=Chain.of_lens(lens.spec.lens)), rays)


def test_a_paraboloid_sends_the_light_of_its_focus_along_the_axis() -> None:
    lens = given()
    rays = upwards(800, 3)
    exits = traced_exactly(lens, rays)
    tabled = TracedLens.of(lens, 8.0).trace(rays)
    turned = np.hypot(rays.directions[:, 0], rays.directions[:, 1]) * HEIGHT > RIM * rays.directions[:, 2]
    assert exits.left_lens.all() and turned.any() and (~turned).any()
    assert exits.directions[turned] == pytest.approx(np.tile([0.0, 0.0, 1.0], (turned.sum(), 1)), abs=1e-12)
    assert np.array_equal(exits.directions[~turned], rays.directions[~turned])
    assert exits.flux == pytest.approx(rays.flux * np.where(turned, MIRROR, 1.0), rel=1e-12)
    assert exits.points[:, 2] == pytest.approx(HEIGHT, abs=1e-9)
    assert np.abs(tabled.directions - exits.directions).max() < 5e-5
    assert np.array_equal(tabled.fates, exits.fates)


def test_an_ellipsoid_sends_the_light_of_one_focus_to_the_other() -> None:
    lens = given(60.0)
    rays = upwards(400, 5)
    exits = traced_exactly(lens, rays)
    turned = np.abs(exits.directions - rays.directions).max(axis=1) > 1e-9
    assert exits.left_lens.all() and 0.3 < turned.mean() < 0.9
    to_focus = np.array([0.0, 0.0, 60.0]) - exits.points[turned]
    beside = np.linalg.norm(np.cross(to_focus, exits.directions[turned]), axis=1)
    assert beside.max() < 1e-11


def test_light_by_way_is_that_of_a_lambertian_point() -> None:
    light = lf.evaluate(given(source={"kind": "disc", "diameter_mm": 1e-3}), rays=2**14)
    shares = {way.faces: way.share.value for way in light.ways}
    assert shares == {
        ("mouth",): pytest.approx(DIRECT, abs=1e-4),
        ("cup", "mouth"): pytest.approx(MIRROR * (1.0 - DIRECT), abs=1e-4),
    }
    assert light.flux.absorbed == pytest.approx((1.0 - MIRROR) * (1.0 - DIRECT), abs=1e-4)
    assert sum(vars(light.flux).values()) == pytest.approx(1.0, abs=1e-12)
    assert light.efficiency.value <= light.possible.efficiency


def test_along_the_axis_a_lambertian_chip_fills_the_mirror_with_its_luminance() -> None:
    lens = given()
    rays = build_source(lens.spec.source, None).sample(2**19, 11)
    exits = TracedLens.of(lens, 8.0).trace(rays)
    narrow = np.sin(np.radians(0.3))  # so small that the chip is seen in 99 % of the mirror: at its foot it is edge-on
    within = exits.left_lens & (np.hypot(exits.directions[:, 0], exits.directions[:, 1]) < narrow)
    share = exits.flux[within].sum() / rays.flux.sum()
    count = within.sum()
    lit_mm2 = MIRROR * np.pi * (RIM**2 - (2.0 * FOCAL) ** 2) + 1.0  # the mirror, and the chip of 1 mm^2 itself
    assert share == pytest.approx(lit_mm2 * narrow**2, rel=0.01 + 3.0 / np.sqrt(count))


def test_light_passes_a_cover_window_after_the_reflector() -> None:
    glass = {**GLASS, "distance_mm": HEIGHT + 1.0}
    open_cup = given()
    rays = upwards(400, 3)
    spec = open_cup.spec.replace({"lens.cover_glass": glass})
    lens = Lens(open_cup.surfaces, spec, 0, FEW)
    exits = traced_exactly(open_cup, rays)
    behind = traced_exactly(lens, rays)
    along = exits.directions[:, 2] > 1.0 - 1e-12
    assert behind.flux[along] == pytest.approx(exits.flux[along] * (1.0 - 0.2**2) ** 2, rel=1e-9)
    assert behind.directions == pytest.approx(exits.directions, abs=1e-12)
    assert TracedLens.of(lens, 8.0).trace(rays).flux == pytest.approx(behind.flux, rel=1e-5)


def test_rays_that_fall_back_are_counted_with_their_fates() -> None:
    lens = given(30.0, source={"kind": "square", "side_mm": 4.0})
    rays = build_source(lens.spec.source, None).sample(2**11, 2)
    exits = TracedLens.of(lens, 8.0).trace(rays)
    exact = traced_exactly(lens, rays)
    assert (exits.fates != Fate.LEFT_LENS).sum() <= 2 + (exact.fates != Fate.LEFT_LENS).sum()
    assert np.mean(exits.fates == exact.fates) > 0.998
    assert (exits.met[:, 2] >= 0).any(), "some are reflected twice"


def moved(parameters: ProfileParameters) -> tuple[torch.Tensor, torch.Tensor]:
    rng = np.random.default_rng(5)
    (weights, offsets) = parameters.start()
    return weights + 0.003 * torch.from_numpy(rng.normal(size=weights.shape)), offsets + 0.003


@pytest.mark.parametrize("along", [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], ids=["cup", "mouth"])
def test_the_derivative_of_the_merit_is_that_of_differences(along: list[float]) -> None:
    spec = reflector()
    source = build_source(spec.source, None)
    parameters = ProfileParameters.of(spec, 2.5)
    merit = MeritFunction.of(spec, source, parameters)
    weights, offsets = moved(parameters)
    direction = torch.tensor(along, dtype=torch.float64)
    rays = source.sample(2**16, 3)
    step = 1.6e-2

    def loss(moved: torch.Tensor) -> torch.Tensor:
        return merit.terms[0].loss(merit.light_of(parameters.tables(weights, moved), rays).images[0], False)

    slope = (loss(offsets + step * direction) - loss(offsets - step * direction)).item() / (2.0 * step)
    moving = offsets.clone().requires_grad_()
    loss(moving).backward()
    assert float((moving.grad * direction).sum()) == pytest.approx(slope, rel=0.05)


@pytest.mark.parametrize("offset_mm", [3.0, 4.5])
def test_the_offset_of_a_cup_is_its_radius_in_the_plane_of_the_led(offset_mm: float) -> None:
    cup = start_faces(reflector({"cup": {"offset_mm": offset_mm}}))["cup"]
    for azimuth in (0.0, 2.0):
        way = np.array([[np.cos(azimuth), np.sin(azimuth), 0.0]])
        assert cup.radius(way)[0] == pytest.approx(offset_mm, rel=1e-9)


def test_the_back_of_an_oval_cup_is_a_wall_away_on_every_side() -> None:
    """Round, and so a wall away where the cup reaches farthest, and more elsewhere."""
    cup = ConicFace(16.0, 5.0, 0.8, (0.1, -0.05, 1.0))
    wall = 0.8
    back = reflector_faces(cup, 12.0, wall, 9.0)["back"]
    polar = np.radians(np.linspace(50.0, 88.0, 20))
    azimuth = np.linspace(0.0, 2.0 * np.pi, 361)
    for angle in polar:
        u = np.column_stack(
            [np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.full_like(azimuth, np.cos(angle))]
        )
        needed = cup.radius(u) + wall / np.sum(cup.normal(u) * u, axis=1)
        assert back.radius(u) == pytest.approx(np.full(361, needed.max()), rel=5e-3)


def test_a_mouth_is_where_the_back_has_its_radius_and_no_higher_than_allowed() -> None:
    cup = ConicFace(16.0, 5.0, 0.8, (0.1, -0.05, 1.0))
    radius_mm = 8.0
    wall_mm = 0.8

    def height_mm(most_mm: float) -> float:
        mouth = reflector_faces(cup, radius_mm, wall_mm, most_height_mm=most_mm)["mouth"]
        return float(mouth.radius(np.array([[0.0, 0.0, 1.0]]))[0])

    free_mm = height_mm(np.inf)
    back = reflector_faces(cup, radius_mm, wall_mm)["back"]
    edge = np.array([[radius_mm, 0.0, free_mm]]) / np.hypot(radius_mm, free_mm)
    assert back.radius(edge)[0] == pytest.approx(np.hypot(radius_mm, free_mm), rel=5e-3)
    assert height_mm(free_mm + 0.7) == free_mm and height_mm(free_mm - 0.7) == pytest.approx(free_mm - 0.7)


def test_the_back_follows_the_cup() -> None:
    parameters = ProfileParameters.of(reflector(), 2.5)
    weights, offsets = moved(parameters)
    start = parameters.start_surfaces
    now = parameters.surfaces(weights, offsets)
    polar = np.linspace(np.arctan2(9.0, 13.0), 0.5 * np.pi, 40)
    directions = np.column_stack([np.sin(polar), np.zeros(40), np.cos(polar)])
    walls = [faces["back"].radius(directions) - faces["cup"].radius(directions) for faces in (start, now)]
    assert walls[1] == pytest.approx(walls[0], rel=0.1)
    assert np.abs(now["cup"].radius(directions) - start["cup"].radius(directions)).max() > 0.02
    again = parameters.tables(*parameters.parameters_of(parameters.lens(weights, offsets, reflector(), 0, FEW)))
    apart = (again - parameters.tables(weights, offsets)).abs().amax(dim=(1, 2))
    assert apart[0] < 1e-6 and apart[2] < 1e-6
    for face, factor in ((0, 1.02), (1, 0.97)):  # the back goes with the cup, and by its own offset without it
        scaled = offsets.clone()
        scaled[face] *= factor
        ratio = parameters.surfaces(weights, scaled)["back"].radius(directions) / now["back"].radius(directions)
        assert ratio == pytest.approx(np.full(40, factor), rel=1e-6)


def test_limits_are_those_of_the_body() -> None:
    spec = reflector({"cup": {"draft_deg": 2.0, "concave_radius_mm": 1.0}})
    parameters = ProfileParameters.of(spec, 2.5)
    weights, offsets = moved(parameters)
    fine = parameters.refined()
    constraints = AugmentedLagrangian.of(spec, fine.grid)
    least = constraints.least(constraints.fields(fine.tables(weights, offsets)))
    margins = measure_constraints(parameters.lens(weights, offsets, spec, 0, FEW))
    for name in ("cavity_clearance_mm", "wall_margin_mm", "radius_margin_mm", "height_margin_mm"):
        assert least[name] == pytest.approx(getattr(margins, name), abs=0.01), name
    assert least["cup_draft_margin_deg"] == pytest.approx(margins.draft_margin_deg["cup"], abs=0.05)
    assert margins.wall_margin_mm > 0.0 and margins.draft_margin_deg["cup"] > 0.0


def test_a_short_search_gains_light_and_keeps_the_limits() -> None:
    spec = reflector().replace({"optimise.steps_per_level": [8]})
    design = lf.design(spec, accuracy=FEW)
    assert all(criterion.holds for criterion in design.criteria)
    start = Lens(ProfileParameters.of(spec, 2.5).start_surfaces, spec, 0, FEW)
    before, after = (lf.evaluate(lens, rays=2**13).share_in_target.value for lens in (start, design.lens))
    assert after > before + 0.01


def test_a_given_reflector_is_taken_as_it_is() -> None:
    lens = given()
    design = lf.design(lens.spec, accuracy=FEW, force=True)
    assert design.steps == 0 and design.lens.to_json()["faces"] == lens.to_json()["faces"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"lens": {"cup": {"coating": {"reflectance": 0.1}}}}, "the cup is a mirror; give cup.mirror"),
        ({"lens": {"cup": {"mirror": 1.2}}}, r"cup.mirror = 1.2"),
        ({"lens": {"mouth": {"form_um": 1.0}}}, "it has offset_mm alone"),
        ({"lens": {"back": {"offset_mm": 3.0}}}, "it follows the cup"),
        ({"lens": {"cup": {"shift_mm": 0.1}}}, "cup.shift_mm: this face is alone"),
        ({"lens": {"cavity_index": 1.41}}, "a reflector is open"),
        ({"lens": {"mouth": {"offset_mm": 90.0}}}, "does not reach up to 90 mm"),
        ({"constraints": {"max_radius_mm": 1.3}}, "leaves no room for a cup"),
        ({"optimise": {"robust": True}}, "optimise.robust goes with"),
        (
            {"lens": {"mouth": {"offset_mm": 13.0}, "cover_glass": {**GLASS, "distance_mm": 12.5}}},
            "cover_glass.distance_mm = 12.5",
        ),
        ({"lens": {"wall": {"mirror": 0.9}}}, "lens.wall"),
        (
            {"lamps": {"kind": "grid", "columns": 2, "rows": 1, "pitch_mm": 40.0}, "plate": {"thickness_mm": 2.0}},
            "plate",
        ),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(changes: dict[str, Any], message: str) -> None:
    lens = {**BEAM["lens"], **changes.pop("lens", {})}
    with pytest.raises(lf.InputError, match=message) as caught:
        lf.design(parse_spec({**BEAM, "lens": lens, **changes}, "beam"), accuracy=FEW)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["reflector", "tir"])
def test_a_dark_target_is_said_of_the_target(tmp_path: Path, kind: str) -> None:
    Image.new("L", (8, 8)).save(tmp_path / "dark.png")
    target = {"kind": "image", "file": str(tmp_path / "dark.png"), "width_mm": 400.0, "distance_mm": 1000.0}
    with pytest.raises(lf.InputError, match=r"^target: it is dark everywhere"):
        start_faces(parse_spec({**BEAM, "lens": {"kind": kind, "profile": 8}, "target": target}, "beam"))


def test_a_cup_for_a_wall_beside_its_axis_lets_the_light_through_to_it() -> None:
    """Beyond the rim a Lambertian point sends sin^2 of its angle directly; a deep cup would light nothing there."""
    least, most = np.radians([28.0, 60.0])
    direct = np.sin(most) ** 2 - np.sin(least) ** 2
    deep, open_cup = (best_cup(24.0, 0.5, 1.5, most, beside) for beside in (0.0, least))
    rim = np.arctan2(open_cup.rim_mm, open_cup.height_mm)
    assert open_cup.share(most, 1.5, least) >= 0.98 * direct and rim > 0.95 * most
    assert np.arctan2(deep.rim_mm, deep.height_mm) < least and deep.share(most, 1.5, least) < 0.5 * direct
    wall = {"kind": "plane", "centre_mm": [0, 1000, 1500], "normal": [0, -1, 0], "width_mm": 2500, "height_mm": 2500}
    target = {"kind": "rectangle", "width_mm": 1500, "height_mm": 1500, "edge_mm": 100}
    spec = parse_spec(
        {
            "source": {"kind": "square", "side_mm": 1.5},
            "lens": {"kind": "reflector"},
            "constraints": {"max_radius_mm": 25, "max_height_mm": 30},
            "base": {"kind": "none"},
            "receivers": [{**wall, "targets": [target]}],
        },
        "washer",
    )
    mouth = start_faces(spec)["mouth"]
    rim = np.radians(55.0)
    assert float(mouth.radius(np.array([[np.sin(rim), 0.0, np.cos(rim)]]))[0]) < float(
        start_faces(spec)["cup"].radius(np.array([[np.sin(rim), 0.0, np.cos(rim)]]))[0]
    ), "light at 55 degrees passes the mouth before it meets the cup"


WALL = np.radians([25.0, 18.0])  # angle of its middle from the axis, half angle of a cone as wide as it is
LEANING = best_leaning_cup(12.0, 1.0, *WALL, MIRROR, 0.85, 12.0)


def washer(**lens: Any) -> Spec:
    wall = {"kind": "plane", "centre_mm": [0.0, 211.309, 453.154], "tilt_deg": [-30.0, 0.0]}
    target = {"kind": "rectangle", "width_mm": 240.0, "height_mm": 320.0}
    return parse_spec(
        {
            **{name: table for name, table in BEAM.items() if name != "target"},
            "lens": {"kind": "reflector", "levels": [25, 81], "profile": 8, **lens},
            "constraints": {"max_radius_mm": 14.0},
            "receivers": [{**wall, "width_mm": 480.0, "height_mm": 480.0, "targets": [target]}],
            "optimise": {"aim": "share", "steps_per_level": [2, 2, 2], "rays": 4096},
        },
        "washer",
    )


def test_the_share_of_a_leaning_cup_is_that_of_rays_through_its_faces() -> None:
    """The estimate solves a quadratic equation; the kernels trace tables of the faces, a mirror and a plane."""
    assert LEANING is not None
    spec = reflector({"cup": {"mirror": MIRROR}})
    faces = reflector_faces(LEANING.face(40.0), 20.0, 0.8, LEANING.height_mm)
    rays = build_source(spec.source, None).sample(2**15, 4)
    exits = TracedLens.of(Lens(faces, spec, 0, FEW), 8.0).trace(rays)
    wanted = np.array([np.sin(WALL[0]), 0.0, np.cos(WALL[0])])
    once = (exits.met >= 0).sum(axis=1) <= 2
    within = exits.left_lens & once & (exits.directions @ wanted > np.cos(WALL[1]))
    assert LEANING.share(*WALL, 1.0, MIRROR) == pytest.approx(exits.flux[within].sum() / rays.flux.sum(), abs=0.015)


@pytest.mark.parametrize(("room_mm", "draft_deg"), [(12.0, 0.0), (9.0, 3.0)])
def test_a_leaning_cup_keeps_its_sizes_and_lets_a_tool_in(room_mm: float, draft_deg: float) -> None:
    """Measured at points of the conic: its radius, its narrowest place, its slope, and its height over the axis."""
    cup = best_leaning_cup(room_mm, 1.0, *WALL, MIRROR, 0.85, 12.0, np.radians(draft_deg))
    assert cup is not None and cup.height_mm <= 12.0
    face = cup.face(60.0, 0.7)
    mouth = cup.height_mm
    polar, azimuth = (
        coordinates.ravel() for coordinates in np.meshgrid(np.linspace(0.0, np.pi / 2, 400), np.linspace(0.0, 6.28, 91))
    )
    u = np.column_stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)])
    points = face.radius(u)[:, None] * u
    below = points[:, 2] < mouth
    across = np.hypot(*points[below, :2].T)
    assert across.max() < 1.003 * room_mm and np.hypot(*points[polar > 1.57, :2].T).min() > 0.849
    assert np.degrees(np.arcsin(-face.normal(u[below])[:, 2])).min() > draft_deg - 0.2
    assert face.radius(np.array([[0.0, 0.0, 1.0]]))[0] > 1.05 * mouth, "the axis meets the mouth"
    farthest = points[below][across.argmax()]
    assert np.arctan2(farthest[1], farthest[0]) == pytest.approx(0.7, abs=0.08), "within a step of the grid"


@pytest.mark.parametrize("lean_rad", [0.3, 1.1])
def test_a_leaning_cup_has_room_for_what_stands_in_its_narrowest_place(lean_rad: float) -> None:
    """By the radius of its mirror all around at the height of the LED."""
    cup = LeaningCup(focal_mm=5.0, eccentricity=0.8, lean_rad=lean_rad, height_mm=2.0)
    turn = np.linspace(0.0, 2.0 * np.pi, 7201)
    around = np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])
    narrowest_mm = cup.face(1e3).radius(around).min()
    for factor in (2.5, 4.0):
        assert cup.over(1e6, factor * narrowest_mm, 1e6, 0.0) == pytest.approx(factor, rel=1e-6)


def test_a_reflector_for_a_wall_leans_towards_it() -> None:
    """The most that a mirror can send there is 0.896 of the light; by cups of revolution 0.21 was the most found."""
    spec = washer()
    lens = Lens(ProfileParameters.of(spec, 2.5).start_surfaces, spec, 0, FEW)
    light = lf.evaluate(lens, rays=2**14)
    assert 0.69 < light.share_in_target.value < light.possible.share_in_target < 0.9
    polar = np.linspace(0.4, 1.5, 40)
    sides = [
        lens.surfaces["cup"].radius(np.column_stack([0.0 * polar, k * np.sin(polar), np.cos(polar)])) for k in (1, -1)
    ]
    assert (sides[0] > 1.2 * sides[1]).all(), "it reaches farther towards the wall, at +y"


def test_parameters_of_a_leaning_lens_are_those_it_has() -> None:
    spec = washer()
    parameters = ProfileParameters.of(spec, 2.5)
    weights, offsets = moved(parameters)
    again = parameters.parameters_of(parameters.lens(weights, offsets, spec, 0, FEW))
    same = parameters.tables(*again), parameters.tables(weights, offsets)
    apart = (same[0] - same[1]).abs().amax(dim=(1, 2))
    assert apart[0] < 1e-5 and apart[2] < 1e-6
    wall = parameters.surfaces(*parameters.start())
    polar = np.linspace(0.6, 1.5, 60)
    for azimuth in (0.5 * np.pi, -0.5 * np.pi, 0.0):
        u = np.column_stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)])
        cup, back = (wall[name].radius(u) for name in ("cup", "back"))
        slant = np.sum(wall["cup"].normal(u) * u, axis=1)
        walls = ((back - cup) * slant)[back * u[:, 2] < 11.0]
        assert 0.9 * spec.constraints.min_thickness_mm < walls.min() and walls.max() < 2.5


def test_a_cup_does_not_close_over_its_mouth() -> None:
    """The margin is the cup's radius less the mouth's, along rays up to 0.3 rad from the axis; none without levels."""
    spec = washer()
    parameters = ProfileParameters.of(spec, 2.5)
    constraints = AugmentedLagrangian.of(spec, parameters.grid)
    weights, offsets = parameters.start()
    offsets[2] *= 1.4  # the mouth rises
    lens = parameters.lens(weights, offsets, spec, 0, FEW)
    polar, azimuth = (
        coordinates.ravel() for coordinates in np.meshgrid(np.linspace(0.0, OPEN_RAD, 30), np.linspace(0.0, 6.2, 60))
    )
    u = np.column_stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)])
    expected = float((lens.surfaces["cup"].radius(u) - lens.surfaces["mouth"].radius(u)).min())
    margin = constraints.least(constraints.fields(parameters.tables(weights, offsets)))["opening_margin_mm"]
    assert margin == pytest.approx(expected, rel=0.1)
    assert "opening_margin_mm" not in AugmentedLagrangian.of(reflector(), parameters.grid).keys
