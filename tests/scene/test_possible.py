"""Upper bounds of the light in a region: closed forms of both laws, other solvers, and lenses of shipped scenes."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from known_refraction import normal_transmittance
from own_media import with_own
from presets import FEW
from scenes import small_spec
from scipy.optimize import minimize

import lensforge as lf
from lensforge.errors import InputError
from lensforge.optics.coatings import whole_span
from lensforge.optics.exit_space import DrawnBall, ExitBall
from lensforge.optics.fundamental_limits import best_transmittance, least_by_way
from lensforge.optics.media import CoverGlass, Media, Medium, SecondaryOptic
from lensforge.optics.pose import Pose
from lensforge.scene.lens import Lens
from lensforge.scene.pixel_grid import PixelGrid, Window
from lensforge.scene.possible_light import EtendueCurve, LargestShare, PossibleLight, SourceLight
from lensforge.scene.receiver import PosedReceiver
from lensforge.scene.receiver_shapes import Cylinder, FarField, Plane, SphericalReceiver, receivers_of
from lensforge.scene.target_pattern import drawn_target
from lensforge.search.scene_check import SceneCheck
from lensforge.search.start_faces import start_faces
from lensforge.sources.build_source import SquareEmitter, build_source
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec import Spec, load_spec
from lensforge.spec.source_sections import RaySource
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.mirror_group import REVOLUTION

SQUARE = SquareEmitter(2.0)
RAYS = SQUARE.sample(2**14, 0)


def straight_up(index: float, indices: np.ndarray | None = None) -> SourceLight:
    """The rays of the square, all of them along the axis."""
    up = np.zeros_like(RAYS.directions) + np.array([0.0, 0.0, 1.0])
    rays = RayBundle(RAYS.origins, up, RAYS.flux)
    body = Medium(index)
    if indices is not None:
        rays, body = with_own(rays, body, indices)
    return SourceLight.of_rays(rays, EtendueCurve.of(rays), Media(body))


def possible(receiver: PosedReceiver, radius_mm: float, light: float | SourceLight) -> PossibleLight:
    """Bounds of some light; of the square's for a refractive index."""
    return PossibleLight(
        light if isinstance(light, SourceLight) else SourceLight.of(SQUARE, Media(Medium(light))),
        receiver,
        ExitBall(radius_mm),
    )


def largest_share(
    pixels: np.ndarray, receiver: PosedReceiver, radius_mm: float, light: float | SourceLight
) -> LargestShare:
    return possible(receiver, radius_mm, light).in_region(pixels)


def plane(side_mm: float, pixels: int, distance_mm: float) -> Plane:
    return Plane(Pose.facing((0.0, 0.0, 1.0), (0.0, 0.0, distance_mm)), PixelGrid.square(side_mm, pixels))


def whole(receiver: PosedReceiver) -> np.ndarray:
    return np.ones(receiver.grid.shape, dtype=bool)


def test_a_small_far_target_holds_its_share_of_a_lambertian_source() -> None:
    """pi r^2 (side / distance)^2 of the source's pi A, and what two faces transmit of it."""
    receiver = plane(10.0, 8, 1000.0)
    bound = largest_share(whole(receiver), receiver, 15.0, 1.5)
    assert bound.by_etendue == pytest.approx(normal_transmittance(1.5) ** 2 * 15.0**2 * 1e-4 / 4.0, rel=1e-3)
    assert bound.by_etendue < bound.by_refraction < normal_transmittance(1.5) ** 2 and bound.value == bound.by_etendue
    assert "étendue" in str(bound)


def test_without_a_lens_the_bound_is_kept_by_straight_rays() -> None:
    """Index 1: light flies straight. What lands in the region never exceeds either bound, and comes near the second."""
    for side, distance in ((20.0, 30.0), (100.0, 30.0), (30.0, 300.0)):
        receiver = plane(side, 4, distance)
        bound = largest_share(whole(receiver), receiver, 2.0, 1.0)
        hits = RAYS.origins[:, :2] + distance * RAYS.directions[:, :2] / RAYS.directions[:, 2:]
        landed = float((np.abs(hits) <= 0.5 * side).all(axis=1).mean())
        assert landed <= bound.by_refraction and landed <= 1.1 * bound.by_etendue
        assert bound.by_refraction < 3.5 * landed


