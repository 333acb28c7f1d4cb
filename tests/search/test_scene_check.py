"""Scenes that no search can serve are refused before it; others are described by their shares."""

import re
from math import sqrt

import numpy as np
import pytest
from known_refraction import normal_transmittance
from presets import FEW
from scenes import small_spec

import lensforge as lf
from lensforge.errors import Cancelled, InputError
from lensforge.kernels.adjoint import adjoint_of_pairs
from lensforge.kernels.fate import Fate
from lensforge.kernels.precision import in_single
from lensforge.kernels.trace import trace
from lensforge.scene.lens import Lens
from lensforge.search.scene_check import SceneCheck, compile_search_kernels
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec
from lensforge.spec.source_sections import RaySource
from lensforge.surfaces.asphere import sphere


def check(spec: Spec, start: Lens | None = None) -> SceneCheck:
    return SceneCheck.of(spec, build_source(spec.source), start)


def beam(direction: tuple[float, float, float], backward: float = 0.0, **more: object) -> RaySource:
    """Ten thousand parallel rays within 1 mm; a share of them reversed."""
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-0.5, 0.5, (10_000, 2)), np.zeros(10_000)])
    directions = np.tile(np.array(direction, dtype=np.float64), (10_000, 1))
    directions[: round(backward * 10_000)] *= -1.0
    return RaySource(positions_mm=points, directions=directions, flux_w=1.0, **more)


def test_kernels_that_a_second_process_compiles_are_those_of_the_search() -> None:
    compile_search_kernels(small_spec())
    kernels = in_single(trace), in_single(adjoint_of_pairs)
    compiled = [list(kernel.signatures) for kernel in kernels]
    with pytest.raises(Cancelled):
        lf.design(small_spec(), progress=lambda step: False)
    assert all(compiled) and compiled == [list(kernel.signatures) for kernel in kernels]


def test_a_source_in_its_cavity_sends_all_its_light_into_the_lens() -> None:
    scene_check = check(small_spec())
    assert scene_check.entering == 1.0 and 0.9 < scene_check.targets[0].bounds.value < normal_transmittance(1.4936) ** 2
    assert scene_check.warnings() == ()
    scene_check.require_light()


def test_the_mean_direction_counts_each_ray_by_its_flux() -> None:
    """Three quarters of the flux is upright, in half of the rays; the rest leans by 37 degrees."""
    source = beam((0.0, 0.0, 1.0))
    directions = np.array(source.directions)
    directions[5000:] = [0.6, 0.0, 0.8]
    flux = np.repeat([3.0, 1.0], 5000)
    rays = RaySource(positions_mm=source.positions_mm, directions=directions, ray_flux=flux, flux_w=1.0)
    spec = small_spec().replace(source=rays)
    assert check(spec).mean_direction == pytest.approx((0.15, 0.0, 0.95), abs=0.01)


def wall(height_mm: float, **more: object) -> tuple[str, ...]:
    """Warnings on an upright wall at x = 300 mm, whose target's middle is ``height_mm`` above the LED."""
    plane = {"kind": "plane", "name": "wall", "centre_mm": [300.0, 5.0, height_mm], "normal": [1.0, 0.0, 0.0],
             "width_mm": 600.0, "height_mm": 400.0,
             "targets": [{"kind": "rectangle", "width_mm": 200.0, "height_mm": 100.0}], **more}  # fmt: skip
    spec = small_spec().replace(target=None, receivers=[plane])
    return check(spec).warnings()


def test_shares_of_a_disc_that_is_wider_than_the_cavity_are_those_of_its_area() -> None:
    """A square of 6 mm around a cavity of 1.5 mm radius: pi 1.5^2 of its 36 mm^2 starts inside."""
    spec = small_spec(source__side_mm=6.0, lens__inner__offset_mm=1.5)
    scene_check = check(spec)
    inside = np.pi * 1.5**2 / 36.0
    assert scene_check.entering == pytest.approx(inside, abs=4.0 * sqrt(inside * (1.0 - inside) / 2**14))
    assert scene_check.lost[Fate.OUTSIDE_CAVITY] == pytest.approx(1.0 - scene_check.entering)
    assert "a larger lens.inner.offset_mm" in scene_check.warnings()[0]
    wide = Lens.double(sphere(5.0), sphere(6.5), spec, 0, "draft")
    assert check(spec, wide).entering == 1.0, "the lens to begin from decides"


