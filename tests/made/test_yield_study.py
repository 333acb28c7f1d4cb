"""Parts of a study against closed forms of small errors, and the yield against binomial statistics."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from nightly import NIGHTLY, scaled
from parts import lens_with, part_of, study_of

import lensforge as lf
from lensforge.errors import InputError
from lensforge.light.lens_light import evaluate
from lensforge.made import part_study, yield_study
from lensforge.made.part_study import PartStudy, Recipe
from lensforge.made.part_verbs import _name_of
from lensforge.made.tolerance_result import PassRate, Yield
from lensforge.made.yield_facts import cause_rows, judged_metrics, metric_label, spread_rows, worst_phrase
from lensforge.made.yield_study import measure_yield
from lensforge.results import Metric
from lensforge.results.estimates import rsd_estimate
from lensforge.scene.pixel_grid import PixelGrid, splat_flux

SMALL = {
    "source_shift_mm": 2e-3, "source_height_mm": 2e-3, "source_tilt_deg": 0.1, "source_size": 2e-3,
    "outer_shift_mm": 1e-3, "gap_mm": 1e-3, "outer_tilt_deg": 0.01, "lens_shift_mm": 2e-3, "lens_height_mm": 2e-3,
    "lens_tilt_deg": 0.02, "inner_form_um": 0.1, "outer_form_um": 0.1, "inner_waviness_um": 0.02, "index": 1e-4,
    "shrinkage": 1e-4,
}  # fmt: skip


def _landed(study: PartStudy, part) -> tuple[np.ndarray, np.ndarray]:
    landings = study.leds[0].light.receivers[0].land(study.leds[0].light.exit_rays(part))
    kept = landings.landed
    return landings.hits[kept], landings.flux[kept]


def _smooth_light(study: PartStudy, part) -> np.ndarray:
    """Centroid (mm), light about an edge of the picture (in units of the flux), and a coarse smooth image."""
    hits, flux = _landed(study, part)
    centroid = np.sum(hits * flux[:, None], axis=0) / flux.sum()
    edge = np.sum(flux * np.exp(-0.5 * ((hits[:, 0] - 10.0) / 3.0) ** 2)) / flux.sum()
    image = splat_flux(hits, flux, PixelGrid.square(400.0, 8))
    return np.concatenate([centroid, [edge], image.ravel()])


@pytest.fixture(scope="module")
def small_errors():
    """Smooth light of many parts with small errors, and its derivative by every number that is drawn."""
    study = study_of(SMALL, parts=scaled(2048, by_day=512), rays=2048 if NIGHTLY else 512)
    designed = _smooth_light(study, None)
    parts = np.array([_smooth_light(study, part_of(study, k)[0]) for k in range(study.recipe.parts)]) - designed
    (led,), slopes, variances = study.leds, [], []
    for factor in study.factors:
        numbers = study.draws.numbers[factor.name]
        for axis in range(factor.numbers):
            unit = np.eye(factor.numbers)[axis]
            step = factor.amount * factor.to_internal * unit
            ends = [_smooth_light(study, led.made([{factor.name: sign * step}])[0]) for sign in (1.0, -1.0)]
            slopes.append(0.5 * (ends[0] - ends[1]))
            variances.append(1.0 if factor.kind == "field" else float(np.mean(numbers[:, axis] ** 2)))
    return parts, np.array(slopes), np.array(variances), designed


@pytest.mark.parametrize(("number", "name"), [(0, "x of the centroid"), (1, "y of it"), (2, "light about an edge")])
def test_variances_of_small_errors_add_up(small_errors, number: int, name: str) -> None:
    parts, slopes, variances, _ = small_errors
    expected = float(np.sum(variances * slopes[:, number] ** 2))
    assert parts[:, number].var() == pytest.approx(expected, rel=4.0 * np.sqrt(2.0 / len(parts)) + 0.03), name
    assert abs(parts[:, number].mean()) < 5.0 * np.sqrt(expected / len(parts)) + 0.05 * np.sqrt(expected)


def test_at_an_optimum_the_mean_rise_is_half_the_trace_of_hessian_and_covariance(small_errors) -> None:
    """Where the picture as designed is the target, NMSE is |J x|^2 over its square: its Hessian is 2 J'J over that."""
    parts, slopes, variances, designed = small_errors
    square = np.sum(designed[3:] ** 2)
    rises = np.sum(parts[:, 3:] ** 2, axis=1) / square
    hessian = 2.0 * slopes[:, 3:] @ slopes[:, 3:].T / square
    expected = 0.5 * float(np.sum(np.diag(hessian) * variances))
    assert rises.mean() == pytest.approx(expected, rel=4.0 * rises.std() / rises.mean() / np.sqrt(len(rises)) + 0.05)