def test_a_collimated_source_reaches_no_target_far_to_its_side() -> None:
    """Straight up, and a target at 60 to 70 degrees: an index of 1.1 turns rays by 49 degrees, one of 1.5 by 96."""
    receiver = plane(600.0, 64, 100.0)
    pixels = (receiver.grid.x()[None, :] > 200.0) & (np.abs(receiver.grid.y())[:, None] < 30.0)
    weak = largest_share(pixels, receiver, 3.0, straight_up(1.05))
    assert weak.by_refraction == 0.0 and "refractions" in str(weak)
    some = largest_share(pixels, receiver, 3.0, straight_up(1.5)).by_refraction
    assert 0.5 < some < normal_transmittance(1.5) ** 2, "the turn costs some of it"
    colours = straight_up(1.05, np.linspace(1.05, 1.5, len(RAYS)))
    assert 0.1 < largest_share(pixels, receiver, 3.0, colours).by_refraction < some, "the rays' own indices"


def test_a_point_source_is_bounded_by_refraction_alone() -> None:
    physics = possible(plane(1.0, 8, 1000.0), 15.0, SourceLight.of(SquareEmitter(0.0), Media(Medium(1.5))))
    assert physics.in_region(whole(physics.receiver)).by_etendue == pytest.approx(normal_transmittance(1.5) ** 2)
    assert not physics.light.curve.estimated


def test_the_least_nmse_is_that_of_the_nearest_pattern_within_the_bounds() -> None:
    """Against a general solver of the same problem, on 5 x 5 pixels with bounds that bind."""
    receiver = plane(8.0, 5, 1000.0)
    physics = possible(receiver, 40.0, 1.5)
    target = np.exp(-(np.linspace(-1.5, 1.5, 5)[:, None] ** 2)) * np.exp(-(np.linspace(-1.5, 1.5, 5) ** 2))
    target /= target.sum()
    region = target > 0.1 * target.max()
    for arriving in (0.006, 0.01, 0.02):
        caps = np.maximum(physics.on_pixels.ravel() / arriving, 0.0)
        least = physics.least_nmse(target, region, arriving)
        assert caps.sum() > 1.0 and (caps < target.ravel()).any(), "some bounds bind, all together leave room"
        best = minimize(
            lambda pattern: np.sum((pattern - target.ravel()) ** 2),
            caps / caps.sum(),
            jac=lambda pattern: 2.0 * (pattern - target.ravel()),
            bounds=[(0.0, cap) for cap in caps],
            constraints={"type": "eq", "fun": lambda pattern: pattern.sum() - 1.0},
            options={"ftol": 1e-14, "maxiter": 1000},
        )
        assert best.success and least == pytest.approx(best.fun / np.sum(target**2), rel=1e-4, abs=1e-9)
    assert physics.least_nmse(target, region, 1e-6) == pytest.approx(0.0, abs=1e-12), (
        "little light can have any pattern"
    )


@pytest.mark.parametrize("width_mm", [50.0, 400.0, 2500.0])
def test_the_bound_of_a_window_is_that_of_a_receiver_of_its_size(width_mm: float) -> None:
    """Whether the window is narrower than the receiver, or wider and to both sides of what the light can reach."""
    pose = Pose.facing((0.2, -0.1, 1.0), (60.0, -40.0, 500.0))
    receiver = Plane(pose, PixelGrid(200.0, 120.0, 40, 24), Window(width_mm, 0.4 * width_mm))
    window = Plane(pose, PixelGrid(width_mm, 0.4 * width_mm, 40, 24))
    bound = possible(receiver, 9.0, 1.5).in_window()
    expected = largest_share(whole(window), window, 9.0, 1.5)
    assert bound.by_etendue == pytest.approx(expected.by_etendue, rel=1e-9)
    assert bound.by_refraction == pytest.approx(expected.by_refraction, rel=1e-9)