def test_light_that_goes_backward_is_a_warning_until_there_is_none_left() -> None:
    most = check(small_spec().replace(source=beam((0.0, 0.0, 1.0), backward=0.98)))
    most.require_light(force=True)
    with pytest.raises(InputError, match=r"98 % goes backward.*; at least 10 % must enter; .*--force"):
        most.require_light()
    with pytest.raises(InputError, match=r"less than half of the .*89 % goes backward.*force"):
        check(small_spec().replace(source=beam((0.0, 0.0, 1.0), backward=0.89))).require_light()
    assert most.lost[Fate.BACKWARD] == pytest.approx(0.98)
    assert any("2 % of the light enters" in warning and "98 % goes backward" in warning for warning in most.warnings())
    with pytest.raises(InputError, match=r"0 % of the light enters.*100 % goes backward.*source\.axis") as refusal:
        check(small_spec().replace(source=beam((0.0, 0.0, -1.0)))).require_light()
    assert "(0.00, 0.00, -1.00)" in str(refusal.value) and "\n" not in str(refusal.value)
    with pytest.raises(
        InputError, match=r"100 % starts outside the cavity or misses its opening; try source\.scale, source\.origin"
    ):
        check(small_spec().replace(source=beam((0.0, 0.0, 1.0), position_mm=(10.0, 0.0, 0.0)))).require_light()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"source__tilt_deg": [180.0, 0.0]}, r"100 % goes backward, towards -z; try source\.tilt_deg"),
        (
            {"target__distance_mm": 1e5},
            r"target: upper bound 0\.0\d+ % of the light \(étendue\).*target\.distance_mm.*less than half of the",
        ),
        (
            {"target__width_mm": 0.16, "target__receiver_mm": 0.2, "target__uniform_mm": 0.1},
            r"upper bound 0\.0\d+ % of the light \(étendue\)",
        ),
        (
            {"lens__refractive_index": 1.0, "lens__material": "nothing", "target__distance_mm": 2000.0},
            r"deflection and loss of two refractions",
        ),
    ],
)
def test_a_wrong_place_or_unit_is_refused_before_the_search(changes: dict[str, object], message: str) -> None:
    spec = small_spec(**changes)
    begun = []
    with pytest.raises(InputError, match=message) as refusal:
        lf.design(spec, accuracy=FEW, progress=begun.append)
    assert not begun and "\n" not in str(refusal.value)


def cob(**changes: object) -> Spec:
    """A board of chips of 3 mm in a lens of 12 mm, for 60 x 40 mm at 500 mm: étendue allows a fifth of the light."""
    content = {
        "source": {"kind": "disc", "diameter_mm": 3.0},
        "lens": {"inner": {"offset_mm": 4.0}, "outer": {"offset_mm": 8.0}},
        "constraints": {
            "cavity_radius_mm": 2.0, "cavity_height_mm": 1.0, "min_thickness_mm": 1.0, "max_radius_mm": 12.0
        },
        "target": {
            "kind": "rectangle", "width_mm": 60.0, "height_mm": 40.0, "distance_mm": 500.0, "receiver_mm": 100.0
        },
    }  # fmt: skip
    return Spec.model_validate(content).replace(changes)


