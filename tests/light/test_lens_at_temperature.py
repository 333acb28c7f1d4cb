"""The light of a lens at another temperature: against lenses of another index and sources of another size."""

import numpy as np
import pytest
from nightly import first_by_day
from presets import FEW, WITH_TABLE_ERROR
from scenes import hemisphere_directions, random_surface, small_spec, sphere
from tir_lenses import spot, spot_lens

import lensforge as lf
from lensforge.light.lens_light import _conditions
from lensforge.light.simulation import TracedLens
from lensforge.optics.material import MATERIALS
from lensforge.scene.lens import Lens
from lensforge.scene.lens_at_temperature import at_temperature
from lensforge.sources.build_source import build_source
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec import Preset, Spec

LINE = {"kind": "line", "wavelength_nm": 450.0}
PLASTIC = {"lens__index_per_k": -1.1e-4, "lens__expansion_per_k": 7e-5}
TARGET = {"kind": "flat_top", "width_mm": 160.0, "distance_mm": 100.0, "receiver_mm": 200.0, "uniform_mm": 100.0}


def lens_of(spec: Spec, accuracy: Preset = FEW) -> Lens:
    return Lens.double(random_surface(1, 3.0, 0.01, (9,)), random_surface(2, 6.0, 0.01, (9,)), spec, 0, accuracy)


def require_same(light: lf.Light, wanted: lf.Light, larger: float = 1.0) -> None:
    """The same shares and pictures, the latter on a receiver ``larger`` times as wide."""
    for name in ("nmse", "efficiency", "uniformity", "share_in_target"):
        assert getattr(light, name).value == pytest.approx(getattr(wanted, name).value, rel=1e-9), name
    assert light.flux.model_dump() == pytest.approx(wanted.flux.model_dump(), abs=1e-12)
    np.testing.assert_allclose(light.map * larger**2, wanted.map, rtol=1e-9)


def test_the_reference_temperature_gives_the_same_bits() -> None:
    lens = lens_of(small_spec(**PLASTIC, lens__reference_temperature_c=25.0))
    plain = lf.evaluate(lens)
    light = lf.evaluate(lens, temperature_c=25.0)
    assert light.conditions is None and light.sha256 == plain.sha256
    unknown = lens_of(small_spec())
    assert lf.evaluate(unknown, temperature_c=20).conditions is None, "nothing of its change needs to be known"


def test_the_index_alone_is_that_of_another_material() -> None:
    warm = lf.evaluate(lens_of(small_spec(lens__index_per_k=-1e-4, lens__expansion_per_k=0.0)), temperature_c=120.0)
    other = lf.evaluate(lens_of(small_spec(lens__refractive_index=1.4936 - 1e-4 * 100.0)))
    require_same(warm, other)
    assert warm.possible.efficiency == pytest.approx(other.possible.efficiency, rel=1e-12)
    assert warm.efficiency.value > lf.evaluate(lens_of(small_spec())).efficiency.value, "less is reflected"


@pytest.mark.parametrize(
    "base", first_by_day(1, [{"kind": "none"}, {"diameter_mm": 16.0, "height_mm": 2.5}], "another base")
)
def test_expansion_alone_conserves_the_light_of_a_scene_that_is_as_much_smaller(base: dict[str, object]) -> None:
    """Lens, source and receiver of one scale have one light; the seat stays, and the source is nearer to it."""
    e = 5e-4 * 100.0
    depth = 2.5 if "height_mm" in base else 0.0
    fields = {"lens__index_per_k": 0.0, "lens__expansion_per_k": 5e-4}
    warm = lf.evaluate(lens_of(small_spec(base=base, target=TARGET, **fields), WITH_TABLE_ERROR), temperature_c=120.0)
    small = {name: value / (1.0 + e) for name, value in TARGET.items() if name != "kind"}
    small |= {"distance_mm": (100.0 - depth * e) / (1.0 + e), "kind": "flat_top"}
    source = {"kind": "square", "side_mm": 1.0 / (1.0 + e), "position_mm": [0.0, 0.0, -depth * e / (1.0 + e)]}
    cold = lf.evaluate(lens_of(small_spec(base=base, target=small, source=source), WITH_TABLE_ERROR))
    require_same(warm, cold, 1.0 + e)
    assert warm.preset_error is not None and cold.preset_error is not None
    error = warm.preset_error.evaluation
    same = cold.preset_error.evaluation
    assert error.hit_max_mm == pytest.approx(same.hit_max_mm * (1.0 + e), rel=1e-3), "both tracers see the shift"
    if not depth:
        assert warm.possible.efficiency == pytest.approx(cold.possible.efficiency, rel=1e-9)
    else:
        assert warm.possible.efficiency >= cold.possible.efficiency * (1.0 - 1e-12)


