"""Radiance tables: étendue and files; rays one by one, traced back to the numbers that they were drawn by."""

import warnings
from pathlib import Path

import numpy as np
import pytest

from lensforge.errors import InputError
from lensforge.seeds import sobol
from lensforge.sources.radiance_emitter import RadianceEmitter, RadianceTable, _problem, read_radiance

X_MM, Y_MM = np.array([-1.0, 0.5, 2.0, 3.0]), np.array([0.0, 0.5, 2.0])
C_DEG, GAMMA_DEG = np.array([0.0, 90.0, 200.0, 360.0]), np.array([5.0, 20.0, 50.0, 85.0])


def write_radiance(path: Path, table: RadianceTable) -> None:
    """Write ``table`` so that ``read_radiance`` finds the same numbers."""
    names = ("x_mm", "y_mm", "c_deg", "gamma_deg", "radiance")
    np.savez_compressed(path, **{name: getattr(table, name) for name in names})


def made(planes: int = 4) -> RadianceTable:
    """Random radiances, all cells but the first of the lower row lit; some nodes are dark."""
    random = np.random.default_rng(7)
    values = random.uniform(0.2, 1.0, (2, 3, planes, 4)) * (random.random((2, 3, planes, 4)) > 0.2)
    values[0, 0] = 0.0
    values[:, :, -1] = values[:, :, 0]
    return RadianceTable(X_MM, Y_MM, C_DEG if planes == 4 else np.zeros(1), GAMMA_DEG, values)


def squares(gamma_deg: np.ndarray) -> np.ndarray:
    return np.sin(np.deg2rad(gamma_deg)) ** 2


def up_to(values: np.ndarray, end: float) -> float:
    """Integral of values linear between the nodes in sin^2 gamma, up to ``end``; none beyond the last."""
    nodes = squares(GAMMA_DEG)
    end = min(end, nodes[-1])
    inside = np.append(nodes[nodes < end], end)
    return float(np.trapezoid(np.interp(inside, nodes, values), inside))


def cell_of(edges: np.ndarray, place: float) -> int:
    return min(int(np.searchsorted(edges, place, side="right")) - 1, len(edges) - 2)


@pytest.mark.parametrize("planes", [1, 4])
def test_each_ray_stands_where_the_shares_of_light_before_it_are_its_four_numbers(planes: int) -> None:
    table = made(planes)
    points = sobol(64, 4, 3)
    origins, directions = RadianceEmitter(table, 1.0).emit(points)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    assert (origins[:, 2] == 0.0).all() and (directions[:, 2] > 0.0).all()
    widths, heights = np.diff(X_MM), np.diff(Y_MM)
    by_plane = np.array([[[up_to(plane, 1.0) for plane in cell] for cell in row] for row in table.radiance])
    turns = np.deg2rad(table.c_deg)
    around = 0.5 * (by_plane[..., 1:] + by_plane[..., :-1]) * np.diff(turns) if planes > 1 else 2.0 * np.pi * by_plane
    fluxes = around.sum(axis=2) * heights[:, None] * widths
    for (down, across, rise, turned), (x, y, _), (kx, ky, kz) in zip(points, origins, directions, strict=True):
        row, column = cell_of(Y_MM, y), cell_of(X_MM, x)
        rows = fluxes.sum(axis=1)
        in_row = (y - Y_MM[row]) / heights[row]
        assert (rows[:row].sum() + in_row * rows[row]) / rows.sum() == pytest.approx(down, abs=1e-9)
        cells, part = fluxes[row], (x - X_MM[column]) / widths[column]
        assert (cells[:column].sum() + part * cells[column]) / cells.sum() == pytest.approx(across, abs=1e-9)
        turn = np.arctan2(ky, kx) % (2.0 * np.pi)
        if planes == 1:
            assert turn / (2.0 * np.pi) == pytest.approx(turned, abs=1e-9)
            radiance = table.radiance[row, column, 0]
        else:
            low = cell_of(turns, turn)
            share, sectors = (turn - turns[low]) / (turns[low + 1] - turns[low]), around[row, column]
            first, second = by_plane[row, column, low : low + 2]
            passed = (turns[low + 1] - turns[low]) * (first * share + 0.5 * (second - first) * share**2)
            assert (sectors[:low].sum() + passed) / sectors.sum() == pytest.approx(turned, abs=1e-9)
            radiance = (1.0 - share) * table.radiance[row, column, low] + share * table.radiance[row, column, low + 1]
        assert up_to(radiance, 1.0 - kz**2) / up_to(radiance, 1.0) == pytest.approx(rise, abs=1e-7)