def test_a_target_of_which_less_than_half_is_possible_is_refused_with_the_lens_that_would_do() -> None:
    spec = cob()
    target = check(spec).targets[0]
    transmitted = normal_transmittance(spec.lens.refractive_index) ** 2
    closed_form = transmitted * 12.0**2 * (60.0 * 40.0 / 500.0**2) / (np.pi * 1.5**2)
    assert target.bounds.by_etendue == pytest.approx(closed_form, rel=0.05)
    with pytest.raises(InputError) as refusal:
        lf.design(spec, accuracy=FEW)
    reason = str(refusal.value)
    assert "(étendue)" in reason and "force" in reason and "\n" not in reason
    radius_mm = float(reason.partition(">= ")[2].split()[0])
    assert 25.0 < radius_mm < 29.0
    assert check(spec.replace({"constraints.max_radius_mm": radius_mm})).targets[0].bounds.by_etendue >= 0.92
    messages: list[str] = []
    with pytest.raises(Cancelled):
        lf.design(spec, accuracy=FEW, force=True, progress=lambda _: False, warn=messages.append)
    assert any("(étendue)" in message for message in messages), "it says so all the same"


def test_a_limit_beyond_half_of_what_the_luminance_allows_is_refused_by_its_name() -> None:
    """A Lambertian square of 1 mm and 1 W: at most L pi R^2 in any direction, times what two faces transmit.

    The limit is on the second of two receivers.
    """
    wall = {"kind": "plane", "name": "wall", "centre_mm": [0.0, 0.0, 200.0], "width_mm": 90.0, "height_mm": 90.0}
    sky = {"kind": "far_field", "name": "sky", "half_angle_deg": 60.0}
    discs = [{"kind": "disc", "diameter_mm": 60.0}], [{"kind": "disc", "diameter_deg": 30.0}]
    receivers = [{**wall, "targets": discs[0]}, {**sky, "targets": discs[1]}]
    transmitted = normal_transmittance(1.4936) ** 2

    def asking(intensity: float) -> SceneCheck:
        limit = {"kind": "points", "name": "axis", "at_deg": [[0, 0]], "unit": "w_per_sr", "at_least": intensity}
        limits = [{**limit, "receiver": "sky"}]
        return check(small_spec(target=None, receivers=receivers).replace({"limits": limits, "evaluate.pixels": 32}))

    radius_mm = small_spec().constraints.max_radius_mm
    most = transmitted * radius_mm**2 / 1.0
    assert asking(1.0).limits[0].possible == pytest.approx(most, rel=0.01)
    asking(1.9 * most).require_light()
    assert any(warning.startswith("limits: axis: upper bound") for warning in asking(1.9 * most).warnings())
    with pytest.raises(
        InputError, match=r"limits: axis: upper bound .* W/sr \(étendue\).*a larger lens \(>= "
    ) as refusal:
        asking(2.1 * most).require_light()
    assert "\n" not in str(refusal.value)
    enough_mm = float(str(refusal.value).partition(">= ")[2].split()[0])
    assert enough_mm == pytest.approx(sqrt(2.1) * radius_mm, rel=0.02), "flux rises with the area of the lens"


def aside(**changes: object) -> Spec:
    """A TIR lens of faces of revolution, and a beam 30 degrees beside its axis."""
    content = {
        "source": {"kind": "square", "side_mm": 1.0},
        "lens": {"kind": "tir"},
        "constraints": {"max_radius_mm": 8.0},
        "target": {"kind": "disc", "diameter_deg": 20.0, "centre_deg": [0.0, 30.0], "half_angle_deg": 60.0},
        "evaluate": {"pixels": 48},
    }
    return Spec.model_validate(content).replace(changes)


def test_light_beside_the_axis_is_said_to_need_levels() -> None:
    """Four images of a square's: a quarter of the light. With a symmetry that is not known it is said, too."""
    with pytest.raises(
        InputError, match=r"upper bound 23\.1 % of the light \(the symmetry of faces of revolution\).*try lens\.levels"
    ):
        check(aside()).require_light()
    scene_check = check(aside(**{"lens.levels": [25]}))
    assert scene_check.warnings() == () and scene_check.targets[0].bounds.by_symmetry == 1.0
    off_centre = aside(**{"source.position_mm": [0.1, 0.2, 0.0]})
    check(off_centre).require_light()
    (warning,) = check(off_centre).warnings()
    assert "faces of revolution make round light" in warning and "lens.levels" in warning
    assert not check(aside(**{"target.centre_deg": [0.0, 5.0]})).targets[0].beside


