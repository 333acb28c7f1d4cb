"""A road judged: the same by a lens's table, by a file, and on pixels of a far field; its merit, and its command."""

import json
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from in_this_process import lensforge
from nightly import first_by_day
from presets import FEW
from scenes import random_surface, small_spec

import lensforge as lf
from lensforge.addons.road import road_judgement
from lensforge.addons.road.road_classes import VEILING_RATIO
from lensforge.addons.road.road_command import coarse_for_roads
from lensforge.addons.road.road_facts import spacing_fact, with_remedies
from lensforge.addons.road.road_field import RoadReadings
from lensforge.addons.road.road_judgement import (
    best_class,
    c_class,
    classes_held,
    held_spacing,
    judge_road,
    p_class,
)
from lensforge.addons.road.road_light import RoadLight
from lensforge.addons.road.road_section import RP8_CLASSES, RoadSection
from lensforge.errors import InputError
from lensforge.light.angular_grid import AngularGrid
from lensforge.light.by_intensities import of_file, of_lens
from lensforge.light.judged_limits import judged_limits, limit_value
from lensforge.light.light_facts import light_facts
from lensforge.light.luminaire_classes import LampLight
from lensforge.optics.efficacy import Efficacy
from lensforge.results import Fact, Metric, Sense
from lensforge.scene.limit_readings import light_limits
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.search.limit_terms import JoinedTerms, LimitTerm, smoothed
from lensforge.sources.intensity import TabulatedIntensity
from lensforge.sources.photometric.photometric_file import PhotometricFile, turned_over
from lensforge.sources.photometric.photometric_io import read_photometric, write_photometric
from lensforge.spec import Spec
from lensforge.spec.quantities import LeastOverMean, LeastOverMost, MeanOverLeast, MostOverLeast, PlaceLight, RatioOfTwo

ROAD = {"lighting_class": "M3", "width_m": 7.0, "pole_height_m": 9.0, "pole_spacing_m": 30.0, "overhang_m": 0.5}
RP8 = ROAD | {"lighting_class": "collector medium"}
FAR = {"kind": "beam", "fwhm_deg": 60.0, "half_angle_deg": 90.0}
GRID = AngularGrid(144, np.linspace(0.0, 90.0, 181))


def _intensity(azimuth, gamma):
    """Two wide lobes along a street at +y, brighter ahead than behind (W/sr at most 1)."""
    x, y, z = np.sin(gamma) * np.cos(azimuth), np.sin(gamma) * np.sin(azimuth), np.cos(gamma)
    lobe = sum(k * np.exp(-6.0 * ((x - side) ** 2 + (y - 0.3) ** 2)) for side, k in ((0.8, 1.0), (-0.8, 0.8)))
    return (0.15 + lobe) * np.clip(z, 0.0, None) ** 0.6


def _lamp(noise: float = 0.0) -> LampLight:
    azimuth, gamma = np.meshgrid(np.radians(GRID.c_deg), np.radians(GRID.gamma_deg), indexing="ij")
    random = np.random.default_rng(1).normal(size=(16, *azimuth.shape))
    return LampLight(GRID, 3000.0 * _intensity(azimuth, gamma) * (1.0 + noise * random), 90.0)


def _file() -> PhotometricFile:
    return PhotometricFile(turned_over(GRID.table(_lamp().samples.mean(axis=0))), title="a lamp")


def _spec(**road) -> Spec:
    return small_spec(target=FAR).replace(roads=[ROAD | {"lamp_lm": 3000.0} | road])


def _figures(judgement):
    return [limit.value for limit in judgement.limits]


