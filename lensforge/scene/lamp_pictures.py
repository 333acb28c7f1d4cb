"""Light of equal lamps on one receiver, made of pictures of one lamp that are moved and added.

A lamp at its place lights a receiver as one at the origin lights the receiver as it is seen from there. On a plane
above the lamps these views differ by a move alone. Where that is whole pixels, all are parts of one picture of one lamp
on a wider plane: rays are deposited once, however many the lamps. Elsewhere, and where lamps have heights and aims,
each view has a picture of its own. In the far field only the turns and aims differ. The light of an infinite
end is that of one lamp, each landing moved by whole periods into one: nothing is left out.

A sum is linear, and its adjoint moves the sensitivities back.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product

import numpy as np
from jaxtyping import Bool, Float

from lensforge.errors import InputError
from lensforge.optics.arrays import Array, module_of
from lensforge.optics.pose import ORIGIN, Pose
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.pixel_grid import PixelGrid, Window
from lensforge.scene.receiver import Landings, PosedReceiver
from lensforge.scene.receiver_shapes import WHOLE, Plane
from lensforge.spec.lamps_section import ALONE, Lamps

_MOST_PIXELS = 2**22  # of a picture, of which an evaluation keeps sixteen: half a gigabyte
_CELLS = 4  # periods on each side by which amounts on a lattice's pixels are summed
_Image = Float[np.ndarray, "_ _"]
_Images = Float[np.ndarray, "..."]  # of replicates, or one


@dataclass(frozen=True)
class PeriodPlane(Plane):
    """A plane on which each landing is moved by whole periods of a lattice into one; those around take the splat."""

    def _land(self, rays: ExitRays) -> Landings:
        return self._within(super()._land(rays))

    def _land_by_arrays(self, rays: ExitRays) -> Landings:
        return self._within(super()._land_by_arrays(rays))

    def _within(self, landings: Landings) -> Landings:
        period = self.lamps.period_mm
        assert period is not None
        hits = [
            landings.hits[:, k] - side * module_of(landings.hits).round(landings.hits[:, k] / side)
            for k, side in enumerate(period)
        ]
        return replace(landings, hits=module_of(landings.hits).stack(hits, 1))


@dataclass(frozen=True)
class Raster:
    """Pixels on which the light of one lamp is deposited: the ``receiver`` as ``lamps`` equal lamps see it.

    ``corners``: row and column at which the receiver of each of them begins; it may reach beyond the raster.
    ``numbers``: of the lamp of each corner.
    """

    receiver: PosedReceiver
    lamps: int
    corners: tuple[tuple[int, int], ...] = ((0, 0),)
    numbers: tuple[int, ...] = (0,)

    def overlaps(self, shape: tuple[int, int]) -> Iterator[tuple[tuple[slice, slice], tuple[slice, slice]]]:
        """Rows and columns of the raster, and of the receiver of ``shape``, that are the same, for each corner."""
        for corner in self.corners:
            there = []
            here = []
            for start, side, size in zip(corner, self.receiver.grid.shape, shape, strict=True):
                first = max(start, 0)
                last = min(start + size, side)
                there.append(slice(first, last))
                here.append(slice(first - start, last - start))
            yield (there[0], there[1]), (here[0], here[1])


@dataclass(frozen=True)
class LampPictures:
    """The rasters of one receiver, in a fixed order; pictures of one lamp on them make that of all on the receiver."""

    receiver: PosedReceiver
    rasters: tuple[Raster, ...]

    @staticmethod
    def of(receiver: PosedReceiver) -> "LampPictures":
        """Make as few rasters as will do. Raises :class:`InputError` where one of them would have too many pixels."""
        return _pictures(receiver)

    @property
    def receivers(self) -> list[PosedReceiver]:
        """The receivers on which one lamp's rays are deposited."""
        return [raster.receiver for raster in self.rasters]

    @property
    def is_single(self) -> bool:
        """True for one lamp at the origin: its picture is the whole."""
        return self.receiver.lamps.is_single

    @property
    def widened(self) -> bool:
        """True where a picture reaches beyond the receiver, whose flux is then known by pixel alone."""
        return any(raster.receiver.grid != self.receiver.grid for raster in self.rasters)

    def added(self, pictures: Sequence[_Images], fluxes: Float[np.ndarray, " n"] | None = None) -> _Images:
        """Mean flux of a lamp on the receiver's pixels, from that of one on each raster's.

        ``fluxes``: of the lamps, relative to that of the pictures; all are 1 where it is None.
        """
        if self.is_single:
            return pictures[0] if fluxes is None else float(fluxes[0]) * pictures[0]
        shape = self.receiver.grid.shape
        weights = np.ones(len(self.receiver.lamps)) if fluxes is None else fluxes
        total = np.zeros((*pictures[0].shape[:-2], *shape))
        for raster, picture in zip(self.rasters, pictures, strict=True):
            for (there, here), number in zip(raster.overlaps(shape), raster.numbers, strict=True):
                total[(..., *here)] += weights[number] * picture[(..., *there)]
        return total / len(self.receiver.lamps)

    def spread(self, by_picture: _Image) -> list[_Image]:
        """Sensitivities to the pictures of one lamp from those to :meth:`added`: its adjoint."""
        shape = self.receiver.grid.shape
        pictures = []
        for raster in self.rasters:
            by_raster = np.zeros(raster.receiver.grid.shape)
            for there, here in raster.overlaps(shape):
                by_raster[there] += by_picture[here]
            pictures.append(by_raster / len(self.receiver.lamps))
        return pictures

    def mean(self, amounts: Sequence[Array]) -> Array:
        """Mean over the lamps of an amount that belongs to each raster."""
        weights = [raster.lamps / len(self.receiver.lamps) for raster in self.rasters]
        return sum(weight * amount for weight, amount in zip(weights, amounts, strict=True))

    def summed(self, amounts: Callable[[PosedReceiver], _Images], whole: Float[np.ndarray, " k"]) -> _Images:
        """Amounts on each pixel as a lamp sees it, the mean of all, by those on the pixels of any receiver.

        Of a lattice that of all its periods. Those farther than a few are spread over the pixels evenly: all together
        are the ``whole``, on an endless plane.
        """
        period = self.receiver.lamps.period_mm
        count = len(self.receiver.lamps)
        if period is None:
            return self.added([amounts(receiver) for receiver in self.receivers])
        around = np.arange(-_CELLS, _CELLS + 1)
        pose = self.receiver.pose
        total = np.zeros((len(whole), *self.receiver.grid.shape))
        for (x, y), i, j in product(self.receiver.lamps.places_mm, around.tolist(), around.tolist()):
            place = x - i * period[0], y - j * period[1], 0.0
            total += amounts(replace(self.receiver, pose=pose.seen_from(Pose(place)))) / count
        rest = np.maximum(whole - total.sum(axis=(1, 2)), 0.0)
        return np.asarray(total + rest[:, None, None] / total[0].size)

    def regions(self, pixels: Bool[np.ndarray, "_ _"]) -> list[Bool[np.ndarray, "_ _"]]:
        """Pixels of each raster that are one of ``pixels`` for one of its lamps at least."""
        return [pixels] if self.is_single else [picture > 0.0 for picture in self.spread(pixels.astype(np.float64))]


