"""Limits on where light of no use ends: by each cause, in the evaluation, the search and the study of parts."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from presets import FEW
from scenes import small_spec
from tir_lenses import spot, spot_lens

import lensforge as lf
from lensforge.errors import InputError
from lensforge.kernels.fate import Fate
from lensforge.light.reference_bodies import ReferenceBody
from lensforge.light.reference_trace import as_arrays, trace_reference
from lensforge.light.simulation import TracedLens, bundles
from lensforge.made.part_study import PartStudy, Recipe
from lensforge.optics.efficacy import Efficacy
from lensforge.scene.body import Chain
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.light_ends import LOSSES, cause_numbers, loss_names
from lensforge.scene.limit_readings import light_limits
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.search.limit_terms import LimitTerm
from lensforge.search.merit import MeritFunction
from lensforge.search.profiles import ProfileParameters
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec
from lensforge.surfaces.asphere import sphere

NEEDED = {"refractive_index": 1.45}  # the faces are made for it; that of the spec is less, and light leaks
FLANGE = {"diameter_mm": 20.0, "thickness_mm": 1.0, "setback_mm": 0.15}
CAUSES = ("beside", "opening", "base", "flange", "total_reflection", "trapped", "wall")


def crooked(*causes: str, share: float = 0.01, **more: Any) -> Spec:
    """A lens with a flange, whose LED stands beside its axis and below its opening, with a limit on each cause."""
    limits = [{"kind": "loss", "cause": cause, "at_most_share": share} for cause in causes]
    base = {"kind": "cylinder", "diameter_mm": 7.0}
    changed = spot(flange=FLANGE, events=3).replace(base=base, limits=limits, evaluate={"rays": 2**10}, **more)
    return changed.replace(lens={"refractive_index": 1.2}, source={"position_mm": [0.9, -0.3, -0.2]})


def made(spec: Spec) -> lf.Lens:
    """The lens of ``spec`` with the faces for a higher index."""
    return replace(spot_lens(spec.replace(lens=NEEDED)), spec=spec)


def two_faces() -> lf.Lens:
    """A lens of two faces, the LED beside the axis and high."""
    limits = [{"kind": "loss", "cause": cause, "at_most_share": 0.01} for cause in CAUSES[:-1]]
    target = {"kind": "beam", "fwhm_deg": 30.0, "half_angle_deg": 40.0}
    spec = small_spec(target=target).replace(limits=limits, source={"position_mm": [0.2, 0.3, 1.2]})
    return lf.Lens.double(sphere(1.5), sphere(3.0, -1.6), spec, 0, FEW)


SCENES = {"beside opening flange wall": lambda: made(crooked(*CAUSES)), "beside opening total_reflection": two_faces}


@pytest.mark.parametrize("some", SCENES)
def test_each_cause_is_the_share_of_a_trace_of_its_own(some: str) -> None:
    """By the tracer in torch, from the fate and the last face of each ray; in each scene some causes take light."""
    lens = SCENES[some]()
    spec = lens.spec
    rays = [bundle for *_, bundle in bundles(build_source(spec.source), 2**10, 16, 0)]
    traced = TracedLens.of(lens, FEW.evaluate_nodes_per_sigma)
    receiver = receivers_of(spec, 64)[0]
    sums = dict.fromkeys(CAUSES, 0.0)
    whole = 0.0
    for bundle in rays:
        body = ReferenceBody.by_tables(torch.from_numpy(traced.tables), traced.scene)
        exits = as_arrays(trace_reference(body, bundle))
        landed = receiver.land(exits)
        out = exits.fates == Fate.LEFT_LENS
        inside = landed.landed & receiver.window.contains(landed.hits)
        last = np.array([traced.scene.names[face] for face in exits.met[:, -1]])
        rows = {
            "beside": out & ~inside,
            "opening": np.isin(exits.fates, (Fate.BACKWARD, Fate.OUTSIDE_CAVITY)),
            "base": exits.fates == Fate.BASE,
            "flange": exits.fates == Fate.FLANGE,
            "total_reflection": exits.fates == Fate.TOTAL_REFLECTION,
            "trapped": exits.fates == Fate.EVENT_LIMIT,
            "wall": out & (last == "wall"),
        }
        sums = {cause: sums[cause] + exits.flux[rows[cause]].sum() for cause in CAUSES}
        whole += bundle.flux.sum()
    for cause, limit in zip(CAUSES, lf.evaluate(lens, rays=2**10).limits, strict=False):
        share = sums[cause] / whole
        assert limit.value == pytest.approx(share, rel=1e-9, abs=1e-12), cause
        assert (limit.standard_error > 0.0) == (share > 0.0), cause
    assert all(sums[cause] > 1e-3 * whole for cause in some.split())


@pytest.mark.parametrize(("factor", "state"), [(0.8, "fail"), (1.25, "pass")])
def test_a_leak_is_judged_on_each_side_of_its_limit(factor: float, state: str) -> None:
    leak = lf.evaluate(made(crooked("wall")), rays=2**10).limits[0].value
    (limit,) = lf.evaluate(made(crooked("wall", share=factor * leak)), rays=2**10).limits
    assert limit.state == state


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        (lambda: small_spec().replace(limits=[{"kind": "loss", "cause": "wall", "at_most_share": 0.1}]), "beside"),
        (lambda: crooked("exit"), "trapped, wall"),
        (lambda: crooked("beside").replace(limits=[{"kind": "loss", "cause": "wall"}]), "at_most_share"),
        (lambda: crooked("beside").replace(limits=[
            {"kind": "loss", "cause": "wall", "unit": "lx", "at_most": 2.0, "at_most_share": 0.1}]), "share alone"),
    ],
)  # fmt: skip
def test_a_cause_that_the_lens_does_not_have_is_refused(spec: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        spec()


def test_the_fate_decides_and_for_light_that_leaves_the_last_face() -> None:
    chain = Chain.of_lens(crooked("wall").lens)
    ends = [*((fate, 2) for fate in Fate), (Fate.LEFT_LENS, 4), (Fate.LEFT_LENS, 1)]
    met = np.array([[0, face, -1] for _, face in ends], dtype=np.int8)
    fates = np.array([fate for fate, _ in ends], dtype=np.int8)
    nowhere = np.zeros((len(ends), 3))
    none = np.zeros(len(ends))
    numbers = cause_numbers(ExitRays(nowhere, nowhere, none, none, fates, met=met), chain)
    names = [loss_names(chain)[number] if number >= 0 else "" for number in numbers]
    assert names == [
        "wall",
        "opening",
        "opening",
        "base",
        "total_reflection",
        "",
        "",
        "trapped",
        "flange",
        "beside",
        "side",
    ]


def test_causes_of_two_faces_are_those_without_a_leak() -> None:
    assert loss_names(None) == LOSSES
    assert loss_names(Chain.of_lens(crooked("wall").lens)) == (*LOSSES, "cap", "side", "wall", "flange")


def test_the_search_counts_the_flux_of_each_cause_and_lowers_what_leaks() -> None:
    spec = crooked(*CAUSES, share=1e-3)
    source = build_source(spec.source)
    parameters = ProfileParameters.of(spec.replace(lens=NEEDED), 2.5)
    merit = MeritFunction.of(spec, source, parameters)
    rays = source.sample(2**10, 3)
    weights, offsets = parameters.start()

    tables = parameters.tables(weights, offsets)
    exits = as_arrays(trace_reference(ReferenceBody.by_tables(tables, merit.light.scene), rays))
    numbers = cause_numbers(exits, merit.light.scene.chain)
    names = loss_names(merit.light.scene.chain)
    losses = merit.light_of(tables, rays).losses[0].detach().numpy()
    for number, cause in enumerate(names[1:], 1):
        assert losses[number] == pytest.approx(exits.flux[numbers == number].sum(), rel=1e-9, abs=1e-15), cause
    inside = merit.light_of(tables, rays).images[0].sum()
    assert losses[0] == pytest.approx(float(exits.flux[exits.left_lens].sum() - inside), rel=0.05), "the splat is wider"
    at = offsets.clone().requires_grad_()
    without_creases = replace(merit.light, source=None)
    (light,) = without_creases.collect(parameters.tables(weights, at), rays)
    for cause, stand_in in (("wall", light.total_reflection), ("beside", light.outside_receiver)):
        loss = light.losses[names.index(cause)]
        gradient, wanted = (torch.autograd.grad(term, at, retain_graph=True)[0] for term in (loss, stand_in))
        assert torch.allclose(gradient, wanted, rtol=1e-9) and float(gradient.abs().max()) > 0.0, cause


LAMPS = {
    "grid": {"kind": "grid", "columns": 2, "rows": 1, "pitch_mm": 40.0},
    "aimed, one past the plane": {
        "kind": "table",
        "places_mm": [[-20.0, 0.0, 0.0], [25.0, 4.0, 30.0]],
        "aims_mm": [[0.0, 9.0, 200.0], [300.0, 4.0, 20.0]],
    },
}


@pytest.mark.parametrize("lamps", LAMPS.values(), ids=LAMPS)
def test_the_search_counts_the_light_beside_of_all_lamps(lamps: dict[str, Any]) -> None:
    """As the evaluation does, on a plane so near that lamps see more of it than its window, or each its own of it."""
    plane = {"kind": "plane", "centre_mm": [10.0, -5.0, 120.0], "width_mm": 90.0, "height_mm": 60.0}
    disc = [{"kind": "disc", "diameter_mm": 50.0}]
    spec = crooked("beside", target=None, receivers=[plane | {"targets": disc}], lamps=lamps)
    source = build_source(spec.source)
    parameters = ProfileParameters.of(spec.replace(lens=NEEDED), 2.5)
    merit = MeritFunction.of(spec, source, parameters)
    light = merit.light_of(parameters.tables(*parameters.start()), source.sample(2**13, 3))
    (limit,) = lf.evaluate(made(spec), rays=2**13).limits
    assert limit.value > 0.05
    assert float(light.losses[0][0]) / light.emitted_w == pytest.approx(limit.value, rel=0.03)


def test_a_term_costs_beyond_its_bound_alone() -> None:
    spec = crooked("wall", share=0.02)
    (term,) = map(LimitTerm.of, light_limits(spec, receivers_of(spec, 64), Efficacy(), 2.0))
    by_cause = torch.zeros(len(loss_names(Chain.of_lens(spec.lens))), dtype=torch.float64)
    wall = len(LOSSES) + 2
    for share, excess in ((0.0193, 0.0), (0.03, 0.0265)):  # 0.4 of the flux counts as 1
        by_cause[wall] = 2.0 * share
        assert term.loss((), (by_cause,)).item() == pytest.approx(30.0 * excess**2 / (1.0 + excess), abs=1e-12)


def test_a_board_loses_the_mean_of_its_lamps() -> None:
    """Of two lamps whose LEDs are out of place: between the losses of each alone."""
    grid = {"kind": "grid", "columns": 2, "rows": 1, "pitch_mm": 40.0}
    spec = crooked("opening", "wall").replace(tolerances={"source_shift_mm": 0.3}, lamps=grid)
    study = PartStudy(Recipe(made(spec), 4, 2**10, 0, 2**10))
    light = study.leds[0].light
    lamps = study.leds[0].made(study.deviations(1))
    one, other, both = (
        light.received([lamps[number] for number in which])[0].losses for which in ((0, 0), (1, 1), (0, 1))
    )
    values = [np.sum(flux, axis=0)[1:] for flux in (one, other, both)]
    assert values[2] == pytest.approx(0.5 * (values[0] + values[1]), rel=0.1)
    assert abs(values[0] - values[1]).max() > 0.1 * values[2].max(), "the lamps are not alike"
    brighter = light.received([replace(lamps[0], flux=2.0 * lamps[0].flux)] * 2)[0].losses
    assert brighter == pytest.approx(2.0 * one, rel=1e-9), "an LED of twice the flux loses twice as much"
    designed = light.measured(light.received(None)).limits
    wanted = lf.evaluate(made(spec), rays=2**10).limits
    assert [limit[0] for limit in designed] == [pytest.approx(limit.value, rel=0.1) for limit in wanted]


def test_parts_lose_what_the_lens_loses_that_they_are_made_as() -> None:
    """With no deviation the study's figures are those of the evaluation by the same rays; a part that is not, leaks."""
    spec = crooked("beside", "wall").replace(tolerances={"source_shift_mm": 0.3})
    study = PartStudy(Recipe(made(spec), 4, 2**10, 0, 2**10))
    light = study.leds[0].light
    values = [limit[0] for limit in light.measured(light.received(None)).limits]
    designed = lf.evaluate(made(spec), rays=2**10).limits
    assert values == [pytest.approx(limit.value, rel=0.05) for limit in designed]
    moved = light.measured(light.received(study.leds[0].made(study.deviations(1)))).limits
    assert all(limit[0] != value for limit, value in zip(moved, values, strict=True))
