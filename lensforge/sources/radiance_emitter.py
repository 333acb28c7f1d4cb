"""An emitter whose radiance depends on position and direction together: near-field data of a real LED.

The radiance R(x, y, C, gamma) in the plane z = 0 is a table, and its flux is known in closed form. A surface element
emits ``R cos(gamma) dA dOmega``, and ``cos(gamma) dOmega = dC d(sin^2 gamma) / 2``. So the table is taken as constant
in each cell of (x, y) and bilinear in (C, sin^2 gamma): every flux is then a trapezoid, its inverse the root of a
quadratic, and nothing is approximated but the radiance between the table's nodes.

A file is a NumPy archive (`.npz`) of five arrays, named and shaped as in :class:`RadianceTable`.
"""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from lensforge.errors import FileWarning, InputError, refused, remedy
from lensforge.kernels.parallel import in_pieces
from lensforge.results.files import read_file
from lensforge.results.json_npz import arrays_in
from lensforge.results.table_names import QUARTER_TURN_RAD
from lensforge.seeds import sobol
from lensforge.sources.ray_bundle import RayBundle, aimed
from lensforge.sources.source_flux import emitter_flux
from lensforge.spec.source_sections import RadianceSource
from lensforge.surfaces.mirror_group import largest_symmetry

_M2_PER_MM2 = 1e-6
_SAME = 1e-6  # of the largest radiance, and of the width: what differs less is symmetric
_NAMES = ("x_mm", "y_mm", "c_deg", "gamma_deg", "radiance")
# The range of a source's flux in a spec.
_LEAST_W = 1e-30
_MOST_W = 1e12
_BRIGHTEST = 1e20  # W/m^2/sr; lasers reach 1e16
_MOST_NODES = 4096  # of an axis: 0.1 degrees in azimuth are 3601
_FARTHEST = 1e9  # mm, as of any coordinate in a spec
_NEARLY_FLAT_DEG = 89.0
_CUT_SHARE = 0.01
_NARROWEST_MM = 0.02
_WIDEST_MM = 500.0
_LARGEST = 2**28  # bytes unpacked, some 30 million nodes; a small archive may claim anything