def test_the_bound_of_a_round_window_is_that_of_its_disc() -> None:
    """Wider than the receiver's pixels along y."""
    pose = Pose.facing((0.2, -0.1, 1.0), (60.0, -40.0, 500.0))
    receiver = Plane(pose, PixelGrid(200.0, 120.0, 40, 24), Window(math.inf, math.inf, 70.0))
    window = Plane(pose, PixelGrid.square(140.0, 56))
    disc = np.hypot(*np.meshgrid(window.grid.x(), window.grid.y())) <= 70.0
    bound = possible(receiver, 9.0, 1.5).in_window()
    expected = largest_share(disc, window, 9.0, 1.5)
    assert bound.by_etendue == pytest.approx(expected.by_etendue, rel=0.02)


GRID = PixelGrid(60.0, 40.0, 6, 4)
AHEAD = Pose.facing((0.0, 0.6, 0.8), (10.0, 30.0, 50.0))
RECEIVERS = {
    "plane": Plane(AHEAD, GRID),
    "cylinder": Cylinder(Pose.facing((0.0, 0.0, 1.0), (0.0, 0.0, 5.0)), GRID, radius_mm=60.0),
    "sphere": SphericalReceiver(Pose.facing((0.0, 0.0, 1.0), (0.0, 4.0, 5.0)), GRID, radius_mm=60.0),
    "far field": FarField(Pose.facing((0.1, 0.0, 1.0), (0.0, 0.0, 0.0)), PixelGrid(1.2, 0.8, 6, 4)),
}
each_receiver = pytest.mark.parametrize("receiver", RECEIVERS.values(), ids=list(RECEIVERS))
PIXELS = np.zeros((4, 6), dtype=bool)
PIXELS[1:3, 2:5] = True


def rays() -> RayBundle:
    chance = np.random.default_rng(0)
    directions = np.column_stack([chance.normal(size=(40, 2)) * 0.4, np.ones(40)])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return RayBundle(np.zeros((40, 3)), directions, chance.uniform(0.5, 1.0, 40) / 30.0)


INDICES = np.random.default_rng(1).uniform(1.45, 1.55, 40)


def light(media: Media) -> SourceLight:
    """Rays with an index each."""
    coloured, body = with_own(rays(), media.body, INDICES)
    curve = EtendueCurve(np.array([0.0, 2.0, 9.0]), np.array([0.1, 0.7, 1.0]), False)
    return SourceLight(coloured, curve, replace(media, body=body))


GLASS = CoverGlass(1.5, 1.5, 300.0)
MEDIA = {"bare": Media(Medium(1.5)), "glass": Media(Medium(1.5), cover_glass=GLASS)}


def best(turn: float, index: float, media: Media) -> float:
    least = least_by_way(media, whole_span(rays().wavelengths_nm, media))
    return float(best_transmittance(np.array([turn]), np.array([index]), 1.0, 1.0, least)[0])


def solid_angles(receiver: PosedReceiver) -> np.ndarray:
    """Of every pixel seen from the origin, by two triangles each (L'Huilier)."""
    corners = receiver.corners()
    units = corners / np.linalg.norm(corners, axis=-1, keepdims=True)
    angles = np.zeros(receiver.grid.shape)
    for row, column in np.ndindex(angles.shape):
        a, b, c, d = (units[row + i, column + j] for i, j in ((0, 0), (0, 1), (1, 1), (1, 0)))
        for one, other, third in ((a, b, c), (a, c, d)):
            sides = [
                2.0 * math.asin(0.5 * np.linalg.norm(p - q)) for p, q in ((one, other), (other, third), (third, one))
            ]
            half = sum(sides) / 2.0
            product = math.prod(math.tan(0.5 * (half - side)) for side in (0.0, *sides))
            angles[row, column] += 4.0 * math.atan(math.sqrt(max(product, 0.0)))
    return angles


