"""A lens for two unlike LEDs in two unlike lamps on poles: every stage takes each LED, and all of the lamps."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from addon_rows import has_addon, needs_addon
from presets import FEW
from scenes import random_surface, small_spec
from scipy.spatial.transform import Rotation

import lensforge as lf
from lensforge.light.lens_light import judging_source
from lensforge.light.light_facts import light_facts, light_reasons
from lensforge.light.receiver_light import LARGEST_NMSE
from lensforge.optics.pose import Pose
from lensforge.proof.independent_draws import stand
from lensforge.report.results import Results
from lensforge.results import Metric
from lensforge.scene.receiver_shapes import seen_by_lamp
from lensforge.sources.intensity import TabulatedIntensity
from lensforge.sources.photometric.photometric_io import photometric_of
from lensforge.surfaces.srbf import fibonacci_hemisphere

ASIDE = {"position_mm": [0.3, -0.2, 0.15], "tilt_deg": [9.0, -14.0], "flux_w": 0.2, "flux_lm": 30.0}
LEDS = (
    {"name": "even", "source": {"kind": "square", "side_mm": 1.0, "flux_w": 0.6, "flux_lm": 170.0}},
    {"name": "aside", "source": {"kind": "disc", "diameter_mm": 0.4, **ASIDE}},
)
POLES = {
    "kind": "table",
    "places_mm": [[35.0, -10.0, 0.0], [-22.0, 14.0, 18.0]],
    "aims_mm": [[20.0, -5.0, 150.0], [-31.0, 60.0, 150.0]],
    "turns_deg": [25.0, -70.0],
}
ROAD = {"lighting_class": "P4", "width_m": 5.0, "pole_height_m": 5.0, "pole_spacing_m": 14.0, "tilt_deg": 4.0}
RECEIVERS = [
    {"kind": "plane", "name": "wall", "centre_mm": [4.0, 3.0, 160.0], "width_mm": 300.0, "height_mm": 260.0,
     "targets": [{"kind": "disc", "diameter_mm": 120.0}]},
    {"kind": "far_field", "name": "sky", "half_angle_deg": 90.0, "targets": [{"kind": "disc", "diameter_deg": 70.0}]},
]  # fmt: skip
NO_ROADS = {"roads": []} if has_addon("road") else {}
MOST_RAYS, LEVEL = 2**15, np.eye(3)


def lens_with(**changes: object) -> lf.Lens:
    spec = small_spec(
        **{"sources": LEDS, "source": None, "target": None, "receivers": RECEIVERS, "lamps": POLES} | changes
    )
    return lf.Lens.double(random_surface(1, 3.0, 0.005), random_surface(2, 6.0, 0.01), spec, 4, FEW)


@pytest.fixture(scope="module")
def lens() -> lf.Lens:
    return lens_with(roads=[ROAD]) if has_addon("road") else lens_with()


@pytest.fixture(scope="module")
def light(lens: lf.Lens) -> lf.Light:
    return lf.evaluate(lens, rays=MOST_RAYS)


@pytest.fixture(scope="module")
def part(lens: lf.Lens) -> lf.Part:
    return lf.build(lens, rings=72)


@pytest.fixture(scope="module")
def whole(lens: lf.Lens) -> lf.Photometry:
    return lf.photometry(lens, rays=MOST_RAYS)


def test_figures_and_reasons_tell_led_and_receiver(light: lf.Light) -> None:
    """Every figure is of its case, and the second LED's light on the second receiver fails by its own name alone."""
    of_no_road = lens_with()
    by_title = {group.title: group for group in light_facts(light, of_no_road) if group.key == "light"}
    cases = [(led, receiver) for led in ("even", "aside") for receiver in ("wall", "sky")]
    assert list(by_title) == [f"{receiver}, {led}" for led, receiver in cases]
    for led, receiver in cases:
        on = next(candidate for candidate in light.by_led[led].receivers if candidate.name == receiver)
        told = by_title[f"{receiver}, {led}"]
        assert (told.fact("efficiency").value, told.fact("nmse").value) == (100.0 * on.efficiency.value, on.nmse.value)
    exact = Metric(value=LARGEST_NMSE, standard_error=0.0)
    above = exact.changed(value=1.001 * LARGEST_NMSE)
    whole = exact.changed(value=1.0)
    for changed, missed in ({}, []), ({("aside", "sky"): above}, ["Pattern error (NMSE), aside, sky"]):
        leds = {
            led: alone.changed(
                limits=(),
                receivers=[
                    receiver.changed(nmse=changed.get((led, receiver.name), exact), share_in_target=whole)
                    for receiver in alone.receivers
                ],
            )
            for led, alone in light.by_led.items()
        }
        reasons = light_reasons(lf.Light.joined(leds), of_no_road)
        assert [reason.partition(" = ")[0] for _, reason in reasons] == missed