@pytest.mark.parametrize("fields", [ROAD, RP8 | {"oncoming_lanes": 1}])
def test_a_lens_and_its_file_are_judged_alike(fields, tmp_path) -> None:
    """By the table itself, and as written to a file and read back, whose street is at C = 270."""
    road = RoadSection(**fields)
    by_table = judge_road(road, of_lens(_lamp(), 1.0))
    assert _figures(by_table) == pytest.approx(_figures(judge_road(road, of_file(_file(), 270.0, None))), rel=1e-9)
    path = tmp_path / "lens.ies"
    roads = tmp_path / "roads.toml"
    write_photometric(path, _file())
    roads.write_text("[[roads]]\n" + "\n".join(f"{name} = {json.dumps(value)}" for name, value in fields.items()))
    done = lensforge("road", path, "--road", roads, "--street-c", "270", "--json")
    (read,) = json.loads(done.stdout)["roads"]
    assert [limit["value"]["value"] for limit in read["limits"]] == pytest.approx(_figures(by_table), rel=1e-4)
    held = all(limit.holds for limit in by_table.limits)
    assert done.code == (0 if held else 1)
    lux = RoadReadings.of(road).seen_lux[0]
    per_lux = by_table.drivers[0].mean_cd_per_m2.value / lux.of(of_lens(_lamp(), 1.0)(lux)).mean()
    assert by_table.drivers[0].luminance_per_lux.value == pytest.approx(per_lux, rel=1e-9)


@pytest.mark.parametrize(("bright", "factor", "power"), [(1.0, 65.0, 0.8), (20.0, 95.0, 1.05)])
def test_glare_by_its_law_up_to_5_cd_per_m2_and_above(bright: float, factor: float, power: float) -> None:
    road = RoadSection(**ROAD, maintenance_factor=0.5)
    candela = of_lens(_lamp(), bright)
    readings = RoadReadings.of(road)
    for driver, seen, veiling in zip(
        judge_road(road, candela).drivers, readings.luminance, readings.veiling, strict=True
    ):
        mean = seen.of(candela(seen)).mean()
        assert (mean > 5.0) == (bright > 1.0)
        veil = veiling.of(candela(veiling)).mean(axis=0).max()
        assert driver.glare_percent.value == pytest.approx(factor * veil / mean**power, rel=1e-6)
        assert driver.mean_cd_per_m2.value == pytest.approx(0.5 * mean)


@pytest.mark.parametrize("bright", [0.4, 1.0])
def test_ratios_of_rp_8_are_stated_as_it_states_them(bright: float) -> None:
    """Mean over least, largest over least, veiling over mean; the classes that the road has, and those only."""
    road = RoadSection(**RP8, maintenance_factor=0.8)
    candela = of_lens(_lamp(), bright)
    judgement = judge_road(road, candela)
    readings = RoadReadings.of(road)
    seen, veil = (light[0].of(candela(light[0])).mean(axis=0) for light in (readings.luminance, readings.veiling))
    figures = 0.8 * seen.mean(), seen.mean() / seen.min(), seen.max() / seen.min(), veil.max() / seen.mean()
    assert _figures(judgement) == pytest.approx(figures, rel=1e-6)
    (driver,) = judgement.drivers
    assert (driver.uniformity.value, driver.uniformity_along.value) == pytest.approx((1 / figures[1], 1 / figures[2]))
    assert driver.veiling_ratio.value == pytest.approx(figures[3]) and driver.glare_percent is None
    held = []
    for name in RP8_CLASSES:
        limits = judge_road(road.model_copy(update={"lighting_class": name}), candela).limits
        held += [name] if all(limit.holds for limit in limits) else []
    assert judgement.reached == (", ".join(held) or "none")
    assert ("collector low" in held) == ("freeway B" in held) == (bright == 1.0)
    glaring = driver.model_copy(update={"veiling_ratio": driver.veiling_ratio.model_copy(update={"value": 0.35})})
    assert classes_held((driver, glaring)) == (", ".join(name for name in held if name[0] in "cl") or "none")
    for name in ("uniformity", "uniformity_along"):
        uneven = driver.model_copy(update={name: getattr(driver, name).model_copy(update={"value": 1e-3})})
        assert classes_held((driver, uneven)) == "none", name
    assert judgement.standard == "RP-8-14"