@pytest.mark.parametrize("planes", [1, 4])
def test_the_flux_of_each_cell_is_that_of_a_loop_over_its_trapezoids(planes: int) -> None:
    table, nodes = made(planes), squares(GAMMA_DEG)
    turns = [2.0 * np.pi] if planes == 1 else np.diff(np.deg2rad(C_DEG))
    for row, column in np.ndindex(2, 3):
        flux = 0.0
        for sector, turn in enumerate(turns):
            beside = table.radiance[row, column, [sector, min(sector + 1, planes - 1)]].mean(axis=0)
            flux += turn * sum(
                0.25 * (beside[g] + beside[g + 1]) * (nodes[g + 1] - nodes[g]) for g in range(len(nodes) - 1)
            )
        area_m2 = np.diff(Y_MM)[row] * np.diff(X_MM)[column] * 1e-6
        assert table.cell_fluxes[row, column] == pytest.approx(flux * area_m2, rel=1e-12, abs=1e-30)
    assert table.flux() == pytest.approx(table.cell_fluxes.sum(), rel=1e-12)


def test_a_sample_has_the_flux_and_the_outline_leaves_out_dark_cells() -> None:
    table = made()
    rays = RadianceEmitter(table, 3.0).sample(7, 2)
    np.testing.assert_array_equal(rays.flux, 3.0 / 7)
    np.testing.assert_array_equal(rays.origins, RadianceEmitter(table, 1.0).emit(sobol(7, 4, 2))[0])
    assert RadianceEmitter(table, 1.0).ray_count is None
    radiance = table.radiance.copy()
    radiance[0], radiance[:, 0] = 0.0, 0.0
    lit = RadianceEmitter(RadianceTable(X_MM, Y_MM, C_DEG, GAMMA_DEG, radiance), 1.0)
    assert lit.outline().tolist() == [[0.5, 0.5, 0.0], [3.0, 0.5, 0.0], [3.0, 2.0, 0.0], [0.5, 2.0, 0.0]]
    radiance[:, 2] = 0.0
    lit = RadianceEmitter(RadianceTable(X_MM, Y_MM, C_DEG, GAMMA_DEG, radiance), 1.0)
    assert lit.outline()[:, 0].tolist() == [0.5, 2.0, 2.0, 0.5]


@pytest.mark.parametrize("gamma_max", [10.0, 45.0, 90.0])
def test_flux_over_radiance_is_the_etendue(gamma_max: float) -> None:
    """pi A sin^2 of the cone's half angle, for any number of nodes."""
    for nodes in (2, 7):
        cone = RadianceTable(
            X_MM, Y_MM, np.zeros(1), np.linspace(0.0, gamma_max, nodes), np.full((2, 3, 1, nodes), 3.0)
        )
        assert cone.flux() == pytest.approx(3.0 * np.pi * 8e-6 * np.sin(np.deg2rad(gamma_max)) ** 2, rel=1e-14)


def good(**changes: np.ndarray) -> dict[str, np.ndarray]:
    table = {
        "x_mm": np.array([0.0, 1.0]),
        "y_mm": np.array([0.0, 1.0, 2.0]),
        "c_deg": np.zeros(1),
        "gamma_deg": np.array([0.0, 90.0]),
        "radiance": np.ones((2, 1, 1, 2)),
    }
    return table | changes


LONG = np.arange(4097.0)


def around(values: list[float]) -> np.ndarray:
    return np.array(values)[None, None, :, None] * np.ones((2, 1, 1, 2))


@pytest.mark.parametrize(
    ("changes", "phrase"),
    [
        ({}, ""),
        ({"x_mm": LONG[:-1], "radiance": np.ones((2, 4095, 1, 2))}, ""),
        ({"x_mm": LONG, "radiance": np.ones((2, 4096, 1, 2))}, "x_mm has 4097 numbers"),
        ({"gamma_deg": LONG / 50.0, "radiance": np.ones((2, 1, 1, 4097))}, "gamma_deg has 4097 numbers"),
        ({"x_mm": np.array([-1e9, 1e9])}, ""),
        ({"x_mm": np.array([-1.001e9, 1e9])}, "x_mm has 2 numbers up to 1.001e"),
        ({"x_mm": np.array([1.0])}, "x_mm must be a list"),
        ({"x_mm": np.ones((2, 2))}, "x_mm must be a list"),
        ({"y_mm": np.array([0.0, np.inf, 2.0])}, "y_mm must be a list"),
        ({"gamma_deg": np.array([45.0])}, "gamma_deg must be a list"),
        ({"gamma_deg": np.array([0.0, 0.0])}, "gamma_deg must rise"),
        ({"gamma_deg": np.array([0.0, 90.001])}, "within 0 to 90"),
        ({"gamma_deg": np.array([-0.001, 60.0])}, "within 0 to 90"),
        ({"c_deg": np.array([0.001])}, "or be the single number 0"),
        ({"c_deg": np.array([0.001, 360.0]), "radiance": np.ones((2, 1, 2, 2))}, "c_deg must run"),
        ({"c_deg": np.array([0.0, 360.0]), "radiance": np.ones((2, 1, 2, 2))}, ""),
        ({"c_deg": np.array([0.0, 359.0]), "radiance": np.ones((2, 1, 2, 2))}, "c_deg must run"),
        ({"radiance": np.ones((1, 1, 1, 2))}, "radiance has the shape"),
        ({"radiance": np.ones((2, 2, 1, 2))}, "radiance has the shape"),
        ({"radiance": np.ones((2, 1, 1, 3))}, "radiance has the shape"),
        ({"x_mm": np.array([-1e9 - 0.5, 1e9])}, "x_mm has 2 numbers"),
        ({"c_deg": np.array([0.0, 90.0, 360.0]), "radiance": around([1.0, 2.0, 1.0])}, ""),
        ({"c_deg": np.array([0.0, 90.0, 360.0]), "radiance": around([1.0, 1.0, 2.0])}, "at c_deg = 360 must be"),
        ({"radiance": np.array([[[[0.0, 1.0]]], [[[2.0, 0.0]]]])}, ""),
        ({"radiance": np.full((2, 1, 1, 2), 0.99e20)}, ""),
        ({"radiance": np.full((2, 1, 1, 2), 1e20)}, "radiances must be finite"),
        ({"radiance": np.array([[[[1.0, 0.0]]], [[[2.0, -1e-9]]]])}, "none below 0"),
    ],
)
def test_a_table_is_whole_or_one_line_says_what_it_lacks(changes: dict[str, np.ndarray], phrase: str) -> None:
    problem = _problem(good(**changes))
    assert phrase in problem and bool(problem) == bool(phrase)


