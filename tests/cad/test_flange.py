"""The flange of a lens for total internal reflection: its light, its room in the search, its solid, mesh and sizes."""

from functools import cache
from typing import Any

import numpy as np
import pytest
import torch
from landed import exactly
from nightly import first_by_day
from tir_lenses import SPOT, TIR, margins_but_for_the_wall, spot, spot_lens

import lensforge as lf
from lensforge.cad.body_export import BuiltBody, on_base
from lensforge.cad.flange import FlangeRing, ring_of
from lensforge.cad.form_error import fit_lens
from lensforge.cad.mesh_files import stl_bytes
from lensforge.cad.section import body_outlines
from lensforge.kernels.fate import Fate
from lensforge.light.table_trace import TracedBundle
from lensforge.proof.proof_inputs import optical_of
from lensforge.proof.sequential_cast import CastFate
from lensforge.proof.verification import passage_through
from lensforge.scene.lens import Lens
from lensforge.search.constraints import AugmentedLagrangian
from lensforge.search.merit import MeritFunction
from lensforge.search.profiles import ProfileParameters
from lensforge.shop.dimensions import dimensions
from lensforge.shop.point_tables import faces_to_cut
from lensforge.shop.view_lines import dome_lines, end_lines
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec, parse_spec

FLANGE = {"diameter_mm": 20.0, "thickness_mm": 1.0, "setback_mm": 0.15}
BASE = {"kind": "cylinder", "diameter_mm": 7.0, "height_mm": 1.0}


def flanged(**lens: Any) -> Spec:
    return spot(flange=FLANGE, **lens).replace(base=BASE)


@cache
def built() -> tuple[Lens, FlangeRing, BuiltBody]:
    lens = spot_lens(flanged())
    pair = fit_lens(lens)
    ring = ring_of(lens, pair[1])
    assert ring is not None
    return lens, ring, on_base(lens.surfaces, pair, lens.spec.base, 48, 0.0, None, ring)


@pytest.fixture(scope="module")
def lit() -> lf.Light:
    with pytest.MonkeyPatch.context() as patch:  # the error of the tables takes half of the time
        patch.setattr("lensforge.light.evaluation.measure_preset", lambda *_: None)
        return lf.evaluate(built()[0], rays=2**14)


@cache
def merit() -> tuple[MeritFunction, Any]:
    source = build_source(flanged().source, None)
    return MeritFunction.of(flanged(), source, ProfileParameters.of(flanged(), 2.5)), source


def test_the_ring_lies_below_the_exit_and_above_the_wall() -> None:
    lens, ring, _ = built()
    polar = np.linspace(0.3, 1.2, 200_001)
    u = np.column_stack([np.sin(polar), np.zeros_like(polar), np.cos(polar)])
    places = {name: lens.surfaces[name].radius(u)[:, None] * u for name in ("exit", "wall")}
    at_rim = {name: points[np.argmin(np.abs(points[:, 0] - ring.inner_mm)), 2] for name, points in places.items()}
    assert (ring.inner_mm, ring.outer_mm) == (pytest.approx(8.0 - 2.0 * 0.0024, rel=1e-9), 10.0)
    assert ring.high_mm == pytest.approx(at_rim["exit"] - 0.15, abs=1e-3)
    assert ring.high_mm - ring.low_mm == pytest.approx(1.0, rel=1e-12) and ring.low_mm > at_rim["wall"] + 0.15


def test_solid_mesh_and_section_hold_the_same_ring() -> None:
    """Their volumes: of the section that of its body of revolution, by Guldin; all three are made apart."""
    lens, ring, body = built()
    x, z = body_outlines(lens, 0.0)[0].T
    (a, b), (low, high) = np.maximum(np.stack([x, np.roll(x, -1)]), 0.0), np.stack([z, np.roll(z, -1)])
    volume = abs(np.pi / 3.0 * np.sum((a**2 + a * b + b**2) * (high - low)))
    ring_volume = np.pi * (ring.outer_mm**2 - ring.inner_mm**2) * (ring.high_mm - ring.low_mm)
    assert body.solid.valid and body.solid.genus == 0 and ring_volume > 0.05 * volume
    assert body.mesh.volume() == pytest.approx(volume, rel=2e-3)
    assert body.solid.default_volume_mm3 == pytest.approx(volume, rel=1e-3)
    (low_x, _, _), (high_x, _, _) = body.mesh.bounds_mm
    assert (-low_x, high_x) == (pytest.approx(10.0, rel=2e-3), pytest.approx(10.0, rel=2e-3))


def test_light_that_meets_the_flange_has_a_fate_of_its_own(lit: lf.Light) -> None:
    (function, source), lens = merit(), built()[0]
    parameters, scene = function.parametrisation, function.light.scene
    rays = source.sample(2**14, 5)
    traced = TracedBundle.of(parameters.tables(*parameters.start()).numpy(), scene, rays)
    ended = traced.exits.fates == Fate.FLANGE
    assert 0.001 < ended.mean() < 0.02 and (traced.exits.fates != Fate.NOT_CONVERGED).all()
    some = rays.take(np.flatnonzero(ended)[:20])
    assert (exactly(lens.surfaces, scene, some).fates == Fate.FLANGE).mean() > 0.9
    assert lit.missed_by_cause.flange == pytest.approx(rays.flux[ended].sum() / rays.flux.sum(), rel=0.2)
    assert sum(vars(lit.flux).values()) == pytest.approx(1.0, abs=1e-12)
    assert not any("flange" in way.faces for way in lit.ways)


