"""Parts of a lens for several LEDs, of boards with lenses of several kinds, and the colour that parts must keep."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from parts import lens_with
from presets import FEW
from scenes import NO_TOLERANCES, small_spec, tolerance_changes
from several_lamps import BOTH, FAR, NEAR, PLACES, TABLE, board

from lensforge.errors import InputError
from lensforge.light.beam_colour import BeamColour, distances_left_out
from lensforge.light.lens_light import evaluate
from lensforge.made.part_study import PartStudy, Recipe
from lensforge.made.sensitivity import measure_sensitivity
from lensforge.made.tolerance_result import Yield
from lensforge.made.yield_facts import pass_sentence, sensitivity_facts, yield_facts
from lensforge.made.yield_study import measure_yield
from lensforge.scene.lens import Lens

UNIFORM = {"amount": 0.3, "distribution": "uniform"}


def light_limit(bound: float) -> dict[str, Any]:
    return {"kind": "points", "at_mm": [[0.0, 0.0]], "at_least": bound, "unit": "w_per_m2"}


def lens_for(leds: dict[str, Any], tolerances: dict[str, Any], **changes: Any) -> Lens:
    fields = tolerance_changes({**NO_TOLERANCES, **tolerances})
    return replace(lens_with(), spec=small_spec(**fields, **{**leds, **changes}))


def test_a_part_has_with_each_led_the_metrics_that_it_has_with_that_one_alone() -> None:
    tolerances = {"source_shift_mm": 0.2, "source_tilt_deg": 4.0, "outer_shift_mm": 0.2, "source_size": 0.1}
    study = PartStudy(Recipe(lens_for(BOTH, tolerances), 3, 1024, 5, 1024))
    for led, (name, source) in zip(study.leds, (("near", NEAR), ("far", FAR)), strict=True):
        alone = PartStudy(replace(study.recipe, lens=lens_for({"source": source}, tolerances)))
        names = tuple(led.of_design)
        assert names == tuple(f"{name}: {metric}" for metric in alone.names)
        rows = [study.names.index(name) for name in names]
        for number in range(3):
            assert np.array_equal(study.measure(number)[rows], alone.measure(number))
    assert len(study.names) == len(set(study.names)) == 2 * len(alone.names)


def test_a_part_that_is_turned_turns_the_light_of_each_led_about_its_own_place() -> None:
    """Against the same rays, turned by hand about the middle of that LED, through the lens as designed."""
    study = PartStudy(Recipe(lens_for(BOTH, {"source_tilt_deg": 5.0}), 2, 512, 0, 512))
    angle = np.radians(3.0)
    turn = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
    for led, source in zip(study.leds, (NEAR, FAR), strict=True):
        (part,) = led.made([{"source_tilt_deg": np.array([angle, 0.0])}])
        rays = led.light.held.rays
        middle = np.array(source.get("position_mm", [0.0, 0.0, 0.0]))
        turned = replace(rays, origins=middle + (rays.origins - middle) @ turn.T, directions=rays.directions @ turn.T)
        exits = led.light.exit_rays(part)
        wanted = led.light.nominal.trace(turned)
        both = exits.left_lens & wanted.left_lens
        assert both.mean() > 0.9
        for name in ("points", "directions"):
            np.testing.assert_allclose(getattr(exits, name)[both], getattr(wanted, name)[both], atol=1e-9)
        assert np.abs(exits.directions - led.light.exit_rays(None).directions)[both].max() > 0.5 * angle


@pytest.fixture(scope="module")
def study() -> Yield:
    """The light of the second LED misses its bound in the parts whose flux is below 0.95 of its own."""
    lens = lens_for(BOTH, {"source_flux": UNIFORM}, limits=[light_limit(1.0)])
    far = PartStudy(Recipe(lens, 2, 2048, 0, FEW.studies.designed_rays)).of_design["far: limits.0: light"].value
    lens = lens_for(BOTH, {"source_flux": UNIFORM}, limits=[light_limit(0.95 * far)])
    return measure_yield(lens, parts=60, rays=2048, with_budget=False)


def test_the_second_led_decides_which_parts_pass(study: Yield) -> None:
    flux = 1.0 + study.column("source_flux")
    near, far = (study.metrics[f"{led}: limits.0: light"].designed.value for led in ("near", "far"))
    assert near > 1.5 * far and study.leds == ("near", "far")
    for name, designed in (("near", near), ("far", far)):
        np.testing.assert_allclose(study.column(f"{name}: limits.0: light"), designed * flux, rtol=0.02)
    clear = np.abs(flux - 0.95) > 0.02
    assert np.array_equal(study.passing[clear], (flux >= 0.95)[clear]) and 0.2 < study.passing.mean() < 0.8
    assert study.passing_with("near").all() and np.array_equal(study.passing_with("far"), study.passing)
    assert study.pass_rate.value == study.passing.mean() and study.worst_leds == ("far",) * 3
    assert [bound.metric for bound in study.bounds] == ["near: limits.0: light", "far: limits.0: light"]


def test_facts_and_files_name_each_led(study: Yield, tmp_path: Any) -> None:
    study.write(tmp_path)
    assert Yield.read(tmp_path) == study
    first, *rest = yield_facts(study)
    passes = [(fact.label, fact.value) for fact in first.facts if fact.key == "passes_with"]
    assert passes == [("Yield with near", 100.0), ("Yield with far", 100.0 * study.passing.mean())]
    assert {"Near: limits.0: light", "near: limits.0: light"} & {group.title for group in rest if group.key == "bound"}
    assert "meet all limits with each of 2 LEDs" in pass_sentence(study)
    assert "measured with every LED (near, far)" in study.notes[0]


def test_sensitivity_has_the_rows_of_each_led(tmp_path: Any) -> None:
    tolerances = {"source_shift_mm": 0.2, "index": 0.01}
    sensitivity = measure_sensitivity(lens_for(BOTH, tolerances), rays=1024)
    sensitivity.write(tmp_path)
    assert type(sensitivity).read(tmp_path) == sensitivity
    for led, source in zip(sensitivity.by_led.values(), (NEAR, FAR), strict=True):
        alone = measure_sensitivity(lens_for({"source": source}, tolerances), rays=1024)
        assert (led.nominal, led.rows, led.rays) == (alone.nominal, alone.rows, alone.rays)
    assert list(sensitivity.by_led) == ["near", "far"]
    groups = sensitivity_facts(sensitivity)
    assert [group.title for group in groups[:2]] == ["As designed, near", "As designed, far"]
    assert len(groups) == 2 + 2 * len(sensitivity.rows) and groups[-1].title.endswith(", far")


# -- Colour ------------------------------------------------------------------------------------------------------------

RED, BLUE = ({"kind": "gaussian", "peak_nm": peak, "fwhm_nm": 20.0} for peak in (620.0, 460.0))
CHIPS = {"kind": "chips", "chips": [
    {"x_mm": -0.35, "y_mm": 0.0, "width_mm": 0.6, "height_mm": 0.6, "flux_lm": 60.0, "spectrum": RED},
    {"x_mm": 0.35, "y_mm": 0.0, "width_mm": 0.6, "height_mm": 0.6, "flux_lm": 10.0, "spectrum": BLUE},
]}  # fmt: skip


def test_distances_of_two_colours_side_by_side_are_those_of_their_mixture() -> None:
    """Halves of (u', v') = U_1/D_1 and U_2/D_2 mix by D; all replicates are alike: there is no noise."""
    halves = np.array([[3.0, 2.0, 1.0], [1.0, 1.5, 4.0]])
    pictures = np.empty((3, 16, 6, 8))
    pictures[..., :4], pictures[..., 4:] = (half[:, None, None, None] for half in halves)
    weights = halves @ [1.0, 15.0, 3.0]
    uv = np.stack([4.0 * halves[:, 0], 9.0 * halves[:, 1]], axis=1) / weights[:, None]
    away = np.linalg.norm(uv - weights @ uv / weights.sum(), axis=1)
    rows = distances_left_out(pictures, 0.5)
    whole = BeamColour.of(pictures, 0.5)
    assert len(rows) == 17 and whole is not None
    for row in [*rows, {"rms": whole.rms, "worst": whole.worst}]:
        assert row is not None
        assert row["rms"].value == pytest.approx(np.sqrt(np.mean(away**2)), rel=1e-9)
        assert row["worst"].value == pytest.approx(away.max(), rel=0.006)
    assert distances_left_out(0.0 * pictures, 0.5) == [None] * 17


def coloured(bound: float, **changes: Any) -> Lens:
    near = {"kind": "disc", "diameter_mm": 20.0, "distance_mm": 10.0, "receiver_mm": 40.0}
    lens = lens_for({"source": CHIPS, "target": near}, {"source_flux": UNIFORM, "source_size": UNIFORM}, **changes)
    return replace(lens, spec=lens.spec.replace(colour={"max_rms_delta_uv": bound, "max_delta_uv": 0.9}))


RMS = "Δu′v′ rms within half of the peak: distance from the mean colour"


def test_chips_that_stand_farther_apart_mix_less_and_miss_the_limit_on_their_colour() -> None:
    """Distances of colours are as the distance of the chips, to first order; the flux of the LED changes none."""
    bound = evaluate(coloured(0.05), rays=2**15, seed=0).limits[0].metric
    result = measure_yield(coloured(bound.value), parts=60, rays=2**14, with_budget=False)
    rms = result.column(RMS)
    grown = 1.0 + result.column("source_size")
    assert [bound.metric for bound in result.bounds] == [RMS, RMS.replace("rms", "worst")]
    assert result.metrics[RMS].designed.value == pytest.approx(bound.value, abs=3.0 * (bound.standard_error or 0.0))
    np.testing.assert_allclose(rms, result.metrics[RMS].designed.value * grown, rtol=0.1)
    clear = np.abs(grown - 1.0) > 0.12
    assert np.array_equal(result.passing[clear], (grown < 1.0)[clear]) and 0.2 < result.passing.mean() < 0.8
    causes = result.variance[RMS].certain
    assert [cause.tolerance for cause in causes] == ["source_size"] and causes[0].share > 0.8


def test_light_of_one_colour_keeps_any_bound_on_each_receiver_of_a_board() -> None:
    source = {**CHIPS, "chips": [{**chip, "spectrum": RED} for chip in CHIPS["chips"]]}
    plane = {"kind": "plane", "centre_mm": [0.0, 0.0, 40.0], "width_mm": 90.0, "height_mm": 80.0}
    plane |= {"targets": [{"kind": "disc", "diameter_mm": 50.0}]}
    several = [{**plane, "name": "low"}, {**plane, "name": "high", "centre_mm": [0.0, 0.0, 60.0]}]
    lamps = {"kind": "grid", "columns": 2, "rows": 1, "pitch_mm": 20.0}
    lens = coloured(1e-6, lamps=lamps, target=None, receivers=several, source=source, base={"kind": "none"})
    study = PartStudy(Recipe(lens, 2, 1024, 0, 1024))
    names = [f"{place}: {RMS.replace('rms', figure)}" for place in ("low", "high") for figure in ("rms", "worst")]
    assert [bound.metric for bound in study.bounds] == names
    assert (study.excess(study.measure(1)[:, 0]) <= 0.0).all()


# -- Lenses of several kinds -------------------------------------------------------------------------------------------


def test_a_board_of_two_kinds_is_the_sum_of_its_lamps_each_with_its_own_lens_and_flux() -> None:
    tolerances = {"lens_shift_mm": 0.3}
    rays = 2**17
    fluxes = (2.0, 0.4, 1.0)
    study = PartStudy(Recipe(board(tolerances), 4, rays, 0, rays))
    (led,) = study.leds
    parts = [replace(part, flux=flux) for part, flux in zip(led.made(study.deviations(2)), fluxes, strict=True)]
    assert len(led.light.held) == rays

    def summed(kinds: list[str], fluxes: tuple[float, ...]) -> Any:
        """Light of lamps that are lit one by one, each with a lens of its kind."""
        total = np.zeros((16, 16))
        for number, (kind, flux) in enumerate(zip(kinds, fluxes, strict=True)):
            table = {"kind": "table", "places_mm": [PLACES[number]], "turns_deg": [TABLE["turns_deg"][number]]}
            alone = PartStudy(Recipe(board(tolerances, table, kind), 1, rays, 0, rays)).leds[0]
            lit = alone.light.received([replace(parts[number], flux=flux)])[0]
            total += lit.images.mean(axis=0) / 3.0
        return total

    received = led.light.received(parts)[0]
    noise = np.sqrt(np.mean(received.images.var(axis=0, ddof=1) / 16.0))

    def off(wanted: Any) -> float:
        return float(np.sqrt(np.mean((received.images.mean(axis=0) - wanted) ** 2)) / noise)

    assert off(summed(["a", "b", "b"], fluxes)) < 1.5
    assert min(off(summed(["b", "a", "a"], fluxes)), off(summed(["a", "b", "b"], (0.4, 2.0, 1.0)))) > 3.0
    assert received.emitted_w == pytest.approx(np.mean(fluxes), rel=1e-12)


def test_yield_and_sensitivity_of_lenses_of_two_kinds() -> None:
    tolerances = {"source_flux": UNIFORM, "outer_form_um": 40.0, "index": 1e-3}
    result = measure_yield(board(tolerances), parts=40, rays=2**11, with_budget=False)
    lit = evaluate(board(tolerances), rays=2**15, seed=0).receivers[0]
    assert result.lamps == 3 and "each part is a board with 3 lamps" in result.notes[0]
    for name in ("nmse", "efficiency"):
        assert result.metrics[name].designed.value == pytest.approx(getattr(lit, name).value, abs=0.02), name
    kinds = PartStudy(Recipe(board(tolerances), 1, 512, 0, 512)).kinds
    assert [kind.numbers for kind in kinds] == [(0,), (1, 2)]
    rows = {row.name: row.change for row in measure_sensitivity(board(tolerances), rays=2**11).rows}
    assert abs(rows["source, flux"].nmse.value) < 1e-9  # all lamps alike: no other shape
    assert abs(rows["form, outer face"].nmse.value) > 0.0
    with pytest.raises(InputError, match="32 rays for 3 lamps: 16 each at least; give 48"):
        measure_yield(board(tolerances), parts=40, rays=32, with_budget=False)


@pytest.mark.parametrize("kinds", [(), ("a", "b")])
def test_lamps_seen_from_afar_change_as_one_of_them_does(kinds: tuple[str, ...]) -> None:
    """All lamps stand at one place: rows are as for one lamp, within the errors of both; two kinds have one lens."""
    far = {"kind": "rectangle", "width_deg": 40.0, "height_deg": 25.0, "half_angle_deg": 60.0, "uniform_deg": 16.0}
    lamps = {"kind": "table", "places_mm": [[-15.0, 3.0], [14.0, -6.0]], **({"kinds": kinds} if kinds else {})}
    tolerances = {"source_shift_mm": 0.4, "outer_form_um": 90.0, "lens_tilt_deg": 6.0, "index": 0.03, "gap_mm": 0.3}
    results = []
    for changes in ({}, {"lamps": lamps}):
        lens = lens_for({}, tolerances, target=far, base={"kind": "none"}, **changes)
        others = {"b": lens.surfaces} if kinds and changes else {}
        results.append(measure_sensitivity(replace(lens, others=others), rays=2**14))
    alone, together = results
    sure = 0
    for row, row_together in zip(alone.rows, together.rows, strict=True):
        assert (row.name, row.amount) == (row_together.name, row_together.amount)
        for name in ("nmse", "efficiency", "rsd"):
            change = getattr(row.change, name)
            seen = getattr(row_together.change, name)
            error = np.hypot(change.standard_error, seen.standard_error)
            assert abs(change.value - seen.value) < 4.0 * error, (row.name, name)
            sure += abs(change.value) > 8.0 * error
    assert sure >= 4
