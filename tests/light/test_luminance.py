"""Luminance of the lens as eyes see it: by light sent the other way, at closed forms, and as limits judge it."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import torch
from presets import FEW
from scenes import small_spec
from scipy.signal import fftconvolve

import lensforge as lf
from lensforge.errors import InputError
from lensforge.kernels.fate import Fate
from lensforge.light.evaluation_result import Light
from lensforge.light.table_trace import Scene, trace_tables
from lensforge.optics.efficacy import Efficacy
from lensforge.report.light_section import receiver_pictures
from lensforge.report.results import Results
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.eye_view import EyeView, RingView, eye_views
from lensforge.scene.limit_readings import light_limits
from lensforge.scene.pixel_grid import bin_flux
from lensforge.search.limit_terms import LimitTerm
from lensforge.search.merit import MeritFunction
from lensforge.search.parameters import SphereParameters
from lensforge.search.scene_symmetry import settled_symmetry
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.bicubic_table import grid_for, tabulate

# mm; the outer sphere magnifies the LED
SIDE = 1.6
INNER = 2.2
OUTER = 6.0
RAISED = 1.5
INDEX = 1.5
SOURCE = {"kind": "square", "side_mm": SIDE, "flux_w": 2.0, "position_mm": [0.5, -0.3, 0.5], "tilt_deg": [20.0, -12.0]}
RADIANCE = 2.0 / (np.pi * (1e-3 * SIDE) ** 2)  # of a Lambertian square
LIMIT = {"kind": "luminance", "at_most": 0.5 * RADIANCE, "unit": "w_per_m2_sr"}
NEAR = (-20.0, 14.0, 30.0)
BESIDE = (6.0, -25.0, 3.0)
FAR = (30.0, 10.0)


def crooked(*limits: dict[str, object], **more: object) -> Spec:
    """A small beam from an LED beside the axis that is tilted, and limits."""
    lens = {"levels": [9, 25], "refractive_index": INDEX, "inner": {"offset_mm": INNER}, "outer": {"offset_mm": 7.0}}
    spec = small_spec(source=SOURCE, lens=lens, evaluate={"rays": 2**20, "pixels": 16}, constraints={
        "cavity_height_mm": 0.5, "cavity_radius_mm": 1.0, "min_thickness_mm": 1.0, "max_radius_mm": 8.0})  # fmt: skip
    return spec.replace(limits=[LIMIT | limit for limit in limits], **more)


def balls(spec: Spec) -> lf.Lens:
    """Spheres: the cavity about the origin, and the outer face higher."""
    return lf.Lens.double(sphere(INNER), sphere(OUTER, RAISED), spec, 0, FEW)


def passed(d: np.ndarray, normals: np.ndarray, ratio: float) -> tuple[np.ndarray, np.ndarray]:
    """Directions behind a face by Snell's law in vectors, and the share that passes it by Fresnel's formulas.

    ``normals`` are along the light, ``ratio``: of the index before to that behind.
    """
    cosine = (d * normals).sum(axis=1)
    square = 1.0 - ratio**2 * (1.0 - cosine**2)
    behind = np.sqrt(np.maximum(square, 1e-30))
    s = (ratio * cosine - behind) / (ratio * cosine + behind)
    p = (cosine - ratio * behind) / (cosine + ratio * behind)
    share = np.where(square > 0.0, 1.0 - 0.5 * (s**2 + p**2), 0.0)
    return ratio * d + (behind - ratio * cosine)[:, None] * normals, share


def to_sphere(p: np.ndarray, d: np.ndarray, centre: np.ndarray, radius: float, sign: float) -> tuple[np.ndarray, ...]:
    """First (-1) or last (1) points of lines on a sphere, their unit normals, and whether they meet it."""
    away = p - centre
    half = (away * d).sum(axis=1)
    square = half**2 - (away**2).sum(axis=1) + radius**2
    points = p + (sign * np.sqrt(np.maximum(square, 0.0)) - half)[:, None] * d
    return points, (points - centre) / radius, (square > 0.0) & (points[:, 2] > 0.0)


def radiance_backwards(points: np.ndarray, directions: np.ndarray, spec: Spec) -> np.ndarray:
    """Radiance along lines: from the eye into the balls, through the cavity, and down to the LED or beside it."""
    d = -directions
    pose = spec.source.pose
    p, normals, met = to_sphere(points, d, np.array([0.0, 0.0, RAISED]), OUTER, -1.0)
    d, first = passed(d, -normals, 1.0 / INDEX)
    p, normals, cavity = to_sphere(p, d, np.zeros(3), INNER, -1.0)
    d, second = passed(d, -normals, INDEX)
    local = pose.to_local_points(p)
    along = pose.to_local_directions(d)
    hits = local[:, :2] - (local[:, 2] / along[:, 2])[:, None] * along[:, :2]
    lit = met & cavity & (along[:, 2] < 0.0) & (np.abs(hits) < 0.5 * spec.source.side_mm).all(axis=1)
    return np.where(lit, RADIANCE * first * second, 0.0)


def seen_backwards(view: EyeView, spec: Spec, times: int = 400) -> np.ndarray:
    """Radiance of each pixel towards the eye: means over lines from places in it."""
    rng = np.random.default_rng(1)
    grid = view.grid
    picture = np.zeros(grid.shape)
    for row, y in enumerate(grid.y()):
        x = np.repeat(grid.x(), times)
        at = np.stack([x, np.full_like(x, y), 0.0 * x], axis=1)
        at[:, :2] += (rng.random((len(x), 2)) - 0.5) * grid.pixel
        e = np.array([0.0, 0.0, view.distance_mm]) - at
        e /= np.linalg.norm(e, axis=1, keepdims=True)
        light = radiance_backwards(view.pose.points(at), view.pose.directions(e), spec)
        picture[row] = light.reshape(-1, times).mean(axis=1)
    return picture


def brightest_disc(view: EyeView, spec: Spec) -> float:
    """Largest mean over a disc as wide as a spot, about any of many places."""
    fine = replace(view, grid=view.grid.finer(4))
    picture = seen_backwards(fine, spec, 3)
    pixel = fine.grid.pixel[0]
    reach = int(np.ceil(0.5 * view.spot_mm / pixel))
    across = np.arange(-reach, reach + 1) * pixel
    disc = np.hypot(across, across[:, None]) <= 0.5 * view.spot_mm
    return float(fftconvolve(picture, disc / disc.sum(), mode="same").max())


def test_the_picture_is_that_of_light_sent_from_the_eye_to_the_led() -> None:
    """Of two eyes near the lens, and one far away; the LED is shifted and tilted, and magnified."""
    spec = crooked({"eyes_mm": [NEAR, BESIDE], "blur_deg": 4.0, "spot_deg": 3.0},
                   {"eyes_deg": [FAR], "blur_deg": 4.0, "spot_mm": 1.5})  # fmt: skip
    light = lf.evaluate(balls(spec), accuracy=FEW)
    for view, seen in zip(eye_views(spec), light.seen, strict=True):
        exact = view.spots() @ seen_backwards(view, spec).ravel()
        assert exact.max() > 0.1 * RADIANCE and seen.label == view.label
        apart = np.linalg.norm(seen.map.ravel() - exact) / np.linalg.norm(exact)
        assert apart < 0.03 and seen.map.sum() == pytest.approx(exact.sum(), rel=0.02)
        assert seen.map.max() == pytest.approx(exact.max(), rel=0.04)


def of_a_small_led(blur_deg: float) -> Spec:
    small = {"side_mm": 0.4, "flux_w": 2.0 * (0.4 / SIDE) ** 2}
    eyes = [{"eyes_mm": [NEAR, BESIDE], "spot_mm": 0.5}, {"eyes_deg": [FAR], "spot_mm": 0.5}]
    return crooked(*(eye | {"blur_deg": blur_deg} for eye in eyes), source=small)


@cache
def brightest_discs() -> tuple[float, ...]:
    """Brightest disc of the image of the small LED for each eye, which no blur changes."""
    spec = of_a_small_led(5.0)
    return tuple(brightest_disc(view, spec) for view in eye_views(spec))


@pytest.mark.parametrize("blur_deg", [4.0, 6.0])
def test_the_image_of_a_small_led_is_as_bright_as_it_is(blur_deg: float) -> None:
    """Its image is narrower than the blur: rays beside the eye, counted where they pass, made it up to 16 % darker."""
    light = lf.evaluate(balls(of_a_small_led(blur_deg)), accuracy=FEW)
    for exact, limit in zip(brightest_discs(), light.limits, strict=True):
        assert abs(limit.value - exact) < 3.0 * limit.standard_error < 0.15 * exact, limit.key


@pytest.mark.parametrize("blur", [0.5, 4.0, 25.0])
def test_a_surface_of_one_luminance_to_all_sides_keeps_it_exactly(blur: float) -> None:
    """An element of any tilt in the plane of the picture, by Gauss's rule over the cap of the kernel."""
    (view,) = eye_views(crooked({"eyes_mm": [NEAR], "blur_deg": blur, "spot_mm": 1.0}))
    place = np.array([2.0, -3.0, 0.0])
    normal = np.array([0.3, -0.2, 0.9])
    e = np.array([0.0, 0.0, view.distance_mm]) - place
    e /= np.linalg.norm(e)
    h = 1.0 - np.cos(view.blur_rad)
    (nodes, weights) = np.polynomial.legendre.leggauss(4)
    side = np.cross(e, normal) / np.linalg.norm(np.cross(e, normal))
    cosine, turn = (
        coordinates.ravel() for coordinates in np.meshgrid(1.0 - 0.5 * h * (nodes + 1.0), 0.25 * np.pi * np.arange(8))
    )
    d = cosine[:, None] * e + np.sqrt(1.0 - cosine**2)[:, None] * (
        np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * np.cross(e, side)
    )
    flux = 3.0 * d @ normal * np.tile(0.5 * h * weights, 8) * 0.25 * np.pi  # of an area of 1, L = 3
    there = np.tile(view.pose.points(place), (32, 1))
    fates = np.full(32, Fate.LEFT_LENS, dtype=np.int8)
    landed = view.land(ExitRays(there, view.pose.directions(d), flux, flux, fates))
    assert landed.flux.sum() == pytest.approx(3.0 * (normal @ e) / e[2], rel=1e-9), "L times the area that is covered"
    assert np.allclose(landed.hits, place[:2], atol=1e-9) and landed.arrived.all()
    assert not view.land(ExitRays(there, -view.pose.directions(d), flux, flux, fates)).arrived.any()


