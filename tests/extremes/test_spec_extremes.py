"""Any spec at all: one clear line, or a lens that is traced and judged soundly; and the search from hopeless starts."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from extremes import fuzzed
from hypothesis import example, given
from hypothesis import strategies as st
from presets import FEW
from scenes import small_spec

from lensforge.errors import InputError, WrongFields
from lensforge.light.evaluation import evaluate_lens
from lensforge.scene.lens import Lens
from lensforge.search.optimiser import search
from lensforge.sources.build_source import SquareEmitter, build_source
from lensforge.spec import Spec, parse_spec
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface

COARSE = FEW.replace("coarse", evaluate_nodes_per_sigma=2.0)
NONSENSE = st.sampled_from([0.0, -1.0, -1e300, 5e-324, 1e-7, 1e10, 1e308, math.inf, math.nan, None, "wide", [], True])


def _length(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(math.log10(low), math.log10(high)).map(lambda exponent: 10.0**exponent)


@st.composite
def _contents(draw: st.DrawFn) -> dict[str, Any]:
    """A spec of any size whose parts mostly fit together; up to one field of it is nonsense."""
    size = draw(_length(1e-3, 1e4))
    inner = size * draw(_length(0.01, 1.0))
    receiver = draw(_length(1e-2, 1e7))
    kinds = {
        "flat_top": {"width_mm": 2.0 * receiver * draw(_length(0.1, 1.0)), "exponent": draw(st.floats(2.0, 200.0))},
        "cross": {
            "length_mm": receiver * draw(_length(0.1, 1.0)),
            "stroke_mm": receiver * draw(_length(0.05, 1.0)),
            "edge_mm": receiver * draw(st.sampled_from([0.0, 1e-9, 0.01, 1.0])),
        },
    }
    kind = draw(st.sampled_from(sorted(kinds)))
    content = {
        "name": "any",
        "source": {"kind": "square", "side_mm": inner * draw(st.sampled_from([0.0, 1e-9, 0.3, 1.0, 3.0]))},
        "lens": {
            "levels": draw(st.lists(st.integers(1, 30), min_size=1, max_size=3)),
            "sigma_c": draw(st.one_of(st.floats(0.7, 3.0), st.sampled_from([1e-5, 100.0]))),
            "refractive_index": draw(st.one_of(st.sampled_from([1.0, 4.0]), st.floats(1.0, 4.0))),
            "inner": {"offset_mm": inner},
            "outer": {"offset_mm": size * (1.0 + 1e-9)},
            "symmetry": draw(st.sampled_from(["none", "mirror_x", "rectangle", "square"])),
        },
        "constraints": {
            "cavity_height_mm": 0.3 * inner,
            "cavity_radius_mm": 0.5 * inner,
            "min_thickness_mm": draw(st.sampled_from([0.0, 0.1])) * size,
            "max_radius_mm": 1.1 * size,
        },
        "target": {
            "kind": kind,
            "distance_mm": 1.2 * size * draw(_length(1.0, 1e6)),
            "receiver_mm": receiver,
            "uniform_mm": draw(st.sampled_from([None, 1e-3, 0.5, 1.0])),
            **kinds[kind],
        },
        "evaluate": {
            "rays": draw(st.integers(1, 200)),
            "pixels": draw(st.sampled_from([1, 2, 7, 16])),
            "filter_variance": draw(st.sampled_from([0.0, 5e-324, 1.0, 1e308])),
            "window_mm": draw(st.one_of(st.none(), _length(1e-2, 1e7))),
        },
    }
    if content["target"]["uniform_mm"] is not None:
        content["target"]["uniform_mm"] *= receiver
    if draw(st.integers(0, 4)) == 0:
        section = content[draw(st.sampled_from(["source", "lens", "constraints", "target", "evaluate"]))]
        section[draw(st.sampled_from(sorted(section)))] = draw(NONSENSE)
    return content


def _lens(spec: Spec, seed: int, roughness: float) -> Lens:
    basis = SrbfBasis(spec.lens.levels, spec.lens.sigma_c, spec.lens.symmetry)
    rng = np.random.default_rng(seed)
    inner, outer = (
        SrbfSurface(basis, roughness * offset * rng.normal(size=basis.size), offset)
        for offset in (spec.lens.inner.offset_mm, spec.lens.outer.offset_mm)
    )
    return Lens.double(inner, outer, spec, seed, "draft")


def _one_line(refusal: InputError) -> None:
    """One line, or where several fields are wrong one for each."""
    lines = refusal.lines if isinstance(refusal, WrongFields) else (str(refusal),)
    assert lines and all("\n" not in line and 0 < len(line) < 400 for line in lines)


@fuzzed(60, by_day=8)
@given(_contents(), st.integers(0, 2**31), st.sampled_from([0.0, 1e-12, 0.01, 0.1, 1.0]))
def test_any_spec_is_refused_in_one_line_or_judged_soundly(content: dict, seed: int, roughness: float) -> None:
    try:
        spec = parse_spec(content, "any.toml")
        light = evaluate_lens(_lens(spec, seed, roughness), build_source(spec.source), COARSE)
    except InputError as refusal:
        _one_line(refusal)
        return
    assert sum(light.flux.model_dump().values()) == pytest.approx(1.0, abs=1e-12)
    assert all(np.isfinite(image).all() for image in (light.map, light.raw_map, light.target_map))


def _numbers(schema: Any) -> Iterator[dict[str, Any]]:
    """The number types in a JSON schema, however deep."""
    if isinstance(schema, dict):
        if schema.get("type") == "number":
            yield schema
        for value in schema.values():
            yield from _numbers(value)
    elif isinstance(schema, list):
        for value in schema:
            yield from _numbers(value)


def test_every_length_of_a_spec_is_bounded() -> None:
    """Squares of lengths, and ratios of squares, stay far from the ends of floating point."""
    lengths = [
        (section, field, number)
        for section, schema in Spec.model_json_schema()["$defs"].items()
        for field, type_ in schema.get("properties", {}).items()
        if (field.endswith("_mm") or field == "origin") and field != "positions_mm"  # arrays are held to it elsewhere
        for number in _numbers(type_)
    ]
    assert len(lengths) > 40
    for section, field, number in lengths:
        assert number.get("maximum", math.inf) <= 1e9, f"{section}.{field}"
        assert number.get("exclusiveMinimum", number.get("minimum", -math.inf)) >= -1e9, f"{section}.{field}"


@fuzzed(5, by_day=2)
@given(
    index=st.sampled_from([1.0, 1.4936, 4.0]),
    side=st.sampled_from([0.0, 1e-9, 1.0, 5.9, 20.0]),
    receiver=st.sampled_from([1e-2, 1.0, 200.0, 1e7]),
    mask=st.sampled_from([1e-3, 0.5, 1.0]),
    pixels=st.sampled_from([4, 5, 16]),
    levels=st.sampled_from([[1], [2, 9]]),
    seed=st.integers(0, 2**20),
)
@example(index=1.4936, side=1.0, receiver=1e-2, mask=0.5, pixels=4, levels=[1], seed=0)  # all dark
@example(index=1.4936, side=0.0, receiver=1e-2, mask=0.5, pixels=4, levels=[1], seed=0)  # but no bound: searched
def test_a_search_from_anywhere_stays_finite(index, side, receiver, mask, pixels, levels, seed) -> None:
    spec = small_spec(
        source={"kind": "square", "side_mm": side},
        lens__refractive_index=index,
        lens__levels=levels,
        target__width_mm=0.8 * receiver,
        target__receiver_mm=receiver,
        target__uniform_mm=mask * receiver,
        optimise={"steps_per_level": [3] * len(levels), "rays": 64, "pixels": pixels},
    )
    result, refused = None, ""
    try:
        result = search(spec, SquareEmitter(side), accuracy=COARSE, seed=seed)
    except InputError as refusal:
        refused = str(refusal)
    if result is None:
        assert "the light" in refused, "none in the lens, or a target that no lens can light"
        return
    assert np.isfinite([value for level in result.history for value in level.nmse + level.efficiency]).all()
    limits = result.constraints.model_dump().values()
    margins = [limit for value in limits for limit in (value.values() if isinstance(value, dict) else [value])]
    assert np.isfinite([value for value in margins if value is not None]).all()
