"""Rays drawn from plain numbers that describe an emitter, by NumPy's own generator: independent, of equal flux.

The design draws by inverse cumulative distributions and quasi-random points. Here nothing is inverted: points outside a
disc are thrown away, cosines are NumPy's own power law, and tables are drawn by rejection under a bound in each cell.
"""

from collections.abc import Callable
from math import atan2, hypot

import numpy as np
from jaxtyping import Float, Int
from numpy.random import Generator
from scipy.spatial.transform import Rotation

from lensforge.sources.ray_bundle import RayBundle

Points = Float[np.ndarray, "n 2"]
Directions = Float[np.ndarray, "n 3"]
_BATCH = 4096  # drawn at least at a time, of which some are rejected


def in_rectangles(
    random: Generator,
    count: int,
    centres: Float[np.ndarray, "k 2"],
    sides: Float[np.ndarray, "k 2"],
    shares: Float[np.ndarray, " k"],
) -> Points:
    """Points (mm) uniform in rectangles that share the flux by ``shares``."""
    chosen = random.choice(len(shares), count, p=shares / shares.sum())
    return centres[chosen] + random.uniform(-0.5, 0.5, (count, 2)) * sides[chosen]


def in_disc(random: Generator, count: int, radius_mm: float) -> Points:
    """Points (mm) uniform in a disc about the axis, by rejection from its square."""

    def draw(many: int) -> tuple[np.ndarray, np.ndarray]:
        points = random.uniform(-radius_mm, radius_mm, (many, 2))
        return points, (points**2).sum(axis=1) <= radius_mm**2

    return _accepted(count, draw)


def in_picture(random: Generator, count: int, values: Float[np.ndarray, "h w"], width_mm: float) -> Points:
    """Points (mm) in a picture centred on the axis, row 0 at its top, by the flux of its pixels."""
    height, width = values.shape
    chosen = random.choice(values.size, count, p=values.ravel() / values.sum())
    row, column = np.divmod(chosen, width)
    x, y = column - 0.5 * width + random.random(count), 0.5 * height - row - random.random(count)
    return np.stack([x, y], axis=1) * (width_mm / width)


def along_cosine(random: Generator, count: int, power: float) -> Directions:
    """Directions whose intensity is a power of the cosine to +z: the cosines have a power-law density."""
    return _directions(random.power(power + 1.0, count), random.uniform(0.0, 2.0 * np.pi, count))


def along_table(
    random: Generator,
    count: int,
    c_deg: Float[np.ndarray, " c"],
    gamma_deg: Float[np.ndarray, " g"],
    intensity: Float[np.ndarray, "c g"],
) -> Directions:
    """Directions by a table of intensity, bilinear in C and gamma; the single half-plane C = 0: of revolution."""
    turns, values = _whole_turn(c_deg, intensity[None])
    gamma = np.radians(gamma_deg)
    # No sine in a cell is larger than this; of a cell on both sides of 90 degrees it is 1.
    largest = np.sin(np.clip(np.pi / 2.0, gamma[:-1], gamma[1:]))
    highest = _cell_bounds(values) * largest
    bounds = highest * np.diff(turns)[:, None] * np.diff(gamma)

    def draw(many: int) -> tuple[np.ndarray, np.ndarray]:
        (_, low, step), (along, up) = _in_cells(random, many, bounds)
        angle = gamma[step] + up * (gamma[step + 1] - gamma[step])
        azimuth = turns[low] + along * (turns[low + 1] - turns[low])
        height = _blend(values, np.zeros(many, dtype=np.int64), low, step, along, up) * np.sin(angle)
        return _directions(np.cos(angle), azimuth), random.random(many) * highest[0, low, step] < height

    return _accepted(count, draw)


def of_radiance(
    random: Generator,
    count: int,
    edges_mm: tuple[Float[np.ndarray, " x1"], Float[np.ndarray, " y1"]],
    c_deg: Float[np.ndarray, " c"],
    gamma_deg: Float[np.ndarray, " g"],
    radiance: Float[np.ndarray, "y x c g"],
) -> Float[np.ndarray, "n 5"]:
    """Points (x, y in mm) and directions of a radiance, uniform in cells of (x, y), bilinear in C and sin^2 gamma.

    Its flux is ``R / 2 dA dC d(sin^2 gamma)``.
    """
    (x, y) = edges_mm
    rows = len(radiance)
    columns = radiance.shape[1]
    turns, values = _whole_turn(c_deg, radiance.reshape(rows * columns, *radiance.shape[2:]))
    squares = np.sin(np.radians(gamma_deg)) ** 2
    areas = (np.diff(y)[:, None] * np.diff(x)).reshape(-1, 1, 1)
    highest = _cell_bounds(values)
    bounds = highest * areas * np.diff(turns)[:, None] * np.diff(squares)

    def draw(many: int) -> tuple[np.ndarray, np.ndarray]:
        (cell, low, step), (along, up) = _in_cells(random, many, bounds)
        row, column = np.divmod(cell, columns)
        across, down = random.random((2, many))
        cosine = np.sqrt(1.0 - squares[step] - up * (squares[step + 1] - squares[step]))
        towards = _directions(cosine, turns[low] + along * (turns[low + 1] - turns[low]))
        place = [x[column] + across * np.diff(x)[column], y[row] + down * np.diff(y)[row]]
        accepted = random.random(many) * highest[cell, low, step] < _blend(values, cell, low, step, along, up)
        return np.column_stack([*place, towards]), accepted

    return _accepted(count, draw)


