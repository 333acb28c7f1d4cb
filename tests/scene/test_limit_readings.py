"""Readings of limits on pictures whose light is known at every place."""

import numpy as np
import pytest
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.scene.limit_readings import LightLimit, light_limits
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.spec import Spec

BEAM = {"kind": "beam", "fwhm_deg": 30.0, "half_angle_deg": 60.0}
FLUX_W, LUMENS = 2.0, 300.0


def far(*limits: dict[str, object]) -> Spec:
    return small_spec(target=BEAM).replace(limits=limits)


def limits_of(spec: Spec, lumens: float | None = LUMENS) -> tuple[LightLimit, ...]:
    return light_limits(spec, receivers_of(spec, 64), lumens, FLUX_W)


def picture(spec: Spec) -> np.ndarray:
    """Flux (W) of an intensity of 3 + x/10 - y/20 W/sr, x and y in degrees."""
    receiver = receivers_of(spec, 64)[0]
    x, y = receiver.target_coordinates(*np.meshgrid(receiver.grid.x(), receiver.grid.y()))
    return (3.0 + 0.1 * x - 0.05 * y) * receiver.pixel_measure


def test_points_read_the_light_there_in_their_unit() -> None:
    spec = far(
        {"kind": "points", "at_deg": [[0, 0], [10, 0], [-12.3, 20]], "unit": "cd", "at_least": 1.0, "at_most": 1e9}
    )
    least, most = limits_of(spec)
    expected = LUMENS * np.array([3.0, 4.0, 3.0 - 1.23 - 1.0])
    for limit in (least, most):
        assert np.abs(limit.of(picture(spec)[None])[0] / expected - 1.0).max() < 1e-3
    assert (least.sense, most.sense, least.unit, least.quantity) == (">=", "<=", "cd", "light")


def test_a_line_is_read_more_than_once_per_pixel_from_end_to_end() -> None:
    spec = far({"kind": "line", "from_deg": [-20, 5], "to_deg": [20, 5], "unit": "w_per_sr", "at_least": 1.0})
    read = limits_of(spec)[0].of(picture(spec)[None])[0]
    assert len(read) >= 2 * 64 * 40 / 120
    assert np.abs(read - (2.75 + 0.1 * np.linspace(-20.0, 20.0, len(read)))).max() < 3e-3


def test_zones_are_the_pixels_in_them_and_a_share_is_one_of_the_source() -> None:
    disc = {"kind": "disc", "diameter_deg": 40.0, "centre_deg": [10.0, 0.0]}
    spec = far({"kind": "zone", "zone": disc, "unit": "w_per_sr", "at_most": 9.0, "at_least_share": 0.1})
    light, share = limits_of(spec)
    read = light.of(picture(spec)[None])[0]
    assert read.max() == pytest.approx(6.0, abs=0.25) and read.min() == pytest.approx(2.0, abs=0.25)
    sr = 2.0 * np.pi * (1.0 - np.cos(np.radians(20.0)))
    assert share.of(picture(spec)[None])[0, 0] == pytest.approx(4.0 * sr / FLUX_W, rel=0.05)
    whole = limits_of(far({"kind": "zone", "unit": "w_per_sr", "at_most": 9.0}))[0]
    assert whole.readings.shape[0] == pytest.approx(np.pi / 4.0 * 64**2, rel=0.01), "the round window"


def test_glare_is_everything_from_an_angle_on() -> None:
    spec = far({"kind": "glare", "from_deg": 50.0, "unit": "w_per_sr", "at_most": 1.0})
    read = limits_of(spec)[0].of(picture(spec)[None])[0]
    assert read.max() == pytest.approx(3.0 + 60.0 * np.hypot(0.1, 0.05), abs=0.2)
    assert read.min() == pytest.approx(3.0 - 60.0 * np.hypot(0.1, 0.05), abs=0.2)


def test_irradiance_on_a_plane_is_read_in_lux() -> None:
    spec = small_spec().replace(limits=[{"kind": "points", "at_mm": [[3.0, -4.0]], "unit": "lx", "at_least": 1.0}])
    receiver = receivers_of(spec, 64)[0]
    flat = np.full((1, 64, 64), receiver.pixel_measure)
    assert limits_of(spec)[0].of(flat)[0, 0] == pytest.approx(LUMENS)


def test_candela_need_lumens() -> None:
    spec = far({"kind": "points", "at_deg": [[0, 0]], "unit": "cd", "at_least": 1.0})
    with pytest.raises(InputError, match=r"limits\.0.*lumens are not known; give source\.flux_lm"):
        limits_of(spec, None)


@pytest.mark.parametrize(
    ("at_deg", "most", "refused"),
    [
        ([[5, 5]], {"kind": "zone", "unit": "cd", "at_most": 10}, True),
        ([[5, 5]], {"kind": "zone", "unit": "cd", "at_most": 30}, False),
        ([[5, 5]], {"kind": "glare", "from_deg": 20, "unit": "cd", "at_most": 1}, False),
        ([[0, 0], [5, 5]], {"kind": "points", "at_deg": [[5, 5]], "unit": "cd", "at_most": 1}, True),
        ([[5, 5]], {"kind": "zone", "unit": "w_per_sr", "at_most": 0.001}, False),
    ],
)  # fmt: skip
def test_limits_that_contradict_each_other_are_refused(
    at_deg: list[list[float]], most: dict[str, object], refused: bool
) -> None:
    spec = far({"kind": "points", "at_deg": at_deg, "unit": "cd", "at_least": 20}, most)
    if refused:
        with pytest.raises(InputError, match=r"limits\.0 asks for at least 20 cd where limits\.1 allows at most"):
            limits_of(spec)
    else:
        assert len(limits_of(spec)) == 2


def test_a_zone_between_pixels_is_refused() -> None:
    tiny = {"kind": "disc", "diameter_deg": 0.01, "centre_deg": [0.3, 0.3]}
    with pytest.raises(InputError, match="no pixel of the receiver lies in it"):
        limits_of(far({"kind": "zone", "zone": tiny, "unit": "cd", "at_most": 1.0}))
