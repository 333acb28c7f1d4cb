"""Learning rate of a stage: half a period of a cosine, from the stage's rate to a twentieth of it."""

import pytest

from lensforge.search.schedule import Stage


@pytest.mark.parametrize(
    ("step", "share"),
    [(0, 1.0), (25, 0.05 + 0.95 * (0.5 + 8.0**-0.5)), (50, 0.525), (75, 0.05 + 0.95 * (0.5 - 8.0**-0.5)), (100, 0.05)],
)
def test_the_rate_falls_by_half_a_cosine_to_a_twentieth(step: int, share: float) -> None:
    stage = Stage(0, (9,), 9, 100, 64, 0.2, 100)
    assert stage.rate(step) == pytest.approx(0.2 * share, rel=1e-12)


def test_a_longer_stage_takes_as_many_more_steps() -> None:
    short, long = (Stage(0, (9,), 9, steps, 64, 0.1, steps) for steps in (40, 400))
    assert [short.rate(step) for step in range(41)] == pytest.approx([long.rate(10 * step) for step in range(41)])