def test_the_picture_is_upright_and_a_spot_is_the_mean_over_a_disc() -> None:
    """From the right of the lens its +y is to the right, its axis up; of several lamps the first one is seen."""
    beside = crooked({"eyes_deg": [(60.0, 0.0)], "spot_mm": 2.5})
    (view,) = eye_views(beside)
    sine = 0.5 * 3.0**0.5
    cosine = 0.5
    assert np.allclose(view.pose.axes, [[0.0, 1.0, 0.0], [-cosine, 0.0, sine], [sine, 0.0, cosine]])
    spots = view.spots()
    pixel = view.grid.pixel[0]
    middle = spots[view.grid.columns * (view.grid.rows // 2) + view.grid.columns // 2]
    assert middle.sum() == pytest.approx(1.0)
    centres = np.stack(np.meshgrid(view.grid.x(), view.grid.y()), axis=-1).reshape(-1, 2)
    away = np.linalg.norm(centres - middle @ centres, axis=1)
    disc = np.pi * (1.25**2 - 2.0 / 3.0 * pixel**2)  # whose pixels are as broad as the spot
    assert middle.max() == pytest.approx(pixel**2 / disc, rel=0.03), "whole pixels are within"
    distances = np.linalg.norm(centres - middle @ centres, axis=1)
    assert 0.5 * (middle @ distances**2) + pixel**2 / 12.0 == pytest.approx(1.25**2 / 4.0, rel=0.01)
    assert away[middle.toarray().ravel() > 0.0].max() < 1.25 + 0.75 * pixel
    centre = centres[view.grid.columns * (view.grid.rows // 2) + view.grid.columns // 2]
    assert np.abs(middle @ centres - centre).max() < 1e-9 * pixel, "about the centre of its pixel"
    turned = {"kind": "table", "places_mm": [[50.0, 8.0], [0.0, 0.0]], "turns_deg": [90.0, 0.0]}
    first = crooked({"eyes_mm": [(50.0, 18.0, 40.0)]} | {"spot_mm": 1.0}, lamps=turned)
    alone = crooked({"eyes_mm": [(10.0, 0.0, 40.0)]} | {"spot_mm": 1.0})
    assert np.allclose(eye_views(first)[0].pose.frame, eye_views(alone)[0].pose.frame)


def test_each_eye_is_judged_and_the_second_decides() -> None:
    """On both sides of a bound; in cd/m² where the lumens are known."""
    eyes = {"eyes_mm": [BESIDE, NEAR], "blur_deg": 6.0, "spot_deg": 3.0, "name": "desk"}
    lens = balls(crooked(eyes))
    dim, bright = lf.evaluate(lens, accuracy=FEW).limits
    assert [eye.key for eye in (dim, bright)] == [
        "desk, seen from (6, -25, 3) mm",
        "desk, seen from (-20, 14, 30) mm",
    ]
    assert 0.0 < bright.standard_error < 0.02 * bright.value and dim.value < 0.9 * bright.value
    for bound, states in ((0.5 * (dim.value + bright.value), ["pass", "fail"]), (1.1 * bright.value, ["pass"] * 2)):
        spec = crooked(eyes | {"at_most": 200.0 * bound, "unit": "cd_per_m2"})
        spec = spec.replace(source={"luminous_efficacy_lm_per_w": 200.0})
        light = lf.evaluate(balls(spec), accuracy=FEW)
        assert [limit.state for limit in light.limits] == states
        assert light.limits[1].value == pytest.approx(200.0 * bright.value, rel=1e-9)
    unknown = crooked(eyes | {"unit": "cd_per_m2"})
    with pytest.raises(InputError, match=r"^limits.0: its bound is in cd/m², but .* not known; give source.flux_lm"):
        lf.evaluate(balls(unknown), accuracy=FEW)


def around(spec: Spec) -> RingView:
    (view,) = eye_views(spec)
    assert isinstance(view, RingView)
    return view


RING = {"from_deg": 65.0, "spot_mm": 2.5, "blur_deg": 4.0, "name": "room"}


def test_eyes_all_around_are_judged_by_the_one_that_sees_most() -> None:
    """The LED is tilted to one side, and light sent back from every eye tells which it is; on both sides of a bound."""
    few = {"rays": 2**17}
    spec = crooked(RING, evaluate=few)
    ring = around(spec)
    angles = [np.degrees(np.arccos(eye.pose.axis[2])) for eye in ring.eyes]
    assert np.allclose(angles, [65.0] * 24 + [80.0] * 24)
    assert np.allclose(ring.eyes[6].pose.axis, [0.0, np.sin(np.radians(65.0)), np.cos(np.radians(65.0))], atol=1e-6)
    (limit,) = (light := lf.evaluate(balls(spec), accuracy=FEW)).limits
    (seen,) = light.seen
    assert limit.key == "room, seen from 65° up, all around" and limit.note == "luminance of the brightest spot"
    exact = [(eye.spots() @ seen_backwards(eye, spec, 1).ravel()).max() for eye in ring.eyes]
    assert limit.value == pytest.approx(max(exact), abs=3.0 * limit.standard_error)
    assert exact[[eye.label for eye in ring.eyes].index(seen.label)] > 0.9 * max(exact) > 1.1 * exact[0]
    bounds = [RING | {"at_most": factor * limit.value, "name": f"{factor}"} for factor in (0.8, 1.2)]
    bounded = lf.evaluate(balls(crooked(*bounds, evaluate=few)), accuracy=FEW)
    assert [bound.state for bound in bounded.limits] == ["fail", "pass"]


def test_the_picture_of_a_ring_holds_those_of_its_eyes() -> None:
    """Pictures, spots and the slope of the search are as for an eye alone, those of the second above the first's."""
    spec = crooked(RING)
    ring = around(spec)
    rays = build_source(spec.source).sample(2**14, 3)
    grid = grid_for(0.4, 8.0)
    faces = [tabulate(grid, face) for face in balls(spec).surfaces.values()]
    exits = trace_tables(faces, Scene(spec.lens.media, grid), rays)
    landed = ring.land(exits)
    parts = np.split(bin_flux(landed.hits, landed.flux, ring.grid), len(ring.eyes))
    rng = np.random.default_rng(4)
    by_hits = rng.normal(size=landed.hits.shape)
    by_flux = rng.normal(size=len(rays))
    gradients, of_flux = ring.adjoint(exits, by_hits, by_flux)
    points = np.zeros_like(exits.points)
    fluxes = np.zeros(len(rays))
    for eye, part in zip(ring.eyes, parts, strict=True):
        landing = eye.land(exits)
        np.testing.assert_allclose(part, bin_flux(landing.hits, landing.flux, eye.grid), atol=1e-12)
        by, flux = eye.adjoint(exits, by_hits * landing.arrived[:, None], by_flux * landing.arrived)
        points += by.by_points
        fluxes += flux
    np.testing.assert_allclose(gradients.by_points, points)
    np.testing.assert_allclose(of_flux, fluxes)
    spots = (ring.spots() @ np.concatenate(parts).ravel()).reshape(len(ring.eyes), -1)
    np.testing.assert_allclose(spots[1], ring.eyes[1].spots() @ parts[1].ravel())


def test_the_mean_is_judged_and_none_is_asked_above_that_of_the_source() -> None:
    """Of a bound on both sides of it; a lens loses two faces' reflections at least."""
    eyes = {"eyes_deg": [FAR], "spot_mm": 1.5, "of": "mean", "at_most": 1e9}
    light = lf.evaluate(balls(crooked(eyes)), accuracy=FEW)
    (limit,) = light.limits
    (seen,) = light.seen
    assert limit.value == pytest.approx(seen.mean.value, rel=1e-9) and limit.note == "mean luminance over the outline"
    for factor, states in ((0.8, ["pass", "pass"]), (1.2, ["fail", "pass"])):
        spec = crooked(eyes | {"at_least": factor * limit.value})
        assert [limit.state for limit in lf.evaluate(balls(spec), accuracy=FEW).limits] == states
    bright = crooked(eyes | {"at_least": 2.1 * 0.96**2 * RADIANCE}, source={"position_mm": [0.1, 0.2, -0.5]})
    with pytest.raises(
        InputError, match=r"limits.0, seen from .* upper bound 2.29e\+05 W/\(m² sr\) \(étendue\).* brighter"
    ):
        lf.design(bright, accuracy=FEW)


def test_the_search_sees_the_mean_over_the_outline_of_the_lens_of_each_step() -> None:
    """The intensity of its eye over the area that a trace of the same faces finds."""
    spec = crooked({"eyes_deg": [FAR], "spot_mm": 1.5, "of": "mean"})
    seen = []
    source = build_source(spec.source)
    parameters = SphereParameters.of(spec, 4.0)
    for of in ("mean", "peak"):
        merit = MeritFunction.of(
            spec.replace(limits=[LIMIT | {"eyes_deg": [FAR], "spot_mm": 1.5, "of": of}]), source, parameters
        )
        tables = parameters.tables(*parameters.start())
        seen.append(merit.light_of(tables, source.sample(2**14, 0)).images[-1])
    (view,) = merit.light.receivers[1:]
    (limit,) = light_limits(spec, (), Efficacy(), 2.0, (replace(view, of_mean=True),))
    area = view.outline_mm2(trace_tables(tables.numpy(), merit.light.scene, source.sample(2**14, 1)))
    assert np.pi * 5.0**2 < area < np.pi * 7.0**2
    assert (seen[1] / seen[0]).nanmean().item() == pytest.approx(area, rel=0.03)
    mean = limit.of(seen[0].numpy()[None]).item()
    assert mean == pytest.approx(1e6 * seen[1].sum().item() / area, rel=0.03)


def test_the_page_shows_the_lens_as_seen_and_its_mean_over_the_outline(tmp_path: Path) -> None:
    spec = crooked({"eyes_deg": [FAR], "spot_mm": 1.5}, evaluate={"rays": 2**16})
    lens = balls(spec)
    light = lf.evaluate(lens, accuracy=FEW)
    light.write(tmp_path)
    assert Light.read(tmp_path) == light
    (seen,) = light.seen
    intensity = seen.mean.value * seen.outline_mm2 * 1e-6  # W/sr
    (view,) = eye_views(spec)
    pixel = 1e-6 * view.grid.pixel[0] ** 2
    assert intensity == pytest.approx(seen.map.sum() * pixel, rel=0.02), "spots at the edge reach beyond the picture"
    assert np.pi * 5.0**2 < seen.outline_mm2 < np.pi * OUTER**2, "a part of the outer sphere"
    results = Results(lens, {"evaluate": light}, {})
    *_, pictures = receiver_pictures(results)
    assert pictures.heading == "The lens as seen" and [picture.title for picture in pictures.seen] == ["From (30, 10)°"]
    (group,) = (shown for shown in results.facts(light) if shown.key == "seen")
    assert group.facts[0].value == seen.mean.value and group.facts[0].unit == "W/(m² sr)"


def test_the_search_pays_for_spots_above_the_bound_alone() -> None:
    """Of a picture of one radiance; and the symmetry of a lens does not ask where eyes are."""
    spec = crooked({"eyes_mm": [NEAR], "at_most": 10.0, "spot_mm": 0.5})
    views = eye_views(spec, searched=True)
    (limit,) = light_limits(spec, (), Efficacy(), 1.0, views)
    assert views[0].spot_mm == pytest.approx(views[0].grid.width / 16.0) and views[0].blur_rad == np.radians(5.0)
    term = LimitTerm.of(limit)
    ones = torch.full(views[0].grid.shape, views[0].pixel_measure, dtype=torch.float64)
    inside = np.isclose(limit.of(ones.numpy()[None]), 1.0)  # at the edge a spot is in part beyond the picture
    assert inside.mean() > 0.7
    images = (ones, 9.3 * ones)
    assert term.loss(images).item() == 0.0
    loss = term.loss((ones, 12.0 * ones)).item()
    excess = np.maximum(limit.of(12.0 * ones.numpy()[None]) / 10.0 - 0.94, 0.0)
    assert loss == pytest.approx(300.0 * np.mean(excess**2 / (1.0 + excess)))
    square = small_spec(lens__symmetry="auto")
    looked_at = square.replace(limits=[LIMIT | {"eyes_deg": [FAR], "spot_mm": 1.0}])
    source = build_source(square.source)
    assert (
        settled_symmetry(looked_at, source).lens.symmetry == settled_symmetry(square, source).lens.symmetry == "square"
    )


@pytest.mark.parametrize(("eye", "message"), [
    ((1.0, 2.0, 7.0), r"it lies in the lens's space, to 8.4 mm; move it farther away"),
    ((0.0, 0.0, 100.0), r"a spot of 0.028 mm is too fine .* give spot_mm = 0.08\d or more"),
])  # fmt: skip
def test_an_eye_that_sees_no_picture_is_refused_in_one_line(eye: tuple[float, ...], message: str) -> None:
    with pytest.raises(InputError, match=rf"^limits.0, seen from .* mm: {message}[^\n]*$"):
        eye_views(crooked({"eyes_mm": [eye]}))