def test_the_evaluation_the_photometry_and_the_file_have_one_figure(tmp_path) -> None:
    """Two roads, the second by RP-8 and named after the first: value and error; the file has no error."""
    spec = _spec(lamp_lm=2500.0).replace(
        photometry={"street_side_deg": 75.0}, evaluate={"rays": 1024, "pixels": 16, "window_mm": None}
    )
    wide = RP8 | {"lamp_lm": 4000.0, "name": "road 1: wide"}
    spec = spec.replace(roads=[*(road.model_dump() for road in spec.roads), wide])
    preset = FEW.replace("roads", photometry_rays=(2**12, 2**12))
    lens = lf.Lens.double(random_surface(1, 3.0), random_surface(2, 6.0), spec, 3, preset)
    light = lf.evaluate(lens)
    far = lf.photometry(lens)
    by_light = [(limit.label, limit.value, limit.standard_error) for limit in light.limits]
    named = [(f"{road.name}: {limit.label}", limit) for road in far.roads for limit in road.limits]
    by_table = [(name, limit.value, limit.standard_error) for name, limit in named]
    assert by_light == by_table and len(far.roads) == 2
    assert all(error > 0.0 for _, _, error in by_light)
    (told,) = (group.facts for group in light_facts(light, lens) if group.key == "limits")
    remedies = [limit.remedy for road in far.roads for limit in with_remedies(road.limits)]
    assert [fact.remedy for fact in told] == remedies, "of each road by its own limits, whatever the names"
    far.save(tmp_path / "lens.ies")
    file = read_photometric(tmp_path / "lens.ies")
    for road, stated in zip(spec.roads, far.roads, strict=True):
        read = judge_road(road, of_file(file, -75.0, road.lamp_lm))
        np.testing.assert_allclose(_figures(read), _figures(stated), rtol=2e-4)


def test_dark_roads_hold_no_ratio() -> None:
    limits = judge_road(RoadSection(**RP8), of_lens(_lamp(), 0.0)).limits
    assert [limit.outcome for limit in limits] == ["missed"] * 4 and max(limit.value for limit in limits) == 1e6


@pytest.mark.parametrize("fields", [ROAD, RP8])
def test_noise_chooses_no_minimum(fields) -> None:
    road = RoadSection(**fields, lamp_w=50.0)
    quiet, noisy = (judge_road(road, of_lens(_lamp(noise), 1.0)) for noise in (0.0, 0.3))
    for true, limit in zip(quiet.limits, noisy.limits, strict=True):
        assert abs(limit.value - true.value) < 4.0 * limit.standard_error + 1e-9, limit.label


@pytest.mark.parametrize(
    ("arrangement", "lamps"), {"right": 1, "left": 1, "opposite": 2, "staggered": 2, "median": 1}.items()
)
def test_power_and_energy_are_those_of_the_lamps_of_one_field(arrangement, lamps) -> None:
    """Of two on a median the second lights another road."""
    median = {"median_m": 3.0} if arrangement == "median" else {}
    road = RoadSection(**ROAD, arrangement=arrangement, lamp_w=50.0, hours=1234.0, **median)
    judgement = judge_road(road, of_lens(_lamp(), 1.0))
    watts = lamps * 50.0 / (7.0 * 30.0)  # per m^2
    assert judgement.power_density.value == pytest.approx(watts / judgement.mean_lx.value, rel=1e-9)
    assert judgement.yearly_energy.value == pytest.approx(1e-3 * 1234.0 * watts, rel=1e-12)


_EN_13201_2 = {  # cd/m^2, U0, Ul, TI in %, edge ratio
    "M1": (2.0, 0.40, 0.70, 10.0, 0.35), "M2": (1.5, 0.40, 0.70, 10.0, 0.35), "M3": (1.0, 0.40, 0.60, 15.0, 0.30),
    "M4": (0.75, 0.40, 0.60, 15.0, 0.30), "M5": (0.50, 0.35, 0.40, 15.0, 0.30), "M6": (0.30, 0.35, 0.40, 20.0, 0.30),
}  # fmt: skip
_OF_M = "mean_cd_per_m2", "uniformity", "uniformity_along", "glare_percent"