@dataclass(frozen=True, eq=False)
class RadianceTable:
    """Table of ``radiance`` (W/m^2/sr) by cell between the edges ``y_mm`` and ``x_mm``, azimuth, and polar angle.

    ``c_deg`` runs from 0 to 360, both included, or is the single number 0 for light of revolution about each point's
    own normal. There is no light beyond the first and last gamma.
    """

    x_mm: Float[np.ndarray, " x1"]
    y_mm: Float[np.ndarray, " y1"]
    c_deg: Float[np.ndarray, " c"]
    gamma_deg: Float[np.ndarray, " g"]
    radiance: Float[np.ndarray, "y x c g"]

    @cached_property
    def squares(self) -> Float[np.ndarray, " g"]:
        """Squared sines of gamma at the nodes, never falling."""
        return np.asarray(np.sin(np.deg2rad(self.gamma_deg)) ** 2)

    @cached_property
    def cumulative(self) -> Float[np.ndarray, "y x c g"]:
        """Integral of ``R cos sin`` up to each gamma: W/m^2 per radian of azimuth."""
        cells = 0.25 * (self.radiance[..., 1:] + self.radiance[..., :-1]) * np.diff(self.squares)
        start = np.zeros((*self.radiance.shape[:3], 1))
        return np.concatenate([start, np.cumsum(cells, axis=3)], axis=3)

    @cached_property
    def sectors(self) -> Float[np.ndarray, "y x s"]:
        """Radiant exitance (W/m^2) of each cell into each sector of azimuth."""
        planes = self.cumulative[..., -1]
        if len(self.c_deg) == 1:
            return 2.0 * np.pi * planes
        return np.asarray(0.5 * (planes[..., 1:] + planes[..., :-1]) * np.diff(np.deg2rad(self.c_deg)))

    @cached_property
    def cell_fluxes(self) -> Float[np.ndarray, "y x"]:
        """Flux (W) of each cell."""
        areas = np.diff(self.y_mm)[:, None] * np.diff(self.x_mm) * _M2_PER_MM2
        return np.asarray(self.sectors.sum(axis=2) * areas)

    def flux(self) -> float:
        """Integral over area and projected solid angle (W), exact for the interpolation."""
        return float(self.cell_fluxes.sum())

    @property
    def symmetry(self) -> str:
        """Largest mirror group found by comparing the table with its mirror images."""
        return largest_symmetry(self._unchanged)

    def intensity(self, origins: Float[np.ndarray, "n 3"], along: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Share (1/sr) of the flux from points (mm) of lit cells into unit directions."""
        cells = tuple(
            np.clip(np.searchsorted(edges, origins[:, axis], side="right") - 1, 0, len(edges) - 2)
            for axis, edges in ((1, self.y_mm), (0, self.x_mm))
        )
        azimuth = np.rad2deg(np.arctan2(along[:, 1], along[:, 0])) % 360.0
        squared = np.sum(along[:, :2] ** 2, axis=1)
        radiance = np.zeros(len(along))
        for plane, by_turn in _beside(azimuth, self.c_deg):
            for node, by_rise in _beside(squared, self.squares):
                radiance += by_turn * by_rise * self.radiance[(*cells, plane, node)]
        lit = (along[:, 2] > 0.0) & (squared >= self.squares[0]) & (squared <= self.squares[-1])
        of_cell = self.sectors.sum(axis=2)[cells]  # 0 of a dark one at whose edge a ray starts
        return np.asarray(lit * radiance * along[:, 2] / np.where(of_cell > 0.0, of_cell, np.inf))

    def _unchanged(self, mirror: Float[np.ndarray, "3 3"]) -> bool:
        """True if the mirror image has the same edges, and the same radiance in each cell and direction."""
        swapped = mirror[0, 0] == 0.0
        signs = mirror.sum(axis=1).astype(int)
        edges = (self.y_mm, self.x_mm) if swapped else (self.x_mm, self.y_mm)
        width = float(np.ptp(self.x_mm) + np.ptp(self.y_mm))
        for nodes, image, sign in zip((self.x_mm, self.y_mm), edges, signs[:2], strict=True):
            if len(nodes) != len(image) or np.abs(nodes - sign * image[::sign]).max() > _SAME * width:
                return False
        by_x = np.swapaxes(self._turned(mirror), 0, 1)
        by_x = (np.swapaxes(by_x, 0, 1) if swapped else by_x)[:: signs[0], :: signs[1]]
        return bool(np.abs(np.swapaxes(by_x, 0, 1) - self.radiance).max() <= _SAME * self.radiance.max())

    def _turned(self, mirror: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "y x c g"]:
        """Radiance at the nodes' mirror images."""
        if len(self.c_deg) == 1:
            return self.radiance
        angle = np.deg2rad(self.c_deg)
        before = np.stack([np.cos(angle), np.sin(angle)], axis=1) @ mirror[:2, :2]
        degrees = np.rad2deg(np.arctan2(before[:, 1], before[:, 0])) % 360.0
        place = np.interp(degrees, self.c_deg, np.arange(len(self.c_deg)))
        low = np.minimum(place.astype(int), len(self.c_deg) - 2)
        return np.asarray(
            self.radiance[:, :, low]
            + (place - low)[:, None] * (self.radiance[:, :, low + 1] - self.radiance[:, :, low])
        )


def _beside(
    values: Float[np.ndarray, " n"], nodes: Float[np.ndarray, " k"]
) -> Iterator[tuple[Int[np.ndarray, " n"], Float[np.ndarray, " n"]]]:
    """The two nodes beside each value, and their weights in linear interpolation; beyond an end that end alone."""
    place = np.interp(values, nodes, np.arange(len(nodes)))
    low = place.astype(np.int64)
    yield low, 1.0 - (place - low)
    yield np.minimum(low + 1, len(nodes) - 1), place - low


def read_radiance(path: Path) -> RadianceTable:
    """Read ``path``. Raises :class:`InputError`, one line, if it is missing, damaged, or not a radiance table."""
    arrays = _arrays(path)
    problem = _problem(arrays)
    if problem:
        raise InputError(f"{path}: {problem}")
    table = RadianceTable(**arrays)
    if not _LEAST_W < table.flux() < _MOST_W:
        raise InputError(f"{path}: its flux is {table.flux():g} W: radiances must not be all dark, or huge")
    for doubt in _doubts(table):
        warnings.warn(f"{path}: {doubt}", FileWarning, stacklevel=1)
    return table


def _doubts(table: RadianceTable) -> Iterator[str]:
    """Warnings on light at the last gamma, and on sizes that no LED has: their units may differ."""
    last = float(table.gamma_deg[-1])
    at_last = float(table.radiance[..., -1].max() / table.radiance.max())
    if last < _NEARLY_FLAT_DEG and at_last > _CUT_SHARE:
        unit = ": in radians?" if last < QUARTER_TURN_RAD else ""
        yield f"gamma_deg ends at {last:g} degrees, with {100.0 * at_last:.3g} % of the largest radiance{unit}"
    for name, edges in (("x_mm", table.x_mm), ("y_mm", table.y_mm)):
        width = float(edges[-1] - edges[0])
        if not _NARROWEST_MM <= width <= _WIDEST_MM:
            limits = f"LEDs are {_NARROWEST_MM:g} to {_WIDEST_MM:g} mm wide"
            yield f"{name} is {width:g} mm wide, {limits}: in {'metres' if width < _NARROWEST_MM else 'micrometres'}?"


def _arrays(path: Path) -> dict[str, np.ndarray]:
    content = read_file(path, missing="give a NumPy archive of a radiance table", most_bytes=_LARGEST)
    with refused(path, "not readable as a NumPy archive (…)", ValueError):
        arrays = arrays_in(content, _NAMES, _LARGEST)
    missing = [name for name in _NAMES if name not in arrays]
    if missing:
        raise InputError(f"{path}: no array {missing[0]!r}; it needs {', '.join(_NAMES)}")
    return {name: arrays[name].astype(np.float64) for name in _NAMES}


def _problem(arrays: dict[str, np.ndarray]) -> str:
    """Reason why the arrays are no radiance table; "" if they are one."""
    return (
        _problem_of_nodes(arrays)
        or _problem_of_angles(arrays["c_deg"], arrays["gamma_deg"])
        or _problem_of_cells(arrays)
    )


def _problem_of_nodes(arrays: dict[str, np.ndarray]) -> str:
    for name, values in list(arrays.items())[:4]:
        revolution = name == "c_deg" and values.shape == (1,)
        if values.ndim != 1 or not np.isfinite(values).all() or (len(values) < 2 and not revolution):
            return f"{name} must be a list of two finite numbers or more"
        if not (np.diff(values) > 0.0).all():
            return f"{name} must rise from each number to the next"
    for name, values in list(arrays.items())[:4]:
        if len(values) > _MOST_NODES or np.abs(values).max() > _FARTHEST:
            return f"{name} has {len(values)} numbers up to {np.abs(values).max():g}: {_MOST_NODES} up to {_FARTHEST:g}"
    return ""


def _problem_of_angles(c: Float[np.ndarray, " c"], gamma: Float[np.ndarray, " g"]) -> str:
    if gamma[0] < 0.0 or gamma[-1] > 90.0:
        return f"gamma_deg = {gamma[0]:g} to {gamma[-1]:g}: within 0 to 90"
    if c[0] != 0.0 or (len(c) > 1 and c[-1] != 360.0):
        return "c_deg must run from 0 to 360, both included, or be the single number 0"
    return ""


def _problem_of_cells(arrays: dict[str, np.ndarray]) -> str:
    x, y, c, gamma, radiance = arrays.values()
    wanted = (len(y) - 1, len(x) - 1, len(c), len(gamma))
    if radiance.shape != wanted:
        return f"radiance has the shape {radiance.shape}; cells in y and x, azimuths, polar angles make {wanted}"
    if not 0.0 <= radiance.min() <= radiance.max() < _BRIGHTEST:
        return f"radiances must be finite, none below 0, and below {_BRIGHTEST:g} W/m^2/sr"
    if not np.array_equal(radiance[:, :, 0], radiance[:, :, -1]):
        return "the radiances at c_deg = 360 must be those at 0"
    return ""


@dataclass(frozen=True, eq=False)
class RadianceEmitter:
    """Rays of equal flux, their density in position and direction in proportion to ``table``; total flux ``flux_w``."""

    table: RadianceTable
    flux_w: float
    ray_count: int | None = None

    @cached_property
    def symmetry(self) -> str:
        """Symmetry of the table."""
        return self.table.symmetry

    def sample(self, count: int, seed: int) -> RayBundle:
        """Draw ``count`` rays of equal flux by quasi-Monte-Carlo points in four dimensions."""
        return RayBundle(*self.emit(sobol(count, 4, seed)), np.full(count, self.flux_w / count))

    def towards(self, targets: Float[np.ndarray, "n 3"], seed: int) -> RayBundle:
        """The rays of ``sample(len(targets), seed)``, each turned to its target (mm); their flux is W/sr there."""
        rays = self.sample(len(targets), seed)
        return aimed(rays, targets, lambda along: self.table.intensity(rays.origins, along))

    def emit(self, points: Float[np.ndarray, "n 4"]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Map points of the unit cube to start points (mm) and unit directions; equal volumes get equal flux."""
        from lensforge.kernels.radiance_rays import RadianceSums, emit  # compiled code is loaded where rays are drawn

        sums = RadianceSums(*self._sums)
        origins = np.empty((len(points), 3))
        directions = np.empty((len(points), 3))
        in_pieces(lambda part: emit(points[part], sums, origins[part], directions[part]), len(points), worth=4096)
        return origins, directions

    def outline(self) -> Float[np.ndarray, "4 3"]:
        """Rectangle (mm) around the cells that emit."""
        rows, columns = np.nonzero(self.table.cell_fluxes)
        left = self.table.x_mm[columns.min()]
        right = self.table.x_mm[columns.max() + 1]
        bottom = self.table.y_mm[rows.min()]
        top = self.table.y_mm[rows.max() + 1]
        return np.array([[left, bottom, 0.0], [right, bottom, 0.0], [right, top, 0.0], [left, top, 0.0]])

    @cached_property
    def _sums(self) -> tuple[np.ndarray, ...]:
        table = self.table
        rows = np.cumsum(table.cell_fluxes.sum(axis=1))
        columns = np.pad(np.cumsum(table.cell_fluxes, axis=1), ((0, 0), (1, 0)))
        azimuths = np.pad(np.cumsum(table.sectors, axis=2), ((0, 0), (0, 0), (1, 0)))
        axes = (table.x_mm, table.y_mm, np.deg2rad(table.c_deg), table.squares)
        arrays = (*axes, table.radiance, np.pad(rows, (1, 0)), columns, azimuths, table.cumulative)
        return tuple(map(np.ascontiguousarray, arrays))


def radiance_emitter(spec: RadianceSource) -> RadianceEmitter:
    """Build the emitter that ``spec`` describes, in the plane z = 0, of the table's flux unless ``spec`` has one.

    Raises :class:`InputError` for a file that cannot be used.
    """
    with remedy("correct source.file"):
        table = read_radiance(spec.file)
    return RadianceEmitter(table, emitter_flux(spec, table.flux()).flux_w)