@each_receiver
@pytest.mark.parametrize("media", MEDIA.values(), ids=list(MEDIA))
def test_the_bounds_of_a_region_are_those_of_its_solid_angle_and_of_the_cone_around_it(receiver, media) -> None:
    physics = PossibleLight(light(media), receiver, ExitBall(4.0))
    ball = 4.0 + (1.5 if media.cover_glass else 0.0)
    at_best = max(best(0.0, index, media) for index in INDICES)
    angles = solid_angles(receiver)

    def share(angle: float) -> float:
        return at_best * float(np.interp(math.pi * ball**2 * angle, [0.0, 2.0, 9.0], [0.1, 0.7, 1.0]))

    np.testing.assert_allclose(physics.on_pixels, np.vectorize(share)(angles), rtol=1e-6)
    bound = physics.in_region(PIXELS)
    assert bound.by_etendue == pytest.approx(share(angles[PIXELS].sum()), rel=1e-6)
    corners = receiver.corners()
    units = corners / np.linalg.norm(corners, axis=-1, keepdims=True)
    around = [
        units[row + i, column + j] for row, column in np.argwhere(PIXELS) for i, j in ((0, 0), (0, 1), (1, 1), (1, 0))
    ]
    axis = np.mean(around, axis=0) / np.linalg.norm(np.mean(around, axis=0))
    half = max(math.acos(min(1.0, float(direction @ axis))) for direction in around)
    nearest = float(np.linalg.norm(corners, axis=-1).min())
    if receiver.is_flat:
        nearest = 0.6 * 30.0 + 0.8 * 50.0
    parallax = 0.0 if receiver.is_far else math.asin(ball / nearest)
    bundle = rays()
    passed = sum(
        flux * best(math.acos(min(1.0, float(way @ axis))) - half - parallax, index, media)
        for flux, way, index in zip(bundle.flux, bundle.directions, INDICES, strict=True)
    )
    assert bound.by_refraction == pytest.approx(passed / bundle.flux.sum(), rel=1e-9)


@pytest.mark.parametrize("media", MEDIA.values(), ids=list(MEDIA))
def test_a_lens_of_revolution_sends_what_it_transmits_to_an_arc_and_all_else_around(media: Media) -> None:
    """One pixel in a corner of the far field, as wide as the azimuths of its corners."""
    receiver = RECEIVERS["far field"]
    pixel = np.zeros((4, 6), dtype=bool)
    pixel[3, 5] = True
    azimuths = np.arctan2(*receiver.corners()[3:, 5:, 1::-1].reshape(-1, 2).T)
    share = np.ptp(azimuths) / (2.0 * math.pi)
    assert 0.02 < share < 0.2
    around = PossibleLight(replace(light(media), round_by=REVOLUTION), receiver, ExitBall(4.0))
    bound = around.in_region(pixel)
    assert around.light.transmittance < 0.95
    assert bound.by_symmetry == pytest.approx(around.light.transmittance * share, rel=1e-9)


def test_a_larger_lens_holds_a_share_by_the_square_of_its_radius() -> None:
    angle = float(solid_angles(RECEIVERS["plane"])[PIXELS].sum())
    for share, etendue in ((0.1, 0.0), (0.4, 1.0), (0.7, 2.0), (0.85, 5.5), (1.0, 9.0)):
        radius_mm = max(math.sqrt(etendue / (math.pi * angle)), 1e-9)
        physics = PossibleLight(light(Media(Medium(1.5))), RECEIVERS["plane"], ExitBall(radius_mm))
        assert physics.by_etendue(PIXELS) == pytest.approx(share * physics.light.transmittance, rel=1e-6)


def spec_of(**sections: Any) -> Spec:
    return Spec.model_validate({"base": {"kind": "none"}, "optimise": {"aim": "share"}, **sections})


def bounds_of(spec: Spec) -> PossibleLight:
    """The bounds on the first receiver of ``spec``."""
    receiver = receivers_of(spec, spec.evaluate.pixels)[0]
    source = SourceLight.of(build_source(spec.source), spec.media, lens=spec.lens)
    return PossibleLight(source, receiver, spec.lens.exit_space(spec.constraints))


