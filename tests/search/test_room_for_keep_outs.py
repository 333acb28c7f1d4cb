"""Room around a keep-out: extents along rays by hand, limits that just suffice, and balls around its triangles."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import small_spec

from lensforge.cad.keep_out import FACET_MM, KeepOut, KeepOutSolid
from lensforge.errors import InputError
from lensforge.search import keep_out_extent
from lensforge.search.constraint_points import _GROUP, ChartPoints, KeepOutExtent, _in_groups, require_keep_out_fits
from lensforge.spec import Spec
from lensforge.surfaces import surface
from lensforge.surfaces.srbf import fibonacci_hemisphere

GROWTH = 0.2


def roof(height: float, side: float = 1.0, centre: tuple[float, float] = (0.0, 0.0)) -> KeepOutSolid:
    """A level square of two triangles."""
    corners = [
        [centre[0] + a * side / 2, centre[1] + b * side / 2, height] for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    return KeepOutSolid(np.array(corners), np.array([[0, 1, 2], [0, 2, 3]]))


def extent_of(*solids: KeepOutSolid, symmetry: str = "none", largest: float = 7.0) -> KeepOutExtent:
    return KeepOutExtent(KeepOut(Path("led.step"), solids), GROWTH, largest, symmetry)


def along(extent: KeepOutExtent, *directions: tuple[float, float, float]) -> np.ndarray:
    units = np.array(directions) / np.linalg.norm(directions, axis=1, keepdims=True)
    return extent.along(units)


def by_steps(solid: KeepOutSolid, direction: np.ndarray) -> float:
    """The last place along a ray within the growth of a level square, in steps of half a thousandth of a millimetre."""
    low, high = solid.vertices.min(axis=0), solid.vertices.max(axis=0)
    places = np.linspace(0.0, 6.0, 12_001)[:, None] * direction
    away = np.linalg.norm(np.maximum(np.maximum(low - places, places - high), 0.0), axis=1)
    near = np.flatnonzero(away <= GROWTH)
    return 6.0 * near[-1] / 12_000 if len(near) else 0.0


def test_the_extent_is_the_last_place_within_the_growth_of_any_solid() -> None:
    low, high = roof(1.5), roof(2.5, 0.4, (0.6, 0.0))
    directions = fibonacci_hemisphere(80)
    found = extent_of(low, high).along(directions)
    wanted = [max(by_steps(each, direction) for each in (low, high)) for direction in directions]
    np.testing.assert_allclose(found, wanted, atol=6e-4)
    assert (found == 0.0).any() and along(extent_of(low), (0.0, 0.0, 1.0)) == pytest.approx([1.7])
    assert not extent_of().along(directions).any()


@pytest.mark.parametrize(("symmetry", "images"), [("none", (1, 0, 0, 0)), ("mirror_x", (1, 1, 0, 0)),
                                                  ("mirror_y", (1, 0, 1, 0)), ("rectangle", (1, 1, 1, 1))])  # fmt: skip
def test_a_symmetric_lens_stays_clear_of_all_mirror_images(symmetry: str, images: tuple[int, ...]) -> None:
    beside = roof(1.5, 0.2, (1.0, 0.5))
    ways = [(1.0, 0.5, 1.5), (-1.0, 0.5, 1.5), (1.0, -0.5, 1.5), (-1.0, -0.5, 1.5)]
    assert (along(extent_of(beside, symmetry=symmetry), *ways) > 0.0).tolist() == [bool(each) for each in images]


def test_solids_beside_the_lens_and_below_its_plane_do_not_count() -> None:
    way = [(1.0, 0.0, 0.0)]
    for nearest, counts in ((7.19, True), (7.21, False)):
        wall = roof(0.0, 1.0, (nearest + 0.5, 0.0))
        assert (along(extent_of(wall), *way) > 0.0).tolist() == [counts]
    for height, counts in ((-0.19, True), (-0.21, False), (0.0, True)):
        assert len(extent_of(roof(height))._corners_inside()) == (2 if counts else 0)
    both = extent_of(roof(-9.0), roof(1.0))._corners_inside()
    np.testing.assert_array_equal(both, roof(1.0).corners)


def test_a_point_of_the_chart_speaks_for_the_outline_within_its_spacing() -> None:
    extent = extent_of(roof(1.5))
    places = np.array([[0.0, 0.0], [0.3, 0.1], [-0.2, 0.35], [0.9, 0.0]])
    directions = fibonacci_hemisphere(60_000)
    extents = extent.along(directions)
    around = surface.to_chart(directions)
    own = extent.along(surface.to_sphere(places))
    np.testing.assert_array_equal(extent.at(ChartPoints.of(places)).numpy(), own)
    found = extent.at(ChartPoints.of(places, 0.2)).numpy()
    for k, place in enumerate(places):
        near = np.linalg.norm(around - place, axis=1) <= 0.21
        assert found[k] == max(own[k], extents[near].max())
    assert found[1] > own[1] and found[3] == 0.0
    outline, values = keep_out_extent._outline(extent)
    np.testing.assert_array_equal(values, extents[extents > 0.0])
    np.testing.assert_array_equal(outline, around[extents > 0.0])


def test_the_keep_out_of_a_spec_is_grown_by_its_margin_and_the_error_of_its_mesh(monkeypatch) -> None:
    solid = KeepOut(Path("led.step"), (roof(1.0),))
    monkeypatch.setattr(keep_out_extent, "read_keep_out", lambda path: solid)
    for symmetry, expected in (("auto", "none"), ("mirror_x", "mirror_x")):
        spec = with_limits(small_spec(lens__symmetry=symmetry), keep_out=Path("led.step"), keep_out_margin_mm=0.3)
        found = KeepOutExtent.of(spec)
        assert (found.keep_out, found.growth_mm, found.largest_mm) == (solid, 0.3 + FACET_MM, 7.0)
        assert found.symmetry == expected


def with_limits(spec: Spec, **changes: Any) -> Spec:
    return spec.model_copy(update={"constraints": spec.constraints.model_copy(update=changes)})


@pytest.mark.parametrize("height", [False, True])
def test_a_lens_has_room_for_the_keep_out_the_wall_and_three_margins(height: bool, monkeypatch) -> None:
    extent = extent_of(roof(2.5, 1.5))
    monkeypatch.setattr(KeepOutExtent, "of", lambda spec: extent)
    directions = fibonacci_hemisphere(60_000)
    reach = extent.along(directions)
    lit = reach > 0.0
    needed = float(((reach + 1.0) * (directions[:, 2] if height else 1.0))[lit].max())
    spec = with_limits(small_spec(), keep_out=Path("led.step"))
    for more, fits in ((1e-6, True), (-1e-6, False)):
        if height:
            own = with_limits(spec, max_height_mm=needed + 9e-4 * 7.0 + more)
        else:  # the margins are 3e-4 of the largest radius
            own = with_limits(spec, max_radius_mm=needed / (1.0 - 9e-4) + more)
        if fits:
            require_keep_out_fits(own)
            continue
        with pytest.raises(InputError) as refusal:
            require_keep_out_fits(own)
        words = str(refusal.value)
        assert f"needs a {'max_height_mm' if height else 'max_radius_mm'} of at least" in words
        margin = 9e-4 * own.constraints.max_radius_mm
        assert float(words.split("of at least ")[1].split(",")[0]) == pytest.approx(needed + margin, abs=2e-3)
        worst = int(((reach + 1.0) * np.where(lit, directions[:, 2] if height else 1.0, 0.0)).argmax())
        x, y, z = reach[worst] * directions[worst]
        assert f"reaches ({x:.4g}, {y:.4g}, {z:.4g}) mm" in words


def test_nothing_above_the_plane_needs_no_room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(KeepOutExtent, "of", lambda spec: extent_of(roof(-3.0)))
    require_keep_out_fits(with_limits(small_spec(), keep_out=Path("led.step"), max_radius_mm=0.01))


@pytest.mark.parametrize("count", [1, 70])
def test_each_ball_touches_the_farthest_corner_and_each_group_holds_its_balls(count):
    chance = np.random.default_rng(4)
    triangles = chance.uniform(-1.0, 1.0, (count, 1, 3)) + chance.uniform(-2.0, 2.0, (count, 3, 3))
    corners, balls, groups = _in_groups(triangles, GROWTH)
    assert {each.tobytes() for each in corners} == {each.tobytes() for each in triangles}
    distances = np.linalg.norm(corners - balls[:, None, :3], axis=2)
    np.testing.assert_allclose(distances.max(axis=1) + GROWTH, balls[:, 3], rtol=1e-12)
    of_group = np.repeat(groups, _GROUP, axis=0)
    reached = np.linalg.norm(balls[:, :3] - of_group[:, :3], axis=1) + balls[:, 3]
    np.testing.assert_allclose(reached.reshape(-1, _GROUP).max(axis=1), groups[:, 3], rtol=1e-12)
    furthest = np.linalg.norm(groups[:, :3], axis=1) + groups[:, 3]
    assert (np.diff(furthest) <= 0.0).all(), "groups that reach furthest come first"
