"""Measured bodies of a ``[[scene]]`` as receivers: light on their surface, on all sides.

A ray counts where it meets the body first, from outside: what the body itself or others shade is dark. An evaluation
counts it by patches. A search, whose gradient moves hits, sees the surface from the lens instead, on the equal-area
chart of directions: neighbours there are neighbours on the body, but at its rims.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse

from lensforge.errors import InputError
from lensforge.kernels.parallel import in_pieces
from lensforge.kernels.triangle_tree import first_hits
from lensforge.optics.arrays import Array, as_numpy, lengths, like, module_of
from lensforge.optics.pose import Pose
from lensforge.scene.body_patches import BodyPatches
from lensforge.scene.housing import Housing
from lensforge.scene.pixel_grid import PixelGrid, smoothing, splat_flux
from lensforge.scene.receiver import Landings, PosedReceiver, equal_area, from_equal_area
from lensforge.spec import Spec
from lensforge.spec.housing_sections import HousingSection
from lensforge.spec.light_limits import BodyLimit

_WORTH_SHARING = 2**10  # rays: a millisecond of work
_AROUND = 1.05  # of a picture over the body in it
_OF_PATCH = 0.3  # width of a pixel over that of a patch: what is read is a mean over three
_FEWEST = 8  # pixels along the longer side of a picture
_OVERSAMPLING = 8  # sub-pixels along a side, by which the area in a pixel is measured
_FLATTEST = 0.05  # cosine of arrival: a surface that is seen more edge on is left out
_LEAST_OF_PIXEL = 0.5  # of a pixel that the body must fill
_M2 = 1e-6  # in a mm2


@dataclass(frozen=True)
class LitBody(PosedReceiver):
    """The surface of the body ``name`` in ``patches``, in its pose; ``housing``: of the other bodies."""

    name: str = field(kw_only=True)
    patches: BodyPatches = field(kw_only=True)

    @property
    def centres_mm(self) -> Float[np.ndarray, "p 3"]:
        """Middles of the patches in the coordinates of the scene."""
        return self.pose.points(self.patches.centres_mm)

    def counted(self, limit: BodyLimit) -> Int[np.ndarray, " k"]:
        """Numbers of the patches that ``limit`` counts. Raises :class:`InputError` for none."""
        counted = np.flatnonzero(limit.counts(self.pose.directions(self.patches.normals)))
        if not len(counted):
            raise InputError(
                f"limits: no patch of {self.name!r} faces {limit.facing} within {limit.within_deg:g} deg; widen "
                "within_deg, or turn facing"
            )
        return counted

    def shows(self, number: int, limit: BodyLimit) -> bool:
        """True if it reads this ``limit``, which has that ``number``."""
        return limit.body == self.name

    def readings(self, limit: BodyLimit) -> sparse.csr_array:
        """Matrix from the flux (W) on each pixel, the mean of a lamp, to the light (W/m²) that ``limit`` bounds."""
        raise NotImplementedError

    def met(
        self, points: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, " n"], Int[np.ndarray, " n"]]:
        """Distance (mm) along rays to the body, in its coordinates, and the piece there; infinite and -1 for none."""
        starts = np.ascontiguousarray(points)
        units = np.ascontiguousarray(directions)
        distances = np.empty(len(points))
        pieces = np.empty(len(points), dtype=np.int64)

        def work(part: slice) -> None:
            first_hits(starts[part], units[part], self.patches.tree, distances[part], pieces[part])

        in_pieces(work, len(points), worth=_WORTH_SHARING)
        return distances, pieces

    def _reach_mm(
        self, points: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"], landings: Landings
    ) -> Float[np.ndarray, " n"]:
        distances, _ = self.met(self.pose.to_local_points(points), self.pose.to_local_directions(directions))
        return distances


@dataclass(frozen=True)
class BodyView(LitBody):
    """The body as an evaluation sees it: patch k is pixel k of a picture of one row."""

    @staticmethod
    def of(section: HousingSection) -> "BodyView":
        """The body alone."""
        patches = BodyPatches.of(section)
        grid = PixelGrid(float(len(patches)), 1.0, len(patches), 1)
        return BodyView(section.pose, grid, name=section.name, patches=patches)

    def readings(self, limit: BodyLimit) -> sparse.csr_array:
        """Matrix from flux to light of each patch that counts, or to the mean over all of them."""
        counted = self.counted(limit)
        areas_m2 = _M2 * self.patches.areas_mm2[counted]
        rows = np.arange(len(counted))
        if limit.of == "mean":
            areas_m2 = np.full(len(counted), areas_m2.sum())
            rows = np.zeros_like(counted)
        shape = (rows[-1] + 1, len(self.patches))
        return sparse.csr_array((len(self.lamps) / areas_m2, (rows, counted)), shape=shape)

    def _reached(self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Bool[Array, " n"]:
        _, pieces = self.met(points, directions)
        return np.asarray(pieces >= 0)

    def _chart(self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Float[Array, "n 2"]:
        _, pieces = self.met(points, directions)
        across = self.patches.numbers[pieces] + 0.5 * (1 - len(self.patches))
        return np.stack([across, np.zeros_like(across)], axis=1)

    def _local(self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 3"]:
        patch = np.round(x - 0.5 * (1 - len(self.patches))).astype(np.int64)
        return np.asarray(self.patches.centres_mm[patch])


@dataclass(frozen=True)
class BodyPicture(LitBody):
    """The body as a lens at the origin sees it, for the limit of this ``number``: places are directions from there.

    ``towards``: the frame of the chart. ``pieces``: numbers of those whose patches the limit counts.
    """

    number: int = field(kw_only=True)
    towards: Pose = field(kw_only=True)
    pieces: frozenset[int] = field(kw_only=True)

    @staticmethod
    def of(view: BodyView, number: int, limit: BodyLimit, width_mm: float, most: int) -> "BodyPicture":
        """The picture for a ``limit`` by patches ``width_mm`` wide, with at most so many pixels along a side."""
        counted = view.counted(limit)
        towards = Pose.facing(tuple(view.centres_mm[counted].mean(axis=0).tolist()))
        pieces = np.flatnonzero(np.isin(view.patches.numbers, counted))
        corners = view.pose.points(view.patches.corners[pieces].reshape(-1, 3))
        away_mm = np.linalg.norm(corners, axis=1, keepdims=True)
        reach = 2.0 * _AROUND * np.abs(equal_area(towards.to_local_directions(corners / away_mm))).max(axis=0)
        pixels = int(np.clip(reach.max() * float(away_mm.mean()) / (_OF_PATCH * width_mm), _FEWEST, most))
        width, height = reach.tolist()
        return BodyPicture(
            view.pose,
            PixelGrid.of(width, height, pixels),
            housing=view.housing,
            name=view.name,
            patches=view.patches,
            number=number,
            towards=towards,
            pieces=frozenset(pieces.tolist()),
        )

    def shows(self, number: int, limit: BodyLimit) -> bool:
        """True for the limit of its number."""
        return number == self.number

    def readings(self, limit: BodyLimit) -> sparse.csr_array:
        """Matrix from flux to the light about each pixel that the body fills, or to the mean of all patches that count.

        The area of the body in a pixel is spread over pixels as light is.
        """
        if limit.of == "mean":
            area_m2 = _M2 * self.patches.areas_mm2[self.counted(limit)].sum()
            return sparse.csr_array(np.full((1, self.grid.rows * self.grid.columns), 1.0 / area_m2))
        fine = self.grid.finer(_OVERSAMPLING)
        x, y = (coordinates.ravel() for coordinates in np.meshgrid(fine.x(), fine.y()))
        start = np.zeros((x.size, 3))
        units = self.towards.directions(from_equal_area(x, y))
        ways = self.pose.to_local_points(start), self.pose.to_local_directions(units)
        distances, pieces = self.met(*ways)
        cosines = -(ways[1] * self.patches.piece_normals[pieces]).sum(axis=1)
        seen = self._counts[pieces] & (cosines > _FLATTEST)
        if self.housing is not None:
            seen &= ~self.housing.shadow(start, units, distances).met
        hits = np.stack([x, y], axis=1)
        pixel_sr = fine.width / fine.columns * (fine.height / fine.rows)
        filled_sr = np.where(seen, pixel_sr, 0.0)
        areas_m2 = _M2 * filled_sr * np.where(seen, distances, 0.0) ** 2 / np.where(seen, cosines, 1.0)
        least_sr = _LEAST_OF_PIXEL * pixel_sr * _OVERSAMPLING**2
        rows = np.flatnonzero(splat_flux(hits, filled_sr, self.grid).ravel() > least_sr)
        matrix = smoothing(self.grid.shape)
        around_m2 = matrix @ splat_flux(hits, areas_m2, self.grid).ravel()
        return sparse.csr_array(sparse.diags_array(1.0 / around_m2[rows]) @ matrix[rows])

    @cached_property
    def _counts(self) -> Bool[np.ndarray, " t"]:
        """True for pieces that count; the last one, which stands for none, does not."""
        counts = np.zeros(len(self.patches.numbers) + 1, dtype=bool)
        counts[list(self.pieces)] = True
        return counts

    def _reached(self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Bool[Array, " n"]:
        _, pieces = self.met(as_numpy(points), as_numpy(directions))
        return module_of(points).asarray(self._counts[pieces])

    def _chart(self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Float[Array, "n 2"]:
        _, pieces = self.met(as_numpy(points), as_numpy(directions))
        normals = like(points, self.patches.piece_normals[pieces])
        first = like(points, self.patches.corners[pieces, 0])
        paths = ((first - points) * normals).sum(1) / (directions * normals).sum(1)
        places = self.pose.points(points + paths[:, None] * directions)
        return equal_area(self.towards.to_local_directions(places / lengths(places)[:, None]))

    def _local(self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 3"]:
        units = self.pose.to_local_directions(self.towards.directions(from_equal_area(x, y)))
        start = self.pose.to_local_points(np.zeros((x.size, 3)))
        distances, _ = self.met(start, units.reshape(-1, 3))
        return np.asarray((start + distances[:, None] * units.reshape(-1, 3)).reshape(units.shape))


def body_views(spec: Spec) -> tuple[BodyView, ...]:
    """The bodies of ``spec`` that have ``patch_mm``, in the light of all lamps, as an evaluation sees them."""
    views = []
    for section in spec.scene:
        if section.patch_mm is not None:
            others = Housing.of([body for body in spec.scene if body is not section])
            views.append(replace(BodyView.of(section), lamps=spec.all_lamps, housing=others))
    return tuple(views)


def body_pictures(spec: Spec) -> tuple[BodyPicture, ...]:
    """Pictures of bodies for a search, one for each limit on them; none of several lamps, which see other sides."""
    if not spec.all_lamps.is_single:
        return ()
    views = {view.name: view for view in body_views(spec)}
    width_mm = {body.name: body.patch_mm for body in spec.scene}
    return tuple(
        BodyPicture.of(views[limit.body], number, limit, width_mm[limit.body] or 0.0, spec.optimise.pixels)
        for number, limit in enumerate(spec.limits)
        if isinstance(limit, BodyLimit)
    )
