"""Figures of trades as limits: closed forms on pictures that are shifted and unequal, bounds on each side, slopes."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.light.judged_limits import judged, limit_value
from lensforge.optics.efficacy import Efficacy
from lensforge.scene.limit_readings import LightLimit, light_limits, stated_readings
from lensforge.scene.receiver import PosedReceiver
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.search.limit_terms import LimitTerm, limit_terms
from lensforge.sources.build_source import build_source
from lensforge.sources.joined_spectrum import efficacy_of
from lensforge.spec import Spec

LM_PER_W = 200.0
EFFICACY = Efficacy(LM_PER_W, photons=4.6)
PLANE = {"kind": "rectangle", "width_mm": 200.0, "height_mm": 120.0, "distance_mm": 300.0, "receiver_mm": 400.0}
FAR = {"kind": "beam", "fwhm_deg": 4.0, "half_angle_deg": 5.0}


def spec_with(*limits: dict[str, object], target: dict[str, object] = PLANE, **more: Any) -> Spec:
    return small_spec(target=target, **more).replace(limits=limits)


def read(spec: Spec, light: Any, pixels: int = 200, noise: float = 0.0) -> dict[str, Any]:
    """Values of the limits of ``spec`` on a picture of ``light`` (W/m² or W/sr) at places (x, y), by their words."""
    receiver = receivers_of(spec, pixels)[0]
    limits = light_limits(spec, [receiver], EFFICACY, 1.0)
    return {limit.quantity.phrase: limit_value(limit, images_of(receiver, light, noise)) for limit in limits}


def images_of(receiver: PosedReceiver, light: Any, noise: float = 0.0) -> np.ndarray:
    x, y = receiver.target_coordinates(*np.meshgrid(receiver.grid.x(), receiver.grid.y()))
    flux = light(x, y) * receiver.pixel_measure
    return np.stack([flux * (1.0 + noise * np.random.default_rng(k).normal(size=flux.shape)) for k in range(16)])


SCREEN = {"kind": "screen", "width_mm": 180.0, "height_mm": 90.0, "centre_mm": [30.0, -20.0]}


@pytest.mark.parametrize("meter", [{}, {"meter_mm": 25.0}])
def test_a_screen_is_judged_by_its_nine_and_thirteen_points(meter: dict[str, float]) -> None:
    """Of E = 10 + x/50 - y/40 the mean of nine is that at the middle; the extremes are in the corners, at 0.9."""
    bounds = {"unit": "lx", "at_least": 1.0, "at_least_min_over_mean": 0.1, "at_most_max_over_mean": 2.0}
    figures = read(spec_with(SCREEN | bounds | meter), lambda x, y: 10.0 + x / 50.0 - y / 40.0)
    middle = 10.0 + 30.0 / 50.0 + 20.0 / 40.0
    off = 0.9 * (90.0 / 50.0 + 45.0 / 40.0)
    assert figures["mean light of nine points"].value == pytest.approx(LM_PER_W * middle, rel=1e-9)
    assert figures["mean light of nine points"].unit == "lx"
    assert figures["min of 13 points/mean of 9"].value == pytest.approx(1.0 - off / middle, rel=1e-9)
    assert figures["max of 13 points/mean of 9"].value == pytest.approx(1.0 + off / middle, rel=1e-9)


def test_one_dark_corner_decides_a_screen_and_a_dark_middle_of_an_edge_does_not() -> None:
    bounded = spec_with(SCREEN | {"at_least_min_over_mean": 0.1})

    def with_hole(at_x: float, at_y: float) -> float:
        hole = lambda x, y: 1.0 - 0.5 * ((np.abs(x - at_x) < 6.0) & (np.abs(y - at_y) < 6.0))  # noqa: E731
        return float(read(bounded, hole)["min of 13 points/mean of 9"].value)

    assert with_hole(30.0 - 81.0, -20.0 + 40.5) == pytest.approx(0.5, rel=1e-9), "a corner point"
    assert with_hole(30.0 + 60.0, -20.0) == pytest.approx(0.5 / (1.0 - 0.5 / 9.0), rel=1e-9), "one of the nine"
    assert with_hole(30.0 - 85.0, -20.0) == pytest.approx(1.0), "no point"


def test_a_light_field_has_the_diameters_of_its_gaussian() -> None:
    """Widths of exp(-(u/a)^2 - (v/b)^2) along four diameters: at 45 degrees the square of 1/r is the mean of both."""
    a, b = 60.0, 30.0
    field = {"kind": "light_field", "centre_mm": [12.0, -16.0], "unit": "w_per_m2", "at_least": 0.1}
    bounds = {"at_least_d10_mm": 1.0, "at_most_d50_mm": 300.0, "at_least_d50_over_d10": 0.1}

    def light(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 7.0 * np.exp(-(((x - 12.0) / a) ** 2) - ((y + 16.0) / b) ** 2)

    spec = spec_with(field | bounds)
    receiver = receivers_of(spec, 200)[0]
    values = [
        limit_value(limit, images_of(receiver, light)) for limit in light_limits(spec, [receiver], Efficacy(), 1.0)
    ]
    slanted = 1.0 / np.sqrt(0.5 / a**2 + 0.5 / b**2)
    mean = np.mean([a, slanted, b, slanted])
    wanted = [
        7.0,
        2.0 * mean * np.sqrt(np.log(10.0)),
        2.0 * mean * np.sqrt(np.log(2.0)),
        np.sqrt(np.log(2.0) / np.log(10.0)),
    ]
    assert [value.value for value in values] == pytest.approx(wanted, rel=2e-3)
    assert [value.unit for value in values] == ["W/m²", "mm", "mm", ""]


@pytest.mark.parametrize("width_deg", [0.1, 0.3])
def test_the_gradient_of_a_cut_off_is_its_steepest_tenth_of_a_degree(width_deg: float) -> None:
    """Of log10 I = -tanh((v + 0.6 + x/10)/w) it is 2 tanh(0.05/w); the line at x = -2.5 has its edge at -0.35."""
    limit = {"kind": "cut_off", "at_least_gradient": 0.1, "at_most_gradient": 3.0}
    spec = spec_with(limit, target=FAR)
    figures = read(spec, lambda x, y: 5.0 * 10.0 ** -np.tanh((y + 0.6 + 0.1 * x) / width_deg), pixels=800)
    assert figures["gradient G of the cut-off"].value == pytest.approx(2.0 * np.tanh(0.05 / width_deg), rel=0.02)


def test_light_above_the_brightest_place_moves_with_it() -> None:
    """The brightest place of a Gaussian about (30, 40); 50 mm above it, in the same column, is the most light there."""
    light = {"kind": "peak", "unit": "lx", "at_least": 1.0}
    above = {"kind": "peak", "unit": "lx", "at_most": 1e6, "up_mm": 50.0}
    for x0, y0 in ((30.0, 40.0), (-55.0, -70.0)):
        gaussian = lambda x, y: 3.0 * np.exp(-((x - x0) ** 2 + (y - y0) ** 2) / 60.0**2)  # noqa: E731, B023
        figures = read(spec_with(light, above), gaussian, pixels=400)
        assert figures["light of the brightest place"].value == pytest.approx(3.0 * LM_PER_W, rel=2e-3)
        falls = np.exp(-(50.0**2) / 60.0**2)
        assert figures["light above the brightest place"].value == pytest.approx(3.0 * LM_PER_W * falls, rel=0.03)
    over_edge = read(spec_with(light, above), lambda x, y: 1.0 + y / 300.0)
    assert over_edge["light above the brightest place"].value == 0.0


def test_a_zone_has_its_mean_in_each_unit_and_its_contrast() -> None:
    """Of 4 + x/100 in a rectangle of 150 mm about (-20, 10); the outermost centres lie on its sides."""
    zone = {"kind": "rectangle", "width_mm": 150.0, "height_mm": 60.0, "centre_mm": [-20.0, 10.0]}
    bounds = {"at_least_mean_lx": 1.0, "at_most_mean_w_per_m2": 9.0, "at_least_mean_mw_per_cm2": 0.01}
    bounds["at_least_mean_umol_per_m2_s"] = 1.0
    spec = spec_with({"kind": "zone", "zone": zone, "at_most_contrast": 0.5} | bounds)
    receiver = receivers_of(spec, 200)[0]
    images = images_of(receiver, lambda x, y: 4.0 + x / 100.0)
    values = {limit.unit: limit_value(limit, images).value for limit in light_limits(spec, [receiver], EFFICACY, 1.0)}
    assert values == pytest.approx(
        {"": 0.75 / 3.8, "lx": 3.8 * LM_PER_W, "W/m²": 3.8, "mW/cm²": 0.38, "µmol/(m² s)": 3.8 * 4.6}, rel=1e-9
    )  # centres from -95 to 55 mm


@pytest.mark.parametrize(("bound", "state"), [(1039.0, "pass"), (1041.0, "fail")])
def test_a_dose_is_the_irradiance_over_the_exposure(bound: float, state: str) -> None:
    """At (30, -70) mm there are 4.3 W/m², 0.43 mW/cm²: in 2,418.6 s 1,040 mJ/cm²; the second of two decides."""
    point = {"kind": "points", "at_mm": [[30.0, -70.0]], "unit": "mj_per_cm2", "exposure_s": 2418.6}
    spec = spec_with({"kind": "zone", "at_least_mean_mj_per_cm2": 7.9, "exposure_s": 20.0}, point | {"at_least": bound})
    receiver = receivers_of(spec, 200)[0]
    images = images_of(receiver, lambda x, y: 4.0 + x / 100.0, 1e-6)
    mean, place = light_limits(spec, [receiver], EFFICACY, 1.0)
    assert (mean.unit, limit_value(mean, images).value) == ("mJ/cm²", pytest.approx(8.0, rel=1e-6))
    assert judged(place, "light", limit_value(place, images)).state == state


RED, BLUE = ({"kind": "line", "wavelength_nm": nm} for nm in (660.0, 450.0))
CHIP = {"width_mm": 0.5, "height_mm": 0.5, "y_mm": 0.0}


def test_photons_are_those_of_the_chips_by_their_power() -> None:
    """Of 3 W at 660 nm and 1 W at 450 nm by the mean of both wavelengths; the zone is darkest at its left edge."""
    chips = [
        CHIP | {"x_mm": -0.4, "flux_w": 3.0, "spectrum": RED},
        CHIP | {"x_mm": 0.4, "flux_w": 1.0, "spectrum": BLUE},
    ]
    limit = {"kind": "zone", "unit": "umol_per_m2_s", "at_least": 5.0}
    spec = spec_with(limit, source={"kind": "chips", "chips": chips})
    efficacy = efficacy_of(build_source(spec.source), spec.source, photons=spec.counts_photons)
    assert efficacy.photons == pytest.approx((0.75 * 660.0 + 0.25 * 450.0) / 119.62656, rel=1e-6)
    receiver = receivers_of(spec, 100)[0]
    (darkest,) = light_limits(spec, [receiver], efficacy, 4.0)
    images = images_of(receiver, lambda x, y: 4.0 + x / 100.0)
    assert limit_value(darkest, images).value == pytest.approx((4.0 - 1.98) * efficacy.photons, rel=1e-9)


@pytest.mark.parametrize(("bound", "state"), [(16.54, "pass"), (16.56, "fail")])
def test_photons_are_judged_on_each_side_of_their_number(bound: float, state: str) -> None:
    """Of 3 W/m² at 660 nm there are 16.552 µmol/(m² s)."""
    source = {"kind": "square", "side_mm": 1.0, "spectrum": RED}
    spec = spec_with({"kind": "zone", "at_least_mean_umol_per_m2_s": bound}, source=source)
    receiver = receivers_of(spec, 100)[0]
    (limit,) = light_limits(spec, [receiver], efficacy_of(build_source(spec.source), spec.source, photons=True), 1.0)
    value = limit_value(limit, images_of(receiver, lambda x, y: 3.0 + 0.0 * x, 1e-5))
    assert judged(limit, "light", value).state == state


def test_photons_need_a_spectrum_and_are_not_asked_for_without_need() -> None:
    with_photons = spec_with({"kind": "zone", "at_least_mean_umol_per_m2_s": 5.0})
    efficacy = efficacy_of(build_source(with_photons.source), with_photons.source, photons=True)
    assert efficacy.photons is None
    with pytest.raises(InputError, match=r"limits\.0: .* the source's spectrum is not known; give source.spectrum"):
        light_limits(with_photons, receivers_of(with_photons, 20), efficacy, 1.0)
    assert spec_with(application="horticulture").counts_photons
    assert not spec_with({"kind": "zone", "at_least_mean_lx": 5.0}, application="curing").counts_photons


def test_a_meter_reads_the_mean_over_its_disc_with_the_filter_of_the_picture_as_a_part() -> None:
    """The mean of x^2 over a disc is x0^2 + D^2/16; the filter, one square pixel, is in the picture already."""
    points = {"kind": "points", "at_mm": [[20.0, -30.0], [-50.0, 10.0]], "unit": "w_per_m2", "at_least": 0.1}
    pixel = 400.0 / 200
    for wide, more in ((40.0, 40.0**2 / 16.0 - pixel**2), (6.0, 0.0)):
        value = read(spec_with(points | {"meter_mm": wide}), lambda x, y: x**2 + 1.0)["light"].value
        assert value == pytest.approx(20.0**2 + 1.0 + more, rel=3e-3)


LIMITS = [
    SCREEN | {"unit": "lx", "at_least": 100.0},
    SCREEN | {"at_least_min_over_mean": 0.9},
    SCREEN | {"at_most_max_over_mean": 1.1},
    {"kind": "light_field", "at_least_d50_mm": 50.0},
    {"kind": "light_field", "at_most_d10_mm": 100.0},
    {"kind": "light_field", "at_least_d50_over_d10": 0.5},
    {"kind": "light_field", "unit": "w_per_m2", "at_least": 1.0},
    {"kind": "peak", "unit": "lx", "at_least": 1.0},
    {"kind": "zone", "at_least_mean_mw_per_cm2": 0.1},
    {"kind": "zone", "at_least_mean_umol_per_m2_s": 5.0},
    {"kind": "zone", "at_least_mean_mj_per_cm2": 40.0, "exposure_s": 7.0},
    {"kind": "points", "at_mm": [[30.0, -70.0]], "unit": "umol_per_m2_s", "at_least": 5.0},
]


def _bumpy(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.asarray(2.0 + np.exp(-((x - 20.0) ** 2 + (y + 10.0) ** 2) / 80.0**2) + 0.05 * np.sin(x / 17.0 + y / 23.0))


def _peaked(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.asarray(np.exp(-(x**2 + (y / 1.2) ** 2) / 70.0**2) * (1.0 + 0.02 * np.sin(x / 9.0)))


@pytest.mark.parametrize("limit", LIMITS, ids=str)
def test_a_search_lacks_nothing_inside_the_bound_and_something_outside(limit: dict[str, object]) -> None:
    """Where the judged value is 4 % inside of a bound the term is 0, where it is 2 % inside it is not."""
    (bounded, term, picture) = _searched(limit)
    value = limit_value(bounded, np.stack([_filtered(picture)] * 16)).value
    sign = 1.0 if bounded.sense == ">=" else -1.0
    steep = 6.0 if limit["kind"] == "light_field" and bounded.unit != "W/m²" else 1.0  # of a width, not of light
    bounds = [value * (1.0 - sign * steep * part) for part in (0.04, 0.02 / steep)]
    losses = [float(replace(term, limit=replace(bounded, bound=bound)).loss((picture,))) for bound in bounds]
    assert losses[0] == 0.0 < losses[1]


@pytest.mark.parametrize("limit", LIMITS, ids=str)
def test_the_term_of_a_limit_falls_along_its_gradient(limit: dict[str, object]) -> None:
    """A step along the slope changes the term by as much as the slope says, where places and largest light are held."""
    (bounded, term, picture) = _searched(limit)
    value = limit_value(bounded, np.stack([_filtered(picture)] * 16)).value
    sign = 1.0 if bounded.sense == ">=" else -1.0
    missed = replace(
        term, limit=replace(bounded, bound=min(value * (1.0 + 0.3 * sign), 0.99 if bounded.unit == "" else 1e9))
    )
    asked = picture.clone().requires_grad_()
    (slope,) = torch.autograd.grad(missed.loss((asked,)), asked)
    assert float(slope.abs().max()) > 0.0
    step = 1e-6 * slope / slope.abs().max() * picture.max()
    before, after = (float(missed.loss((picture + way * step,))) for way in (0.0, -1.0))
    assert after < before


def test_a_range_and_what_is_above_the_peak_are_not_searched_for() -> None:
    above = {"kind": "peak", "unit": "lx", "at_most": 1.0, "up_mm": 40.0}
    peak = {"kind": "peak", "unit": "lx", "at_least": 1.0}
    spec = spec_with({"kind": "zone", "at_most_contrast": 0.1}, peak, above)
    limits = light_limits(spec, receivers_of(spec, 20), EFFICACY, 1.0)
    assert [term.limit.name for term in limit_terms(limits) if isinstance(term, LimitTerm)] == ["limits.1"]


def _filtered(picture: torch.Tensor) -> np.ndarray:
    from lensforge.search.limit_terms import smoothed

    return smoothed(picture).numpy()


def _searched(limit: dict[str, object]) -> tuple[LightLimit, LimitTerm, torch.Tensor]:
    spec = spec_with(limit)
    receiver = receivers_of(spec, 100)[0]
    (bounded,) = light_limits(spec, [receiver], EFFICACY, 1.0)
    light = _peaked if limit["kind"] == "light_field" else _bumpy
    return bounded, LimitTerm.of(bounded), torch.from_numpy(images_of(receiver, light)[0])


@pytest.mark.parametrize(
    ("limit", "target", "message"),
    [
        (SCREEN | {"unit": "relative", "at_least": 0.5}, PLANE, "the light of nine points is a mean"),
        ({"kind": "screen", "width_mm": 10.0, "at_least_min_over_mean": 0.5}, PLANE, "height_mm: missing"),
        (SCREEN | {"width_mm": 600.0, "at_least_min_over_mean": 0.5}, PLANE, "is off receiver"),
        ({"kind": "light_field", "unit": "relative", "at_least": 0.5}, PLANE, "the light in the middle is a level"),
        ({"kind": "light_field", "at_least_d10_deg": 5.0}, PLANE, "in deg"),
        ({"kind": "cut_off", "at_least_gradient": 0.13}, PLANE, "is one of the far field"),
        ({"kind": "cut_off", "at_least_gradient": 0.13, "from_deg": 1.0}, FAR, "to_deg = 1 is not above from_deg = 1"),
        ({"kind": "cut_off", "at_least_gradient": 0.13, "across_deg": -7.0}, FAR, "reaches 5 deg"),
        ({"kind": "peak", "unit": "lx", "at_least": 1.0, "up_mm": 5.0}, PLANE, "give at_most"),
        ({"kind": "peak", "unit": "relative", "at_most": 1.0}, PLANE, "bounded in lx, cd"),
        ({"kind": "zone", "at_least_mean_lx": 5.0, "at_most_mean_lx": 4.0}, PLANE, "no light is both"),
        ({"kind": "zone", "at_least_mean_lx": 5.0}, FAR, "its light is in lx"),
        ({"kind": "zone", "at_least_mean_umol_per_m2_s": 5.0}, FAR, "its light is in umol_per_m2_s"),
        ({"kind": "loss", "cause": "beside", "at_most_share": 0.1, "meter_mm": 3.0}, PLANE, "at_most_share alone"),
    ],
)  # fmt: skip
def test_a_wrong_figure_is_refused_in_one_line(
    limit: dict[str, object], target: dict[str, object], message: str
) -> None:
    with pytest.raises(InputError, match=message) as refusal:
        spec_with(limit, target=target)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("application", "target", "labels"),
    [
        ("projector", PLANE, ["Mean of nine points", "Darkest of 13 points", "Brightest of 13 points"]),
        ("medical", PLANE, ["Central light Ec", "d10", "d50", "d50/d10"]),
        ("simulator", PLANE, ["Non-uniformity", "Mean irradiance"]),
        ("curing", PLANE, ["Mean irradiance", "Peak irradiance", "Min/mean"]),
        ("backlight", PLANE, ["Min/max", "Min/mean", "Mean light"]),
        ("horticulture", PLANE, ["Mean PPFD", "Minimum PPFD", "Min/mean"]),
        ("horticulture", FAR, ["Min/max", "Min/mean"]),
        ("machine vision", PLANE, ["Min/max", "Min/mean", "Mean light"]),
        ("bicycle", PLANE, ["Brightest place", "3.4° above it and higher"]),
        ("bicycle", FAR, ["Brightest place", "3.4° above it and higher"]),
        ("headlamp", FAR, ["Brightest direction", "Gradient G of the cut-off"]),
        ("torch", FAR, ["Brightest place"]),
    ],
)
def test_a_trade_states_its_figures_as_the_limits_of_the_same_section_would(application, target, labels) -> None:
    spec = spec_with(target=target, application=application)
    receivers = receivers_of(spec, 64)
    stated = stated_readings(spec, receivers, EFFICACY)
    assert [reading.name for reading in stated] == labels
    images = images_of(receivers[0], lambda x, y: 2.0 + np.exp(-(x**2 + (y - 1.0) ** 2) / 3.0))
    assert all(np.isfinite(limit_value(reading, images).value) for reading in stated)
    assert stated_readings(spec_with(target=target), receivers, EFFICACY) == ()


@pytest.mark.parametrize(
    ("limit", "application", "trade"),
    [
        (SCREEN | {"at_least_min_over_mean": 0.5}, None, "projector"),
        ({"kind": "light_field", "at_least_d50_mm": 50.0}, None, "medical"),
        ({"kind": "light_field", "at_least_d50_mm": 50.0}, "torch", "torch"),
        ({"kind": "zone", "at_least_min_over_max": 0.5}, None, None),
    ],
)
def test_a_limit_that_only_one_trade_has_tells_it(limit, application, trade) -> None:
    other = {"kind": "zone", "at_least_share": 0.1}
    assert spec_with(other, limit, application=application).trade == trade


def test_a_figure_is_stated_for_the_places_of_the_limit_on_it() -> None:
    """The first limit has another screen than the second: of two of one kind the first counts."""
    smaller = SCREEN | {"width_mm": 60.0, "at_least_min_over_mean": 0.5}
    spec = spec_with(smaller, SCREEN | {"at_most_max_over_mean": 2.0}, {"kind": "peak", "unit": "lx", "at_least": 1.0})
    receivers = receivers_of(spec, 200)
    images = images_of(receivers[0], lambda x, y: 10.0 + x / 50.0 - y / 40.0)
    values = {
        reading.name: limit_value(reading, images).value for reading in stated_readings(spec, receivers, EFFICACY)
    }
    assert values["Darkest of 13 points"] == pytest.approx(1.0 - 0.9 * (30.0 / 50.0 + 45.0 / 40.0) / 11.1, rel=1e-9)


def test_a_limit_of_each_side_is_judged_by_its_number() -> None:
    for bound in (0.70, 0.74, 0.78, 0.82):
        spec = spec_with(SCREEN | {"at_least_min_over_mean": bound})
        receiver = receivers_of(spec, 200)[0]
        (limit,) = light_limits(spec, [receiver], Efficacy(), 1.0)
        value = limit_value(limit, images_of(receiver, lambda x, y: 10.0 + x / 50.0 - y / 40.0, 1e-3))
        assert value.value == pytest.approx(1.0 - 0.9 * 2.925 / 11.1, abs=0.01)
        assert judged(limit, "light", value).state == ("pass" if bound < value.value else "fail")
