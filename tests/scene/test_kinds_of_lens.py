"""Lamps with lenses of several kinds: mirrored places, the record, a cast. Their light: the crooked design of kinds."""

import json
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import hemisphere_directions, small_spec, sphere

from lensforge.errors import InputError
from lensforge.light.exit_light import exit_rays
from lensforge.light.received_flux import ReceivedFlux
from lensforge.light.simulation import TracedLens, simulate
from lensforge.proof.casts import _of_first_lamp
from lensforge.scene.lens import Lens, load_lens
from lensforge.scene.lens_at_temperature import at_temperature
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.sources.build_source import build_source
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface
from lensforge.surfaces.surface import Surface

GRID = {"kind": "grid", "columns": 3, "rows": 3, "pitch_mm": 20.0}
SHEET = {
    "kind": "plane", "centre_mm": [0.0, 0.0, 40.0], "width_mm": 90.0, "height_mm": 90.0,
    "targets": [{"kind": "disc", "diameter_mm": 40.0}],
}  # fmt: skip
SCENE: dict[str, Any] = {"base": {"kind": "none"}, "target": None, "receivers": [SHEET]}
BASIS = SrbfBasis((4, 9), 1.75)


def uneven(seed: int) -> Surface:
    """A face 6 mm from the source, higher by some tenths on one side, with no mirror."""
    return SrbfSurface(BASIS, 0.3 * np.random.default_rng(seed).normal(size=BASIS.size), 6.0)


def lens_of(lamps: dict[str, Any], outer: Surface, *others: Surface, **changes: Any) -> Lens:
    lens = Lens.double(sphere(3.0), outer, small_spec(**{**SCENE, "lamps": lamps, **changes}), 0, "draft")
    names = [kind.name for kind in lens.spec.all_lamps.kinds[1:]]
    return replace(lens, others={k: {"inner": sphere(3.0), "outer": o} for k, o in zip(names, others, strict=True)})


def light_of(lens: Lens, rays: int = 2**16, seed: int = 0) -> ReceivedFlux:
    receivers = receivers_of(lens.spec, 18)
    source = build_source(lens.spec.source, None)
    simulation = simulate(TracedLens.of(lens, 3.0), source, receivers, rays, seed)
    assert simulation.rays == pytest.approx(rays, rel=1e-3)
    return simulation.received[0]


def coarse(received: ReceivedFlux) -> np.ndarray:
    """The mean picture on 6 x 6 pixels, whose noise is small."""
    return np.asarray(received.images.mean(axis=0).reshape(6, 3, 6, 3).sum(axis=(1, 3)))


TABLE = {
    "kind": "table", "places_mm": [[-25.0, 6.0], [0.0, 0.0], [21.0, -9.0]], "turns_deg": [20.0, 0.0, 245.0],
    "kinds": ["wide", "narrow", "wide"],
}  # fmt: skip


def test_a_lens_at_a_mirrored_place_is_turned_where_it_keeps_its_own_mirror() -> None:
    """Then the sum has the mirrors of the grid; without its own mirror it has not."""
    for turned, symmetries in ((True, ("square", "mirror_y", "diagonal")), (False, ("square", "mirror_x", "none"))):
        bases = [replace(BASIS, symmetry=symmetry) for symmetry in symmetries]
        faces = [SrbfSurface(basis, 2.0 * uneven(1).weights_mm, 6.0) for basis in bases]
        light = coarse(light_of(lens_of({**GRID, "kinds": "place"}, *faces), 2**19))
        apart = max(np.abs(image - light).max() for image in (light[::-1], light[:, ::-1], light.T)) / light.max()
        assert apart < 0.005 if turned else apart > 0.008


def test_the_record_has_every_kind(tmp_path: Path) -> None:
    lens = lens_of({**GRID, "kinds": "place"}, *(uneven(seed) for seed in range(3)))
    lens.save(tmp_path / "lens.json")
    read = load_lens(tmp_path / "lens.json")
    assert read == lens and [kind.kind for kind in read.kinds] == ["middle", "edge", "corner"]
    corner = read.of_kind("corner")
    assert set(corner.others) == {"middle", "edge"}
    assert corner.to_json()["faces"] == lens.to_json()["others"]["corner"]
    assert corner.of_kind("middle") == lens and corner != lens
    with pytest.raises(InputError, match="no lens of that name; known: 'middle', 'edge', 'corner'"):
        lens.of_kind("rim")