@pytest.mark.parametrize("name", _EN_13201_2)
def test_each_figure_of_each_driver_and_edge_decides_the_class_that_is_reached(name) -> None:
    """At its bound it is held; a little beyond, by one of two drivers or at one edge, a lower class is reached."""
    (first, *_) = judge_road(RoadSection(**ROAD), of_lens(_lamp(), 1.0)).drivers
    any_edge = Metric(value=9.0)
    asked = dict(zip(_OF_M, _EN_13201_2[name], strict=False))

    def driver(**figures):
        given = {field: getattr(first, field).model_copy(update={"value": value}) for field, value in figures.items()}
        return first.model_copy(update=given)

    def reached(drivers, edges):
        return best_class(drivers, tuple(any_edge.model_copy(update={"value": edge}) for edge in edges))

    least = _EN_13201_2[name][4]
    at = driver(**asked)
    far = driver(mean_cd_per_m2=9.0, uniformity=0.9, uniformity_along=0.9, glare_percent=1.0)
    assert reached((far, at), (least, least)) == name
    beyond = [driver(**{**asked, field: asked[field] * (1.001 if "glare" in field else 0.999)}) for field in _OF_M]
    tried = [((far, value), (9.0, 9.0)) for value in beyond] + [((value, far), (9.0, 9.0)) for value in beyond]
    tried += [((at, at), (0.999 * least, 9.0)), ((at, at), (9.0, 0.999 * least))]
    for drivers, edges in tried:
        reached_class = reached(drivers, edges)
        worst = [max if field == "glare_percent" else min for field in _OF_M]
        figures = [
            pick(getattr(driver, field).value for driver in drivers) for pick, field in zip(worst, _OF_M, strict=True)
        ]
        held = [
            lighting_class
            for lighting_class, bounds in _EN_13201_2.items()
            if all(value >= bound for value, bound in zip(figures[:3], bounds, strict=False))
            and figures[3] <= bounds[3]
            and min(edges) >= bounds[4]
        ]
        assert reached_class == (held or ["none"])[0] != name


def test_each_road_has_its_own_lamp_and_its_own_spacing(tmp_path) -> None:
    """Two roads but for the lumens of their lamps: all light in proportion, and poles farther apart."""
    path = tmp_path / "lens.ies"
    roads = tmp_path / "roads.toml"
    write_photometric(path, _file())
    fields = "".join(f"{name} = {json.dumps(value)}\n" for name, value in {**ROAD, "lighting_class": "P5"}.items())
    roads.write_text("".join(f"[[roads]]\n{fields}lamp_lm = {lumens}\n" for lumens in (1500.0, 4000.0)))
    done = lensforge("road", path, "--road", roads, "--street-c", "270", "--spacing", "--json")
    content = json.loads(done.stdout)
    first, second = content["roads"]
    assert second["mean_lx"]["value"] / first["mean_lx"]["value"] == pytest.approx(4000.0 / 1500.0, rel=1e-9)
    assert first["name"] != second["name"]
    apart = [fact["value"] for group in content["facts"] for fact in group["facts"] if fact["key"] == "largest_spacing"]
    assert apart[1] > 1.1 * apart[0] > 0.0
    assert [all(limit["state"] == "held" for limit in road["limits"]) for road in (first, second)] == [True, False]
    assert done.code == 1 and "road 2: " in done.stderr, "any of them decides"


@pytest.mark.parametrize("lighting_class", ["M3", "collector medium"])
@pytest.mark.parametrize(("pixels", "most"), [(128, 0.06), (512, 0.006)])
def test_pixels_of_the_far_field_read_the_same_road(pixels: int, most: float, lighting_class: str) -> None:
    """Limits on a picture, against the intensity itself; their difference falls with the pixels."""
    spec = _spec(lighting_class=lighting_class)
    receivers = receivers_of(spec, pixels)
    grid = receivers[0].grid
    x, y, z = np.moveaxis(receivers[0].places(*np.meshgrid(grid.x(), grid.y())), -1, 0)
    light = _intensity(np.arctan2(y, x), np.arccos(z)) * receivers[0].pixel_measure
    limits = light_limits(spec, receivers, Efficacy(), 1.0)
    by_pixels = judged_limits(limits, [np.stack([light] * 16)], ["sky"])
    by_table = judge_road(spec.roads[0], of_lens(_lamp(), 1.0))
    assert [limit.label for limit in by_pixels] == [f"road: {limit.label}" for limit in by_table.limits]
    np.testing.assert_allclose([limit.value for limit in by_pixels], _figures(by_table), rtol=most)