def share_of(spec: Spec) -> LargestShare:
    physics = bounds_of(spec)
    return physics.in_region(drawn_target(spec.all_receivers[0].targets, physics.receiver).coverage)


def test_a_given_ellipsoid_is_bounded_by_the_view_of_its_mouth() -> None:
    """Howell's C-41 between the disc and the mouth, whose radius is that of the ellipse there: more than it images."""
    spec = spec_of(
        source={"kind": "disc", "diameter_mm": 4.0},
        lens={
            "kind": "reflector",
            "cup": {
                "mirror": 0.95, "fixed": {"kind": "focal_conic", "vertex_mm": 3.0, "second_focus_mm": 80.0}
            },
            "mouth": {"offset_mm": 70.0},
        },
        constraints={"max_radius_mm": 18.0},
        target={"kind": "disc", "diameter_mm": 4.0, "distance_mm": 80.0, "receiver_mm": 60.0},
    )  # fmt: skip
    mouth = math.sqrt((43.0**2 - 40.0**2) * (1.0 - (30.0 / 43.0) ** 2)) / 10.0
    x = 1.0 + (1.0 + mouth**2) / 0.2**2
    factor = 0.5 * (x - math.sqrt(x**2 - 4.0 * (mouth / 0.2) ** 2))
    bound = share_of(spec)
    assert bound.by_etendue == pytest.approx(factor, rel=0.01) and bound.value > 0.2396, "a tracer of its own"
    assert bounds_of(spec.replace({"lens.mouth.offset_mm": 40.0})).by_etendue(
        np.ones((128, 128), dtype=bool)
    ) == pytest.approx(1.0), "all of the receiver"


def test_a_tir_lens_before_a_near_plane_may_bring_what_one_brought() -> None:
    """An own tracer found 0.8206 in the disc, of a lens 13 mm high. A low one cannot: pi r^2 sin^2, of 4 pi in all."""
    spec = spec_of(
        source={"kind": "square", "side_mm": 2.0},
        lens={"kind": "tir", "refractive_index": 1.4936},
        constraints={"max_radius_mm": 8.5},
        target={"kind": "disc", "diameter_mm": 5.0, "distance_mm": 22.0, "receiver_mm": 60.0},
    )
    transmitted = normal_transmittance(1.4936) ** 2
    assert 0.8206 < share_of(spec.replace({"constraints.max_height_mm": 13.2})).value <= transmitted
    low = share_of(spec.replace({"constraints.max_height_mm": 4.0, "source.side_mm": 6.0})).by_etendue
    ends = [math.pi * 2.5**2 * 8.5**2 / (8.5**2 + (22.0 - height) ** 2) / 36.0 for height in (4.0, 5.0)]
    assert transmitted * ends[0] * 0.95 < low < transmitted * ends[1] * 1.05


SQUARE_LED = {"kind": "square", "side_mm": 1.5}


def washer(source: dict[str, Any] = SQUARE_LED, **changes: Any) -> Spec:
    wall = {
        "kind": "plane", "centre_mm": [0, 1000, 1500], "normal": [0, -1, 0], "width_mm": 2500, "height_mm": 2500,
        "targets": [{"kind": "rectangle", "width_mm": 1500, "height_mm": 1500}],
    }  # fmt: skip
    return spec_of(
        source=source,
        lens={"kind": "reflector"},
        constraints={"max_radius_mm": 25, "max_height_mm": 30},
        receivers=[wall],
    ).replace(changes | {"evaluate.pixels": 32})


