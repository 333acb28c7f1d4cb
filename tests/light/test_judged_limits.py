"""Judgement of limits: the light that decides, against pictures whose noise is made, and the three states."""

import numpy as np
import pytest
from presets import FEW
from pydantic import TypeAdapter, ValidationError
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.light.evaluation_result import JudgedLimits
from lensforge.light.judged_limits import judged_limits
from lensforge.optics.efficacy import Efficacy
from lensforge.results import Fact, Metric
from lensforge.results.estimates import ratio_of
from lensforge.scene.limit_readings import light_limits
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.spec.quantities import LeastOverMean, LeastOverMost, MostOverLeast

BEAM = {"kind": "beam", "fwhm_deg": 30.0, "half_angle_deg": 60.0}
REPLICATES = 16


def judged(limit: dict[str, object], noise: float = 0.0, peak: float = 5.0, seed: int = 0) -> tuple[Fact, ...]:
    """Limits on a Gaussian beam of 30 x 20 degrees, its peak in W/sr, with noise relative to the peak per replicate."""
    spec = small_spec(target=BEAM).replace(limits=[limit])
    receivers = receivers_of(spec, 128)
    x, y = receivers[0].target_coordinates(*np.meshgrid(receivers[0].grid.x(), receivers[0].grid.y()))
    light = peak * np.exp(-4.0 * np.log(2.0) * ((x / 30.0) ** 2 + (y / 20.0) ** 2))
    rng = np.random.default_rng(seed)
    images = light * receivers[0].pixel_measure * (1.0 + noise * rng.normal(size=(REPLICATES, *light.shape)))
    return judged_limits(light_limits(spec, receivers, Efficacy(), 1.0), [images], ["sky"])


@pytest.mark.parametrize(
    ("limit", "value"),
    [
        ({"kind": "points", "at_deg": [[0, 0], [15, 0]], "unit": "w_per_sr", "at_least": 1.0}, 2.5),
        ({"kind": "points", "at_deg": [[0, 0], [15, 0]], "unit": "w_per_sr", "at_most": 1.0}, 5.0),
        ({"kind": "points", "at_deg": [[0, 10]], "unit": "relative", "at_least": 0.3}, 0.5),
        ({"kind": "line", "from_deg": [-15, 0], "to_deg": [15, 0], "unit": "w_per_sr", "at_least": 1.0}, 2.5),
        ({"kind": "glare", "from_deg": 30.0, "unit": "relative", "at_most": 0.1}, 0.0625),
        ({"kind": "beam_angle", "at_least_deg": 10.0}, 30.0),
        ({"kind": "beam_angle", "azimuth_deg": 90.0, "at_least_deg": 10.0}, 20.0),
        ({"kind": "beam_angle", "level": 0.0625, "at_least_deg": 10.0}, 60.0),
        ({"kind": "zone", "zone": {"kind": "disc", "diameter_deg": 20.0}, "at_least_min_over_max": 0.1}, 0.5),
    ],
)  # fmt: skip
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_the_value_that_decides_is_the_one_of_the_closed_form(
    limit: dict[str, object], value: float, noise: float
) -> None:
    (judgement,) = judged(limit, noise)
    error = judgement.standard_error or 0.0
    rough = 0.08 if limit["kind"] in ("zone", "glare") else 0.03  # whole pixels at their edge
    assert judgement.value == pytest.approx(value, rel=rough, abs=4.0 * error)
    assert judgement.place == "sky" and (noise == 0.0 or 0.0 < error < 0.1 * value)


@pytest.mark.parametrize(
    ("value", "error", "state"),
    [
        (1.21, 0.1, "held"),
        (1.19, 0.1, "undecided"),
        (0.81, 0.1, "undecided"),
        (0.79, 0.1, "missed"),
        (5.0, None, "undecided"),
    ],
)
@pytest.mark.parametrize("sense", [">=", "<="])
def test_a_limit_is_decided_beyond_two_standard_errors(
    value: float, error: float | None, state: str, sense: str
) -> None:
    signed = value if sense == ">=" else 2.0 - value
    fact = Fact("a", "a", signed, "cd", error, sense, 1.0, note="light", place="sky").judged(error)
    assert fact.outcome == state
    records = TypeAdapter(JudgedLimits)
    (stored,) = records.dump_python((fact,))
    assert stored == {
        "name": "a", "receiver": "sky", "quantity": "light", "sense": sense, "bound": 1.0, "unit": "cd", "state": state,
        "value": {"value": signed, "unit": "cd", "standard_error": error},
    }  # fmt: skip
    assert records.validate_python([stored]) == (fact,)
    other = "held" if state != "held" else "missed"
    with pytest.raises(ValidationError, match="state: not as it follows from the other entries"):
        records.validate_python([{**stored, "state": other}])


@pytest.mark.parametrize("noise", [0.02, 0.2])
def test_no_noise_lifts_a_ratio_to_the_largest_above_one(noise: float) -> None:
    """Even light, whose least and largest are the same but for the noise taken off both."""
    for seed in range(20):
        readings = 1.0 + noise * np.random.default_rng(seed).normal(size=(16, 50))
        for quantity in (LeastOverMost(), LeastOverMean()):
            assert quantity.value(readings, ">=", "", readings).value <= 1.0
        assert MostOverLeast().value(readings, "<=", "", readings).value >= 1.0
    above = Metric(value=1.2, standard_error=0.1)
    below = Metric(value=1.0, standard_error=0.05)
    ratio = ratio_of(above, below)
    assert (ratio.value, ratio.standard_error) == (1.0, pytest.approx(np.hypot(0.1, 0.06)))


def test_the_light_of_a_lens_has_its_limits_and_its_verdict_follows_them() -> None:
    import lensforge as lf
    from lensforge.report.results import Results
    from lensforge.scene.lens import Lens
    from lensforge.surfaces.asphere import sphere

    for bound, state in ((1e-3, "pass"), (1e6, "fail")):
        spec = small_spec(target=BEAM, source__flux_w=1.0).replace(
            limits=[{"kind": "points", "name": "axis", "at_deg": [[0, 0]], "unit": "w_per_sr", "at_least": bound}]
        )
        lens = Lens.double(sphere(3.0), sphere(6.0), spec, 0, FEW)
        light = lf.evaluate(lens, rays=2**14)
        assert [limit.label for limit in light.limits] == ["axis"]
        verdict = Results(lens, {"evaluate": light}).verdict
        assert verdict.light == state, "limits decide, whatever the pattern"
        assert state == "pass" or "axis = " in verdict.reasons.light[0]
    in_candela = spec.replace(limits=[{"kind": "zone", "unit": "cd", "at_most": 1.0}])
    with pytest.raises(InputError, match="lumens"):
        lf.evaluate(Lens.double(sphere(3.0), sphere(6.0), in_candela, 0, FEW))
