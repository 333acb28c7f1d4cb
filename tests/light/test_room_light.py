"""The light of lenses in a room: budgets, photometry, a receiver in its floor, and the same light by the proof."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scenes import small_spec
from test_scene_light import LAMPS, POST, WHITE, lens_of

import lensforge as lf
from lensforge.light.lens_light import searched_source
from lensforge.light.replicate_rays import ReplicateRays
from lensforge.light.simulation import TracedLens
from lensforge.made.part_light import PartLight
from lensforge.optics.efficacy import UNKNOWN
from lensforge.proof.proof_inputs import independent_light, screens_of
from lensforge.proof.sequential_cast import CastFate, Passage
from lensforge.scene.body_view import body_views
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.limit_readings import light_limits
from lensforge.scene.pixel_grid import bin_flux
from lensforge.scene.receiver_shapes import receivers_of, seen_by_lamp
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec import Spec

GIVEN: dict[str, Any] = {
    "kind": "room", "name": "room", "size_mm": [400.0, 300.0, 240.0], "centre_mm": [12.0, -30.0, 85.0],
    "tilt_deg": [8.0, -13.0], "rotate_z_deg": 30.0, "patch_mm": 40.0,
    "surface": "diffuse", "reflectance": 0.5, "floor_reflectance": 0.3, "ceiling_reflectance": 0.0,
}  # fmt: skip


def room_spec(**more: Any) -> Spec:
    return small_spec(scene=[GIVEN, POST | WHITE], **more)


def ways(events: int = 1, count: int = 4000) -> tuple[ExitRays, Passage]:
    """Rays from about a lens into all directions, for the design and for the proof."""
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(count, 3)) + np.array([0.0, 0.0, 0.8])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = 5.0 * directions + rng.normal(size=(count, 3))
    flux = rng.random(count)
    draws = rng.random((count, 2 * events))
    exits = ExitRays(points, directions, flux, flux, np.zeros(count, dtype=np.int8), draws=draws)
    passage = replace(
        Passage.of(RayBundle(points, directions, flux), 0), points=points, directions=directions, draws=draws,
        fates=np.full(count, CastFate.LANDED),
    )  # fmt: skip
    return exits, passage


@pytest.mark.parametrize("lamps", [None, LAMPS], ids=["one lamp", "the second of two lamps"])
def test_the_proof_has_the_light_of_a_room(lamps: dict[str, Any] | None) -> None:
    """Ray by ray on a receiver before the floor, by its own walk; every ray lands or is lost."""
    spec = room_spec(lamps=lamps)
    spec = spec if lamps is None else seen_by_lamp(spec, 1)
    exits, passage = ways()
    (receiver,) = receivers_of(spec, 16)
    (screen,) = screens_of(spec)
    designed = receiver.land(exits)
    cast = passage.landed(screen)
    assert designed.shadow is not None and not designed.missed_receiver.any()
    assert ((cast.fates == CastFate.SECOND_WALL) == designed.shadow.again).all() and designed.shadow.again.sum() > 500
    assert ((cast.fates == CastFate.HOUSING) == (designed.shadow.onward == 0.0)).all()
    assert cast.flux == pytest.approx(exits.flux * designed.shadow.onward)
    landed = designed.landed
    assert (landed & designed.shadow.met).sum() > 200
    assert cast.landings[landed] == pytest.approx(designed.hits[landed], rel=1e-9, abs=1e-8)
    assert np.isnan(cast.landings[~landed]).all()


@pytest.mark.parametrize("events", [1, 4])
def test_the_proof_has_the_light_of_every_side(events: int) -> None:
    """Patch by patch: direct, and by way of the other sides, the post and itself."""
    spec = room_spec(scene_events=events)
    exits, passage = ways(events)
    lens = lens_of(spec)
    light = lf.evaluate(lens, rays=2**12)
    bodies = independent_light(lens, searched_source(spec), light, 16).bodies
    views = body_views(spec)
    assert [body.name for body in bodies] == [view.name for view in views] == [body.name for body in light.on_bodies]
    assert len(views) == 6
    for body, view in zip(bodies, views, strict=True):
        landings = view.land(exits)
        designed = bin_flux(landings.hits, landings.flux, view.grid)[0]
        assert (landings.again is None) == (events == 1 or view.name == "room-ceiling")
        if landings.again is not None:
            designed += bin_flux(landings.again.hits, landings.again.flux, view.grid)[0]
        on_patches, *_ = body._on_patches(passage)
        assert on_patches == pytest.approx(designed, rel=1e-9, abs=1e-9 * exits.flux.sum())
        assert designed.sum() > 10.0


def test_the_budget_of_a_room_is_whole() -> None:
    """All light that leaves the lens lands before the floor, or sides and bodies take it, each under its name."""
    light = lf.evaluate(lens_of(room_spec()), rays=2**13)
    (receiver,) = light.receivers
    assert sum(receiver.flux.model_dump().values()) == pytest.approx(1.0, abs=1e-12)
    assert receiver.missed_by_cause.missed_receiver == 0.0
    taken = {body.name: body.share.value for body in receiver.blocked}
    assert sum(taken.values()) == pytest.approx(receiver.flux.housing, abs=1e-12)
    assert {"post", "room-wall-1", "room-wall-3"} <= set(taken) and receiver.flux.second_wall > 1e-3
    assert "room-floor" not in taken, "light lands before it"


EVEN = {name: value for name, value in GIVEN.items() if not name.startswith(("floor", "ceiling"))} | {
    "reflectance": 0.8
}


@pytest.mark.parametrize("lamps", [None, LAMPS], ids=["one lamp", "two lamps"])
def test_the_sides_of_an_even_room_together_have_a_geometric_series(lamps: dict[str, Any] | None) -> None:
    """All light that leaves a lens comes to a side, and 0.8 of it to a further one, three times."""
    light = lf.evaluate(lens_of(small_spec(scene=[EVEN], scene_events=3, lamps=lamps)), rays=2**12)
    flux = light.receivers[0].flux
    left = flux.detected + flux.outside + flux.housing + flux.second_wall
    on_sides = sum(1e-6 * body.area_mm2 * body.mean.value for body in light.on_bodies)
    lamps_w = 1.0 if lamps is None else 2.0
    assert on_sides == pytest.approx(lamps_w * left * (1.0 + 0.8 + 0.8**2 + 0.8**3), rel=1e-6)


def test_the_parts_of_a_yield_have_the_same_series() -> None:
    """In the pictures of all sides together, by the rays that parts share."""
    limit = {"kind": "body", "body": "room-floor", "of": "mean", "at_least": 0.1, "unit": "w_per_m2"}
    spec = small_spec(scene=[EVEN], scene_events=3, limits=[limit])
    source = searched_source(spec)
    held = ReplicateRays.of(source, 2**11, 3)
    receivers = receivers_of(spec, 16)
    limits = tuple(light_limits(spec, receivers, UNKNOWN, source.flux_w))
    light = PartLight(spec, TracedLens.of(lens_of(spec), 3.0), receivers, limits, held)
    exits = light.exit_rays(None)
    pictures = [seen.images for seen in light.seen(exits, held, 1.0)]
    left = np.bincount(held.replicate, exits.flux * exits.left_lens)
    series = 1.0 + 0.8 + 0.8**2 + 0.8**3
    assert len(pictures) == 6
    assert sum(picture.sum(axis=(1, 2)) for picture in pictures) == pytest.approx(series * left, rel=1e-6)


def test_a_lens_lights_the_floor_as_a_receiver_in_it_and_as_a_body() -> None:
    """Of a black room without a post: the flux on the plane in its surface is that on the patches."""
    black = {name: value for name, value in GIVEN.items() if "reflectance" not in name} | {"surface": "black"}
    spec = small_spec(scene=[black])
    (room,) = spec.scene
    at = room.pose.points(np.array([[0.0, 0.0, 120.0]]))[0]
    plane = {
        "kind": "plane", "centre_mm": at, "normal": room.pose.axis, "width_mm": 700.0, "height_mm": 700.0,
        "targets": [{"kind": "disc", "diameter_mm": 90.0}],
    }  # fmt: skip
    lens = lens_of(small_spec(target=None, receivers=[plane], scene=[black]))
    light = lf.evaluate(lens, rays=2**14)
    (receiver,) = light.receivers
    floor = next(body for body in light.on_bodies if body.name == "room-floor")
    emitted_w = searched_source(spec).flux_w
    on_floor = floor.mean.value * 1e-6 * floor.area_mm2 / emitted_w
    assert receiver.efficiency.value + receiver.flux.outside == pytest.approx(on_floor, abs=1e-9) and on_floor > 0.3
    assert receiver.flux.second_wall == 0.0


def test_photometric_files_hold_the_lamp_without_its_room() -> None:
    """The same intensities, to the last bit, and nothing blocked."""
    alone, inside = (lf.photometry(lens_of(small_spec(scene=scene)), rays=2**13) for scene in ([], [GIVEN]))
    assert inside.lost_w.housing == inside.lost_w.second_wall == 0.0
    assert inside.lost_w == alone.lost_w and inside.exit_lm == alone.exit_lm and inside.peak_cd == alone.peak_cd