def test_faces_of_revolution_send_as_much_light_to_each_image_of_a_target() -> None:
    """Four images of a wall 74 degrees wide under the turns of a square; of a disc all turns, of a rectangle two."""
    arc = 2.0 * math.atan(750.0 / 1000.0) + 2.0 * math.asin(25.0 / 1000.0)
    least = share_of(washer())
    assert least.by_symmetry == least.value == pytest.approx(0.25)
    assert min(least.by_etendue, least.by_refraction) > 0.3
    disc = {"kind": "disc", "diameter_mm": 1.5}
    assert share_of(washer(source=disc)).by_symmetry == pytest.approx(arc / (2.0 * math.pi), rel=0.04)
    lines = {"kind": "rectangle", "width_mm": 1.5, "height_mm": 1.0}
    assert share_of(washer(source=lines)).by_symmetry == pytest.approx(0.5)
    for no_longer_round in ({"lens.levels": [25]}, {"source": {**disc, "position_mm": [0.1, 0.2, 0.0]}}):
        assert share_of(washer(**no_longer_round)).by_symmetry == 1.0
    assert bounds_of(washer()).beside_axis(np.ones((32, 32), dtype=bool))
    upright = washer(receivers=[{"kind": "plane", "centre_mm": [0, 0, 900], "width_mm": 900, "height_mm": 900,
                                 "targets": [{"kind": "disc", "diameter_mm": 500}]}])  # fmt: skip
    assert share_of(upright).by_symmetry == 1.0 and not bounds_of(upright).beside_axis(np.ones((32, 32), dtype=bool))


EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("*.toml"))
SCENES = [path for path in EXAMPLES if path.stem != "osram_pi"]  # whose rays are the vendor's
KINDS = ("batwing", "curved_screen", "coated_cover_glass", "two_distances")  # the others with the drafts, nightly


def require_possible(light: lf.Light) -> None:
    for receiver in light.receivers:
        for name in ("efficiency", "share_in_target"):
            metric = getattr(receiver, name)
            most = getattr(receiver.possible, name)
            assert metric.value <= most + 3.0 * (metric.standard_error or 0.0), f"{receiver.name}: {name}"
        assert receiver.nmse.value >= receiver.possible.nmse - 3.0 * (receiver.nmse.standard_error or 0.0), (
            receiver.name
        )


HOT = ((0.2, 0.9), (2.0, 0.1))  # sides (mm) of two squares, one within the other, and their shares of the flux


def hot_rays(count: int) -> RaySource:
    """Rays of a small bright square within a wide one, as a file has them."""
    chance = np.random.default_rng(5)
    side = np.where(chance.random(count) < HOT[0][1], HOT[0][0], HOT[1][0])[:, None]
    turn = 2.0 * np.pi * chance.random(count)
    sine = np.sqrt(chance.random(count))
    return RaySource(
        positions_mm=np.column_stack([(chance.random((count, 2)) - 0.5) * side, np.zeros(count)]),
        directions=np.column_stack([sine * np.cos(turn), sine * np.sin(turn), np.sqrt(1.0 - sine**2)]),
        flux_w=1.0,
    )


HOT_CHIPS = {
    "kind": "chips",
    "chips": [{"x_mm": 0.0, "y_mm": 0.0, "width_mm": side, "height_mm": side, "flux_w": w} for side, w in HOT],
}
ROOM = {"max_radius_mm": 8.0, "cavity_radius_mm": 1.5, "cavity_height_mm": 0.5}
SOURCES: dict[str, Any] = {
    "square": {"kind": "square", "side_mm": 1.0},
    "narrow and tilted": {
        "kind": "disc", "diameter_mm": 0.5, "intensity": {"kind": "cosine", "power": 3000.0}, "tilt_deg": [0.0, 45.0]
    },
    "hot chips": HOT_CHIPS,
    "hot rays": hot_rays(2**12),
}  # fmt: skip
SCATTER: dict[str, Any] = {
    "polished": None,
    "frosted": {"kind": "gaussian", "sigma_deg": 8.0},
    "opal": {"kind": "lambertian"},
    "fine": {"kind": "abg", "a": 0.01, "b": 1e-4, "g": 2.0},
    "measured": {"kind": "table", "incidence_deg": [0.0], "scattering_deg": [0.0, 60.0], "bsdf_per_sr": [[0.2, 0.2]]},
}
TARGETS: dict[str, Any] = {
    "ahead": [{"kind": "disc", "diameter_deg": 6.0}],
    "on the other side": [{"kind": "disc", "diameter_deg": 20.0, "centre_deg": [-75.0, 0.0]}],
    "all around": [{"kind": "ring", "inner_diameter_deg": 60.0, "outer_diameter_deg": 150.0}],
}


