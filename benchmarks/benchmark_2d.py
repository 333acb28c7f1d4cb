"""A lens of two profiles in the plane against light that a known lens makes: how near can its light come?

    nice -n 10 python benchmarks/benchmark_2d.py [--source even] [--search] [--check 96]

Hacking et al. (arXiv 2604.02184) design mirrors in the plane for a source of finite size, and state a normalised mean
absolute error of 2e-5 and 5e-5 for two of their scenes, whose numbers are not known to us. The scenes here: a source on
z = 0, 0.5 mm wide, that emits at slopes up to 0.75 (as in their work in space, arXiv 2609.00899), even or with a normal
density in place and slope that is cut off (variance 0.2 of the squares of both ends). The wanted light on a line at 1 m
is that of a known lens, so that an error of 0 can be had by a lens of its size; the fit knows its light alone, in 128
pixels, and begins with two faces of other sizes, which it keeps, whose light is 0.3 to 0.6 off. Faces are those of the
linear lens (`kind = "extruded"`), with Fresnel's losses at both.

Error: the sum over pixels of the absolute difference of both lights, each of a flux of 1, which is the mean absolute
error over the mean. It is stated by more rays than the fit has (``finer``), and with ``--check`` by `plane_tracer.py`,
which shares no code with the fit. ``--search``: what `lensforge.design` reaches on the same scene, by the same rays.
Seconds are those of the processor, all cores together.
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain
from math import inf
from typing import ClassVar, Literal

import numpy as np
from jaxtyping import Float
from plane_fit import Coefficients, FitStep, PlaneScene, error, fitted
from plane_tracer import PlaneLens, PlaneSource, Profile, pixel_light
from scipy.special import erf, erfinv

import lensforge as lf
from lensforge.seeds import sobol
from lensforge.sources.build_source import emitter_of
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec.emitter_section import EmitterSection
from lensforge.spec.spec_section import Millimetres
from lensforge.spec.target_sections import Places, TargetSection
from lensforge.surfaces.drawn_profile import DrawnFace, profile_basis

HALF_MM = 0.25
STEEPEST = 0.75
VARIANCES = {"even": inf, "normal": 0.2}
INDEX = 1.4936
DISTANCE_MM = 1000.0
WINDOW_MM = 2048.0
PIXELS = 128
COUNT = 64  # coefficients of a profile
KNOWN_MM = 2.0, 4.5  # inner circle and apex of the known lens
START_MM = 1.0, 9.5
FINER = 300, 600  # nodes and cells that tell errors
SECONDS = 60.0
EFFORTS = (150, 2**14), (300, 2**16)  # steps and rays of searches


def scene_of(variance: float) -> PlaneScene:
    """The scene of a source of this variance."""
    borders = np.linspace(-0.5, 0.5, PIXELS + 1) * WINDOW_MM
    return PlaneScene(HALF_MM, STEEPEST, variance, INDEX, DISTANCE_MM, borders)


def finer(scene: PlaneScene) -> PlaneScene:
    """The scene with the rays that tell errors."""
    nodes, cells = FINER
    return replace(scene, nodes=nodes, cells=cells)


def lens_of(sizes_mm: tuple[float, float], square: float, fourth: float = 0.0) -> Coefficients:
    """An inner circle, and an outer profile 1 + square sin² + fourth sin⁴ in the reciprocal of its apex."""
    basis = profile_basis(COUNT)
    angles = np.linspace(basis.low, basis.high, 2001) * np.pi
    sine = np.sin(angles)
    outer = basis.nearest(angles / np.pi, (1.0 + square * sine**2 + fourth * sine**4) / sizes_mm[1])
    return np.array([np.full(COUNT, 1.0 / sizes_mm[0]), outer])


KNOWN = lens_of(KNOWN_MM, 0.3, 0.4)
START = lens_of(START_MM, 0.2)


def fit(scene: PlaneScene, wanted: Float[np.ndarray, " p"]) -> FitStep:
    """The best lens within the time."""
    best = FitStep(START, error(scene.light(START).pixels, wanted), 0.0)
    for step in fitted(scene, START, wanted):
        best = min(best, step, key=lambda each: each.error)
        best = replace(best, seconds=step.seconds)
        if step.seconds > SECONDS:
            break
    return best


class SheetSource(EmitterSection):
    """Light in planes across y, from a strip along x."""

    phrase: ClassVar[str] = "sheet of light {0.width_mm:g} mm wide"

    kind: Literal["sheet"] = "sheet"
    width_mm: Millimetres
    variance: float

    @property
    def extent_mm(self) -> float:
        """Half of its width."""
        return 0.5 * self.width_mm


@dataclass(frozen=True)
class Sheet:
    """The emitter of a sheet, 0.1 mm long."""

    spec: SheetSource
    flux_w: float = 1.0
    symmetry: str = "rectangle"
    ray_count: int | None = None

    def sample(self, count: int, seed: int) -> RayBundle:
        """Rays of equal flux, none of which goes along y."""
        points = sobol(count, 3, seed)
        places = 0.5 * self.spec.width_mm * self._share(points[:, 0])
        slopes = STEEPEST * self._share(points[:, 1])
        level = np.zeros(count)
        origins = np.column_stack([places, 0.1 * (points[:, 2] - 0.5), level])
        directions = np.column_stack([slopes, level, level + 1.0]) / np.hypot(1.0, slopes)[:, None]
        return RayBundle(origins, directions, np.full(count, self.flux_w / count))

    def outline(self) -> Float[np.ndarray, "4 3"]:
        """Corners (mm) of the strip."""
        x, y = 0.5 * self.spec.width_mm, 0.05
        return np.array([[-x, -y, 0.0], [x, -y, 0.0], [x, y, 0.0], [-x, y, 0.0]])

    def _share(self, even: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Even numbers between 0 and 1 as shares between -1 and 1, by the density."""
        if self.spec.variance == 0.0:
            return 2.0 * even - 1.0
        width = np.sqrt(2.0 * self.spec.variance)
        return np.asarray(width * erfinv((2.0 * even - 1.0) * erf(1.0 / width)))