def test_no_larger_lens_is_promised_where_a_near_target_is_smaller_than_the_source() -> None:
    """A disc of 2 mm takes 4/9 of the light of one of 3 mm at the most, whatever the lens."""
    content = {
        "source": {"kind": "disc", "diameter_mm": 3.0},
        "lens": {"kind": "tir"},
        "constraints": {"max_radius_mm": 12.0},
        "target": {"kind": "disc", "diameter_mm": 2.0, "distance_mm": 20.0, "receiver_mm": 4.0},
    }
    (warning,) = check(Spec.model_validate(content)).warnings()
    assert "try a smaller source or a larger target" in warning and "larger lens" not in warning


@pytest.mark.parametrize(("radius_mm", "blurred"), [(13.5, True), (14.6, False)])
def test_a_target_narrower_than_the_image_of_the_led_is_said(radius_mm: float, blurred: bool) -> None:
    """A band of 30 mm, 300 mm away, is 0.1 rad wide: the diagonal of a 1 mm LED at 14.1 mm."""
    band = {"kind": "rectangle", "width_mm": 30.0, "height_mm": 80.0, "distance_mm": 300.0, "rotation_deg": 20.0}
    content = {"source": {"kind": "square", "side_mm": 1.0}, "constraints": {"max_radius_mm": radius_mm}}
    warnings = check(
        Spec.model_validate({**content, "lens": {"kind": "tir", "levels": [25]}, "target": band})
    ).warnings()
    assert ["blurs it; try a larger lens (>= 14.1" in text for text in warnings] == [True] * blurred


@pytest.mark.parametrize(("width_mm", "degrees", "pixels"), [(10.0, "1.15", "0.43"), (40.0, "4.58", "1.7")])
def test_a_line_is_as_wide_as_it_is_and_asks_for_pixels(width_mm: float, degrees: str, pixels: str) -> None:
    """A metre of light at half a metre: 64 pixels of the search are 23 mm each, wider than the line."""
    line = {"kind": "rectangle", "width_mm": 1000.0, "height_mm": width_mm, "distance_mm": 500.0, "receiver_mm": 1500.0}
    content = {"source": {"kind": "square", "side_mm": 1.0}, "constraints": {"max_radius_mm": 15.0}, "target": line}
    blur, raster = check(Spec.model_validate(content)).warnings()
    widths = [float(re.findall(r"wider than ([\d.]+)", warning)[0]) for warning in (blur, raster)]
    assert widths == [pytest.approx(float(degrees), abs=0.25), pytest.approx(float(pixels), abs=0.1)]  # a sub-pixel
    finer = {"optimise": {"pixels": round(3.3 / float(pixels) * 64)}}
    assert len(check(Spec.model_validate(content | finer)).warnings()) == 1


def test_an_estimated_luminance_warns_and_stops_nothing() -> None:
    rays = build_source(cob().source).sample(20_000, 1)
    spec = cob().replace(source=RaySource(positions_mm=rays.origins, directions=rays.directions, flux_w=1.0))
    scene_check = check(spec)
    assert scene_check.targets[0].estimated and scene_check.targets[0].met < 0.5
    scene_check.require_light()
    assert any("estimate of the source's luminance" in warning for warning in scene_check.warnings())


def test_warnings_stand_in_the_record_of_the_design() -> None:
    spec = small_spec(target__distance_mm=3000.0, target__width_mm=300.0, target__receiver_mm=400.0)
    messages: list[str] = []
    result = lf.design(spec, accuracy=FEW, warn=messages.append)
    assert any("étendue" in message for message in messages)
    assert tuple(messages) == result.source.warnings
