"""The light of all lamps through the mesh of their plate, against the sum that the design states.

Each ray goes to one lamp, drawn at random, so that every lamp has its share; their light adds up on the receivers. As
in the sum, a ray that leaves its lens meets no other one: what does is counted as stray light.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.optics.media import Media
from lensforge.proof.facet_casting import Grid
from lensforge.proof.optical_faces import OpticalFaces
from lensforge.proof.part_mesh import read_part_mesh
from lensforge.proof.proof_result import LampsTogether
from lensforge.proof.receiver_screen import Screen, nmse, squared_norm
from lensforge.proof.sequential_cast import LandedRays, send_through
from lensforge.sources.ray_bundle import RayBundle


@dataclass(frozen=True, eq=False)
class LampsOnPlate:
    """The STL of a plate, rays of all its lamps, their faces, and the design's light on each receiver, by its name."""

    stl: bytes
    rays: RayBundle
    optical: OpticalFaces
    designed: Sequence[tuple[str, Screen, Float[np.ndarray, "h w"]]]


def cast_lamps(lamps: LampsOnPlate, media: Media, threads: int) -> tuple[LampsTogether, ...]:
    """Cast the rays of all lamps through the mesh of the plate, and compare their light on each receiver."""
    part = read_part_mesh(lamps.stl, lamps.optical)
    passage, together = send_through(part, Grid(part.mesh), lamps.rays, media, threads), []
    count = len(lamps.optical.plate.places) if lamps.optical.plate is not None else 1
    for name, screen, designed in lamps.designed:
        landed = LandedRays.of(passage, screen)
        image, variance = (see(landed.landings, count * landed.flux) for see in (screen.irradiance, screen.noise))
        inside = screen.in_window(landed.landings)
        together.append(
            LampsTogether(
                name=name,
                lamps=count,
                rays=len(lamps.rays),
                efficiency=float(landed.flux[inside].sum() / lamps.rays.flux.sum()),
                nmse_vs_sum=nmse(image, designed),
                noise_floor_nmse=float(variance.sum()) / squared_norm(designed),
            )
        )
    return tuple(together)
