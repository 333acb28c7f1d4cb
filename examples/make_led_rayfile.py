"""Make led.tm25ray, the ray file of a fictitious LED, so that the examples need no vendor's data.

A 2 mm x 2 mm phosphor-coated chip sits under a flat window of 0.3 mm, its centre at (0.15, -0.10) mm. It is neither
uniform nor Lambertian: brighter in the middle, dimmed at steep angles by the phosphor and by the window, with a halo
around the chip, and with a little stray light through the window's edge, some of it backwards. Rays start on the
outside of the window, as in vendors' files, so that the emitter is neither at the ray origins nor at the lens origin.

Only additions, products and square roots are used, so that the file is the same on every machine, byte for byte.

    python examples/make_led_rayfile.py [FILE]
"""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from lensforge.sources.rayfiles.ray_file import RayFile
from lensforge.sources.rayfiles.ray_file_io import write_rayfile

RAYS = 20_000
SEED = 20240229
FLUX_W = 1.0
FLUX_LM = 322.6  # FLUX_W times the luminous efficacy of the spectrum below
CHIP_MM = 2.0
CENTRE_MM = (0.15, -0.10)
WINDOW_TOP_MM = 0.083  # puts the virtual focus 0.05 mm below z = 0
WINDOW_MM = 0.3
WINDOW_HALF_MM = 1.75
INDEX = 1.5
HALO_SHARE = 0.06
EDGE_SHARE = 0.006
SPECTRUM = {
    "wavelength_nm": [420.0, 440.0, 450.0, 460.0, 480.0, 500.0, 520.0,
        540.0, 560.0, 580.0, 600.0, 620.0, 640.0, 660.0, 680.0, 700.0, 720.0],
    "weight": [
        0.06, 0.55, 1.00, 0.60, 0.12, 0.22, 0.42, 0.55, 0.60, 0.58, 0.50, 0.40, 0.29, 0.20, 0.13, 0.08, 0.05,
    ],
}  # fmt: skip

Proposal = Callable[[int], tuple[np.ndarray, np.ndarray]]  # size -> values (size, k), and which of them to keep