_MISSED = {"mean_cd_per_m2": 9.0, "uniformity": 0.9, "luminance_per_lux": 0.9, "edge_ratio": 1.0}


@pytest.mark.parametrize("fields", [{"uniformity_along": 0.95, "glare_percent": 0.5}, RP8])
def test_the_merit_begins_6_percent_inside_of_each_bound(fields) -> None:
    """Where the judged figure is farther inside, the term of a limit is 0; nearer it is not."""
    spec = _spec(**fields, luminance_per_lux=0.07)
    receivers = receivers_of(spec, 48)
    picture = torch.from_numpy(np.random.default_rng(2).uniform(0.5, 1.5, receivers[0].grid.shape)) * 1e-4
    images = np.stack([smoothed(picture).numpy()] * 16)
    for limit in light_limits(spec, receivers, Efficacy(), 1.0):
        value = limit_value(limit, images).value
        over_least = limit.quantity in (MeanOverLeast(), MostOverLeast())
        at = value / 1.06 if limit.sense == ">=" else 1.06 * value if over_least else value / 0.94
        for change, missed in ((0.999, limit.sense == "<="), (1.001, limit.sense == ">=")):
            term = LimitTerm.of(replace(limit, bound=change * at))
            assert (float(term.loss((picture,))) > 0.0) == missed, limit.name


@pytest.mark.parametrize("fields", [{"uniformity_along": 0.95, "glare_percent": 0.5}, RP8])
def test_the_merit_falls_along_its_gradient_and_is_zero_where_the_class_is_held(fields) -> None:
    spec = _spec(**fields, **_MISSED)
    of_ratios = {MostOverLeast(): 1.05, VEILING_RATIO: 1e-3}
    receivers = receivers_of(spec, 32)
    limits = [
        replace(limit, bound=of_ratios.get(limit.quantity, limit.bound))
        for limit in light_limits(spec, receivers, Efficacy(), 1.0)
    ]
    picture = torch.from_numpy(np.random.default_rng(2).uniform(0.5, 1.5, receivers[0].grid.shape)) * 1e-4
    ask = picture.clone().requires_grad_()
    step = torch.from_numpy(np.random.default_rng(3).normal(size=picture.shape))
    for limit in limits:
        if limit.quantity in (LeastOverMost(), MostOverLeast()):
            continue  # its largest light is held: the slope is that of the darkest places
        term = LimitTerm.of(limit)
        (slope,) = torch.autograd.grad(term.loss((ask,)), ask)
        high, low = (term.loss((picture + sign * 1e-9 * step,)) for sign in (1.0, -1.0))
        assert float(term.loss((picture,))) > 0.0, limit.name
        assert float((slope * step).sum()) == pytest.approx(float(high - low) / 2e-9, rel=1e-4, abs=1e-6), limit.name
    (slope,) = torch.autograd.grad(JoinedTerms.of(limits).loss((ask,)), ask)
    (wanted,) = torch.autograd.grad(sum((LimitTerm.of(limit).loss((ask,)) for limit in limits), torch.zeros(())), ask)
    torch.testing.assert_close(slope, wanted)
    easy = {LeastOverMean(): 1e-3, LeastOverMost(): 1e-3, PlaceLight(): 1e-6, RatioOfTwo(): 1e-6}
    kept = [LimitTerm.of(replace(limit, bound=easy.get(limit.quantity, 1e3))) for limit in limits]
    assert sum(float(term.loss((picture,))) for term in kept) == 0.0


def _limits(target, road) -> None:
    spec = small_spec(target=target).replace(roads=[ROAD | road])
    light_limits(spec, receivers_of(spec, 16), Efficacy(), 1.0)


