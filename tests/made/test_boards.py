"""Lamps drawn apart: sums of lamps lit one by one, a patch of equal lamps, rigid plates, and their statistics."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from parts import lens_with, part_of
from presets import FEW
from scenes import NO_TOLERANCES, small_spec, sphere, tolerance_changes

from lensforge.errors import InputError
from lensforge.light.lens_light import evaluate
from lensforge.made.board_light import BoardLight, in_plate
from lensforge.made.part_study import PartStudy, Recipe
from lensforge.made.sensitivity import measure_sensitivity
from lensforge.made.yield_facts import pass_sentence
from lensforge.made.yield_study import contributions, measure_yield
from lensforge.optics.pose import Pose
from lensforge.scene.lens import Lens
from lensforge.scene.perturbations import Draws
from lensforge.search.room_for_parts import require_feasible_tolerances
from lensforge.spec.lamp_places import Lamp
from lensforge.spec.tolerances_section import Factor

PATTERN = {"kind": "rectangle", "width_mm": 20.0, "height_mm": 20.0, "distance_mm": 20.0, "receiver_mm": 40.0}
PERIOD = {**PATTERN, "width_mm": 8.0, "receiver_mm": 20.0, "uniform_mm": 6.0, "distance_mm": 9.0}
GRID = {"kind": "grid", "columns": 3, "rows": 2, "pitch_mm": 15.0}
RING = {"kind": "ring", "count": 3, "diameter_mm": 30.0}
ENDLESS = {"kind": "endless", "lattice": "rectangle", "pitch_mm": 20.0}
PLATE = {"thickness_mm": 2.0}
N = 2**13


def study_of(
    tolerances: dict[str, Any], lamps: dict[str, Any], *, parts: int = 8, rays: int = N, **changes: Any
) -> PartStudy:
    """Of a point source in concentric spheres; as many rays of the lens as designed as of each part."""
    changes = {"target": PATTERN, "base": {"kind": "none"}, "evaluate__filter_variance": 0.0, **changes}
    fields = tolerance_changes({**NO_TOLERANCES, **tolerances})
    lens = Lens.double(sphere(3.0), sphere(6.0), small_spec(lamps=lamps, **changes, **fields), 0, FEW)
    return PartStudy(Recipe(lens, parts, rays, 0, rays))


@pytest.mark.parametrize("lamps", [GRID, RING])
def test_lamps_of_other_flux_make_the_sum_of_lamps_that_are_lit_one_by_one(lamps: dict[str, Any]) -> None:
    """By as many rays of each lamp as of the lens as designed: the pictures are the same, without noise."""
    study = study_of({"source_flux": 0.3}, lamps)
    fluxes = np.array([part.flux for part in part_of(study, 3)])
    assert len(fluxes) == len(study.lamps) and np.ptp(fluxes) > 0.1
    total = np.zeros((16, 16))
    for place, turn, flux in zip(study.lamps.places_mm, study.lamps.turns_deg, fluxes, strict=True):
        table = {"kind": "table", "places_mm": [list(place)], "turns_deg": [turn]}
        lens = study_of({"source_flux": 0.3}, table).recipe.lens
        lit = evaluate(replace(lens, seed=0), rays=N, pixels=16).receivers[0]
        total += flux * lit.map * study.leds[0].light.one.receivers[0].pixel_measure
    received = study.leds[0].light.received(part_of(study, 3))[0]
    np.testing.assert_allclose(received.images.mean(axis=0), total, rtol=1e-3, atol=2e-3 * total.max())
    assert received.emitted_w == pytest.approx(fluxes.mean() * study.leds[0].light.held.emitted_w, rel=1e-12)


def test_light_of_parts_is_in_proportion_to_the_flux_of_their_leds() -> None:
    """Of lenses that are off, too: what each part changes has the flux of its LED."""
    study = study_of({"outer_shift_mm": 0.2, "source_flux": 0.05}, GRID, rays=2**10)
    parts = part_of(study, 2)
    bright = tuple(replace(part, flux=1.3 * part.flux) for part in parts)
    images, brighter, designed = (study.leds[0].light.received(batch)[0].images for batch in (parts, bright, None))
    np.testing.assert_allclose(brighter, 1.3 * images, rtol=1e-9, atol=1e-12 * images.max())
    assert np.abs(images - designed).max() > 0.05 * designed.max()


@pytest.mark.parametrize("lattice", ["rectangle", "hexagon"])
def test_a_patch_of_equal_lamps_is_the_lattice_again_and_again(lattice: str) -> None:
    """Its metrics and limits are those of one period, as are the shares of the light."""
    up = 20.0 * (3.0**0.5 if lattice == "hexagon" else 1.0)
    limits: list[dict[str, Any]] = [
        {"kind": "zone", "at_least_min_over_max": 0.1},
        {"kind": "points", "at_mm": [[2.0, 3.0]], "at_least": 1.0, "unit": "w_per_m2"},
        {"kind": "zone", "at_least_share": 0.1},
        {"kind": "luminance", "of": "mean", "eyes_deg": [[9.0, 4.0]], "spot_mm": 2.0, "blur_deg": 20.0}
        | {"at_most": 1.0, "unit": "w_per_m2_sr"},
    ]
    receiver = {"kind": "plane", "centre_mm": [0.0, 0.0, 20.0], "width_mm": 20.0, "height_mm": up}
    receiver |= {"targets": [{"kind": "disc", "diameter_mm": 10.0, "uniform_mm": 6.0}]}
    study = study_of({"index": 1e-3}, {**ENDLESS, "lattice": lattice}, target=None, receivers=[receiver], limits=limits)
    lit = evaluate(study.recipe.lens, rays=N, pixels=16, seed=0)
    measurement = study.leds[0].light.measured(study.leds[0].light.received(None))
    image = study.leds[0].light.received(None)[0].images.mean(axis=0) / study.leds[0].light.receivers[0].pixel_measure
    np.testing.assert_allclose(image, np.tile(lit.receivers[0].map, (3, 3)), rtol=2e-3, atol=1e-3 * image.max())
    metrics = measurement.metrics[0].metrics()
    for name in ("nmse", "efficiency", "rsd"):
        assert getattr(metrics, name).value == pytest.approx(getattr(lit.receivers[0], name).value, rel=2e-2), name
    assert measurement.shares[0].mean() == pytest.approx(lit.receivers[0].share_in_target.value, rel=2e-2)
    for values, limit in zip(measurement.limits, lit.limits, strict=True):
        of_one = 0.25 if "seen" in limit.label else 0.05  # by the rays of the first lamp
        assert values[0] == pytest.approx(limit.value, rel=of_one), limit.label


@pytest.mark.parametrize(("lamps", "number"), [(GRID, 1), (ENDLESS, 5)])
def test_a_lamp_that_is_moved_as_a_whole_moves_its_own_picture(lamps: dict[str, Any], number: int) -> None:
    """Whole pixels: the change is that of the picture as designed, within the noise of the lamp's share of the rays."""
    amounts = {"source_shift_mm": 1.0, "lens_shift_mm": 1.0}
    study = study_of(amounts, lamps, target=PERIOD, evaluate__pixels=10, rays=2**17)
    light = study.leds[0].light
    step = study.leds[0].light.one.receivers[0].grid.pixel[0]
    assert isinstance(light, BoardLight)
    still = {name: np.zeros(2) for name in ("source_shift_mm", "lens_shift_mm")}
    moved = {name: np.array([2.0 * step, -2.0 * step]) for name in still}
    deviations = [still] * len(study.lamps)
    deviations[number] = moved
    images = light.received(study.leds[0].made(deviations))[0].images
    unit = np.zeros(len(study.lamps))
    unit[number] = 1.0
    (picture,) = light.kinds[0].boards[0].added(light.designed[0][0], unit)
    change = (images - light.received(None)[0].images)[:, 2:-2, 2:-2]

    def off(rows: int, columns: int) -> float:
        """Distance from the picture moved so, in standard errors."""
        wanted = (np.roll(picture, (rows, columns), axis=(1, 2)) - picture)[:, 2:-2, 2:-2]
        noise = (change - wanted).reshape(len(images), -1)
        return float(np.sqrt(np.mean(noise.mean(axis=0) ** 2) / np.mean(noise.var(axis=0, ddof=1) / len(noise))))

    assert off(-2, 2) < 1.25
    assert min(off(2, 2), off(-2, -2), off(0, 0)) > 2.0