def main() -> None:
    """Write the file named on the command line, or led.tm25ray next to this script."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("led.tm25ray")
    write_rayfile(path, make_led(), "tm25")
    print(f"{path}: {RAYS} rays, {path.stat().st_size} bytes")


def make_led() -> RayFile:
    """All rays in random order, each with the same flux."""
    random = np.random.default_rng(SEED)
    through_edge = round(EDGE_SHARE * RAYS)
    halo = round(HALO_SHARE * RAYS)
    chip = RAYS - halo - through_edge
    positions, directions = zip(
        _through_top(random, _on_chip(random, chip)),
        _through_top(random, _in_halo(random, halo)),
        _through_edge(random, through_edge),
        strict=True,
    )
    order = np.argsort(random.random(RAYS), kind="stable")
    centre = np.array([*CENTRE_MM, WINDOW_TOP_MM])
    return RayFile(
        positions_mm=(np.concatenate(positions) + centre)[order].astype(np.float32),
        directions=np.concatenate(directions)[order].astype(np.float32),
        flux=np.full(RAYS, FLUX_W / RAYS, dtype=np.float32),
        flux_unit="W",
        header_flux_w=FLUX_W,
        header_flux_lm=FLUX_LM,
        header={
            "name": "Example LED, 2 mm x 2 mm chip under a flat window",
            "manufacturer": "none: computed by lensforge",
            "ray_file_creator": "examples/make_led_rayfile.py",
            "creation_method": "simulated",
            "date": "2024-02-29T00:00:00",
            "wavelength_min_nm": 420.0,
            "wavelength_max_nm": 720.0,
            "spectral_tables": [SPECTRUM],
        },
    )


def _accepted(count: int, propose: Proposal) -> np.ndarray:
    """Rejection sampling: the first ``count`` values that ``propose`` keeps."""
    kept: list[np.ndarray] = []
    while sum(map(len, kept)) < count:
        values, verdicts = propose(2 * count)
        kept.append(values[verdicts])
    return np.concatenate(kept)[:count]


def _on_chip(random: np.random.Generator, count: int) -> np.ndarray:
    """Points (n, 2) on the chip, in mm from its centre, a third dimmer in the corners than in the middle."""

    def propose(size: int) -> tuple[np.ndarray, np.ndarray]:
        points = (random.random((size, 2)) - 0.5) * CHIP_MM
        corner = (points[:, 0] ** 2 + points[:, 1] ** 2) / (CHIP_MM**2 / 2.0)
        return points, random.random(size) < 1.0 - 0.33 * corner

    return _accepted(count, propose)


def _in_halo(random: np.random.Generator, count: int) -> np.ndarray:
    """Points on the phosphor around the chip, fading outwards over 0.3 mm."""

    def propose(size: int) -> tuple[np.ndarray, np.ndarray]:
        points = (random.random((size, 2)) - 0.5) * (CHIP_MM + 0.6)
        beyond = np.maximum(np.abs(points[:, 0]), np.abs(points[:, 1])) - CHIP_MM / 2.0
        return points, (beyond > 0.0) & (random.random(size) < 1.0 - beyond / 0.3)

    return _accepted(count, propose)


def _through_top(random: np.random.Generator, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Start points on the window's top (z = 0) and directions in air of the light from ``points`` below the window."""

    def propose(size: int) -> tuple[np.ndarray, np.ndarray]:
        sine = 2.0 * random.random((size, 2)) - 1.0  # uniform in the unit disc: Lambertian
        squared = sine[:, 0] ** 2 + sine[:, 1] ** 2
        cosine = np.sqrt(np.maximum(1.0 - squared, 0.0))
        brightness = (0.6 + 0.4 * cosine) * _transmission(cosine)
        return sine, (squared < 1.0) & (random.random(size) < brightness)

    sine = _accepted(len(points), propose)
    squared = sine[:, 0] ** 2 + sine[:, 1] ** 2
    cosine = np.sqrt(1.0 - squared)
    cosine_in_window = np.sqrt(1.0 - squared / INDEX**2)
    across = points + WINDOW_MM * (sine / INDEX) / cosine_in_window[:, None]
    return np.column_stack([across, np.zeros(len(points))]), np.column_stack([sine, cosine])


def _transmission(cosine: np.ndarray) -> np.ndarray:
    """Fresnel transmission of unpolarised light between window and air, ``cosine`` in air."""
    inside = np.sqrt(1.0 - (1.0 - cosine**2) / INDEX**2)
    across = (cosine - INDEX * inside) / (cosine + INDEX * inside)
    along = (INDEX * cosine - inside) / (INDEX * cosine + inside)
    return 1.0 - 0.5 * (across**2 + along**2)


def _through_edge(random: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Stray light: rays from the four sides of the window, Lambertian about the outward normal."""
    along = (2.0 * random.random(count) - 1.0) * WINDOW_HALF_MM
    depth = -WINDOW_MM * random.random(count)

    def propose(size: int) -> tuple[np.ndarray, np.ndarray]:
        sine = 2.0 * random.random((size, 2)) - 1.0
        return sine, sine[:, 0] ** 2 + sine[:, 1] ** 2 < 1.0

    sine = _accepted(count, propose)
    outward = np.sqrt(1.0 - sine[:, 0] ** 2 - sine[:, 1] ** 2)
    side = np.where(random.random(count) < 0.5, 1.0, -1.0)
    starts = np.column_stack([side * WINDOW_HALF_MM, along, depth])
    directions = np.column_stack([side * outward, sine])
    turned = random.random(count) < 0.5
    starts[turned] = starts[turned][:, [1, 0, 2]]
    directions[turned] = directions[turned][:, [1, 0, 2]]
    return starts, directions


if __name__ == "__main__":
    main()