@pytest.mark.parametrize(
    ("target", "road", "message"),
    [
        ({**FAR, "half_angle_deg": 70.0}, {}, "the first has half_angle_deg = 70"),
        ({"kind": "flat_top", "width_mm": 9.0, "distance_mm": 100.0, "receiver_mm": 20.0}, {}, "there is none"),
        (FAR, {"surface_file": "/nowhere/table.csv", "lamp_lm": 3000.0}, "table.csv"),
        (FAR, {}, "lamp_lm is missing"),
    ],
)
def test_roads_that_no_light_can_be_judged_on(target, road, message: str) -> None:
    with pytest.raises(InputError, match=message) as error:
        _limits(target, road)
    assert "\n" not in str(error.value)


def test_a_field_of_one_road_is_changed_by_its_number() -> None:
    spec = _spec().replace({"roads.0.pole_spacing_m": 22.5})
    assert (spec.roads[0].pole_spacing_m, spec.roads[0].pole_height_m) == (22.5, 9.0)
    with pytest.raises(InputError, match="roads has 1 entries"):
        spec.replace({"roads.1.pole_spacing_m": 22.5})


def test_a_share_weighs_what_the_class_of_its_road_lacks() -> None:
    roads = [ROAD | {"lamp_lm": 300.0, "pole_spacing_m": spacing} for spacing in (25.0, 35.0)]
    receivers = receivers_of(_spec(), 48)
    picture = torch.from_numpy(np.random.default_rng(2).uniform(0.5, 1.5, receivers[0].grid.shape)) * 1e-4

    def loss(*shares: float) -> float:
        spec = _spec().replace(roads=[road | {"share": share} for road, share in zip(roads, shares, strict=True)])
        return float(JoinedTerms.of(light_limits(spec, receivers, Efficacy(), 1.0)).loss((picture,)))

    first, second = (loss(*shares) for shares in ((1.0, 1e-12), (1e-12, 1.0)))
    assert min(first, second) > 1.0 and first != pytest.approx(second)
    assert loss(3.0, 0.5) == pytest.approx(3.0 * first + 0.5 * second)


_NOT_TOO_MUCH = ROAD | {"lighting_class": "P3"}  # at most 1.5 times its mean: poles too near miss it, too


@pytest.mark.parametrize(
    "fields", first_by_day(1, [_NOT_TOO_MUCH, ROAD | {"glare_percent": 90.0, "edge_ratio": 0.1}, RP8])
)
def test_the_largest_spacing_is_where_a_class_ceases_to_be_held(fields, tmp_path, monkeypatch) -> None:
    road = RoadSection(**fields)
    candela = of_file(_file(), 270.0, None)
    spacings = held_spacing(road, candela)

    def held(spacing_m: float) -> bool:
        there = road.model_copy(update={"pole_spacing_m": spacing_m})
        return all(limit.holds for limit in judge_road(there, candela).limits)

    assert held(spacings.largest) and not held(spacings.largest + 0.002)
    assert held(spacings.least) and (spacings.least == 4.5 or not held(spacings.least - 0.002))
    assert (spacings.least > 20.0) == (fields is _NOT_TOO_MUCH)
    assert not any(held(spacing) for spacing in np.linspace(spacings.largest + 0.9, 108.0, 4))
    assert held(0.5 * (spacings.least + spacings.largest)) and spacings.beyond.outcome == "missed"
    assert held_spacing(road.model_copy(update={"maintenance_factor": 1e-9}), candela, most_steps=15) is None
    path = tmp_path / "lens.ies"
    roads = tmp_path / "roads.toml"
    write_photometric(path, _file())
    roads.write_text("[[roads]]\n" + "\n".join(f"{name} = {json.dumps(value)}" for name, value in fields.items()))
    asked = []
    monkeypatch.setattr(road_judgement, "held_spacing", lambda *given: asked.append(given) or spacings)
    done = lensforge("road", path, "--road", roads, "--street-c", "270", "--json", "--spacing")
    (fact,) = (fact for fact in json.loads(done.stdout)["facts"][0]["facts"] if fact["key"] == "largest_spacing")
    assert fact["value"] == pytest.approx(spacings.largest, abs=0.05) and spacings.beyond.label in fact["note"]
    assert [call[0] for call in asked] == [road]