@lru_cache(maxsize=32)
def _pictures(receiver: PosedReceiver) -> LampPictures:
    lamps = receiver.lamps
    rasters = list[Raster]()
    if lamps.is_single:
        return LampPictures(receiver, (Raster(receiver, 1),))
    moves = np.array(lamps.places_mm) @ receiver.pose.rotation[:2, :2] / receiver.grid.pixel
    alike = receiver.housing is None  # no two lamps see the bodies of a scene at one place
    level = alike and receiver.is_flat and not any(receiver.pose.axis[:2]) and not lamps.posed
    for members in _alike(receiver, moves, level):
        if lamps.period_mm is not None:
            rasters.append(_period(receiver, members[0]))
        elif level:
            rasters.append(_wider(receiver, members, moves[members]))
        else:
            seen = receiver.seen_by_lamp(lamps.lamps[members[0]].pose)
            rasters.append(Raster(seen, len(members), ((0, 0),) * len(members), tuple(members)))
    return LampPictures(receiver, tuple(rasters))


def _alike(receiver: PosedReceiver, moves: Float[np.ndarray, "n 2"], level: bool) -> list[list[int]]:
    """Numbers of lamps whose views of the receiver differ by whole pixels, or not at all, together."""
    lamps = receiver.lamps
    groups = dict[object, list[int]]()
    for number, turn in enumerate(lamps.turns_deg):
        key: object = number
        if receiver.is_far and receiver.housing is None:
            key = round(turn % 360.0, 9), *(round(along, 12) for along in lamps.lamps[number].axis)
        elif level and lamps.period_mm is None:
            parts = np.round((moves[number] - np.round(moves[number])) / WHOLE).astype(int)
            key = (round(turn % 360.0, 9), *(parts % round(1.0 / WHOLE)).tolist())
        groups.setdefault(key, []).append(number)
    return list(groups.values())


