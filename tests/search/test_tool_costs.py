"""What tools cost: differences of short searches from the same lens on, told where they matter."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from scenes import small_spec

import lensforge as lf
from lensforge.results import Metric
from lensforge.results.fact import Change
from lensforge.search.design_result import Design, Margins, ToolCost, design_facts, limits_of
from lensforge.search.tool_costs import _cost, holding_tools, tool_costs
from lensforge.spec.accuracy import AnyAccuracy, preset_of

RAYS = 131072  # of each light that is compared
FREE = SimpleNamespace(accuracy="draft")  # that a search without limits finds
BALL_MM = 2.5  # so large that the first steps are at it
MILLED = {"process": "milled", "cutter_radius_mm": BALL_MM, "required": True}


def cost(efficiency: float, nmse: float | None = None, without: float | None = None) -> ToolCost:
    return ToolCost(limit="tools", instead="x = 1", efficiency=efficiency, nmse=nmse, nmse_without=without)


@pytest.mark.parametrize(
    ("told", "matters"),
    [
        (cost(0.0051), True),
        (cost(0.0049), False),
        (cost(-0.02), False),
        (cost(0.0, 0.0100, 0.0089), True),
        (cost(0.0, 0.0100, 0.0091), False),
        (cost(0.0, 0.0100, 0.0200), False),
        (cost(0.0060, 0.0100, 0.0200), True),
    ],
)
def test_a_cost_matters_above_half_a_point_or_a_tenth_of_the_pattern_error(told: ToolCost, matters: bool) -> None:
    assert told.matters is matters


def held(spec: lf.Spec, **margins: dict[str, float]) -> set[str]:
    """The limits by which the tools hold a lens of ``spec`` whose search ended with ``margins``."""
    stated = Margins(cavity_clearance_mm=1.0, wall_margin_mm=1.0, radius_margin_mm=1.0, **margins)
    return holding_tools(SimpleNamespace(lens=SimpleNamespace(spec=spec), constraints=stated))


def test_a_limit_holds_a_face_within_ten_times_the_margin_with_which_a_search_ends() -> None:
    spec = small_spec(manufacture=MILLED)
    spare = {limit.key: limit.spare for limit in limits_of(spec)}
    curved = spare["outer_curvature_margin_per_mm"]
    assert curved == pytest.approx(3e-3 / BALL_MM)
    far = {"inner": 1.0, "outer": 1.0}
    drafts = {"inner": 9.0, "outer": 9.0}
    for times, kinds in ((9.9, {"curvature_margin_per_mm"}), (10.1, set())):
        near = {**far, "outer": times * curved}  # the second face decides
        assert held(spec, curvature_margin_per_mm=near, draft_margin_deg=drafts) == kinds
    near = {**drafts, "outer": 0.29}
    upright = spec.replace({"manufacture.max_tilt_deg": 0.0})
    assert held(upright, curvature_margin_per_mm=far, draft_margin_deg=near) == {"draft_margin_deg"}
    stated = small_spec(manufacture=MILLED, lens__outer__concave_radius_mm=3.0, lens__outer__draft_deg=1.0)
    nothing = {"inner": 9.0, "outer": 0.0}
    assert held(stated, curvature_margin_per_mm=nothing, draft_margin_deg=nothing) == set(), "wishes, not tools"


def light_after(lens: lf.Lens, spec: lf.Spec) -> lf.Light:
    steps = {"optimise.steps_per_level": [1, 20]}
    return lf.evaluate(lf.design(spec.replace(steps), accuracy="draft", start=lens).lens, rays=RAYS)


@pytest.fixture(scope="module")
def made() -> Design:
    spec = small_spec(manufacture=MILLED, optimise__steps_per_level=[10, 30])
    return lf.design(spec, accuracy="draft")


def test_costs_are_differences_of_the_light_after_the_same_steps_and_the_screen_says_against_what(made: Design) -> None:
    """By the verbs: with the limits, without all, and with the ball of half the radius."""
    assert "curvature_margin_per_mm" in holding_tools(made)
    spec = made.lens.spec
    kept = light_after(made.lens, spec)
    whole, *costs = tool_costs(made)
    free = light_after(made.lens, spec.replace({"manufacture.process": "none", "manufacture.required": False}))
    assert whole.efficiency == free.efficiency.value - kept.efficiency.value
    assert (whole.nmse, whole.nmse_without) == (kept.nmse.value, free.nmse.value)
    assert whole.matters, "the ball is half as large as the lens"
    ball = next(told for told in costs if told.limit == "ball of 2.5 mm")
    smaller = light_after(made.lens, spec.replace({"manufacture.cutter_radius_mm": 1.25}))
    assert ball.instead == "manufacture.cutter_radius_mm = 1.25"
    assert ball.efficiency == smaller.efficiency.value - kept.efficiency.value
    assert ball.nmse_without == smaller.nmse.value
    group = design_facts(made.changed(tool_costs=(whole, ball)))[-1]
    assert (group.key, [fact.label for fact in group.facts]) == (
        "costs",
        ["Cost of the tools", "Cost of the ball of 2.5 mm"],
    )
    assert group.facts[1].value == 100.0 * ball.efficiency
    assert "against manufacture.cutter_radius_mm = 1.25" in group.facts[1].note


@pytest.mark.parametrize(("gaining", "rate"), [((1.0, 0.25), 1.0), ((0.25,), 0.25), ((), None)])
def test_shorter_steps_are_tried_where_the_usual_ones_gain_nothing(gaining, rate, monkeypatch, made: Design) -> None:
    """Near its optimum a lens only loses by the usual steps: that they gain nothing is no cost of 0.

    All searches that are compared take steps of one length; a lens that keeps its limits may gain nothing by them.
    """
    rates = list[float]()

    def search(spec: lf.Spec, *_: object, accuracy: AnyAccuracy, **__: object) -> SimpleNamespace:
        rates.append(preset_of(accuracy).effort.learning_rate / preset_of("draft").effort.learning_rate)
        is_free = spec.manufacture.process == "none"
        return SimpleNamespace(kept_start=not is_free or rates[-1] not in gaining, lens=FREE)

    def light(lens: object, **_: object) -> SimpleNamespace:
        share = 0.8 if lens is FREE else 0.7 if lens is made.lens else None
        return SimpleNamespace(nmse=None, cases=lambda: iter([SimpleNamespace(result=figures(share))]))

    def figures(share: float | None) -> SimpleNamespace:
        return SimpleNamespace(efficiency=Metric(value=share))

    monkeypatch.setattr("lensforge.search.optimiser.search", search)
    monkeypatch.setattr("lensforge.search.tool_costs.evaluate", light)
    costs = tool_costs(made)
    if rate is None:
        assert (costs, rates) == ((), [1.0, 0.25])
        return
    assert [told.efficiency for told in costs] == [pytest.approx(0.1), *[0.0] * (len(costs) - 1)]
    assert rates == ([] if rate == 1.0 else [1.0]) + [rate] * (1 + len(costs))


@pytest.mark.parametrize(("gain", "told"), [(0.0049, False), (0.0051, True)])
def test_a_study_ends_with_its_first_search_where_that_gains_less_than_is_told(gain, told, monkeypatch, made) -> None:
    """And no search takes more rays in a step than a draft, whatever the accuracy of the lens."""
    rays = list[int]()

    def search(spec: lf.Spec, *_: object, accuracy: AnyAccuracy, **__: object) -> SimpleNamespace:
        rays.append(preset_of(accuracy).design_rays)
        return SimpleNamespace(kept_start=spec.manufacture.process != "none", lens=FREE)

    def light(lens: object, **_: object) -> SimpleNamespace:
        figures = SimpleNamespace(efficiency=Metric(value=0.7 + gain if lens is FREE else 0.7))
        return SimpleNamespace(nmse=None, cases=lambda: iter([SimpleNamespace(result=figures)]))

    monkeypatch.setattr("lensforge.search.optimiser.search", search)
    monkeypatch.setattr("lensforge.search.tool_costs.evaluate", light)
    fine = made.changed(lens=replace(made.lens, accuracy="standard"))
    costs = tool_costs(fine)
    assert bool(costs) == told and set(rays) == {2**14}
    assert len(rays) == (1 + len(costs) if told else 1)


def test_a_cost_is_the_mean_over_all_states() -> None:
    """The second of two sources counts as the first does."""

    def light(*figures: tuple[float, float]) -> SimpleNamespace:
        values = [
            SimpleNamespace(result=SimpleNamespace(efficiency=Metric(value=share), nmse=Metric(value=nmse)))
            for share, nmse in figures
        ]
        return SimpleNamespace(nmse=values[0].result.nmse, cases=lambda: iter(values))

    told = _cost("tools", Change("x", "1"), light((0.8, 0.02), (0.6, 0.04)), light((0.8, 0.02), (0.7, 0.02)))
    assert told.efficiency == pytest.approx(0.05)
    assert (told.nmse, told.nmse_without) == (pytest.approx(0.03), pytest.approx(0.02))


def test_a_lens_that_no_tool_holds_costs_nothing_and_is_searched_no_further(made: Design, monkeypatch) -> None:
    monkeypatch.setattr("lensforge.search.optimiser.search", None)  # would raise
    free = made.changed(
        lens=made.lens, constraints=made.constraints.changed(curvature_margin_per_mm={}, draft_margin_deg={})
    )
    assert tool_costs(free) == ()
    assert [group.key for group in design_facts(free)] == ["lens", "search"]