def test_the_flux_and_the_spacing_that_are_named_keep_the_mean_of_the_class(tmp_path) -> None:
    """And no less does; glare then is what is named, and what is not even is not mended by flux."""
    road = RoadSection(**ROAD, mean_cd_per_m2=1.5, uniformity=0.9, glare_percent=12.0)

    def judged(factor: float, spacing: float = 1.0):
        there = road.model_copy(update={"pole_spacing_m": spacing * road.pole_spacing_m})
        return judge_road(there, of_lens(_lamp(), factor)).limits

    def state(limits, part: str) -> set[str]:
        return {limit.state for limit in limits if part in limit.key}

    by_key = {limit.key: limit for limit in with_remedies(judged(0.05))}
    remedy = by_key["lane 1: mean luminance"].remedy
    flux, spacing, glare = map(float, re.findall(r"([0-9.]+) (?:lumens|the spacing|%, above)", remedy))
    assert "fail" in state(judged(0.05 * flux * 0.99), "mean") and state(judged(0.05 * flux), "mean") == {"pass"}
    assert max(limit.value for limit in judged(0.05 * flux) if "glare" in limit.key) == pytest.approx(glare, rel=5e-3)
    assert [limit.value for limit in judged(0.05, spacing) if "mean" in limit.key] == pytest.approx(
        [1.5, 1.5], rel=0.15
    )
    assert "the flux does not change it" in by_key["lane 2: uniformity U0"].remedy
    dim = RoadSection(**_NOT_TOO_MUCH)
    (bright,) = (
        limit for limit in with_remedies(judge_road(dim, of_lens(_lamp(), 2.0)).limits) if "maximum" in limit.key
    )
    (less,) = re.findall(r"× ([0-9.]+) lumens", bright.remedy)
    kept = judge_road(dim, of_lens(_lamp(), 2.0 * float(less))).limits
    assert {limit.state for limit in kept if "maximum" in limit.key} == {"pass"}
    for state_of_limit, has_remedy in (("fail", True), ("pass", False), ("undecided", False)):
        (told,) = with_remedies([replace(judged(0.05)[0], state=state_of_limit, remedy="")])
        assert bool(told.remedy) == has_remedy, state_of_limit
    uneven = replace(judged(1.0)[0], sense="<=", limit=0.5, key="largest").judged()
    for limits in ((uneven, judged(0.05)[0]), judged(0.0)):
        assert next(with_remedies(limits)).remedy == "no luminous flux meets all limits: the light must be more uniform"
    path = tmp_path / "lens.ies"
    roads = tmp_path / "roads.toml"
    write_photometric(path, _file())
    roads.write_text(
        "[[roads]]\n" + "\n".join(f"{name} = {json.dumps(value)}" for name, value in ROAD.items()) + "\nlamp_lm = 9.0"
    )
    ahead, behind = (lensforge("road", path, "--road", roads, "--street-c", street).stderr for street in ("270", "90"))
    assert "lumens, or ×" in ahead and "is the street on that side" not in ahead
    assert re.search("with --street-c 270 the roads get 1.[2-9][0-9]* times the light", behind)


def test_tables_in_steps_of_5_degrees_of_gamma_are_a_tenth_off_in_glare_and_named() -> None:
    road = RoadSection(**ROAD)

    def glare(step: int) -> tuple[float, list[str]]:
        fine = _file().intensity
        file = PhotometricFile(TabulatedIntensity(fine.c_deg, fine.gamma_deg[::step], fine.values[:, ::step]))
        judgement = judge_road(road, of_file(file, 270.0, 3000.0))
        return judgement.drivers[0].glare_percent.value, list(coarse_for_roads(file))

    (finest, _) = glare(1)
    (of_cie, quiet) = glare(5)
    (coarse, named) = glare(10)
    assert quiet == [] and "its steps of gamma are up to 5 degrees" in named[0]
    assert of_cie == pytest.approx(finest, rel=0.05) and abs(coarse / finest - 1.0) > 0.1