def test_rays_leave_each_lamp_through_its_kind_of_lens_as_it_is_turned() -> None:
    """Lamp by lamp: those dealt to it, traced through the lens of its kind, then turned to it."""
    lens = lens_of(TABLE, uneven(0), uneven(1))
    traced = TracedLens.of(lens, 3.0)
    lamps = lens.spec.all_lamps
    rays = build_source(lens.spec.source, None).sample(600, 1)
    dealt = np.random.default_rng(600).permutation(600) % 3
    leaving = []
    for number, lamp in enumerate(lamps.lamps):
        (kind,) = (k for k, lens_kind in enumerate(lamps.kinds) if number in lens_kind.numbers)
        alone = traced.kinds[kind].trace(rays.take(dealt == number))
        turned = alone.directions @ lamp.pose.rotation.T
        rows = np.column_stack([turned, 3.0 * alone.flux])
        leaving.append(rows[alone.left_lens & (turned[:, 2] > 0.0)])
    exits = exit_rays(traced, rays, 100.0, lamps).rays
    rows = np.column_stack([exits.directions, exits.flux])
    expected = np.concatenate(leaving)
    assert len(rows) == len(expected) > 500
    np.testing.assert_allclose(rows[np.lexsort(rows.T)], expected[np.lexsort(expected.T)], rtol=1e-9)


def test_a_cast_shows_the_first_lamp_of_the_kind_of_its_lens() -> None:
    """Of lamps at heights, here the second: the receiver as that lamp sees it."""
    poles = {**TABLE, "places_mm": [[-25.0, 6.0, 1.0], [0.0, 2.0, 4.0], [21.0, -9.0, 3.0]], "turns_deg": [0.0] * 3,
             "kinds": ["wide", "narrow", "narrow"]}  # fmt: skip
    lens = lens_of(poles, uneven(0), uneven(1))
    assert lens.kind == "narrow"
    (receiver,) = receivers_of(_of_first_lamp(lens), 8)
    assert receiver.pose.origin_mm == pytest.approx((0.0, -2.0, 36.0))


def test_every_kind_of_lens_expands() -> None:
    law = {"lens__index_per_k": 0.0, "lens__expansion_per_k": 1e-4}
    lens = lens_of(TABLE, uneven(0), uneven(1), **law)
    warm = TracedLens.of(at_temperature(lens, 120.0), 3.0)
    from_centre = RayBundle(np.zeros((20, 3)), hemisphere_directions(20), np.ones(20))
    for before, after in zip(TracedLens.of(lens, 3.0).kinds, warm.kinds, strict=True):
        left = before.trace(from_centre).left_lens
        points = before.trace(from_centre).points[left]
        assert after.trace(from_centre).points[left] == pytest.approx(1.01 * points, rel=1e-9, abs=1e-9)
        assert left.sum() > 5


def test_a_record_has_a_lens_of_each_kind_but_the_first_with_all_its_faces(tmp_path: Path) -> None:
    path = tmp_path / "lens.json"
    lens_of(TABLE, uneven(0), uneven(1)).save(path)
    content = json.loads(path.read_text())
    del content["content_sha256"]  # as of another program
    faces = content["others"]["wide"]
    names = r"must be all but one of the kinds \['narrow', 'wide'\]"
    for others, fault in (
        ({"wide": faces}, ""),
        ({}, rf"lenses \[\], {names}"),
        ({"broad": faces}, rf"lenses \['broad'\], {names}"),
        ({"narrow": faces, "wide": faces}, rf"lenses \['narrow', 'wide'\], {names}"),
        ({"wide": {"outer": faces["outer"]}}, "the lens of each kind must have the faces inner, outer"),
    ):
        path.write_text(json.dumps(content | {"others": others}))
        with (
            pytest.raises(InputError, match=rf"lens\.json: others: {fault}; run `lensforge design` again")
            if fault
            else nullcontext()
        ):
            load_lens(path)
