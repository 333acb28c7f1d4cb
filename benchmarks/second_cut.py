"""Second cut from a corrected STEP file, simulated: a known form error, measured with noise, corrected, cut again.

    python benchmarks/second_cut.py examples/quickstart.toml [--points 10000] [--noise 0.3] [--rays 1048576]

The machine errs by about 5 um: low orders, and a wave of ``--wave`` mm over the whole face, the same at both cuts. Its
part is measured at points on a spiral, in a pose of its own. The error of the second cut is read from the STEP file by
the CAD kernel, not from the result; its light, and that of the design, are traced with the same rays. Designs the spec
at draft accuracy, unless it is a lens.json. Prints a row of docs/validation.md for each face.
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.spatial.transform import Rotation

import lensforge as lf
from lensforge.addons.measure.measured_surface import ChangedLens
from lensforge.cad.form_error import face_points
from lensforge.cad.plan import INNER, OUTER
from lensforge.cad.step import parse_step
from lensforge.sources.build_source import build_source
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.surfaces.surface import HALF_WIDTH, Surface, grid, to_chart

NODES, PLACES = 241, 20_000  # of the chart at which the STEP is read; directions of the errors
ROTATION_RAD, SHIFT_MM = (0.01, -0.02, 0.03), (0.2, -0.1, 0.15)  # of the part in the measuring machine
COLUMNS = (
    "face", "wavelength (mm)", "first cut (µm rms / max)", "second cut", "expected", "NMSE of the design",
    "first cut's less it", "second cut's less it", "efficiency, second cut's less the design's",
)  # fmt: skip

Error = Callable[[np.ndarray], np.ndarray]


def machine_error(size_mm: float, radius_mm: float, wave_mm: float) -> Error:
    """Radial error (mm) of about ``size_mm`` at most, on a face of this mean radius."""

    def error(u: np.ndarray) -> np.ndarray:
        x, y, z = u.T
        low = 1.6 * (x * x - y * y) + 2.4 * x * y * z + 1.5 * (x**3 - 3.0 * x * y * y) + 2.5 * z**3 - 1.5 * z
        arc = radius_mm * np.arctan2(0.8 * x + 0.6 * y, np.hypot(z, 0.8 * y - 0.6 * x))
        return np.asarray(size_mm / 4.2 * (low + np.cos(2.0 * np.pi * arc / wave_mm)))

    return error


def without_motion(of: Surface, error: Error) -> Error:
    """``error`` less the small rigid motion that is nearest to it: that is pose, and the registration takes it off."""

    def motions(u: np.ndarray) -> np.ndarray:
        normals = of.normal(u)
        return np.concatenate([np.cross(u * of.radius(u)[:, None], normals), normals], axis=1)

    u = fibonacci_hemisphere(5000)
    motion = np.linalg.lstsq(motions(u), error(u) * cosine(of, u), rcond=None)[0]
    return lambda at: np.asarray(error(at) - motions(at) @ motion / cosine(of, at))


def cosine(of: Surface, u: np.ndarray) -> np.ndarray:
    """Cosine between directions and normals."""
    return np.asarray(np.sum(of.normal(u) * u, axis=1))


class RadialError(Surface):
    """A radial error as a surface, for tables of a lens."""

    def __init__(self, error: Error) -> None:
        self.error = error

    @property
    def detail_rad(self) -> float:
        """Sigma of the tables' nodes."""
        return 0.04

    def radius(self, directions: np.ndarray) -> np.ndarray:
        """The error (mm)."""
        return self.error(directions)

    def gradient(self, directions: np.ndarray) -> np.ndarray:
        """Not needed for tables."""
        raise NotImplementedError


def cut_from(step: bytes, side: str, of: Surface, error: Error) -> Error:
    """Radial error (mm) of a part that is cut from a STEP file with ``error``."""
    face: Any = parse_step(step).faces[{"inner": INNER, "outer": OUTER}[side]]
    chart = grid(NODES)
    points, _ = face_points(face, chart.reshape(-1, 2))
    lengths = np.linalg.norm(points, axis=1)
    change = (lengths - of.radius(points / lengths[:, None])).reshape(NODES, NODES)
    spline = RectBivariateSpline(chart[:, 0, 0], chart[:, 0, 0], change, kx=5, ky=5)

    def total(u: np.ndarray) -> np.ndarray:
        at = np.clip(to_chart(u), -HALF_WIDTH, HALF_WIDTH)
        return np.asarray(error(u) + spline.ev(at[:, 0], at[:, 1]))

    return total


def measured(of: Surface, error: Error, options: argparse.Namespace) -> np.ndarray:
    """Points (mm) of the first cut, in the pose that it has in the measuring machine."""
    u = fibonacci_hemisphere(options.points)
    noise = 1e-3 * options.noise * np.random.default_rng(1).normal(size=len(u))
    points = u * (of.radius(u) + error(u))[:, None] + noise[:, None] * of.normal(u)
    return np.asarray(Rotation.from_rotvec(ROTATION_RAD).apply(points) + SHIFT_MM)


def size(of: Surface, error: Error) -> str:
    """Rms over the area and largest error along the normal, in um."""
    u = fibonacci_hemisphere(PLACES)
    along, area = 1e3 * error(u) * cosine(of, u), of.radius(u) ** 2 / cosine(of, u)
    return f"{np.sqrt(np.sum(area * along**2) / np.sum(area)):.2f} / {np.abs(along).max():.2f}"


def row(lens: lf.Lens, side: Any, options: argparse.Namespace) -> tuple[str, ...]:
    """Correct one face, cut it again, and compare errors and light."""
    of: Surface = getattr(lens, side)
    mean_mm = float(of.radius(fibonacci_hemisphere(1000)).mean())
    error = without_motion(of, machine_error(5e-3, mean_mm, options.wave))
    with TemporaryDirectory() as folder:
        file = Path(folder) / "points.csv"
        np.savetxt(file, measured(of, error, options), delimiter=",")
        made = lf.correct(lens, points=file, surface=side, rays=options.rays)
    again = cut_from(made.step, side, of, error)
    cuts = ChangedLens(lens, side, build_source(lens.spec.source, lens.spec.lens.dispersion), 6.0, options.rays)
    design, *cut = cuts.lights(None, RadialError(error), RadialError(again))
    first, second = (each.replicates.change_from(design.replicates) for each in cut)
    return (
        side,
        f"{made.wavelength_mm:.2f}",
        size(of, error),
        size(of, again),
        f"{made.expected_um.rms:.2f} / {made.expected_um.max:.2f}",
        str(design.metrics.nmse),
        str(first.nmse),
        str(second.nmse),
        str(second.efficiency),
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("spec", type=Path, help="a spec, or a lens.json")
    parser.add_argument("--points", type=int, default=10_000)
    parser.add_argument("--noise", type=float, default=0.3, help="of the probe (um)")
    parser.add_argument("--wave", type=float, default=2.5, help="of the machine (mm)")
    parser.add_argument("--rays", type=int, default=2**20)
    options = parser.parse_args()
    is_lens = options.spec.suffix == ".json"
    lens = lf.load_lens(options.spec) if is_lens else lf.design(lf.load_spec(options.spec), accuracy="draft").lens
    print("| " + " | ".join(COLUMNS) + " |")
    print("|" + "---|" * len(COLUMNS))
    for side in ("outer", "inner"):
        print("| " + " | ".join(row(lens, side, options)) + " |", flush=True)


if __name__ == "__main__":
    main()