def test_a_part_without_errors_has_the_numbers_of_the_design_to_the_last_bit() -> None:
    study = study_of({"gap_mm": 1e-300, "inner_form_um": 1e-300}, parts=2)
    values = study.measure(1)
    assert values[:, 0].tolist() == [metric.value for metric in study.of_design.values()]


_WHITE = {"kind": "table", "wavelength_nm": [450.0, 550.0, 650.0], "weight": [1.0, 2.0, 1.0]}
_SOURCES = {
    "of one index": {"kind": "square", "side_mm": 1.0},
    "of a spectrum": {"kind": "square", "side_mm": 1.0, "spectrum": _WHITE},
}


@pytest.mark.parametrize("source", _SOURCES)
def test_every_tolerance_moves_the_light_of_every_kind_of_ray(source: str) -> None:
    """Also of rays that carry an index of their own each; the flux of the LED alone changes no landing."""
    amounts = SMALL | {"source_flux": 0.1, "outer_waviness_um": 0.02, "inner_ripple_um": 0.1, "outer_ripple_um": 0.1}
    amounts |= {"inner_roughness_mrad": 1.0, "outer_roughness_mrad": 1.0}
    glass = {"material": "PMMA"} if source == "of a spectrum" else {}
    study = PartStudy(Recipe(lens_with(amounts, source=_SOURCES[source], lens=glass), 2, 512, 0, 512))
    assert (study.leds[0].light.held.rays.wavelengths_nm is None) == (source == "of one index")
    hits, _ = _landed(study, None)
    assert {factor.name for factor in study.factors} == set(amounts)
    for factor in study.factors:
        deviation = {factor.name: factor.amount * factor.to_internal * np.ones(factor.numbers)}
        part = study.leds[0].made([deviation])[0]
        moved, _ = _landed(study, part)
        if factor.name == "source_flux":
            assert (moved == hits).all() and part.flux == pytest.approx(1.1)
        else:
            assert moved.shape != hits.shape or np.abs(moved - hits).max() > 1e-7, factor.name
            assert part.flux == 1.0


EYES = [
    {"kind": "luminance", "of": of, "eyes_deg": [(35.0, -25.0)], "spot_mm": 4.0, "blur_deg": 8.0, "at_most": 1.0}
    | {"unit": "w_per_m2_sr"}
    for of in ("peak", "mean")
]


def test_luminance_of_a_part_is_that_of_a_lens_over_a_led_that_is_off_as_much() -> None:
    """By evaluations of a spec with the LED at that place.

    The mean is the same. The change of the brightest spot is right to a tenth: a part is seen as in a search, with
    spots of half as many pixels and a blur that also blurs the LED.
    """
    lens = lens_with({"source_shift_mm": 1.0}, limits=EYES)
    study = PartStudy(Recipe(lens, 2, 2**16, 0, 2**16))
    away = np.array([-0.5, 0.4])
    figures = study.leds[0].measure([{"source_shift_mm": away}])
    moved = replace(lens, spec=lens.spec.replace({"source.position_mm": [*away, 0.0]}))
    there, here = (evaluate(design, rays=2**16, seed=0).limits for design in (moved, lens))
    for bound, limit, designed in zip(study.bounds, there, here, strict=True):
        value, error = figures[study.names.index(bound.metric)]
        assert limit.value < 0.95 * designed.value, designed.note
        within = 0.1 * (designed.value - limit.value) if "brightest" in designed.note else 1e-3 * limit.value
        assert value == pytest.approx(limit.value, abs=within), designed.note
        assert 0.0 < error < 0.01 * value, designed.note


