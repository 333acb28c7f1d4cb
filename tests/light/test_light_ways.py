"""The ways of the light through a lens of four faces: told apart, added up, kept in the record, shown."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from addon_rows import needs_addon
from chains import collimator
from jinja2 import Environment, PackageLoader
from presets import FEW
from scenes import small_spec
from tir_lenses import spot, spot_lens

import lensforge as lf
from lensforge.cli.conclusion import _limit_rows, _title
from lensforge.light.evaluation import evaluate_traced
from lensforge.light.light_facts import light_facts
from lensforge.light.light_ways import FluxByWay, LightWay, leak_facts
from lensforge.light.simulation import TracedLens
from lensforge.optics.fundamental_limits import BY_SYMMETRY, LEVELS
from lensforge.results import Fact, Metric, Record
from lensforge.scene.exit_rays import ExitRays
from lensforge.sources.build_source import build_source
from lensforge.surfaces.asphere import sphere

TOLD = [(0, 3), (1, 2, 3), (1, 3), (0, 2, 3), (1, 3, 2, 3), (0, 3, 2, 3), (0, 2, 2, 3), (1, 2, 2, 3)]
MET = [*TOLD, (1, 2), (1, 3, 2), (1, 3, 2, 3, 2, 3), (0, 3, 2, 3, 3), (1, 2, 3)]  # the last is lost in the end


def test_long_and_faint_ways_count_together() -> None:
    met = np.array([[*way, *[-1] * (6 - len(way))] for way in MET], dtype=np.int8)
    flux = 2.0 ** -np.arange(13.0)
    nowhere = np.zeros((13, 3))
    fates = np.array([0] * 12 + [4], dtype=np.int8)
    by_way = FluxByWay.none_yet(collimator().chain(6), 1)
    by_way.add(0, 3.0, ExitRays(nowhere, nowhere, flux, np.zeros(13), fates, met=met))
    ways = [(way.title, way.share.value) for way in by_way.ways(6.0)]
    names = ("cap", "side", "wall", "exit")
    wanted = [(" → ".join(names[k] for k in way).capitalize(), 0.5 * flux[n]) for n, way in enumerate(TOLD[:6])]
    rest = [("Through the wall", 0.5 * flux[8:10].sum()), ("Other paths", 0.5 * flux[[6, 7, 10, 11]].sum())]
    assert ways == [(title, pytest.approx(share, rel=1e-15)) for title, share in (*wanted, *rest)]


def test_ways_add_up_to_the_light_that_leaves_and_stand_in_the_record(tmp_path: Path) -> None:
    lens = spot_lens()
    light = evaluate_traced(TracedLens.of(lens, 4.0), lens.spec, build_source(lens.spec.source), 2**13, 1)
    left = light.flux.detected + light.flux.outside + light.missed_by_cause.missed_receiver
    assert sum(way.share.value for way in light.ways) == pytest.approx(left, rel=1e-12)
    assert [way.faces for way in light.ways[:2]] == [("side", "wall", "exit"), ("cap", "exit")]
    light.save(tmp_path / "evaluate.json")
    stored = json.loads((tmp_path / "evaluate.json").read_text(encoding="utf-8"))
    assert [entry["share"]["value"] for entry in stored["ways"]] == [way.share.value for way in light.ways]
    group = next(group for group in light_facts(light, lens) if group.key == "ways")
    assert [fact.value for fact in group.facts] == [100.0 * way.share.value for way in light.ways]


def test_each_of_several_leds_has_its_own_ways() -> None:
    """That of the second is the light of a lens that has this LED alone; a wide one sends more past the cap."""
    leds = [{"kind": "square", "side_mm": side} for side in (0.4, 2.4)]
    several = [{"name": f"led_{number}", "source": led} for number, led in enumerate(leds)]
    lens = spot_lens(spot().replace(source=None, sources=several))
    groups = [group for group in light_facts(lf.evaluate(lens, rays=2**12), lens) if group.key == "ways"]
    assert [group.title for group in groups] == ["Flux by path, led_0", "Flux by path, led_1"]
    for group, led in zip(groups, leds, strict=True):
        alone = lf.evaluate(lens, source=lf.SquareSource(side_mm=led["side_mm"]), rays=2**12)
        assert [fact.value for fact in group.facts] == pytest.approx([100.0 * way.share.value for way in alone.ways])
    first, second = ([fact.value for fact in group.facts] for group in groups)
    assert first != pytest.approx(second, rel=1e-4), "so that the one cannot stand for the other"


def test_the_record_of_a_usual_lens_says_nothing_of_ways() -> None:
    spec = small_spec()
    start = lf.Lens.double(sphere(3.0), sphere(6.0), spec, 0, FEW)
    light = lf.evaluate(start, rays=2**8)
    assert light.ways == () and "ways" not in light.plain()


@pytest.mark.parametrize(("share", "warned"), [(0.0099, False), (0.0101, True)])
def test_a_leak_above_a_hundredth_is_said_with_what_to_try(share: float, warned: bool) -> None:
    def way(value: float, *faces: str) -> LightWay:
        return LightWay(faces=faces, share=Metric(value=value, standard_error=1e-4))

    class Lost(Record):
        flange: float = 0.0

    leaking = (way(0.8, "side", "wall", "exit"), way(share, "wall"))
    facts = list(leak_facts(spot().lens, leaking, Lost(flange=share)))
    assert [fact.label for fact in facts] == (["Lost through the wall", "Lost in the flange"] if warned else [])
    assert all("lens." in fact.note and fact.value == pytest.approx(100.0 * share) for fact in facts)
    assert all(fact.notice == "above 1 %" and fact.sentence.endswith("; above 1 %") for fact in facts)
    cup = lf.ReflectorSection()
    assert not list(leak_facts(cup, (way(0.3, "cup", "mouth"), way(0.5, "mouth")), Lost())), "an open mouth is no leak"
    assert not list(leak_facts(small_spec().lens, (), Lost(flange=0.5))), "a lens of two faces has none of these"


@pytest.mark.parametrize(("of_possible", "notice"), [(0.899, "below 0.9 of the upper bound"), (0.901, "")])
def test_an_efficiency_below_nine_tenths_of_possible_is_amber(of_possible: float, notice: str) -> None:
    start = lf.Lens.double(sphere(3.0), sphere(6.0), small_spec(), 0, FEW)
    light = lf.evaluate(start, rays=2**8)
    receiver = light.receivers[0]
    receiver = receiver.model_copy(update={"efficiency": Metric(value=of_possible * receiver.possible.efficiency)})
    group = light_facts(light.model_copy(update={"receivers": (receiver,)}), start)[0]
    fact = group.fact("efficiency")
    assert fact.notice == notice and fact.state == "" and fact.plain().get("notice", "") == notice
    assert _title("light", "pass", [group]) == "Photometry: pass" + ("; look at: efficiency" if notice else "")
    assert _title("light", "fail", [group]) == "Photometry: fail", "reasons say what is wrong"
    tables = Environment(loader=PackageLoader("lensforge.report")).get_template("tables.html").module
    for shown in (tables.required_table([fact]), tables.card_list([fact]), tables.fact_table([fact])):
        assert ("look: below 0.9" in shown and 'badge open"' in shown) == bool(notice)


@needs_addon("road")
def test_shares_that_limits_bound_are_in_per_cent_and_what_is_missed_names_what_helps() -> None:
    """A road more flux; a lens of revolution levels, where its symmetry bounds the light."""
    far = {"kind": "beam", "fwhm_deg": 60.0, "half_angle_deg": 90.0}
    roads = [{"lighting_class": "M3", "width_m": 7.0, "pole_height_m": 9.0, "pole_spacing_m": 30.0, "lamp_lm": 40.0}]
    start = lf.Lens.double(sphere(3.0), sphere(6.0), small_spec(target=far).replace(roads=roads), 0, FEW)
    light = lf.evaluate(start, rays=2**8)
    (receiver,) = light.receivers
    receiver = receiver.model_copy(update={"possible": receiver.possible.changed(law=BY_SYMMETRY)})
    flux = Metric(value=0.25, standard_error=1e-3)
    lost = Fact.measured("beside", "beside", flux, "lost share of the flux", limit=0.2, place=receiver.name)
    dim = min(
        (limit for limit in light.limits if limit.note == "light"), key=lambda limit: limit.metric.value / limit.bound
    )
    shown = light_facts(light.model_copy(update={"receivers": (receiver,), "limits": (lost, *light.limits)}), start)
    figures = shown[0]
    limits = next(group for group in shown if group.key == "limits")
    assert (figures.fact("nmse").remedy, figures.fact("share_in_target").remedy) == (LEVELS, LEVELS)
    rows = [text for _, text in _limit_rows(limits)]
    assert rows[1].replace("\u2009", " ").startswith("beside: 25.00 ± 0.10 % (required ≤ 20 %); lost share")
    (need,) = {row[row.index("the road needs") :].split(";")[0] for row in rows if "the road needs" in row}
    needed, spacing = map(float, re.findall(r"× ([0-9.]+)", need))
    assert needed == pytest.approx(dim.bound / dim.metric.value, rel=6e-3)
    assert spacing == pytest.approx(1.0 / needed, rel=6e-3)
    tables = Environment(loader=PackageLoader("lensforge.report")).get_template("tables.html").module
    assert need in tables.required_table(limits.facts)


@pytest.mark.parametrize(
    ("scatter", "first"), [(None, "a larger lens"), ({"kind": "gaussian", "sigma_deg": 9.0}, "less scatter")]
)
def test_of_a_frosted_lens_less_scatter_is_the_first_remedy(scatter: dict[str, object] | None, first: str) -> None:
    """The inner face is polished, the outer one is not: its spread no larger lens takes back."""
    spec = small_spec(lens__outer={"offset_mm": 6.0, "scatter": scatter} if scatter else {"offset_mm": 6.0})
    start = lf.Lens.double(sphere(3.0), sphere(6.0), spec, 0, FEW)
    figures = light_facts(lf.evaluate(start, rays=2**8), start)[0]
    remedies = [figures.fact(key).remedy for key in ("nmse", "share_in_target")]
    assert [remedy.split(",")[0] for remedy in remedies] == [first, first]
    assert remedies[1].endswith("a smaller source or a wider target")