@pytest.mark.parametrize("face", first_by_day(1, ["wall", "exit"]))
def test_the_derivative_counts_light_that_begins_to_meet_the_flange(face: str) -> None:
    function, source = merit()
    parameters, rays = function.parametrisation, source.sample(2**17, 4)
    weights, offsets = parameters.start()
    along = torch.tensor([float(name == face) for name in parameters.names], dtype=torch.float64)

    def loss(moved: torch.Tensor) -> torch.Tensor:
        return function.terms[0].loss(function.light_of(parameters.tables(weights, moved), rays).images[0], False)

    step, moving = 4e-3, offsets.clone().requires_grad_()
    slope = float(loss(offsets + step * along) - loss(offsets - step * along)) / (2.0 * step)
    loss(moving).backward()
    assert float((moving.grad * along).sum()) == pytest.approx(slope, abs=0.02), "differences err by 0.01"
    assert abs(slope) > 0.06 or face == "exit"


@pytest.mark.parametrize("levels", first_by_day(1, [[9], []]))
def test_the_search_sees_the_room_that_the_faces_leave(levels: list[int]) -> None:
    spec = flanged(levels=levels)
    parameters, rng = ProfileParameters.of(spec, 2.5), np.random.default_rng(5)
    weights, offsets = parameters.start()
    weights = weights + 0.005 * torch.from_numpy(rng.normal(size=weights.shape))
    along = torch.from_numpy(rng.normal(size=weights.shape))
    constraints = AugmentedLagrangian.of(spec, parameters.grid)
    constraint = constraints.constraints[constraints.keys.index("flange_margin_mm")]

    def rooms(step: float | torch.Tensor) -> torch.Tensor:
        operator = constraints.chart_operator
        jets = dict(
            zip(constraints.names, operator.jets(parameters.tables(weights + step * along, offsets)), strict=True)
        )
        return constraint.of(jets, operator.points)

    def room(step: float | torch.Tensor) -> torch.Tensor:
        return rooms(step).min()

    measured = margins_but_for_the_wall(parameters.lens(weights, offsets, spec, 0, "draft")).flange_margin_mm
    assert room(0.0).item() == pytest.approx(measured, abs=2e-3)
    least, second = rooms(0.0).sort().values[:2]
    assert second.item() == pytest.approx(least.item(), abs=1e-9), "at the lowest exit, and at the highest wall"
    moving, step = torch.zeros((), dtype=torch.float64, requires_grad=True), 1e-6
    (exact,) = torch.autograd.grad(room(moving), moving)
    assert exact.item() == pytest.approx((room(step) - room(-step)).item() / (2.0 * step), rel=1e-3)


@pytest.mark.nightly("ten seconds; by day the search sees the room, and lenses without a flange are designed")
def test_a_search_leaves_the_room() -> None:
    lens = lf.design(flanged(), accuracy="draft").lens
    assert lf.evaluate(lens, rays=2**15).limits[0].value > 0.895, "0.9 without a flange"
    ring = ring_of(lens)
    assert ring is not None and ring.high_mm - ring.low_mm == pytest.approx(1.0)


def test_the_referee_finds_the_light_that_the_flange_takes(lit: lf.Light) -> None:
    lens, _, body = built()
    rays = build_source(lens.spec.source, None).sample(2**14, 9)
    passage = passage_through(stl_bytes(body.mesh), optical_of(lens.body, lens.events), lens.media, rays)
    share = passage.flux[passage.fates == CastFate.FLANGE].sum() / rays.flux.sum()
    assert share == pytest.approx(lit.missed_by_cause.flange, abs=1e-3) and not passage.absorbed.any()


def test_views_and_sizes_show_it() -> None:
    lens, ring, _ = built()
    drawn = {dimension.name: dimension for dimension in dimensions(lens)}
    sizes = {name: dimension.value_mm for name, dimension in drawn.items()}
    assert sizes["thickness of the rim's flange"] == pytest.approx(1.0)
    for name in ("thickness of the rim's flange", "underside of the rim's flange above z = 0"):
        assert {across for _, across in drawn[name].ends or ()} == {-10.0}, "on the side of the heights, not across"
    assert sizes["diameter of the rim's flange"] == sizes["largest width"] == 20.0
    assert sizes["underside of the rim's flange above z = 0"] == pytest.approx(ring.low_mm)
    assert [face.name for face in faces_to_cut(lens)] == list(TIR), "it is no optical face"
    for lines in (dome_lines(lens), end_lines(lens)):
        assert max(np.hypot(*line.points.T).max() for line in lines) == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"lens": {"kind": "tir", "flange": {**FLANGE, "diameter_mm": 15.0}}}, "must exceed that .* above 16"),
        (
            {"constraints": {"max_radius_mm": 8.0, "max_height_mm": 1.2}, "lens": {"kind": "tir", "flange": FLANGE}},
            "thickness_mm = 1: .* below constraints.max_height_mm = 1.2",
        ),
        ({"lens": {"kind": "tir", "flange": {"diameter_mm": 20.0}}}, "lens.flange.thickness_mm"),
        ({"lens": {"flange": FLANGE}, "optimise": {}}, "lens.flange"),
        ({"lens": {"kind": "tir", "flange": FLANGE}, "plate": {"thickness_mm": 2.0}}, "the plate holds the lenses"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(changes: dict, message: str) -> None:
    with pytest.raises(lf.InputError, match=message) as caught:
        parse_spec({**SPOT, **changes}, "spot")
    assert "\n" not in str(caught.value)