def test_lamps_are_drawn_apart_and_their_mean_scatters_as_that_of_independent_ones() -> None:
    study = study_of({"source_flux": 0.1, "index": 1e-3, "lens_shift_mm": 0.1}, GRID, parts=4096)
    fluxes = np.array([study.draws.of_lamp("source_flux", k)[:, 0] for k in range(6)])
    assert np.abs(np.corrcoef(fluxes) - np.eye(6)).max() < 0.06
    assert fluxes.mean(axis=0).std() == pytest.approx(fluxes.std() / np.sqrt(6.0), rel=0.04)
    sums = [np.bincount(share.replicate, share.rays.flux) for share in study.leds[0].light.held.shared_out(6)]
    np.testing.assert_allclose(sums, study.leds[0].light.held.emitted_w / 6.0, rtol=1e-12)
    parts = part_of(study, 5)
    assert len({part.index for part in parts}) == 1 and len({part.made.lens.origin_mm for part in parts}) == 6
    again = study_of({"source_flux": 0.1, "index": 1e-3, "lens_shift_mm": 0.1}, GRID, parts=64)
    assert [part.flux for part in part_of(again, 5)] == [part.flux for part in parts]  # more parts change none
    whole = part_of(study_of({"lens_shift_mm": 0.1, "source_shift_mm": 0.1}, GRID, plate=PLATE), 5)
    assert len({part.made.lens for part in whole}) == 1 and len({part.made.source for part in whole}) == 6
    tilted = study_of({"lens_tilt_deg": 0.1}, GRID, plate=PLATE)
    for part, (x, y) in zip(part_of(tilted, 5), tilted.lamps.places_mm, strict=True):
        about_x, about_y = part.made.lens.axes[1][2], -part.made.lens.axes[0][2]
        assert part.made.lens.origin_mm[2] == pytest.approx(about_x * y - about_y * x, rel=1e-5) != 0.0