@pytest.mark.parametrize("targets", TARGETS.values(), ids=list(TARGETS))
@pytest.mark.parametrize("scatter", SCATTER.values(), ids=list(SCATTER))
@pytest.mark.parametrize("source", SOURCES.values(), ids=list(SOURCES))
def test_no_light_is_above_its_bound(source: Any, scatter: Any, targets: Any) -> None:
    """Of spheres about the LED whose second face scatters, or both, whatever light an LED has."""
    far_field = {"kind": "far_field", "half_angle_deg": 90.0, "targets": targets}
    for faces in (("outer",), ("inner", "outer")):
        lens = {"refractive_index": 1.4936, "inner": {"offset_mm": 3.0}, "outer": {"offset_mm": 6.0}}
        for face in faces if scatter else ():
            lens[face] |= {"scatter": scatter}
        spec = spec_of(source=source, lens=lens, constraints=ROOM, receivers=[far_field])
        light = lf.evaluate(starting_lens(spec), rays=2**12, pixels=48)
        require_possible(light)
        if scatter == SCATTER["opal"] and len(faces) == 2:  # each face turns it by up to a right angle
            assert light.share_in_target.value > 0.0
        SceneCheck.of(spec, build_source(spec.source)).require_light(force=True)


def test_an_opal_lens_is_not_refused_what_no_two_refractions_would_turn() -> None:
    """Of the same two faces, polished ones turn no light of this LED to the target; a mirror's paint scatters none."""
    far_field = {"kind": "far_field", "half_angle_deg": 90.0, "targets": TARGETS["on the other side"]}
    spec = spec_of(
        source=SOURCES["narrow and tilted"], constraints=ROOM, receivers=[far_field],
        lens={"refractive_index": 1.4936, "inner": {"offset_mm": 3.0}, "outer": {"offset_mm": 6.0}},
    )  # fmt: skip
    for scatter, most in (("polished", 0.0), ("frosted", 0.0), ("opal", normal_transmittance(1.4936) ** 2)):
        case = spec if scatter == "polished" else spec.replace({"lens.outer.scatter": SCATTER[scatter]})
        bound = share_of(case)
        assert bound.by_refraction == pytest.approx(most, abs=1e-3), scatter
        check = SceneCheck.of(case, build_source(case.source))
        if most > 0.0:
            check.require_light()
            continue
        with pytest.raises(InputError, match="deflection and loss of two refractions"):
            check.require_light()


def test_an_estimate_of_the_luminance_is_no_bound_and_refuses_nothing() -> None:
    """What chips are known to hold, by pi r^2 sin^2 of their etendue, is no more than guessed of their rays."""
    sections: dict[str, Any] = {
        "constraints": ROOM | {"max_radius_mm": 3.0}, "evaluate": {"pixels": 32},
        "lens": {"refractive_index": 1.4936, "inner": {"offset_mm": 1.5}, "outer": {"offset_mm": 2.5}},
        "target": {"kind": "disc", "diameter_deg": 2.0, "half_angle_deg": 10.0},
    }  # fmt: skip
    chips = spec_of(source=HOT_CHIPS, **sections)
    rays = spec_of(source=hot_rays(2**12), **sections)
    known = share_of(chips)
    bound = share_of(rays)
    transmitted = normal_transmittance(1.4936) ** 2
    radiance = 0.9 / (math.pi * 0.2**2) + 0.1 / (math.pi * 2.0**2)  # of the place where both are
    etendue = math.pi * 3.0**2 * math.pi * math.sin(math.radians(1.0)) ** 2
    assert known.by_etendue == pytest.approx(transmitted * radiance * etendue, rel=0.05)
    assert known.value == known.certain == known.by_etendue and not known.is_estimate
    assert bound.is_estimate and bound.value == bound.by_etendue < 0.5 * bound.certain
    assert bound.certain == pytest.approx(known.by_refraction, rel=0.02)
    light = lf.evaluate(starting_lens(rays), rays=2**12).first
    assert light.possible.share_in_target == pytest.approx(bound.certain, rel=1e-6) and light.possible.nmse == 0.0
    assert light.possible.estimate.share_in_target == pytest.approx(bound.value, rel=0.02)
    assert lf.evaluate(starting_lens(chips), rays=2**12).first.possible.estimate is None
    with pytest.raises(InputError, match=r"upper bound .*\(étendue\)"):
        SceneCheck.of(chips, build_source(chips.source)).require_light()
    check = SceneCheck.of(rays, build_source(rays.source))
    check.require_light()
    assert check.warnings()[0].startswith(
        "target: by an estimate of the source's luminance, which is no bound, at most"
    )


