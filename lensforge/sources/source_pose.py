"""Place of a source in the lens: turned about z, tilted about x and y, and shifted, in lens coordinates (mm)."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from lensforge.sources.ray_bundle import ChangedSource, RayBundle
from lensforge.spec.emitter_section import EmitterSection
from lensforge.surfaces.mirror_group import group, largest_symmetry

_SAME = 1e-12  # elements of a rotation by 90 degrees, rounded, are this close to 0


@dataclass(frozen=True, eq=False)
class SourcePose:
    """Rotation ``rotation`` about the lens origin, and then a shift to ``position_mm``."""

    rotation: Float[np.ndarray, "3 3"]
    position_mm: Float[np.ndarray, " 3"]

    @classmethod
    def of(cls, spec: EmitterSection) -> "SourcePose":
        """Pose of a source: ``rotate_z_deg``, the two angles of ``tilt_deg``, ``position_mm``, in this order."""
        about_x, about_y = np.deg2rad(spec.tilt_deg)
        rotation = rotation_about("z", float(np.deg2rad(spec.rotate_z_deg)))
        if any(spec.tilt_deg):
            rotation = rotation_about("y", about_y) @ rotation_about("x", about_x) @ rotation
        return cls(rotation, np.array(spec.position_mm, dtype=np.float64))

    @property
    def moves(self) -> bool:
        """False where everything stays where it is."""
        return bool(self.position_mm.any()) or not np.array_equal(self.rotation, np.eye(3))

    def points(self, own_mm: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Map points (mm) of the source's own coordinates to lens coordinates."""
        placed: Float[np.ndarray, "n 3"] = own_mm @ self.rotation.T
        placed += self.position_mm
        return placed

    def directions(self, own: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Rotate directions from the source's own coordinates to lens coordinates."""
        return np.asarray(own @ self.rotation.T)

    def placed(self, rays: RayBundle) -> RayBundle:
        """Move rays of the source's own coordinates to lens coordinates."""
        return replace(rays, origins=self.points(rays.origins), directions=self.directions(rays.directions))

    def own(self, rays: RayBundle) -> RayBundle:
        """Move rays of lens coordinates back to the source's own."""
        return replace(rays, origins=self.own_points(rays.origins), directions=rays.directions @ self.rotation)

    def own_points(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Map points (mm) of lens coordinates to the source's own."""
        own: Float[np.ndarray, "n 3"] = (points - self.position_mm) @ self.rotation
        return own

    def keeps(self, mirror: Float[np.ndarray, "3 3"], symmetry: str) -> bool:
        """True where ``mirror`` leaves the place as it is and is, for the source, one of its own group ``symmetry``."""
        if not np.array_equal(mirror @ self.position_mm, self.position_mm):
            return False
        own = self.rotation.T @ mirror @ self.rotation
        return any(np.allclose(own, image, rtol=0.0, atol=_SAME) for image in group(symmetry))


def rotation_about(axis: str, angle: float) -> Float[np.ndarray, "3 3"]:
    """Matrix of the right-handed rotation by ``angle`` (rad) about the ``axis`` x, y or z."""
    cosine, sine = np.cos(angle), np.sin(angle)
    if axis == "x":
        return np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])
    if axis == "y":
        return np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, eq=False)
class PlacedSource(ChangedSource):
    """``source``, which emits about its own origin, at ``pose`` in the lens; its rays are the same, moved."""

    pose: SourcePose

    @cached_property
    def symmetry(self) -> str:
        """Largest mirror group about the lens axis whose images are images of the source itself, at the same place."""
        own = self.source.symmetry
        return largest_symmetry(lambda mirror: self.pose.keeps(mirror, own))

    @property
    def is_round(self) -> bool:
        """True where it is moved and turned along and about the axis alone."""
        return super().is_round and not self.pose.position_mm[:2].any() and self.pose.rotation[2, 2] == 1.0

    def changed_rays(self, rays: RayBundle, seed: int) -> RayBundle:
        """The rays, moved."""
        return self.pose.placed(rays)

    def towards(self, targets: Float[np.ndarray, "n 3"], seed: int) -> RayBundle:
        """The rays of a sample, each turned to its target (mm); their flux is W/sr there."""
        return super().towards(self.pose.own_points(targets), seed)

    def outline(self) -> Float[np.ndarray, "k 3"]:
        """Outline (mm) of the source itself, moved."""
        return self.pose.points(self.source.outline())
