"""Lamps with lenses of several kinds: equal ones give the light of one lens, others that of lamps moved by hand."""

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
    receivers, source = receivers_of(lens.spec, 18), build_source(lens.spec.source, None)
    found = simulate(TracedLens.of(lens, 3.0), source, receivers, rays, seed)
    assert found.rays == pytest.approx(rays, rel=1e-3)
    return found.received[0]


def coarse(found: ReceivedFlux) -> np.ndarray:
    """The mean picture on 6 x 6 pixels, whose noise is small."""
    return np.asarray(found.images.mean(axis=0).reshape(6, 3, 6, 3).sum(axis=(1, 3)))


def test_kinds_that_are_equal_give_the_light_of_one_lens() -> None:
    one = light_of(lens_of(GRID, sphere(6.0)), 2**18)
    three = light_of(lens_of({**GRID, "kinds": "place"}, sphere(6.0), sphere(6.0), sphere(6.0)), 2**18)
    np.testing.assert_allclose(coarse(three), coarse(one), atol=0.01 * coarse(one).max())
    for name in ("window", "outside"):
        assert getattr(three, name).mean() == pytest.approx(getattr(one, name).mean(), abs=1e-3)


TABLE = {
    "kind": "table", "places_mm": [[-25.0, 6.0], [0.0, 0.0], [21.0, -9.0]], "turns_deg": [20.0, 0.0, 245.0],
    "kinds": ["wide", "narrow", "wide"],
}  # fmt: skip


def test_the_light_of_kinds_is_that_of_lamps_moved_and_turned_by_hand() -> None:
    """Each lamp is a lens of its own: one at the origin, below a receiver that is moved and turned back."""
    narrow, wide = uneven(0), uneven(1)
    total, window = np.zeros((6, 6)), 0.0
    for (x, y), turn, face in zip(TABLE["places_mm"], TABLE["turns_deg"], (wide, narrow, wide), strict=True):
        back = (-x + -1j * y) * np.exp(-1j * np.radians(turn))
        sheet = {**SHEET, "centre_mm": [back.real, back.imag, 40.0], "rotation_deg": -turn}
        spec = small_spec(**{**SCENE, "receivers": [sheet]})
        alone = light_of(Lens.double(sphere(3.0), face, spec, 0, "draft"), 2**17)
        total, window = total + coarse(alone) / 3, window + alone.window.mean() / 3
    found = light_of(lens_of(TABLE, narrow, wide), 3 * 2**17)
    np.testing.assert_allclose(coarse(found), total, atol=0.01 * total.max())
    assert found.window.mean() == pytest.approx(window, abs=1e-3)
    swapped = light_of(lens_of(TABLE, wide, narrow), 3 * 2**15)
    assert np.abs(coarse(swapped) - total).max() > 0.03 * total.max()


def test_a_lens_at_a_mirrored_place_is_turned_where_it_keeps_its_own_mirror() -> None:
    """Then the sum has the mirrors of the grid; without its own mirror it has not."""
    for turned, symmetries in ((True, ("square", "mirror_y", "diagonal")), (False, ("square", "mirror_x", "none"))):
        bases = [replace(BASIS, symmetry=own) for own in symmetries]
        faces = [SrbfSurface(basis, 2.0 * uneven(1).weights_mm, 6.0) for basis in bases]
        found = coarse(light_of(lens_of({**GRID, "kinds": "place"}, *faces), 2**19))
        apart = max(np.abs(image - found).max() for image in (found[::-1], found[:, ::-1], found.T)) / found.max()
        assert apart < 0.005 if turned else apart > 0.008


def test_the_far_field_of_kinds_is_the_mean_of_theirs() -> None:
    narrow, wide = uneven(0), uneven(1)
    source = build_source(small_spec().source, None)

    def exit_of(lens: Lens) -> RayBundle:
        traced = TracedLens.of(lens, 3.0)
        return exit_rays(traced, source.sample(2**17, 0), 100.0, lens.spec.all_lamps).rays

    together = exit_of(lens_of({**TABLE, "turns_deg": []}, narrow, wide))
    apart = [exit_of(lens_of({"kind": "table", "places_mm": [[0.0, 0.0]]}, face)) for face in (narrow, wide, wide)]
    assert together.flux.sum() == pytest.approx(sum(each.flux.sum() for each in apart), rel=2e-3)
    for axis in (0, 1):
        moment = sum(each.flux @ each.directions[:, axis] for each in apart)
        assert together.flux @ together.directions[:, axis] == pytest.approx(moment, abs=6e-3)


def test_the_record_has_every_kind(tmp_path: Path) -> None:
    lens = lens_of({**GRID, "kinds": "place"}, *(uneven(seed) for seed in range(3)))
    lens.save(tmp_path / "lens.json")
    read = load_lens(tmp_path / "lens.json")
    assert read == lens and [each.kind for each in read.kinds] == ["middle", "edge", "corner"]
    corner = read.of_kind("corner")
    assert set(corner.others) == {"middle", "edge"}
    assert corner.to_json()["faces"] == lens.to_json()["others"]["corner"]
    assert corner.of_kind("middle") == lens and corner != lens
    with pytest.raises(InputError, match="no lens of that name; known: 'middle', 'edge', 'corner'"):
        lens.of_kind("rim")


def test_a_cast_shows_the_first_lamp_of_the_kind_of_its_lens() -> None:
    """Of lamps at heights, here the second: the receiver as that lamp sees it."""
    poles = {**TABLE, "places_mm": [[-25.0, 6.0, 1.0], [0.0, 2.0, 4.0], [21.0, -9.0, 3.0]], "turns_deg": [0.0] * 3,
             "kinds": ["wide", "narrow", "narrow"]}  # fmt: skip
    lens = lens_of(poles, uneven(0), uneven(1))
    assert lens.kind == "narrow"
    (receiver,) = receivers_of(_of_first_lamp(lens), 8)
    assert receiver.pose.centre_mm == pytest.approx((0.0, -2.0, 36.0))


def test_every_kind_of_lens_expands() -> None:
    law = {"lens__index_per_k": 0.0, "lens__expansion_per_k": 1e-4}
    lens = lens_of(TABLE, uneven(0), uneven(1), **law)
    warm, u = at_temperature(lens, 120.0), hemisphere_directions(20)
    for before, after in ((lens.surfaces, warm.surfaces), (lens.others["wide"], warm.others["wide"])):
        for name, face in before.items():
            assert after[name].radius(u) == pytest.approx((1.0 + 1e-4 * 100.0) * face.radius(u), rel=1e-12)