def starting_lens(spec: Spec) -> Lens:
    return Lens(start_faces(spec), spec, 0, FEW)


@pytest.mark.parametrize("path", [path for path in SCENES if path.stem in KINDS], ids=lambda path: path.stem)
def test_the_starting_lens_of_each_kind_of_scene_keeps_the_bounds(path: Path) -> None:
    require_possible(lf.evaluate(starting_lens(load_spec(path)), rays=2**13, pixels=32))


@pytest.mark.nightly("drafts of all shipped specs take half an hour")
@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_a_draft_of_each_shipped_scene_keeps_the_bounds(path: Path) -> None:
    require_possible(lf.evaluate(lf.design(load_spec(path), accuracy="draft").lens))


def below(cosine: float) -> float:
    """Share of a Lambertian source's light whose direction has less than this along y."""
    return 0.5 + (cosine * math.sqrt(1.0 - cosine**2) + math.asin(cosine)) / math.pi


def test_profiles_drawn_along_y_bring_light_to_no_band_that_its_directions_along_y_miss() -> None:
    """On a plane so wide that no ray need turn across the band, and by directions; the band lies beside the axis."""
    far_mm, cell_mm, section_mm = 1e5, 5e3 * math.sqrt(2.0), 5.0
    receiver = plane(2e6, 400, far_mm)
    band = whole(receiver)
    y = (np.arange(400) + 0.5) * 5e3 - 1e6
    band[(y < -2e4) | (y > 6e4)] = False
    physics = replace(possible(receiver, 300.0, 1.5), space=DrawnBall(300.0, section_mm))
    near_mm = far_mm - cell_mm - section_mm
    low, high = ((place + sign * cell_mm) / near_mm for place, sign in ((-2e4, -1.0), (6e4, 1.0)))
    share = below(high / math.hypot(high, 1.0)) - below(low / math.hypot(low, 1.0))
    bound = physics.in_region(band)
    assert bound.by_refraction == pytest.approx(normal_transmittance(1.5) ** 2 * share, abs=2e-3)
    assert bound.law == "deflection and loss of faces drawn along y"
    assert possible(receiver, 300.0, 1.5).in_region(band).by_refraction > 1.5 * bound.by_refraction
    dome = Media(Medium(1.5), bodies=(SecondaryOptic("dome", Medium(1.5), sphere(310.0), sphere(312.0)),))
    assert "profiles" not in replace(physics, light=replace(physics.light, media=dome)).in_region(band).law


def test_light_through_profiles_stays_below_its_bound() -> None:
    """Of an LED beside the origin onto a field that lies to the other side of it."""
    spec = small_spec(
        source={"kind": "square", "side_mm": 1.0, "position_mm": [0.2, 0.4, 0.0]},
        lens={"kind": "extruded", "length_mm": 60.0, "ends": "free", "profile": 9},
        target={"kind": "rectangle", "width_mm": 200.0, "height_mm": 30.0, "centre_mm": [10.0, -40.0],
                "distance_mm": 100.0, "receiver_mm": 300.0},
        optimise__steps_per_level=[1], base={"kind": "none"},
    )  # fmt: skip
    (light,) = lf.evaluate(Lens(start_faces(spec), spec, 0, FEW), rays=2**15, pixels=100).receivers
    assert 0.1 < light.share_in_target.value < light.possible.share_in_target < 0.35
