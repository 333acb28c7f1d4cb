"""Measured bodies of a ``[[scene]]`` as receivers: light on their surface, on all sides.

A ray counts where it meets the body first, from outside: what the body itself or others shade is dark. If it goes on
from there and comes to the body again, by way of others, it counts again. An evaluation counts it by patches. A search,
whose gradient moves hits, sees the surface from the lens instead, on the equal-area chart of directions: neighbours
there are neighbours on the body, but at its rims. A side that the lens does not see, and that has light by way of walls
alone, is seen from before it.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse
from scipy.ndimage import distance_transform_edt

from lensforge.errors import InputError
from lensforge.kernels.parallel import in_pieces
from lensforge.kernels.triangle_tree import first_hits
from lensforge.optics.arrays import Array, as_numpy, lengths, like, module_of
from lensforge.optics.pose import ORIGIN, Pose, Vector
from lensforge.scene.body_patches import BodyPatches
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.housing import Housing
from lensforge.scene.housing_walk import legs_of
from lensforge.scene.pixel_grid import PixelGrid, bilinear
from lensforge.scene.receiver import LandedAgain, Landings, PosedReceiver, equal_area, from_equal_area
from lensforge.spec import Spec
from lensforge.spec.housing_sections import HousingSection, bodies_of
from lensforge.spec.light_limits import BodyLimit

_WORTH_SHARING = 2**10  # rays: a millisecond of work
_AROUND = 1.2  # of a picture over the body in it
_OF_PATCH = 0.3  # width of a pixel over that of a patch
_MOST_OF_SEARCH = 2  # times the pixels of a receiver: bodies are seen long and narrow
_FEWEST = 8  # pixels along the longer side of a picture
_OVERSAMPLING = 8  # sub-pixels along a side, by which the area in a pixel is measured
_IN_PLANE_MM = 1e-6
_STEPS_TO_DEPTH = 3  # of a ray beside a body: the lens is small beside its distance
_BEFORE_SIDE = 3.0  # half diameters of a side, from which an eye sees it
_NEAREST_MM2 = 1e-12  # of a path whose square root has a slope


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

    def lies_in_plane_with_lens(self, limit: BodyLimit) -> bool:
        """True if no light of a lens at the origin comes to a patch that counts, such as a ceiling in which it is."""
        pieces = np.isin(self.patches.numbers, self.counted(limit))
        return bool((np.abs(self._heights_mm(ORIGIN)[pieces]) < _IN_PLANE_MM).all())

    def is_by_walls(self, limit: BodyLimit) -> bool:
        """True if other bodies reflect light, by which alone it comes from the origin to the patches that count."""
        if self.housing is None or not self.housing.finishes.reflectances.any():
            return False
        pieces = np.isin(self.patches.numbers, self.counted(limit))
        return bool((self._heights_mm(ORIGIN)[pieces] < _IN_PLANE_MM).all())

    def _heights_mm(self, eye_mm: Vector) -> Float[np.ndarray, " t"]:
        """Height of a place above each piece; negative behind it."""
        eye = self.pose.to_local_points(np.array([eye_mm]))
        return np.asarray(((eye - self.patches.corners[:, 0]) * self.patches.piece_normals).sum(axis=1))

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
        ends = np.full(len(points), np.inf)

        def work(part: slice) -> None:
            rays = starts[part], units[part], ends[part]
            first_hits(*rays, self.patches.tree, distances[part], pieces[part])

        in_pieces(work, len(points), worth=_WORTH_SHARING)
        return distances, pieces

    def _reach_mm(
        self, points: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"], landings: Landings
    ) -> Float[np.ndarray, " n"]:
        distances, _ = self.met(self.pose.to_local_points(points), self.pose.to_local_directions(directions))
        return distances


@dataclass(frozen=True)
class BodyView(LitBody):
    """The body as an evaluation sees it: patch k is pixel k of a picture of one row.

    ``among``: all bodies with it, where light may come to it by way of itself; None where none does.
    """

    among: Housing | None = field(default=None, kw_only=True)

    @staticmethod
    def of(section: HousingSection) -> "BodyView":
        """The body alone."""
        patches = BodyPatches.of(section)
        grid = PixelGrid(float(len(patches)), 1.0, len(patches), 1)
        return BodyView(section.pose, grid, name=section.name, patches=patches)

    def readings(self, limit: BodyLimit) -> sparse.csr_array:
        """Matrix from flux to light of each patch that counts, or to the mean over all of them."""
        counted = self.counted(limit)
        areas_m2 = self.patches.areas_m2[counted]
        rows = np.arange(len(counted))
        if limit.of == "mean":
            areas_m2 = np.full(len(counted), areas_m2.sum())
            rows = np.zeros_like(counted)
        shape = (rows[-1] + 1, len(self.patches))
        return sparse.csr_array((len(self.lamps) / areas_m2, (rows, counted)), shape=shape)

    def before(self, others: Housing | None, among: Housing | None) -> "BodyView":
        """The body among ``others``; ``among``: all bodies with it."""
        relit = (
            among is not None and among.events > 1 and among.finishes.reflectances[among.names.index(self.name)] > 0.0
        )
        return replace(self, housing=others, among=among if relit else None)

    def seen_by_lamp(self, lamp: Pose) -> "BodyView":
        """The body, and the bodies before it, as one lamp at a pose sees them."""
        return replace(super().seen_by_lamp(lamp), among=self.among and self.among.seen_from(lamp))

    def land(self, rays: ExitRays) -> Landings:
        """Land ``rays``, NumPy arrays, also those that come to the body once more by way of itself."""
        landings = super().land(rays)
        return landings if self.among is None else replace(landings, again=self._landed_again(self.among, rays))

    def _landed_again(self, among: Housing, rays: ExitRays) -> LandedAgain:
        body = among.names.index(self.name)
        once = np.zeros(len(rays.flux), dtype=bool)
        parts = []
        for leg in legs_of(among, rays, among.endless_shadow(rays), among.endless_shadow):
            here = np.flatnonzero(leg.shadow.bodies == body)
            more = here[once[leg.rows[here]]]
            once[leg.rows[here]] = True
            ways = (
                self.pose.to_local_points(leg.rays.points[more]),
                self.pose.to_local_directions(leg.rays.directions[more]),
            )
            _, pieces = self.met(*ways)
            on = pieces >= 0
            parts.append(LandedAgain(leg.rows[more][on], self._places(pieces[on]), leg.rays.flux[more][on]))
        return LandedAgain(*map(np.concatenate, zip(*parts, strict=True)))

    def _land_by_arrays(self, rays: ExitRays) -> Landings:
        """Land ``rays``, NumPy arrays, with one cast in the place of two."""
        ways = self.pose.to_local_points(rays.points), self.pose.to_local_directions(rays.directions)
        _, pieces = self.met(*ways)
        landed = rays.left_lens & (pieces >= 0)
        hits = np.where(landed[:, None], self._places(pieces), 0.0)
        return Landings(hits, rays.flux * landed, landed, rays.left_lens & ~landed)

    def _reached(self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Bool[Array, " n"]:
        _, pieces = self.met(points, directions)
        return np.asarray(pieces >= 0)

    def _chart(self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Float[Array, "n 2"]:
        _, pieces = self.met(points, directions)
        return self._places(pieces)

    def _places(self, pieces: Int[np.ndarray, " n"]) -> Float[np.ndarray, "n 2"]:
        """Places of the patches of ``pieces`` in the picture."""
        across = self.patches.numbers[pieces] + 0.5 * (1 - len(self.patches))
        return np.stack([across, np.zeros_like(across)], axis=1)

    def _local(self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 3"]:
        patch = np.round(x - 0.5 * (1 - len(self.patches))).astype(np.int64)
        return np.asarray(self.patches.centres_mm[patch])


@dataclass(frozen=True)
class BodyPicture(LitBody):
    """The body as an eye at ``eye_mm`` sees it, for the limit of this ``number``: places are directions from there.

    The eye is the lens at the origin, or stands before a side that it does not see. Rays that pass beside the body land
    beside it, at its depth there: what moves them onto it is a gain that a search sees. ``towards``: the frame of the
    chart.
    """

    number: int = field(kw_only=True)
    towards: Pose = field(kw_only=True)
    eye_mm: Vector = ORIGIN

    @staticmethod
    def of(view: BodyView, number: int, limit: BodyLimit, width_mm: float, most: int) -> "BodyPicture":
        """The picture for a ``limit`` by patches ``width_mm`` wide, with at most so many pixels along a side."""
        counted = view.counted(limit)
        middle = view.centres_mm[counted].mean(axis=0)
        pieces = np.flatnonzero(np.isin(view.patches.numbers, counted))
        corners = view.pose.points(view.patches.corners[pieces].reshape(-1, 3))
        eye = np.zeros(3)
        if view.is_by_walls(limit):
            facing = view.patches.areas_m2[counted] @ view.pose.directions(view.patches.normals[counted])
            eye = middle + _BEFORE_SIDE * lengths(corners - middle).max() * facing / np.linalg.norm(facing)
        corners = corners - eye
        towards = Pose.facing(tuple((middle - eye).tolist()))
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
            eye_mm=(float(eye[0]), float(eye[1]), float(eye[2])),
        )

    def shows(self, number: int, limit: BodyLimit) -> bool:
        """True for the limit of its number."""
        return number == self.number

    def readings(self, limit: BodyLimit) -> sparse.csr_array:
        """Matrix from flux to light of each patch that counts and is seen, or to the mean over all that count.

        A patch has the light that goes into the solid angle in which it is seen; the intensity is bilinear between
        pixels.
        """
        fine = self.grid.finer(_OVERSAMPLING)
        x, y = (coordinates.ravel() for coordinates in np.meshgrid(fine.x(), fine.y()))
        units = self.towards.directions(from_equal_area(x, y))
        distances, pieces = self._seen(units)
        patches = self.patches.numbers[pieces]
        counted = self.counted(limit)
        seen = (pieces >= 0) & np.isin(patches, counted)
        if self.housing is not None and not self.housing.reflects:  # light by walls comes around bodies
            seen &= ~self.housing.shadow(np.zeros_like(units), units, distances).met
        rows = np.flatnonzero(seen)
        parts = bilinear(self.grid, x[rows], y[rows]) / _OVERSAMPLING**2  # of the flux of pixels, in each sub-pixel
        places = patches[rows], np.arange(len(rows))
        flux = sparse.csr_array((np.ones(len(rows)), places), (len(self.patches), len(rows))) @ parts
        areas_m2 = self.patches.areas_m2
        if limit.of == "mean":
            return sparse.csr_array(flux.sum(axis=0)[None, :] / areas_m2[counted].sum())
        return sparse.csr_array(sparse.diags_array(1.0 / areas_m2) @ flux)[np.unique(patches[rows])]

    def _seen(self, units: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, " n"], Int[np.ndarray, " n"]]:
        """Distance (mm) of the body from the eye in directions of the scene, and the piece there."""
        start = self.pose.to_local_points(np.zeros_like(units) + self.eye_mm)
        return self.met(start, self.pose.to_local_directions(units))

    @cached_property
    def _depths_mm(self) -> Float[np.ndarray, "h w"]:
        """Distance of the body from the eye in each pixel; beside it that in the nearest pixel that has one."""
        x, y = np.meshgrid(self.grid.x(), self.grid.y())
        distances, pieces = self._seen(self.towards.directions(from_equal_area(x, y)).reshape(-1, 3))
        missed = (pieces < 0).reshape(x.shape)
        nearest = distance_transform_edt(missed, return_distances=False, return_indices=True)
        return np.asarray(distances.reshape(x.shape)[tuple(nearest)])

    def _depths_at(
        self, points: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, " n"]:
        """Distance (mm) from the eye of where each ray is at the depth of the body, or of its nearest part."""
        depths = np.full(len(points), self._depths_mm.mean())
        for _ in range(_STEPS_TO_DEPTH):
            depths = self._depths_towards(points + self._path_to(points, directions, depths)[:, None] * directions)
        return depths

    def _depths_towards(self, places: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Distance (mm) of the body from the eye in the directions of places."""
        column, row = self._pixels(equal_area(self._directions_to(places)))
        return np.asarray(self._depths_mm[row, column])

    def _path_to(
        self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"], depths: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        """Path (mm) along rays to where they are so far from the eye, or nearest to it."""
        away = points - like(points, self.eye_mm)
        along = (away * directions).sum(1)
        square = along**2 - (away**2).sum(1) + depths**2
        return module_of(points).sqrt(square.clip(_NEAREST_MM2)) - along

    def _directions_to(self, places: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        """Directions, in the frame of the chart, of places in the scene."""
        away = places - like(places, self.eye_mm)
        return self.towards.to_local_directions(away / lengths(away)[:, None])

    def _pixels(self, hits: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, "2 n"]:
        """Column and row of the nearest pixel to each of ``hits``."""
        counts = np.array([self.grid.columns, self.grid.rows])
        return np.clip(np.floor((hits / self.grid.size + 0.5) * counts), 0, counts - 1).astype(np.int64).T

    def _reach_mm(
        self, points: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"], landings: Landings
    ) -> Float[np.ndarray, " n"]:
        """Path (mm) of each ray to the body; beside it for as far as the body is away there."""
        paths = super()._reach_mm(points, directions, landings)
        beside = np.flatnonzero(np.isinf(paths) & as_numpy(landings.landed))
        ways = points[beside], directions[beside]
        paths[beside] = self._path_to(*ways, self._depths_at(*ways))
        return paths

    def _reached(self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Bool[Array, " n"]:
        ways = as_numpy(directions)
        rises = self.pose.directions(ways) @ np.array(self.towards.axis) > 0.0
        if self.housing is not None and self.housing.reflects:
            starts = as_numpy(points)
            _, pieces = self.met(starts, ways)
            places = self.pose.points(starts)
            rises &= lengths(places - self.eye_mm) < self._depths_towards(places)
            rises = np.where(pieces >= 0, self._heights_mm(self.eye_mm)[pieces] > 0.0, rises)  # else it is not seen
        return like(points, rises) > 0.0

    def _chart(self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Float[Array, "n 2"]:
        _, pieces = self.met(as_numpy(points), as_numpy(directions))
        starts = self.pose.points(points)
        ways = self.pose.directions(directions)
        normals = like(points, self.pose.directions(self.patches.piece_normals[pieces]))
        corners = like(points, self.pose.points(self.patches.corners[pieces, 0]))
        to_body = ((corners - starts) * normals).sum(1) / (ways * normals).sum(1)
        beside = like(points, self._depths_at(as_numpy(starts), as_numpy(ways)))
        paths = module_of(points).where(like(points, pieces) >= 0.0, to_body, self._path_to(starts, ways, beside))
        return equal_area(self._directions_to(starts + paths[:, None] * ways))

    def _local(self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 3"]:
        units = self.towards.directions(from_equal_area(x, y))
        column, row = self._pixels(np.stack([x, y], axis=-1).reshape(-1, 2))
        depths = self._depths_mm[row, column].reshape(x.shape)
        return np.asarray(self.pose.to_local_points(depths[..., None] * units + self.eye_mm))


def body_views(spec: Spec) -> tuple[BodyView, ...]:
    """The bodies of ``spec`` that have ``patch_mm``, in the light of all lamps, as an evaluation sees them."""
    views = []
    bodies = bodies_of(spec.scene)
    for section in bodies:
        if section.patch_mm is not None:
            others = Housing.of([body for body in bodies if body is not section], spec.scene_events)
            view = BodyView.of(section).before(others, Housing.of(bodies, spec.scene_events))
            views.append(replace(view, lamps=spec.all_lamps))
    return tuple(views)


def body_pictures(spec: Spec) -> tuple[BodyPicture, ...]:
    """Pictures of bodies for a search, one for each limit on them that light of the lens can reach.

    None of several lamps, which see other sides. Light that passes beside a body, and comes to a side by way of walls,
    fades out beside the body itself, too.
    """
    if not spec.all_lamps.is_single:
        return ()
    views = {view.name: view for view in body_views(spec)}
    width_mm = {body.name: body.patch_mm for body in bodies_of(spec.scene)}
    most = _MOST_OF_SEARCH * spec.optimise.pixels
    pictures = []
    for number, limit in enumerate(spec.limits):
        if isinstance(limit, BodyLimit):
            view = views[limit.body]
            is_by_walls = view.is_by_walls(limit)
            if is_by_walls or not view.lies_in_plane_with_lens(limit):
                picture = BodyPicture.of(view, number, limit, width_mm[limit.body] or 0.0, most)
                pictures.append(replace(picture, housing=Housing.of(spec.scene)) if is_by_walls else picture)
    return tuple(pictures)