def posed(
    points: Float[np.ndarray, "n 3"],
    directions: Directions,
    flux_w: float,
    rotate_z_deg: float,
    tilt_deg: tuple[float, float],
    position_mm: tuple[float, float, float],
) -> RayBundle:
    """Rays of ``flux_w`` in total, turned about z, then about the fixed x and y axes, and shifted."""
    turn = Rotation.from_euler("zxy", [rotate_z_deg, *tilt_deg], degrees=True)  # small letters: about fixed axes
    count = len(points)
    return RayBundle(turn.apply(points) + position_mm, turn.apply(directions), np.full(count, flux_w / count))


def stand(axis: tuple[float, float, float], turn_deg: float) -> Float[np.ndarray, "3 3"]:
    """Axes of a lamp as columns: turned about z, then tilted by the shortest turn, so that z goes along ``axis``."""
    across = hypot(axis[0], axis[1])
    tilt = Rotation.from_euler("y", atan2(across, axis[2]))
    pan = Rotation.from_euler("z", atan2(axis[1], axis[0]) if across > 0.0 else 0.0)
    return (pan * tilt * pan.inv() * Rotation.from_euler("z", turn_deg, True)).as_matrix()


def wavelengths(
    random: Generator, count: int, nodes_nm: Float[np.ndarray, " k"], density: Float[np.ndarray, " k"]
) -> Float[np.ndarray, " n"]:
    """Wavelengths (nm) of a power density that is linear between nodes; a single node is a line.

    A density falling to 0 is that of the smaller of two uniform numbers, one rising from 0 that of the larger.
    """
    if len(nodes_nm) == 1:
        return np.full(count, nodes_nm[0])
    sums = (density[1:] + density[:-1]) * np.diff(nodes_nm)
    cell = random.choice(len(sums), count, p=sums / sums.sum())
    both = np.sort(random.random((2, count)), axis=0)
    falls = random.random(count) * (density[cell] + density[cell + 1]) < density[cell]
    return nodes_nm[cell] + np.where(falls, *both) * np.diff(nodes_nm)[cell]


def _accepted(count: int, draw: Callable[[int], tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    accepted = []
    some = 0
    while some < count:
        rows, is_accepted = draw(max(2 * (count - some), _BATCH))
        accepted.append(rows[is_accepted])
        some += int(is_accepted.sum())
    return np.concatenate(accepted)[:count]


def _whole_turn(
    c_deg: Float[np.ndarray, " c"], values: Float[np.ndarray, "k c g"]
) -> tuple[Float[np.ndarray, " _"], Float[np.ndarray, "k _ g"]]:
    """Half-planes (rad) from 0 to 360 degrees; a single one is both ends."""
    if len(c_deg) > 1:
        return np.radians(c_deg), values
    return np.array([0.0, 2.0 * np.pi]), np.repeat(values, 2, axis=1)


def _cell_bounds(values: Float[np.ndarray, "k c g"]) -> Float[np.ndarray, "k _ _"]:
    """Upper bound in each cell of (C, gamma): the largest of its corners."""
    along = np.maximum(values[:, 1:], values[:, :-1])
    return np.maximum(along[:, :, 1:], along[:, :, :-1])


def _in_cells(
    random: Generator, count: int, bounds: Float[np.ndarray, "k c g"]
) -> tuple[tuple[Int[np.ndarray, " n"], ...], Float[np.ndarray, "2 n"]]:
    """Cells drawn in proportion to their ``bounds``, and positions in them, from 0 to 1 along C and gamma."""
    chosen = random.choice(bounds.size, count, p=bounds.ravel() / bounds.sum())
    return np.unravel_index(chosen, bounds.shape), random.random((2, count))


def _blend(
    values: Float[np.ndarray, "k c g"],
    first: Int[np.ndarray, " n"],
    low: Int[np.ndarray, " n"],
    step: Int[np.ndarray, " n"],
    along: Float[np.ndarray, " n"],
    up: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " n"]:
    """Bilinear interpolation in cells."""
    near, far = (
        (1.0 - up) * values[first, column, step] + up * values[first, column, step + 1] for column in (low, low + 1)
    )
    return (1.0 - along) * near + along * far


def _directions(cosine: Float[np.ndarray, " n"], azimuth: Float[np.ndarray, " n"]) -> Directions:
    sine = np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0))
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=1)