def test_a_file_comes_back_bit_by_bit(tmp_path: Path) -> None:
    original = made()
    write_radiance(tmp_path / "led.npz", original)
    back = read_radiance(tmp_path / "led.npz")
    for name in ("x_mm", "y_mm", "c_deg", "gamma_deg", "radiance"):
        np.testing.assert_array_equal(getattr(back, name), getattr(original, name))


def test_files_that_are_no_table_are_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "led.npz"
    named = {name: good()[name] for name in ("x_mm", "y_mm")}
    contents = np.array(["a"]), np.array([{}], dtype=object)
    for arrays, message in (
        (None, "no such file"),
        (named, "no array 'c_deg'"),
        *((good(radiance=content), "not readable as a NumPy archive") for content in contents),
        (good(gamma_deg=np.array([0.0, 120.0])), r"led\.npz: gamma_deg = 0 to 120: within 0 to 90"),
        (good(radiance=np.zeros((2, 1, 1, 2))), "its flux is 0 W: radiances must not be all dark"),
        (good(radiance=np.full((2, 1, 1, 2), 9e19)), "W: radiances must not be all dark, or huge"),
    ):
        if arrays is not None:
            np.savez(path, **arrays)
        with pytest.raises(InputError, match=message) as caught:
            read_radiance(path)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("bound_w", "inside"), [(1e-30, 1.01), (1e12, 0.99)])
def test_a_flux_is_read_on_one_side_of_its_bound_and_refused_on_the_other(
    tmp_path: Path, bound_w: float, inside: float
) -> None:
    arrays = good()
    scale = bound_w / RadianceTable(**arrays).flux()
    for factor in (inside, 1.0 / inside):
        np.savez(tmp_path / "led.npz", **{**arrays, "radiance": factor * scale * arrays["radiance"]})
        if factor == inside:
            assert read_radiance(tmp_path / "led.npz").flux() == pytest.approx(factor * bound_w)
        else:
            with pytest.raises(InputError, match="W: radiances must not be all dark, or huge"):
                read_radiance(tmp_path / "led.npz")


def _table_file(folder, x_mm, gamma_deg):
    size, count = len(x_mm) - 1, len(gamma_deg)
    table = {"x_mm": x_mm, "y_mm": x_mm, "c_deg": [0.0], "gamma_deg": gamma_deg}
    np.savez(folder / "led.npz", **table, radiance=np.full((size, size, 1, count), 1e5))
    return folder / "led.npz"


@pytest.mark.parametrize(
    ("width_mm", "last_deg", "told"),
    [(1.0, 90.0, ""),
     (1.0, 1.5708, "gamma_deg ends at 1.5708 degrees, with 100 % of the largest radiance: in radians?"),
     (1.0, 60.0, "gamma_deg ends at 60 degrees, with 100 % of the largest radiance"), (0.021, 90.0, ""),
     (0.001, 90.0, "y_mm is 0.001 mm wide, LEDs are 0.02 to 500 mm wide: in metres?"),
     (1000.0, 90.0, "x_mm is 1000 mm wide, LEDs are 0.02 to 500 mm wide: in micrometres?")],
)  # fmt: skip
def test_units_that_a_table_cannot_have_are_told(width_mm, last_deg, told, tmp_path):
    path = _table_file(tmp_path, [-0.5 * width_mm, 0.5 * width_mm], [0.0, 0.5 * last_deg, last_deg])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        read_radiance(path)
    text = " ".join(str(warning.message) for warning in caught)
    assert (told in text) if told else not text