emitter_of.register(SheetSource, lambda spec, **_: Sheet(spec))


class KnownTarget(TargetSection):
    """Light of pixels along x, even along y."""

    needs: ClassVar[tuple[str, ...]] = ("width",)
    phrase: ClassVar[str] = "known light, {width} wide"

    kind: Literal["known"] = "known"
    width_mm: Millimetres | None = None
    pixels: tuple[float, ...]

    @property
    def bounds(self) -> None:
        """None: it fills the receiver, and falls to 0 there."""

    def light(self, x: Places, y: Places) -> Places:
        """The light, linear between the middles of pixels."""
        borders = np.linspace(-0.5, 0.5, len(self.pixels) + 1) * self.size("width")
        values = np.array(self.pixels) / max(self.pixels)
        return np.interp(x, 0.5 * (borders[1:] + borders[:-1]), values) + 0.0 * y


def spec_of(scene: PlaneScene, wanted: Float[np.ndarray, " p"], steps: int, rays: int) -> lf.Spec:
    """The spec of the scene: light in planes across y, so that the lens is one in the plane."""
    pattern = {"kind": "known", "width_mm": WINDOW_MM, "pixels": wanted.tolist()}
    variance = 0.0 if np.isinf(scene.variance) else scene.variance
    return lf.Spec.model_validate(
        {
            "name": "benchmark_2d",
            "source": {"kind": "sheet", "width_mm": 2.0 * HALF_MM, "variance": variance},
            "lens": {
                "kind": "extruded",
                "length_mm": 40.0,
                "ends": "free",
                "profile": COUNT,
                "symmetry": "rectangle",
                "refractive_index": INDEX,
                "inner": {"concave_radius_mm": 0.5},  # against profiles that wave
                "outer": {"concave_radius_mm": 0.5},
            },
            "constraints": {
                "max_radius_mm": 10.0,
                "cavity_radius_mm": 0.6,
                "cavity_height_mm": 0.6,
                "min_thickness_mm": 1.0,
            },
            "base": {"kind": "none"},
            "manufacture": {"process": "none"},
            "receivers": [
                {
                    "kind": "plane",
                    "centre_mm": [0.0, 0.0, DISTANCE_MM],
                    "normal": [0.0, 0.0, 1.0],
                    "width_mm": WINDOW_MM,
                    "height_mm": WINDOW_MM / PIXELS,
                    "targets": [pattern],
                }
            ],
            "optimise": {"steps_per_level": [steps], "rays": rays, "pixels": PIXELS},
            "evaluate": {"pixels": PIXELS, "filter_variance": 0.0},
        }
    )


def profiles_of(lens: lf.Lens) -> Coefficients:
    """Coefficients of both faces."""
    faces = [lens.surfaces[name] for name in ("inner", "outer")]
    return np.array([face.coefficients for face in faces if isinstance(face, DrawnFace)])


def searched(scene: PlaneScene, wanted: Float[np.ndarray, " p"]) -> Iterator[tuple[str, Coefficients, float]]:
    """What `lensforge.design` makes of the scene, with few steps and rays, and with more of both."""
    for steps, rays in EFFORTS:
        begin = time.process_time()
        lens = lf.design(spec_of(scene, wanted, steps, rays), accuracy="draft", warn=lambda _: None, force=True).lens
        yield f"search, {steps} steps of {rays} rays", profiles_of(lens), time.process_time() - begin


def checked(scene: PlaneScene, profiles: Coefficients, places: int) -> Float[np.ndarray, " p"]:
    """The light of pixels by the second tracer."""
    inner, outer = (Profile(coefficients) for coefficients in profiles.tolist())
    lens = PlaneLens(inner, outer, INDEX, DISTANCE_MM)
    return pixel_light(lens, PlaneSource(HALF_MM, STEEPEST, scene.variance), scene.borders, places)


def main() -> None:
    """Print a row of Markdown for each lens."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--search", action="store_true", help="design the scenes by the package, too")
    parser.add_argument("--check", type=int, metavar="PLACES", help="trace by plane_tracer.py from so many places")
    parser.add_argument("--source", choices=VARIANCES, action="append", help="the source; both by default")
    options = parser.parse_args()
    scene_of(inf).light(START)  # compiles the kernels
    print("| source | lens | error | by the second tracer | folded | s |\n|---|---|---|---|---|---|")
    for name in options.source or VARIANCES:
        scene = scene_of(VARIANCES[name])
        exact = finer(scene)
        wanted = exact.light(KNOWN).pixels
        best = fit(scene, wanted)
        rows = [("start", START, 0.0), ("fit", best.profiles, best.seconds)]
        for lens, profiles, seconds in chain(rows, searched(scene, wanted) if options.search else ()):
            light = exact.light(profiles)
            second = "–"
            if options.check and lens == "fit":
                lights = (checked(scene, each, options.check) for each in (profiles, KNOWN))
                second = f"{error(*lights):.1e}"
            off = f"{error(light.pixels, wanted):.1e}"
            print(f"| {name} | {lens} | {off} | {second} | {light.folded:.3f} | {seconds:.0f} |", flush=True)


if __name__ == "__main__":
    main()