def test_rays_with_an_index_of_their_own_have_that_of_their_wavelength() -> None:
    """A blue line through N-BK7 at 85 C, against one index with constants that give the same index and size."""
    glass = MATERIALS["N-BK7"]
    wave = np.array([450.0])
    cold, hot = (float(glass.at(glass.temperature, celsius).index(wave)[0]) for celsius in (20.0, 85.0))
    lens = lens_of(small_spec(lens__material="N-BK7", source__spectrum=LINE))
    warm = at_temperature(lens, 85.0)
    rays = build_source(lens.spec.source, lens.dispersion).sample(10, 0)
    assert warm.media.body.index(rays.waves) == pytest.approx([hot] * 10, abs=1e-15)
    assert warm.media.body.refractive_index != hot, "that at the design wavelength, for rays without their own"
    constants = {"lens__index_per_k": (hot - cold) / 65.0, "lens__expansion_per_k": 7.1e-6}
    other = lens_of(small_spec(lens__refractive_index=cold, **constants))
    require_same(lf.evaluate(lens, temperature_c=85.0), lf.evaluate(other, temperature_c=85.0))


def test_a_source_without_wavelengths_has_the_index_at_the_design_wavelength() -> None:
    lens = lens_of(small_spec(lens__material="N-BK7", lens__design_wavelength_nm=546.074))
    change = at_temperature(lens, 40.0).media.body.refractive_index - lens.media.body.refractive_index
    assert change / 20.0 == pytest.approx(3.0e-6, abs=0.051e-6)


def test_concentric_spheres_reflect_what_fresnel_says() -> None:
    """From their centre every ray meets both faces at right angles: what passes is (4 n / (n + 1)^2)^2."""
    spec = small_spec(source__side_mm=1e-6, base={"kind": "none"}, **PLASTIC)
    light = lf.evaluate(Lens.double(sphere(3.0), sphere(6.0), spec, 0, FEW), temperature_c=85.0)
    n = 1.4936 - 65.0 * 1.1e-4
    assert light.flux.reflected == pytest.approx(1.0 - (4.0 * n / (n + 1.0) ** 2) ** 2, abs=1e-9)


def test_a_fixed_face_expands_too() -> None:
    fixed = {"kind": "sphere", "radius_mm": 6.0, "centre_z_mm": 0.0}
    lens = {"levels": [9], "inner": {"offset_mm": 3.0}, "outer": {"fixed": fixed}, "symmetry": "none"}
    spec = small_spec(lens=lens | {"index_per_k": 0.0, "expansion_per_k": 1e-4}, optimise={"rays": 1024, "pixels": 16})
    cold = Lens.double(sphere(3.0), spec.lens.fixed["outer"], spec, 0, FEW)
    up = RayBundle(np.zeros((1, 3)), np.array([[0.0, 0.6, 0.8]]), np.ones(1))
    exits = TracedLens.of(at_temperature(cold, 120.0), 3.0).trace(up)
    assert np.linalg.norm(exits.points - [0.0, 0.0, 0.01 * spec.base.seat_mm]) == pytest.approx(6.06, abs=1e-9)