def test_the_second_of_two_leds_fails_the_files(lens: lf.Lens, light: lf.Light, part: lf.Part) -> None:
    """Its light as the design has it, and then with its picture the other way around."""
    wall, *rest = light.others[0].receivers
    turned = wall.changed(map=np.roll(wall.map, 5, axis=1).copy())
    wrong = light.changed(others=(light.others[0].changed(receivers=(turned, *rest)),))
    good, bad = (lf.verify(part, design, rays=2**11) for design in (light, wrong))
    assert list(good.by_led) == ["even", "aside"]
    assert [str(criterion) for criterion in good.all_criteria() if not criterion.holds] == []
    missed = [criterion.key for criterion in bad.all_criteria() if not criterion.holds]
    assert missed == ["aside: wall: lamps_nmse_vs_sum"] and all(criterion.holds for criterion in bad.criteria)
    verdict = Results(lens, {result.stage: result for result in (wrong, part, bad)}).verdict
    assert verdict.files == "fail" and "aside" in str(verdict.reasons_of("files"))
    titles = [group.title for group in Results(lens, {"evaluate": light}).facts(bad)]
    assert titles[:4] == [f"Exported part, {led}, {on}" for led in ("even", "aside") for on in ("wall", "sky")]


def test_light_of_all_poles_through_the_part_is_the_sum_of_the_design(light: lf.Light, part: lf.Part) -> None:
    proof = lf.verify(part, light, rays=2**13)
    for of_led, designed in zip(proof.by_led.values(), light.by_led.values(), strict=True):
        assert [judgement.lamps for judgement in of_led.together] == [2, 2]
        for total, receiver in zip(of_led.together, designed.receivers, strict=True):
            assert total.nmse_vs_sum <= 2.5 * total.noise_floor_nmse + 1e-3
            assert total.efficiency == pytest.approx(receiver.efficiency.value, abs=0.02)


def test_light_without_that_of_every_led_is_refused(light: lf.Light, part: lf.Part) -> None:
    with pytest.raises(lf.InputError, match=r"verify: the light is without that of '\w+'; evaluate"):
        lf.verify(part, light.changed(others=(), led=""))


def test_stray_light_of_each_led(part: lf.Part) -> None:
    """Each by its own rays: budgets that close, of which the second has more light beside the wall."""
    first, second = lf.stray_light(part, rays=256).by_led.values()
    assert first.rays == second.rays == 256 and first.flux != second.flux
    for receiver in (first, second):
        assert sum(receiver.flux.model_dump().values()) == pytest.approx(1.0, abs=1e-9)


def test_candela_of_poles_are_the_sum_of_each_turned(lens: lf.Lens, whole: lf.Photometry) -> None:
    """The lens alone with each LED, its table read in the lamp's own directions; as much light is lost as by one."""
    for led, source in zip(LEDS, (section["source"] for section in LEDS), strict=True):
        of_led, single = whole.by_led[str(led["name"])], lens_with(sources=(), source=source, lamps=None)
        alone = lf.photometry(single, rays=MOST_RAYS)
        assert of_led.source_w == 2 * alone.source_w and of_led.source_lm == 2 * alone.source_lm
        away = of_led.exit_w.value + sum(of_led.lost_w.model_dump().values()) + of_led.reflected_w
        assert away == pytest.approx(of_led.source_w, rel=1e-9)
        total = sum(moment(alone, lamp.pose.rotation) for lamp in lens.spec.all_lamps.lamps)
        np.testing.assert_allclose(moment(of_led), total, atol=0.01 * np.linalg.norm(total))


def moment(photometry: lf.Photometry, turned: np.ndarray = LEVEL) -> np.ndarray:
    """Integral of intensity times direction above the horizon, of a lamp that is ``turned``; files are turned over."""
    table = TabulatedIntensity.of(photometric_of(photometry.ies, "lens.ies").intensity)
    over = np.array([1.0, -1.0, 1.0])
    z, turn = (
        coordinates.ravel()
        for coordinates in np.meshgrid((np.arange(400) + 0.5) / 400, np.arange(0, 360, 2) * np.pi / 180)
    )
    u = np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)
    integral: np.ndarray = (table.intensity((u @ turned) * over)[:, None] * u).mean(axis=0)
    return table.flux() * 2 * np.pi * integral