def _wider(receiver: PosedReceiver, members: list[int], moves: Float[np.ndarray, "k 2"]) -> Raster:
    """The plane so wide that it holds the receiver as each of the lamps ``members`` sees it; ``moves`` in pixels."""
    low = moves.min(axis=0)
    high = moves.max(axis=0)
    grid = receiver.grid
    pixel = np.array(receiver.grid.pixel)
    columns, rows = np.round(high - low + [grid.columns, grid.rows]).astype(int).tolist()
    if columns * rows > _MOST_PIXELS:
        raise InputError(
            f"lamps: the picture of one lamp that holds those of all would have {columns} x {rows} pixels, at most "
            f'{_MOST_PIXELS}; take fewer pixels (evaluate.pixels, optimise.pixels), fewer lamps, or kind = "endless"'
        )
    x, y = (-0.5 * (high + low) * pixel).tolist()
    turned = receiver.lamps.lamps[members[0]]._replace(place_mm=ORIGIN)
    pose = receiver.pose.after(Pose((x, y, 0.0))).seen_from(turned.pose)
    wide = PixelGrid(columns * float(pixel[0]), rows * float(pixel[1]), columns, rows)
    corners = np.round(high - moves).astype(int)
    return Raster(
        replace(receiver, pose=pose, grid=wide, lamps=ALONE),
        len(members),
        tuple((row, column) for column, row in corners.tolist()),
        tuple(members),
    )


def _period(receiver: PosedReceiver, number: int) -> Raster:
    """One period as lamp ``number`` of it sees it, and a pixel around it for the splat of rays near its edge."""
    grid = receiver.grid
    (width, height) = receiver.grid.pixel
    pose = receiver.pose.seen_from(receiver.lamps.lamps[number]._replace(turn_deg=0.0).pose)
    rows, columns = grid.shape
    around = PixelGrid(grid.width + 2.0 * width, grid.height + 2.0 * height, columns + 2, rows + 2)
    corners = tuple((1 + i * rows, 1 + j * columns) for i in (-1, 0, 1) for j in (-1, 0, 1))
    return Raster(PeriodPlane(pose, around, Window(), receiver.lamps), 1, corners, (number,) * len(corners))


def patch_pictures(receiver: PosedReceiver, columns: int, rows: int) -> LampPictures:
    """The rasters of a patch of a lattice, ``columns`` x ``rows`` periods, repeated without end.

    ``receiver``: one period. Its lamps stand in each of them, those of one period after those of the one on its left.
    """
    (across, up) = receiver.lamps.period_mm or (0.0, 0.0)
    (height, width) = receiver.grid.shape
    cells = [(i, j) for j in range(rows) for i in range(columns)]
    first = np.array([-0.5 * (columns - 1) * across, -0.5 * (rows - 1) * up])
    kind = len(receiver.lamps)
    starts = [tuple((first + place).tolist()) for place in receiver.lamps.places_mm]
    places = tuple((x + i * across, y + j * up) for i, j in cells for x, y in starts)
    lamps = Lamps.level(places, receiver.lamps.turns_deg * len(cells), (columns * across, rows * up))
    grid = PixelGrid(columns * receiver.grid.width, rows * receiver.grid.height, columns * width, rows * height)
    turns = [(i, j, a, b) for i, j in cells for a in (0, rows) for b in (0, columns)]
    corners = tuple(((a - j) * height, (b - i) * width) for i, j, a, b in turns)
    rasters = tuple(
        Raster(
            PeriodPlane(receiver.pose.seen_from(Pose((x, y, 0.0))), grid, Window(), lamps),
            len(cells),
            corners,
            tuple(number + kind * (i + columns * j) for i, j, _, _ in turns),
        )
        for number, (x, y) in enumerate(starts)
    )
    return LampPictures(replace(receiver, grid=grid, window=Window(), lamps=lamps), rasters)


def seen_by(receiver: PosedReceiver, number: int) -> PosedReceiver:
    """The receiver as one of its lamps sees it, in whose frame rays start from the origin."""
    lamps = receiver.lamps
    lamp = lamps.lamps[number].pose
    if lamps.period_mm is not None:
        return PeriodPlane(receiver.pose.seen_from(lamp), receiver.grid, Window(), lamps)
    return receiver.seen_by_lamp(lamp)