def test_flux_of_the_source_scales_light_and_no_share() -> None:
    limit = {"kind": "points", "name": "axis", "at_mm": [[0, 0]], "unit": "w_per_m2", "at_least": 1.0}
    shares = [
        {"kind": "zone", "name": "in zone", "zone": {"kind": "disc", "diameter_mm": 60.0}, "at_least_share": 0.01},
        {"kind": "loss", "name": "lost", "cause": "beside", "at_most_share": 0.9},
    ]
    limits = [limit, *shares, *EYES]
    study = PartStudy(Recipe(lens_with({"source_flux": 0.5}, limits=limits), 8, 2048, 0, 2048))
    before = {name: metric.value for name, metric in study.of_design.items()}
    for number in range(4):
        flux = part_of(study, number)[0].flux
        values = dict(zip(study.names, study.measure(number)[:, 0], strict=True))
        (light,) = (name for name in study.names if name.startswith("axis"))
        designed = study.leds[0].designed.limits[0][0]
        assert values[light] - before[light] == pytest.approx(designed * (flux - 1.0), rel=1e-6)
        seen = [name for name in study.names if "seen from" in name]
        assert [values[name] / before[name] for name in seen] == pytest.approx([flux] * 2, rel=1e-9)
        limited = [name for name in study.names if name.startswith(("in zone", "lost"))]
        assert len(limited) == 2 and all(before[name] > 0.0 for name in limited)
        for name in ("nmse", "efficiency", "share_in_target", *limited):
            assert values[name] == pytest.approx(before[name], rel=1e-9), name