@pytest.mark.parametrize(
    ("changes", "celsius", "message"),
    [
        ({}, 85.0, r"how PMMA at 564 nm changes with it; give lens.index_per_k \(1/K, .*\) and lens.expansion_per_k"),
        ({"lens__index_per_k": -1e-4}, 85.0, r"changes with it; give lens.expansion_per_k \(1/K: about 7e-5 for pl"),
        (PLASTIC, 401.0, r"temperature_c = 401: must be -100 to 400 \(Celsius\)"),
        (PLASTIC, -273.0, r"temperature_c = -273: must be -100 to 400"),
        (PLASTIC, float("nan"), r"temperature_c = nan: a finite number"),
        (PLASTIC, "85", r"temperature_c = '85': a finite number"),
        (
            {**PLASTIC, "lens__index_per_k": -1e-3, "lens__refractive_index": 1.3},
            400.0,
            r"would be 0\.92, must be 1 to",
        ),
        (  # at 564 nm it would be 1.0005, at the red end of its dispersion less than 1
            {
                "lens__index_per_k": -1e-3,
                "lens__expansion_per_k": 0.0,
                "lens__refractive_index": 1.3,
                "lens__abbe_number": 20.0,
                "lens__reference_temperature_c": 20.0,
            },
            319.5,
            r"would be 0\.9\d+, must be 1 to",
        ),
    ],
)
def test_what_is_not_known_is_refused(changes: dict[str, float], celsius: float, message: str) -> None:
    with pytest.raises(lf.InputError, match=message) as error:
        lf.evaluate(lens_of(small_spec(**changes)), temperature_c=celsius)
    assert "\n" not in str(error.value)


def test_conditions_name_the_temperature_and_warn_of_extrapolation() -> None:
    glass = lens_of(small_spec(lens__material="N-BK7"))
    light = lf.evaluate(glass, temperature_c=-40, pixels=8)
    assert light.conditions is not None and light.inputs["lens"] == glass.sha256
    assert (light.conditions.name, str(light.conditions)) == ("8px_minus40C", "8 x 8 pixels, -40 °C")
    assert light.conditions.warnings == ()
    light = lf.evaluate(glass, temperature_c=200.0)
    assert light.conditions is not None and "extrapolated" in light.conditions.warnings[0]
    asked = dict.fromkeys(("accuracy", "rays", "pixels", "seed")) | {"temperature_c": 200.0}
    both = _conditions(glass, lf.SquareSource(side_mm=2.0), ("on the LED",), None, asked, FEW)
    assert both is not None and both.warnings == ("on the LED", *light.conditions.warnings)


def test_the_seat_is_the_bottom_of_the_base() -> None:
    lens = lens_of(small_spec(**PLASTIC, base={"diameter_mm": 16.0, "height_mm": 3.0}))
    on_axis = RayBundle(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]), np.ones(1))
    for base_mm, placed in ((3.0, lens), (0.0, lens_of(small_spec(**PLASTIC, base={"kind": "none"})))):
        spheres = Lens.double(sphere(3.0), sphere(6.0), placed.spec, 0, FEW)
        (point,) = TracedLens.of(at_temperature(spheres, 120.0), 3.0).trace(on_axis).points
        assert point == pytest.approx([0.0, 0.0, 6.0 * 1.007 + base_mm * 7e-3], abs=1e-9)


def test_a_lens_for_total_internal_reflection_grows_on_all_ways() -> None:
    """Rays from its seat, which stays where it is, leave the grown lens by as many faces, at places as much farther."""
    law = {"index_per_k": 0.0, "expansion_per_k": 3e-4}
    lens = spot_lens(spot(refractive_index=1.49, material="silicone like", **law), base={"kind": "none"})
    directions = hemisphere_directions(200)
    rays = RayBundle(np.zeros((200, 3)), directions, np.ones(200))
    cold = TracedLens.of(lens, 3.0).trace(rays)
    warm = TracedLens.of(at_temperature(lens, 120.0), 3.0).trace(rays)
    assert np.array_equal(cold.fates, warm.fates) and cold.left_lens.sum() > 100
    assert cold.met is not None and np.array_equal(cold.met, warm.met)
    left = cold.left_lens
    np.testing.assert_allclose(warm.points[left], 1.03 * cold.points[left], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(warm.directions[left], cold.directions[left], atol=1e-9)