def test_a_class_may_be_held_at_any_spacing_or_at_none() -> None:
    easy = {"mean_cd_per_m2": 1e-9, "uniformity": 1e-9, "uniformity_along": 1e-9, "glare_percent": 900.0}
    road = RoadSection(**ROAD, **easy, edge_ratio=1e-9, lanes=1)
    candela = of_file(_file(), 270.0, None)
    spacings = held_spacing(road, candela)
    assert (spacings.least, spacings.largest, spacings.beyond) == (4.5, 108.0, None)
    assert spacing_fact(spacings).note == "class met from 4.5 m up"
    assert spacing_fact(replace(spacings, least=4.92031)).note == "class met from 4.93 m up", (
        "rounded up: there it is met"
    )
    assert spacing_fact(None).text == "class met at none"


def test_lamps_together_share_the_lumens_of_a_road() -> None:
    """Two lenses have twice the light of one; where the lumens of the lamp are given, they have the same."""
    pair = {"lamps": {"kind": "table", "places_mm": [[-20.0, 0.0], [20.0, 0.0]]}, "base": {"kind": "none"}}
    far = 64

    def readings(spec: Spec) -> np.ndarray:
        return light_limits(spec, receivers_of(spec, far), Efficacy(300.0), 1.5)[0].readings.toarray()

    for road, times in (({}, 1.0), ({"lamp_lm": None}, 2.0)):
        single = _spec(**road)
        np.testing.assert_allclose(readings(single.replace(pair)), times * readings(single), rtol=1e-12)


@pytest.mark.parametrize(("name", "reached"), [("P2", p_class), ("C5", c_class)])
def test_a_road_by_illuminance_reaches_a_class_of_its_kind(name: str, reached: Callable[[float, float], str]) -> None:
    road = RoadSection(**{**ROAD, "lighting_class": name, "pole_spacing_m": 20.0})
    judgement = judge_road(road, lambda light: 1500.0 * np.cos(np.radians(light.gamma_deg))[None])
    second = judgement.least_lx if name == "P2" else judgement.uniformity_lx
    assert judgement.reached == reached(judgement.mean_lx.value, second.value) != "none"


def test_each_figure_of_a_road_is_told_where_it_is_worst() -> None:
    """By hand: a lower bound where the least is nearest to it, an upper one the other way; not of other limits."""

    def limit(name: str, value: float, sense: Sense, bound: float) -> Fact:
        return Fact(name, name, value, "", 0.01, sense, bound, note="light").judged(0.01)

    figures = {"a: lane 1: glare TI": 11.9, "a: lane 2: glare TI": 12.2, "b: lane 1: glare TI": 9.0}
    judged = [limit(name, value, "<=", 15.0) for name, value in figures.items()]
    judged += [limit("a: lane 1: mean luminance", 0.9, ">=", 0.75), limit("b: lane 1: mean luminance", 1.05, ">=", 1.0)]
    judged += [limit("b: left edge ratio", 0.31, ">=", 0.3), limit("b: right edge ratio", 0.4, ">=", 0.3)]
    judged += [limit("a wall: lane 1: mean luminance", 0.0, ">=", 1.0)]
    roads = [RoadSection(**{**ROAD, "name": name, "lanes": 2, "oncoming_lanes": k}) for k, name in enumerate("ab")]
    head, *told = RoadLight.worst(roads, judged).facts
    assert [(fact.label, fact.value, fact.note) for fact in told] == [
        ("Glare TI", 12.2, "worst: a: lane 2"),
        ("Mean luminance", 1.05, "worst: b: lane 1"),
        ("Edge ratio", 0.31, "worst: b: left edge"),
    ]
    of_one = RoadLight.worst(roads[:1], judged[:2]).facts[1]
    assert of_one.sentence == "12.200 ± 0.010 (required ≤ 15); worst: lane 2"
    name = ROAD["lighting_class"]
    assert head.value == f"{name}, 2 lanes, both one way; {name}, 2 lanes, 1 oncoming"
    traffic = [RoadSection(**{**ROAD, "lanes": lanes}).traffic for lanes in (1, 3)]
    assert traffic == ["1 lane, one way", "3 lanes, all one way"]