@pytest.mark.parametrize(
    ("passed", "count", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_the_interval_is_that_of_published_examples(passed: int, count: int, low: float, high: float) -> None:
    """Newcombe, Statistics in Medicine 17, 857 (1998), table I, method 3."""
    rate = PassRate.of(passed, count)
    assert (rate.value, rate.low, rate.high) == pytest.approx((passed / count, low, high), abs=5e-5)
    mirrored = PassRate.of(count - passed, count)
    assert (mirrored.low, mirrored.high) == pytest.approx((1.0 - high, 1.0 - low), abs=5e-5)


@pytest.mark.nightly("hundreds of parts")
def test_yields_of_many_seeds_scatter_no_more_than_binomial() -> None:
    first = study_of(None, rays=512)
    seeds, parts = scaled(200), 40
    median = None
    rates = []
    for seed in range(seeds):
        study = PartStudy(Recipe(first.recipe.lens, parts, 512, 0, 512))
        for name in ("light", "maker", "designed", "designed_light", "of_design"):
            study.__dict__[name] = getattr(first, name)
        study.__dict__["draws"] = type(study.draws).of(study.factors, parts, seed)
        values = np.array([study.measure(number)[0, 0] for number in range(parts)])
        median = np.median(values) if median is None else median
        rates.append(np.mean(values <= median))
    share = float(np.mean(rates))
    # the variance of a sample of 12 is within 2.4 times of the truth but for 5 in 1000
    assert np.var(rates, ddof=1) < 2.4 * share * (1.0 - share) / parts


@pytest.fixture(scope="module")
def result() -> Yield:
    return measure_yield(lens_with(), parts=48, rays=1024, with_budget=False)


@pytest.fixture(scope="module")
def few() -> Yield:
    """By so few rays that their noise outweighs the spread of some metrics."""
    return measure_yield(lens_with(), parts=48, rays=128, with_budget=False)


def test_noise_that_outweighs_the_spread_is_said_and_no_two_parts_are_made_alike(few: Yield) -> None:
    undecided = {name for name, spread in few.metrics.items() if spread.undecided}
    assert "rsd" in undecided
    shown = {row.title: row.line for row in spread_rows(few)}
    for name, spread in few.metrics.items():
        assert np.ptp(few.column(name)) == 0.0 or spread.p5 < spread.p50 < spread.p95, name
        assert ("undecided" in shown[metric_label(name)]) == (name in undecided), name
    judged = {bound.metric for bound in few.bounds}
    for name in judged & undecided:
        assert any(note.startswith(f"{name}: undecided which parts pass") for note in few.notes)


def test_few_rays_make_no_impossible_figure_and_noise_keeps_its_state_wherever_it_is_stored(few: Yield) -> None:
    assert few.column("rsd").min() >= 0.0 and few.metrics["rsd"].p5 >= 0.0
    assert few.column("uniformity").min() >= 0.0 and few.column("uniformity").max() <= 1.0
    undecided = {name for name, spread in few.metrics.items() if spread.undecided}
    header = few.products()[".csv"].decode().splitlines()[0].split(",")
    assert {name.removesuffix(" (undecided)") for name in header if name.endswith(" (undecided)")} == undecided
    stored = few.model_dump()["metrics"]
    assert {name for name in stored if stored[name]["undecided"]} == undecided >= {"rsd"}
    assert not {row.title for row in cause_rows(few)} & {metric_label(name) for name in undecided}
    for name in undecided & set(judged_metrics(few)):
        assert f"{metric_label(name)} " in worst_phrase(few, few.worst[0])
        assert "(undecided)" in worst_phrase(few, few.worst[0]).split(f"{metric_label(name)} ")[1].split(";")[0]


def test_the_spread_of_the_rsd_is_that_of_many_rays() -> None:
    """By few rays the root of one lens may be 0 and of the next above the designed value: squares are compared."""
    images = np.random.default_rng(3).normal(1.0, 0.05, (16, 4, 4))
    mask = np.ones((4, 4), dtype=bool)
    lit = 1.0 + 0.1 * np.sign(np.arange(4) - 1.5)  # adds 0.1 squared to the square of the RSD
    before, after = rsd_estimate(images, mask), rsd_estimate(images * lit, mask)
    change = after.change_of(0.2, before)
    assert 0.2 + change.value == pytest.approx(np.sqrt(0.2**2 + after.square.value - before.square.value), rel=1e-12)
    assert 0.2 + change.value == pytest.approx(np.sqrt(0.2**2 + 0.1**2), rel=0.05)
    assert before.change_of(0.2, before).value == 0.0
    assert 0.05 + before.change_of(0.05, after).value == 0.0, "at least none"


def test_the_record_agrees_with_its_table_and_is_read_back(result: Yield, tmp_path) -> None:
    assert result.table.shape == (48, len(result.columns))
    kept = np.ones(48, dtype=bool)
    for bound in result.bounds:
        column = result.column(bound.metric)
        kept &= column <= bound.bound if bound.sense == "<=" else column >= bound.bound
    assert (kept == result.passing).all()
    assert result.pass_rate == PassRate.of(int(kept.sum()), 48)
    for name, spread in result.metrics.items():
        column = result.column(name)
        assert spread.mean.value == pytest.approx(column.mean())
        assert spread.p5 <= spread.p50 <= spread.p95
        assert spread.spread <= column.std(ddof=1) * (1.0 + 1e-12)
    for part in result.worst:
        assert part.metrics["nmse"] == result.column("nmse")[part.part]
    result.write(tmp_path)
    assert Yield.read(tmp_path) == result
    result.save(tmp_path / "parts.csv")
    rows = np.genfromtxt(tmp_path / "parts.csv", delimiter=",", skip_header=1)
    assert np.allclose(rows[:, 1:], result.table, rtol=1e-8)


@pytest.mark.parametrize(
    ("tolerances", "message"),
    [
        ({"gap_mm": 4.0}, "tolerances.gap_mm = 4: parts at its end move by 4 mm, but the faces are"),
        # x and y at their ends together
        ({"outer_shift_mm": 2.5}, "tolerances.outer_shift_mm = 2.5: parts at its end move by 3.54 mm, but the faces"),
        ({"source_height_mm": 4.9}, "the source is .* mm from the inner face at its closest; at most"),
    ],
)
def test_a_tolerance_that_the_part_cannot_bear_is_one_line(tolerances: dict, message: str) -> None:
    with pytest.raises(InputError, match=message) as error:
        measure_yield(lens_with(tolerances), parts=48, rays=256)
    assert "\n" not in str(error.value)


def test_rays_are_doubled_until_a_part_is_certain() -> None:
    study = measure_yield(lens_with({"gap_mm": 0.2}), parts=48, with_budget=False)
    nmse = study.metrics["nmse"]
    assert study.rays > 256
    assert study.rays == 2**10 or nmse.standard_error <= 0.15 * max(nmse.spread, 0.01 * nmse.mean.value)


def test_limits_of_the_same_name_are_metrics_of_their_own() -> None:
    at = {"kind": "points", "name": "axis", "at_mm": [[0, 0]]}
    limits = [
        {**at, "unit": "w_per_m2", "at_least": 1.0},
        {**at, "unit": "w_per_m2", "at_least": 2.0},
        {**at, "unit": "w_per_m2", "at_most": 1e6},
    ]
    study = PartStudy(Recipe(lens_with({"gap_mm": 0.1}, limits=limits), 2, 256, 0, 256))
    assert study.names[-3:] == ("axis: light (least)", "axis: light (least) 2", "axis: light (most)")
    assert study.measure(0).shape == (len(study.names), 2)
    assert len(study.bounds) == 3


def test_other_tolerances_name_themselves() -> None:
    import lensforge as lf

    lens = lens_with()
    given = (
        None,
        lf.TolerancesSection(preset="precision"),
        lf.PartTolerances(preset="moulded", faces={"outer": {"gap_mm": 0.1}}),
    )
    plain, other, custom = (
        lf.tolerance(lens, parts=40, rays=8192, budget=False, tolerances=tolerances) for tolerances in given
    )
    assert plain.conditions is None and other.conditions.name == "precision"
    assert custom.conditions.name.startswith("own_")
    names = {_name_of(lf.PartTolerances(preset="precision", faces={"outer": {"gap_mm": gap}})) for gap in (0.1, 0.2)}
    assert len(names) == 2 and "precision" not in names
    assert other.inputs["lens"] == plain.inputs["lens"] == lens.sha256
    assert 0.0 < other.metrics["efficiency"].spread < plain.metrics["efficiency"].spread
    with pytest.raises(InputError, match="no_such"):
        lf.tolerance(lens, tolerances="no_such")


def test_the_worst_part_is_the_farthest_beyond_its_bound_in_units_of_the_spread() -> None:
    """Part 1 by 40 lx of a spread of 125, part 2 by 3 lm of a spread of 1.4; each bound is that of another LED."""
    excess = np.array([[-300.0, -0.1], [40.0, -0.3], [-100.0, 3.0], [-200.0, -0.2]])
    leds = tuple(SimpleNamespace(led=name, bounds=("of one",)) for name in ("near", "far"))
    study = SimpleNamespace(excess=lambda values: values, names=("lux", "lumen"), leds=leds)
    worst, of_parts = yield_study._worst(study, np.stack([excess, excess], axis=-1))
    assert of_parts[:2] == ("far", "near")
    assert [row.part for row in worst[:2]] == [2, 1]
    assert [row.passes for row in worst] == [False, False, True, True][: len(worst)]
    assert worst[0].metrics == {"lux": -100.0, "lumen": 3.0}


def test_a_part_has_the_roughness_that_was_drawn_for_each_face() -> None:
    study = study_of({"inner_roughness_mrad": 0.2, "outer_roughness_mrad": 0.5}, parts=3, rays=256)
    for number in range(3):
        (part,) = part_of(study, number)
        for face, amount in (("inner", 0.2e-3), ("outer", 0.5e-3)):
            drawn = study.draws.numbers[f"{face}_roughness_mrad"][number].ravel()[0]
            assert part.made.slopes[face] == pytest.approx(amount * abs(drawn), rel=1e-12)


def test_with_the_flux_that_a_study_names_as_many_parts_pass() -> None:
    """Parts of a lens with that LED, traced; and of one with a little less."""
    limits = [{"kind": "points", "at_mm": [[20, 10], [-20, 10]], "unit": "w_per_m2", "at_least": 1.0}]
    amounts = {"source_shift_mm": 0.3, "source_flux": 0.05}
    designed = measure_yield(lens_with(amounts, limits=limits), parts=40, rays=2048, with_budget=False)
    limits[0]["at_least"] = designed.metrics[designed.bounds[0].metric].p50

    def studied(flux_w: float) -> Yield:
        lens = lens_with(amounts, limits=limits)
        lens = replace(lens, spec=lens.spec.replace({"source.flux_w": flux_w}))
        return measure_yield(lens, parts=40, rays=2048, with_budget=False)

    before = studied(1.0)
    assert before.flux is not None and before.flux.factor is not None and before.flux.factor > 1.0
    assert before.pass_rate.value < before.flux.pass_rate == 0.95
    assert studied(before.flux.factor * (1.0 + 1e-9)).pass_rate.value == 0.95
    assert studied(before.flux.factor * (1.0 - 1e-6)).pass_rate.value == 0.925


def test_a_study_says_where_the_spec_has_no_limits() -> None:
    """By what its parts pass then, in numbers; one limit of the spec is enough to say nothing."""
    limit = {"kind": "points", "at_mm": [[20, 10]], "unit": "w_per_m2", "at_least": 1e-6}
    notes = {}
    for limits in ([], [limit]):
        study = measure_yield(lens_with({"gap_mm": 0.1}, limits=limits), parts=40, rays=128, with_budget=False)
        notes[len(limits)] = [note for note in study.notes if "[[limits]]" in note]
        if not limits:
            bounds = "; ".join(map(str, study.bounds))
            assert bounds.startswith("nmse <= 0.1; share_in_target >= 0.") and bounds in notes[0][0]
    assert len(notes[0]) == 1 and notes[1] == []


@pytest.mark.parametrize(("aim", "names"), [("pattern", ["nmse", "share_in_target"]), ("share", ["share_in_target"])])
def test_parts_without_limits_are_judged_by_what_the_verdict_on_the_light_counts(aim: str, names: list[str]) -> None:
    """A lens whose search aims at the share of the light in the target alone has no pattern to keep."""
    study = PartStudy(Recipe(lens_with({"gap_mm": 0.1}, optimise={"aim": aim}), 2, 256, 0, 256))
    assert [bound.metric for bound in study.bounds] == names
    assert [(bound.sense, bound.bound) for bound in study.bounds][:-1] == [("<=", 0.1)] * (len(names) - 1)
    light = study.leds[0].designed_light.first
    transmitted = (1.0 - (0.4936 / 2.4936) ** 2) ** 2  # of two faces of PMMA
    most = min(transmitted * light.wanted_in_target, light.possible.share_in_target)
    assert (study.bounds[-1].sense, study.bounds[-1].bound) == (">=", pytest.approx(0.7 * most))


def test_shapes_finer_than_the_tables_are_told_where_the_spec_states_them_not_of_a_preset() -> None:
    for tolerances, told in ((None, 0), ({"inner_waviness_um": 0.2}, 1), ({"outer_waviness_um": 0.2}, 1)):
        study = measure_yield(lens_with(tolerances), parts=40, rays=128, with_budget=False)
        notes = [note for note in study.notes if "taken as roughness" in note]
        assert len(notes) == told and all(note.startswith("waviness, ") for note in notes)


def test_the_mean_of_the_parts_is_uncertain_by_parts_by_the_design_and_by_the_rays_that_all_share() -> None:
    """By hand: variance of 1, 2, 6 over 3, squares of 0.5 and of a quarter of the mean of 0.1, 0.2 and 0.4 squared."""
    values = np.array([[1.0, 0.1], [2.0, 0.2], [6.0, 0.4]])
    spread = yield_study._spread(Metric(value=2.5, unit="lx", standard_error=0.5), values, 0.25)
    assert (spread.mean.value, spread.mean.unit) == (3.0, "lx")
    assert spread.mean.standard_error == pytest.approx(np.sqrt(7.0 / 3.0 + 0.25 + 0.25 * 0.21 / 3.0), rel=1e-12)
    exact = yield_study._spread(Metric(value=2.5), values * [1.0, 0.0], 0.25)
    assert exact.mean.standard_error == pytest.approx(np.sqrt(7.0 / 3.0), rel=1e-12)


@pytest.mark.parametrize("share", [0.0, 0.2, 0.8, 1.0])
def test_noise_that_all_parts_have_is_told_from_that_of_each(share: float) -> None:
    """Of 32 parts by 16 replicates: noise of known variance that is in all, and noise of each part's own."""
    chance = np.random.default_rng(5)
    shares = []
    for _ in range(100):
        common = chance.standard_normal(16)
        alone = chance.standard_normal((32, 16))
        shares.append(part_study._in_common(np.sqrt(share) * common + np.sqrt(1.0 - share) * alone))
    assert np.mean(shares) == pytest.approx(share, abs=0.05)  # each scatters by up to 0.2, and is 0 at least
    assert part_study._in_common(np.zeros((32, 16))) == part_study._in_common(np.zeros((32, 0))) == 0.0


def test_what_replicates_add_to_the_noise_of_a_part_is_in_the_order_of_its_metrics() -> None:
    """The jackknife of those that are means, efficiency and flux in the target, is the error of the change."""
    study = study_of(parts=40, rays=1024)
    (led,) = study.leds
    deviations = study.deviations(3)
    errors = led.measure(deviations)[:, 1]
    noise = led.noise(deviations)
    assert len(noise) == len(study.names) == len(study.noise_in_common(4))
    for name in ("efficiency", "share_in_target"):
        number = study.names.index(name)
        assert noise[number].std(ddof=1) / 4.0 == pytest.approx(errors[number], rel=1e-9)


@pytest.mark.nightly("minutes: the yield of twenty seeds")
@pytest.mark.parametrize("rays", [256, 2048])
def test_the_mean_of_the_parts_scatters_over_the_seeds_by_its_error(rays: int) -> None:
    """By few rays, whose noise all parts share: the scatter of the parts over the root of their number is a fifth."""
    lens = lens_with()
    studies = []
    for seed in range(20):
        studies.append(lf.tolerance(replace(lens, seed=seed), parts=40, rays=rays, seed=seed, budget=False))
    for name in ("nmse", "efficiency", "share_in_target", "rsd", "uniformity"):
        means = [study.metrics[name].mean for study in studies]
        stated = np.sqrt(np.mean([(mean.standard_error or 0.0) ** 2 for mean in means]))
        assert 0.6 < np.std([mean.value for mean in means], ddof=1) / stated < 1.5, name  # known to 16 %
