"""Every fact of a yield against sums over its own table of parts: two roads of unlike classes, and a limit.

Of a lens for one LED, and for two that are unlike.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import oracle_made as made
import pytest
from addon_rows import needs_addon
from crooked import Expected
from presets import FEW
from scenes import NO_TOLERANCES, random_surface, small_spec, tolerance_changes
from test_every_fact import differences

import lensforge as lf
from lensforge.made.yield_facts import yield_facts
from lensforge.made.yield_study import measure_yield
from lensforge.results.fact import Fact, Group

AMOUNTS = {"source_flux": 0.05, "gap_mm": 0.1, "source_shift_mm": 0.15, "index": 0.003}
COLUMNS = {name: [name] for name in AMOUNTS} | {"source_shift_mm": ["source_shift_mm 1", "source_shift_mm 2"]}
EASY = dict.fromkeys(("uniformity", "uniformity_along", "edge_ratio"), 1e-3)
ROAD = {"width_m": 7.0, "pole_height_m": 9.0, "pole_spacing_m": 30.0, "lamp_lm": 3e3, "lighting_class": "M6"} | EASY
ROADS = [ROAD | {"mean_cd_per_m2": 0.2, "glare_percent": 1e3}]
ROADS += [ROAD | {"pole_spacing_m": 37.0, "lighting_class": "M5", "mean_cd_per_m2": 0.165, "glare_percent": 20.0}]
GLARE = {"kind": "glare", "from_deg": 60.0, "at_most": 0.55, "unit": "relative"}
PARTS = 60
RAYS = 2048
NEAR = 1e-4  # per cent, of a share of the variance
FAR = {
    "kind": "rectangle", "width_mm": 0.4, "height_mm": 1.1, "position_mm": [0.2, -0.1, 0.05], "tilt_deg": [14.0, -9.0]
}  # fmt: skip
pytestmark = needs_addon("road")
LEDS = [{"name": "near", "source": {"kind": "square", "side_mm": 1.0}}, {"name": "far", "source": FAR}]


@pytest.fixture(scope="module", params=[1, 2])
def study(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Any:
    spec = small_spec(**tolerance_changes({**NO_TOLERANCES, **AMOUNTS}), target={"kind": "beam", "fwhm_deg": 60.0,
                      "half_angle_deg": 90.0}).replace(roads=ROADS, limits=[GLARE])  # fmt: skip
    several = request.param > 1
    if several:
        spec = spec.replace(source=None, sources=LEDS)
    few = FEW.replace("few_of_each", studies={"designed_rays": 2**12, "worst_rays": 2**11})
    lens = lf.Lens.double(*(random_surface(seed, 3.0 * seed, 0.01, (9, 25)) for seed in (1, 2)), spec, 0, few)
    folder = tmp_path_factory.mktemp("yield")
    result = measure_yield(lens, parts=PARTS, rays=RAYS, with_budget=False, file=folder / "kept.npz")
    result.write(folder)
    record = json.loads((folder / "yield.json").read_text(encoding="utf-8"))
    assert record.get("leds", []) == (["near", "far"] if several else [])
    prefixes = ["near: ", "far: "] if several else [""]
    return SimpleNamespace(facts=yield_facts(result), record=record, parts=parts_of(folder, record), prefixes=prefixes)


def parts_of(folder: Path, record: dict[str, Any]) -> made.Parts:
    with np.load(folder / "yield.npz") as arrays:
        table = dict(zip(record["columns"], arrays["table"].T, strict=True))
    with np.load(folder / "kept.npz") as kept:
        errors = dict(zip(record["metrics"], kept["values"][np.argsort(kept["numbers"])][..., 1].T, strict=True))
    designed = {name: metric["designed"]["value"] for name, metric in record["metrics"].items()}
    return made.Parts(table, record["bounds"], COLUMNS, AMOUNTS, errors, designed)


def test_bounds_are_those_of_the_spec(study: Any) -> None:
    bounds = {bound["metric"]: (bound["sense"], bound["bound"]) for bound in study.record["bounds"]}
    for led in study.prefixes:
        for number, road in enumerate(ROADS, 1):
            for lane in (1, 2):
                start = f"{led}road {number}: lane {lane}: "
                mean, glare = (bounds[f"{start}{key}"] for key in ("mean luminance: light", GLARE_WORDS))
                assert (mean, glare) == ((">=", road["mean_cd_per_m2"]), ("<=", road["glare_percent"]))
        assert bounds[f"{led}limits.0: light relative to its maximum"] == ("<=", 0.55)
    assert len(bounds) == 21 * len(study.prefixes)


GLARE_WORDS = "glare TI: threshold increment"


def expected_of(study: Any, group: Group, number: int, fact: Fact) -> Expected:
    """By the group of the fact, and its number among those of one kind."""
    parts = study.parts
    metrics = study.record["metrics"]
    if group.key == "yield":
        return expected_first(study, fact, group)
    if group.key == "application":
        return expected_road(study, number, fact)
    name = parts.bounds[number]["metric"] if group.key == "bound" else list(metrics)[number]
    unit = metrics[name]["unit"]
    designed = parts.designed[name]
    if fact.key == "designed":
        return made.value_of(name, designed, 1e-12, unit)
    if group.key == "bound":
        bound = parts.bounds[number]
        sign = {"<=": "≤", ">=": "≥"}[bound["sense"]]
        text = f"{sign} {bound['bound']:.4g}" + {"": "", "%": "\u2009%"}.get(bound["unit"], f" {bound['unit']}")
        return Expected(text) if fact.key == "bound" else Expected(100.0 * parts.kept(bound).mean(), 1e-9, "%")
    spread = made.spread(parts, name)
    if spread["spread"] < np.median(parts.errors[name]):
        return Expected("undecided")
    return made.value_of(name, spread[fact.key], 1e-9 * (abs(spread[fact.key]) + 1.0), unit)


def expected_flux(study: Any) -> Expected:
    """The least of all fluxes at which a part begins to pass, with which 95 % of them do."""
    ratios = {}
    fluxes = []
    for number, bound in enumerate(study.parts.bounds):
        quantity = bound["metric"].rpartition(": ")[2]
        power = {"light": 1.0, "threshold increment": 0.2}.get(quantity, 0.0)
        ratios[number] = study.parts.table[bound["metric"]] / bound["bound"], power, bound["sense"]
        if power and bound["sense"] == ">=":
            fluxes += [*(study.parts.table[bound["metric"]] / bound["bound"]) ** (-1.0 / power)]
    shares = [
        np.mean(np.all([(r * f**p >= 1.0 - 1e-12) if s == ">=" else (r * f**p <= 1.0 + 1e-12)
                        for r, p, s in ratios.values()], axis=0))
        for f in fluxes
    ]  # fmt: skip
    enough = [f for f, share in zip(fluxes, shares, strict=True) if share >= 0.95]
    return Expected("none is enough") if not enough else Expected(f"× {min(enough):.4g}")


def expected_first(study: Any, fact: Fact, group: Group) -> Expected:
    if fact.key == "flux":
        return expected_flux(study)
    if fact.key == "main_cause":
        return expected_cause(study, fact, group)
    if fact.key == "passes_with":
        led = f"{fact.label.removeprefix('Yield with ')}: "
        bounds = [bound for bound in study.parts.bounds if bound["metric"].startswith(led)]
        return Expected(100.0 * study.parts.passing(bounds).mean(), 1e-9, "%")
    values = {"parts": PARTS, "rays": RAYS * len(study.prefixes)}
    return (
        Expected(values[fact.key]) if fact.key in values else Expected(100.0 * study.parts.passing().mean(), 1e-9, "%")
    )


def expected_cause(study: Any, fact: Fact, group: Group) -> Expected:
    """Of the two metrics with the most failing parts, of those that have causes."""
    parts = study.parts
    name = next(
        name for name in parts.failing_first() if made.in_words(name) == fact.label.removeprefix("Main cause, ")
    )
    assert parts.failing_first().index(name) < 4
    shares, certain, _ = parts.shares(parts.table[name], parts.errors[name])
    if not certain:
        return Expected("not significant with so few parts")
    share, error = shares[certain[0]]
    return Expected(100.0 * share, NEAR, "%", 100.0 * error, NEAR)


def expected_road(study: Any, number: int, fact: Fact) -> Expected:
    led, number = divmod(number, len(ROADS))
    road = ROADS[number]
    parts = study.parts
    name = f"{study.prefixes[led]}road {number + 1}: "
    bounds = [bound for bound in parts.bounds if bound["metric"].startswith(name)]
    margins = [(1.0 if bound["sense"] == ">=" else -1.0) * (parts.table[bound["metric"]] / bound["bound"] - 1.0)
               for bound in bounds]  # fmt: skip
    rate, low, high = made.wilson(parts.passing(bounds).sum(), PARTS)
    nearest = np.argmin(margins, axis=0)
    most = np.bincount(nearest).argmax()
    label = bounds[most]["metric"].removeprefix(name)
    if fact.key == "main":
        margin = np.min(margins, axis=0)
        errors = [parts.errors[bounds[k]["metric"]][part] / bounds[k]["bound"] for part, k in enumerate(nearest)]
        shares, certain, _ = parts.shares(margin, errors)
        assert fact.value.startswith(MAIN[certain[0]])
        share = float(fact.value.split(", ")[-1].split(" ")[0].rstrip("%\u2009"))
        assert share == pytest.approx(100.0 * shares[certain[0]][0], abs=0.5)
    return {
        "lighting_class": Expected(road["lighting_class"]),
        "holds": Expected(100.0 * rate, 1e-9, "%"),
        "confidence": Expected(f"{made.percent(low)} to {made.percent(high)}"),
        "nearest": Expected(f"{label}, of {made.percent(np.mean(nearest == most))} of the parts"),
        "main": Expected(fact.value),
    }[fact.key]


MAIN = {"source_flux": "source, flux, ", "source_shift_mm": "source, shift, ", "gap_mm": "gap, ", "index": "index, "}


def test_every_fact_of_a_yield(study: Any) -> None:
    seen = {}
    wrong = []
    told = 0
    for group in study.facts:
        number = seen[group.key] = seen.get(group.key, -1) + 1
        if group.key == "causes":
            wrong += list(wrong_causes(study, group))
            continue
        for fact in group.facts:
            expected = expected_of(study, group, number, fact)
            told = told + 1
            wrong += [
                f"{group.key}, {group.title}, {fact.key}: {difference}" for difference in differences(fact, expected)
            ]
    assert not wrong, "\n".join(wrong)
    assert told > 150 and {"yield", "application", "bound", "spread", "causes"} <= set(seen)


def wrong_causes(study: Any, group: Group) -> Iterator[str]:
    """The three leading causes that are certain, and interactions where they stand out."""
    parts = study.parts
    name = next(column for column in parts.table if made.in_words(column) == group.title)
    shares, certain, together = parts.shares(parts.table[name], parts.errors[name])
    for fact in group.facts:
        if fact.key != "together":
            share, error = shares[fact.key]
            yield from (
                f"{group.title}: {difference}"
                for difference in differences(fact, Expected(100 * share, NEAR, "%", 100 * error, NEAR))
            )
        elif isinstance(fact.value, float):
            yield from differences(fact, Expected(100 * together[0], NEAR, "%", 100 * together[1], NEAR))
    named = [fact.key for fact in group.facts if fact.key != "together"]
    if not set(named) <= set(certain[:3]):
        yield f"{group.title}: {named}, must be of {certain}"