def test_opening_holds_all_lamps_and_only_one_lens_is_round(lens: lf.Lens, whole: lf.Photometry) -> None:
    """The outer faces of all lamps as they lean; its sides go from the lowest rim to the highest point."""
    opening = photometric_of(whole.ies, "lens.ies").opening
    turns = np.radians(np.arange(0.0, 360.0))
    rim = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(360)])
    face, rims = (lens.surfaces["outer"].radius(u)[:, None] * u for u in (fibonacci_hemisphere(20_000), rim))
    lamps = lens.spec.all_lamps.lamps
    points = np.concatenate([lamp.pose.points(outline) for lamp in lamps for outline in (face, rims)])
    x_mm, y_mm, _ = np.ptp(points, axis=0)
    height_mm = points[:, 2].max() - min(lamp.pose.points(rims)[:, 2].min() for lamp in lamps)
    sizes = opening.length_mm, opening.width_mm, opening.heights_mm[0]
    assert sizes == pytest.approx((x_mm, y_mm, height_mm), abs=0.02) and opening.shape == "box"
    alone = lf.photometry(lens_with(lamps=None), rays=2**10)
    assert photometric_of(alone.ies, "lens.ies").opening.shape == "vertical cylinder"


@needs_addon("road")
def test_road_is_lit_by_poles_that_carry_all_lamps(light: lf.Light, whole: lf.Photometry) -> None:
    """By its pixels of the far field, and by the tables of the files: the same road with the same lumens."""
    for led, of_led in light.by_led.items():
        (judged,) = whole.by_led[led].roads
        for limit, other in zip(of_led.limits, judged.limits, strict=True):
            noise = 2.5 * (other.standard_error or 0.0)  # of tables in steps of 2.5 degrees
            assert abs(limit.value - other.value) < 0.04 * other.value + noise, (led, limit.key)


def test_height_of_a_lamp_moves_no_candela() -> None:
    raised = {"kind": "table", "places_mm": [[3.0, 4.0, 7.0]]}
    level, high = (lf.photometry(lens_with(lamps=lamps), rays=2**10) for lamps in (None, raised))
    assert np.array_equal(level.candela, high.candela) and level.exit_w == high.exit_w


def test_files_of_each_led_are_read_back(whole: lf.Photometry, tmp_path: Path) -> None:
    whole.write(tmp_path)
    back = lf.Photometry.read(tmp_path)
    assert back == whole and back.sha256 == whole.sha256
    assert {"lens.ies", "lens_aside.ies", "lens_aside.tm25ray"} <= whole.file_names("photometry")
    (tmp_path / "lens_aside.ldt").write_bytes(whole.ldt)
    assert lf.Photometry.read(tmp_path).sha256 != whole.sha256
    (tmp_path / "lens_aside.ies").unlink()
    with pytest.raises(lf.InputError, match=r"lens_aside\.ies"):
        lf.Photometry.read(tmp_path)


@pytest.mark.parametrize(
    "axis", [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.6, 0.0, 0.8), (-0.36, 0.48, 0.8), (0.48, -0.6, -0.64)]
)
def test_lamps_of_the_proof_stand_as_those_of_the_design(axis: tuple[float, float, float]) -> None:
    np.testing.assert_allclose(stand(axis, 37.0), Pose.facing(axis, turn_deg=37.0).rotation, atol=1e-12)


def test_an_led_moved_by_a_known_pose_is_told_and_stands_there(light: lf.Light) -> None:
    """Its rays start about its place, and its mean direction is the axis after both tilts."""
    assert light.place is None and light.others[0].place is not None
    place = light.others[0].place
    assert (place.file, place.position_mm, place.tilt_deg) == (None, (0.3, -0.2, 0.15), (9.0, -14.0))
    rays = judging_source(lens_with(sources=(), source=LEDS[1]["source"]).spec).sample(2**12, 1)
    axis = Rotation.from_euler("xy", place.tilt_deg, degrees=True).apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(rays.origins.mean(axis=0), place.position_mm, atol=2e-3)
    np.testing.assert_allclose(
        rays.directions.mean(axis=0) / np.linalg.norm(rays.directions.mean(axis=0)), axis, atol=2e-3
    )


def test_light_on_the_wall_is_the_mean_of_both_lamps(lens: lf.Lens, light: lf.Light) -> None:
    for led, state in lens.by_state.items():
        seen = [replace(state, spec=seen_by_lamp(state.spec, number).replace(NO_ROADS)) for number in (0, 1)]
        shares = [lf.evaluate(design, rays=MOST_RAYS).efficiency.value for design in seen]
        assert light.by_led[led].efficiency.value == pytest.approx(np.mean(shares), abs=0.01)
