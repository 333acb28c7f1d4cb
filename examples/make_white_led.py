"""Make white_blue.tm25ray and white_phosphor.tm25ray, the light of a fictitious white LED in two ray files.

A blue chip, 1 mm wide, shines through a plate of phosphor, 1.6 mm wide, which makes the rest of the light. What is left
of the blue comes from above the chip and goes forward, cos^3 of the angle; the phosphor shines Lambertian from all of
the plate. So the LED is bluish in the middle and from the front, yellowish at its edge and from the side, as many are.

Only additions, products and square roots are used, so that the files are the same on every machine, byte for byte.

    python examples/make_white_led.py [FOLDER]
"""

import sys
from pathlib import Path

import numpy as np

from lensforge.sources.rayfiles.ray_file import RayFile
from lensforge.sources.rayfiles.ray_file_io import write_rayfile

RAYS = {"blue": 7_000, "phosphor": 21_000}  # all of the same flux
SEED = 20251125
FLUX_W = {"blue": 0.25, "phosphor": 0.75}
CHIP_MM, PLATE_MM = 1.0, 1.6


def main() -> None:
    """Write both files to the folder named on the command line, or next to this script."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    for name, rays in make_white().items():
        path = folder / f"white_{name}.tm25ray"
        write_rayfile(path, rays, "tm25")
        print(f"{path}: {RAYS[name]} rays, {path.stat().st_size} bytes")


def make_white() -> dict[str, RayFile]:
    """The blue light that is left, and that of the phosphor; rays of equal flux."""
    random = np.random.default_rng(SEED)
    return {
        "blue": _part("blue", "blue light", _emitted(random, RAYS["blue"], CHIP_MM, forward=True)),
        "phosphor": _part(
            "phosphor", "light of its phosphor", _emitted(random, RAYS["phosphor"], PLATE_MM, forward=False)
        ),
    }


def _emitted(
    random: np.random.Generator, count: int, side_mm: float, *, forward: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Start points in a square, and directions: Lambertian, or ``forward`` as the cube of the cosine."""
    positions = np.zeros((count, 3))
    positions[:, :2] = side_mm * (random.random((count, 2)) - 0.5)
    flat = np.zeros((0, 2))
    while len(flat) < count:
        some = 2.0 * random.random((count, 2)) - 1.0
        flat = np.concatenate([flat, some[some[:, 0] * some[:, 0] + some[:, 1] * some[:, 1] < 1.0]])
    flat = flat[:count]  # uniform in a disc: the two components of Lambertian directions
    square = flat[:, 0] * flat[:, 0] + flat[:, 1] * flat[:, 1]
    if forward:  # sin^2 = 1 - u^(1/2) of a uniform u, as it is 1 - u for Lambert
        sine = 1.0 - np.sqrt(1.0 - square)
        flat, square = flat * np.sqrt(sine / np.where(square > 0.0, square, 1.0))[:, None], sine
    return positions, np.column_stack([flat, np.sqrt(1.0 - square)])


def _part(name: str, words: str, rays: tuple[np.ndarray, np.ndarray]) -> RayFile:
    positions, directions = rays
    return RayFile(
        positions_mm=positions.astype(np.float32),
        directions=directions.astype(np.float32),
        flux=np.full(len(positions), FLUX_W[name] / len(positions), dtype=np.float32),
        flux_unit="W",
        header_flux_w=FLUX_W[name],
        header={
            "name": f"Example white LED, {words}",
            "manufacturer": "none: computed by lensforge",
            "ray_file_creator": "examples/make_white_led.py",
            "creation_method": "simulated",
            "date": "2025-11-25T00:00:00",
        },
    )


if __name__ == "__main__":
    main()
