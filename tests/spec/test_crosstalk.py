"""A limit on crosstalk is the limits on zones that one would write for each state and each segment of another."""

from typing import Any

import pytest
from scenes import small_spec

import lensforge as lf
from lensforge.spec import Spec

ROW = {"kind": "chip_array", "columns": 4, "rows": 1, "width_mm": 0.2, "height_mm": 0.3, "pitch_mm": [0.3, 1.0]}
CROSSTALK = {"kind": "crosstalk", "at_most_share": 0.05, "neighbours": 1, "at_least_own_share": 0.7}


def segment(number: int, **changes: Any) -> dict[str, Any]:
    return {"kind": "rectangle", "width_deg": 5.0, "height_deg": 8.0, "centre_deg": [5.0 * number - 7.5, 1.0],
            "half_angle_deg": 30.0, "edge_deg": 0.5, **changes}  # fmt: skip


def zone(number: int) -> dict[str, Any]:
    return {"kind": "rectangle", "width_deg": 5.0, "height_deg": 8.0, "centre_deg": [5.0 * number - 7.5, 1.0]}


def row(limits: list[dict[str, Any]] | None = None, **changes: Any) -> Spec:
    states = [
        {"name": f"c{number}", "dimming": [float(chip == number) for chip in range(4)], "target": segment(number)}
        for number in range(4)
    ]
    limits = [CROSSTALK] if limits is None else limits
    return small_spec(**{"source": ROW, "target": None, "limits": limits, "states": states, **changes})


def test_each_state_limits_its_light_in_its_own_segment_and_in_those_beyond_its_neighbours() -> None:
    glare = {"kind": "glare", "from_deg": 25.0, "at_most": 5.0, "unit": "w_per_sr"}
    spec = row([CROSSTALK, glare])
    wanted = {"c0": [2, 3], "c1": [3], "c2": [0], "c3": [0, 1]}
    for number, (name, others) in enumerate(wanted.items()):
        zone_limit = lf.ZoneLimit(name="crosstalk: own segment", zone=zone(number), at_least_share=0.7)
        beside = [lf.ZoneLimit(name=f"crosstalk: in c{k}", zone=zone(k), at_most_share=0.05) for k in others]
        assert spec.by_state[name].limits == (zone_limit, *beside, lf.GlareLimit(**glare))
    every = row([{"kind": "crosstalk", "name": "ghost", "at_most_share": 0.01}]).by_state["c1"].limits
    assert [limit.name for limit in every] == ["ghost: in c0", "ghost: in c2", "ghost: in c3"]
    assert lf.CrosstalkLimit(**CROSSTALK) == spec.limits[0], "the spec keeps what was written"


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"states": [], "source": {"kind": "square", "side_mm": 1.0}, "target": segment(1)},
         r"limits: crosstalk is between states; give states, or a limit of kind zone"),
        ({"states": [{"name": "a", "target": segment(0)}, {"name": "b", "target": segment(1, half_angle_deg=40.0)}]},
         "crosstalk: b has other receivers than the first state"),
        ({"states": [{"name": "a", "target": segment(0)},
                     {"name": "b", "target": {"kind": "beam", "fwhm_deg": 20.0, "half_angle_deg": 30.0}}]},
         "crosstalk: b has no segment; give it one target of kind rectangle, disc"),
        ({"states": [{"name": "a", "target": segment(0)}, {"name": "b", "target": segment(0), "shift_mm": [1, 0, 0]}]},
         "crosstalk: a and b have one segment; give each its own target"),
        ({"limits": [{**CROSSTALK, "at_most": 3.0, "unit": "cd"}]}, "crosstalk is bounded by at_most_share"),
    ],
)  # fmt: skip
def test_what_has_no_segments_is_told_in_a_line(changes: dict[str, Any], line: str) -> None:
    with pytest.raises(lf.InputError, match=line) as refusal:
        row(**changes)
    assert len(str(refusal.value).splitlines()) == 1
