"""Classes of roads, each figure on both sides of its bound; the worst of several drivers and edges decides."""

import pytest

from lensforge.addons.road.road_judgement import best_class, c_class, p_class
from lensforge.addons.road.road_record import SeenRoad
from lensforge.results import Metric

# EN 13201-2:2015, table 4 (mean and minimum illuminance in lx), table 2 (mean), typed again, the strictest first.
_P = [("P1", 15.0, 3.0), ("P2", 10.0, 2.0), ("P3", 7.5, 1.5), ("P4", 5.0, 1.0), ("P5", 3.0, 0.6), ("P6", 2.0, 0.4)]
_C = [("C0", 50.0), ("C1", 30.0), ("C2", 20.0), ("C3", 15.0), ("C4", 10.0), ("C5", 7.5)]


@pytest.mark.parametrize(("name", "mean", "least"), _P)
def test_p_classes(name: str, mean: float, least: float) -> None:
    """Each figure on both sides of its bound, and the mean at most 1.5 times what the class asks for."""
    easier = next((other for other, lower, low in _P if lower < mean <= 1.5 * lower and low <= least), "none")
    assert p_class(mean, least) == name
    assert p_class(1.5 * mean, least) == name
    assert p_class(mean - 0.01, least) == easier
    assert p_class(mean, least - 0.01) == easier
    assert p_class(1.5 * mean + 0.01, least) == next(
        (other for other, lower, low in _P if lower < 1.5 * mean + 0.01 <= 1.5 * lower and low <= least), "none"
    )


@pytest.mark.parametrize(("number", "name", "mean"), [(number, *row) for number, row in enumerate(_C)])
def test_c_classes(number: int, name: str, mean: float) -> None:
    easier = _C[number + 1][0] if number + 1 < len(_C) else "none"
    assert c_class(mean, 0.4) == name and c_class(mean - 0.01, 0.4) == easier
    assert c_class(mean, 0.39) == "none"


def metric(value: float) -> Metric:
    return Metric(value=value)


@pytest.mark.parametrize(
    ("lanes", "edges", "reached"),
    [
        (((1.6, 0.5, 0.71, 9.0), (2.1, 0.5, 0.8, 8.0)), (0.36, 0.40), "M2"),  # the mean of the first lane
        (((2.1, 0.5, 0.8, 8.0), (2.1, 0.41, 0.69, 9.9)), (0.40, 0.36), "M3"),  # the evenness of the second
        (((2.1, 0.5, 0.8, 8.0), (2.1, 0.5, 0.8, 15.1)), (0.40, 0.36), "M6"),  # the glare of the second
        (((2.1, 0.5, 0.8, 8.0), (2.1, 0.5, 0.8, 8.0)), (0.40, 0.34), "M3"),  # the left edge
        (((2.1, 0.5, 0.8, 8.0), (2.1, 0.5, 0.8, 8.0)), (0.40, 0.29), "none"),
        (((2.1, 0.5, 0.8, 8.0), (2.1, 0.5, 0.8, 8.0)), (0.29, 0.40), "none"),
    ],
)
def test_class_of_a_road_by_its_worst_lane_and_edge(lanes, edges, reached: str) -> None:
    seen = tuple(
        SeenRoad(
            lane=k, mean_cd_per_m2=metric(a), uniformity=metric(b), uniformity_along=metric(c), glare_percent=metric(g),
            luminance_per_lux=metric(0.07),
        )
        for k, (a, b, c, g) in enumerate(lanes)
    )  # fmt: skip
    assert best_class(seen, (metric(edges[0]), metric(edges[1]))) == reached