def test_lenses_of_a_plate_move_with_it_as_one_body() -> None:
    """Points of a lens, moved in its own frame and then placed, against those of the plate, to first order."""
    place = (40.0, -25.0)
    turn = 35.0
    shrinkage = 1e-5
    plate = {"lens_shift_mm": np.array([0.01, -0.02]), "lens_height_mm": np.array([0.03]), "index": np.array([1e-3])}
    plate |= {"lens_tilt_deg": np.array([2e-5, -3e-5]), "shrinkage": np.array([shrinkage])}
    lamp = Lamp((*place, 0.0), turn_deg=turn)
    deviations = in_plate(plate, lamp)
    points = np.random.default_rng(0).normal(size=(5, 3))

    def moved(numbers: Any, at: np.ndarray) -> np.ndarray:
        x, y = numbers["lens_shift_mm"]
        body = Pose.displaced((x, y, numbers["lens_height_mm"][0]), (*numbers["lens_tilt_deg"], 0.0))
        return np.asarray(body.points(at * (1.0 + shrinkage)))

    by_lens = lamp.pose.points(moved(deviations, points))
    np.testing.assert_allclose(by_lens, moved(plate, lamp.pose.points(points)), atol=1e-7)
    assert deviations["index"] is plate["index"]


def test_causes_of_boards_are_those_of_a_known_sum() -> None:
    """y = 3 a mean of the lamps' numbers + a product of two lamps' + a common number: shares of 9/4, 1 and 2."""
    spread = {"unit": "", "to_internal": 1.0, "amount": 1.0, "kind": "spread", "numbers": 1}
    factors = tuple(Factor(name=name, phrase=name, distribution="uniform", **spread) for name in ("own", "index"))  # type: ignore[arg-type]
    draws = Draws.of(factors, 4096, 0, 4, frozenset({"index"}))
    per_lamp = np.sqrt(3.0) * draws.numbers["own"]
    common = np.sqrt(3.0) * draws.numbers["index"][:, 0]
    assert per_lamp.shape == (4096, 4)
    contribution = contributions(
        draws, 3.0 * per_lamp.mean(axis=1) + per_lamp[:, 0] * per_lamp[:, 2] + np.sqrt(2.0) * common, 0.0
    )
    shares = {cause.tolerance: cause for cause in contribution.causes}
    for name, share in (("own", 3.25 / 5.25), ("index", 2.0 / 5.25)):
        assert abs(shares[name].share - share) < 4.0 * shares[name].standard_error < 0.2, name


def test_yield_and_sensitivity_of_a_board() -> None:
    """The scatter of the mean flux; numbers of each lamp are not in the table. All lamps at an end are a lamp there."""
    limit = {"kind": "points", "at_mm": [[0.0, 0.0]], "at_least": 1.0, "unit": "w_per_m2"}
    tolerances = {"source_flux": {"amount": 0.3, "distribution": "uniform"}, "index": 1e-4}
    lens = study_of(tolerances, ENDLESS, target=PERIOD, limits=[limit]).recipe.lens
    result = measure_yield(lens, parts=40, rays=2**11, with_budget=False)
    assert result.lamps == 9 and result.columns[0] == "index" and "source_flux" not in result.columns
    assert result.worst_maps.shape == (3, 48, 48)
    assert "40 parts of 9 lamps each" in pass_sentence(result)
    assert result.notes[0].startswith("each part is a board of 3 × 3 periods") and "refractive index" in result.notes[0]
    least = result.metrics["limits.0: light"]
    assert least.p50 < 0.9 * least.designed.value  # the darkest of nine lamps decides
    rows = {row.name: row for row in measure_sensitivity(lens, rays=2**11).rows if row.amount > 0.0}
    assert abs(rows["source, flux"].change.nmse.value) < 1e-9  # all alike: no other shape
    with pytest.raises(InputError, match="16 rays for 9 lamps: 16 each at least; give 144"):
        measure_yield(lens, parts=64, rays=16, with_budget=False)


def test_a_tilted_or_shrunk_plate_is_refused_where_its_last_lens_would_meet_the_led() -> None:
    lens = study_of({"shrinkage": 0.09}, {**GRID, "pitch_mm": 40.0}, plate=PLATE).recipe.lens
    with pytest.raises(InputError, match=r"tolerances.shrinkage = 0.09: parts at its end move by 4.0\d mm"):
        require_feasible_tolerances(lens, PartStudy(Recipe(lens, 2, N, 0, N)).factors)
    alone = lens_with({"shrinkage": 0.09})
    require_feasible_tolerances(alone, PartStudy(Recipe(alone, 2, N, 0, N)).factors)
