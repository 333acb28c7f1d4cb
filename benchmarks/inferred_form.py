"""Hidden errors of made lenses against those that ``lf.infer`` reads from pictures of their light.

    python benchmarks/inferred_form.py 30 > pulls.md           # two minutes of processor time for each lens
    python benchmarks/inferred_form.py 5 --first 10
    python benchmarks/inferred_form.py 30 --rays 65536         # of the model, for each picture; 524288 by default

Each lens has Gaussian form errors of low orders of 4.5 um (inner face) and 4 um (outer face) in the mean, a decentre,
and an LED out of its place. Its light is traced by its faces themselves, through tables finer than those of the model,
onto pictures of 512 x 512 pixels with 1 % noise, for nine places of the LED. Corners are given with an error of 0.2
pixels.
"Pull": rms over all errors of the lens of what is wrong over its standard error.
"""

import argparse
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import lensforge as lf  # before torch, whose idle threads then sleep

# isort: split
import numpy as np
from jaxtyping import Float
from PIL import Image
from result_tables import table
from scipy.ndimage import map_coordinates
from skimage.transform import ProjectiveTransform

from lensforge.addons.measure.form_unknowns import zernike
from lensforge.light.lens_light import source_of
from lensforge.light.simulation import TracedLens, simulate
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.surfaces.surface import Surface

RMS_UM = {"inner": 4.5, "outer": 4.0}
DECENTRE_UM, LED_UM = 8.0, 15.0
SIDE_MM, PIXELS = 200.0, 512
NOISE, DARK, BRIGHT = 0.007, 0.05, 0.7
CORNERS = np.array([[40.2, 31.1], [470.6, 38.3], [462.3, 478.8], [33.9, 470.4]])
CORNER_PX = 0.2
LED_MM = np.array(
    [[0.0, 0.0, 0.0], [0.25, 0.0, 0.0], [-0.25, 0.0, 0.0], [0.0, 0.25, 0.0], [0.0, -0.25, 0.0], [0.2, 0.2, 0.0],
     [-0.2, 0.2, 0.0], [0.0, 0.0, 0.2], [0.2, -0.2, 0.1]]
)  # fmt: skip
RAYS_OF_LIGHT = 2**21
COLUMNS = ("lens", "left on the inner face (µm)", "on the outer face", "of the decentre", "pull", "χ²")


def designed_lens() -> lf.Lens:
    """A lens for a flat top."""
    limits = lf.ConstraintsSection(cavity_height_mm=0.8, cavity_radius_mm=1.2, min_thickness_mm=1.0, max_radius_mm=9.0)
    spec = lf.Spec(
        source=lf.SquareSource(side_mm=1.0),
        target=lf.FlatTopTarget(width_mm=120.0, distance_mm=100.0, receiver_mm=SIDE_MM, uniform_mm=90.0),
        lens=lf.LensSection(inner=lf.FaceSection(offset_mm=4.0), outer=lf.FaceSection(offset_mm=8.7)),
        constraints=limits,
    )
    return lf.design(spec, accuracy="draft").lens


@dataclass(frozen=True)
class MadeFace(Surface):
    """A face with form errors along its normal, displaced by ``shift_um``."""

    designed: Surface
    amounts_um: Float[np.ndarray, "8"]
    shift_um: Float[np.ndarray, "3"]

    @property
    def detail_rad(self) -> float:
        return self.designed.detail_rad

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        normals = self.designed.normal(directions)
        along_mm = 1e-3 * (normals @ self.shift_um + zernike(directions) @ self.amounts_um)
        return self.designed.radius(directions) + along_mm / (normals * directions).sum(axis=1)


@dataclass(frozen=True)
class Hidden:
    """The errors of one lens: forms by face, shift of the outer face, and place of the LED (um)."""

    forms: dict[str, Float[np.ndarray, "8"]]
    shift: Float[np.ndarray, "3"]
    led: Float[np.ndarray, "3"]

    @staticmethod
    def drawn(rng: np.random.Generator) -> "Hidden":
        """Gaussian errors."""
        amounts = {face: rms / 8**0.5 * rng.normal(size=8) for face, rms in RMS_UM.items()}
        return Hidden(amounts, DECENTRE_UM * rng.normal(size=3), LED_UM * rng.normal(size=3))

    @property
    def by_name(self) -> dict[str, float]:
        """The errors that are not 0, except those of form, by the names of the record."""
        of_shift = zip(("decentre x", "decentre y", "gap"), self.shift, strict=True)
        return {**dict(of_shift), **{f"LED {axis}": float(value) for axis, value in zip("xyz", self.led, strict=True)}}


def photographed(lens: lf.Lens, hidden: Hidden, folder: Path, rng: np.random.Generator) -> list[Path]:
    """Pictures of the light of the made lens for each place of the LED, and without it."""
    inner = MadeFace(lens.inner, hidden.forms["inner"], np.zeros(3))
    outer = MadeFace(lens.outer, hidden.forms["outer"], hidden.shift)
    columns, rows = np.meshgrid(np.arange(PIXELS), np.arange(PIXELS))
    square = 0.5 * SIDE_MM * np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
    to_mm = ProjectiveTransform.from_estimate(CORNERS, square)
    x, y = to_mm(np.stack([columns.ravel(), rows.ravel()], axis=1)).T
    paths = []
    for number, place in enumerate(LED_MM):
        source = lens.spec.source.model_copy(update={"position_mm": tuple(place + 1e-3 * hidden.led)})
        spec = lens.spec.model_copy(update={"source": source})
        traced = TracedLens.of.__wrapped__  # which keeps none: such a lens has no hash
        made = traced(lf.Lens.double(inner, outer, spec, 0, "draft"), 6.0)
        receivers = receivers_of(spec, PIXELS // 2)
        image = simulate(made, source_of(spec), receivers, RAYS_OF_LIGHT, 70 + number).received[0].images.mean(axis=0)
        pixel_mm = SIDE_MM / len(image)
        places = [(y + 0.5 * SIDE_MM) / pixel_mm - 0.5, (x + 0.5 * SIDE_MM) / pixel_mm - 0.5]
        light = map_coordinates(image / np.quantile(image, 0.999), places, order=1, mode="nearest")
        light = BRIGHT * (1.0 + 0.02 * rng.normal()) * light + NOISE * rng.normal(size=light.shape) + DARK
        paths.append(folder / f"{number}.png")
        write_picture(paths[-1], light.reshape(PIXELS, PIXELS))
    write_picture(folder / "off.png", np.full((PIXELS, PIXELS), DARK))
    np.savetxt(folder / "poses.csv", LED_MM, delimiter=",", header="x_mm,y_mm,z_mm", comments="")
    return paths


def write_picture(path: Path, light: Float[np.ndarray, "h w"]) -> None:
    """Write grey levels of 16 bits."""
    Image.fromarray(np.round(65535 * np.clip(light, 0.0, 1.0)).astype(np.uint16)).save(path)


def rows(lens: lf.Lens, numbers: range, rays: int) -> Iterator[tuple[float, ...]]:
    """A row of the table for each lens; the pull last but one."""
    for number in numbers:
        rng = np.random.default_rng(number)
        hidden = Hidden.drawn(rng)
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            paths = photographed(lens, hidden, folder, rng)
            corners = [tuple(corner) for corner in CORNERS + CORNER_PX * rng.normal(size=CORNERS.shape)]
            files = {"pictures": paths, "poses": folder / "poses.csv", "off": folder / "off.png"}
            made = lf.infer(lens, **files, corners=corners, rays=rays)
        known = np.array([*hidden.forms["inner"], *hidden.forms["outer"]])
        known = np.append(known, [hidden.by_name.get(error.name, 0.0) for error in made.errors[len(known) :]])
        wrong = np.array([error.value.value for error in made.errors]) - known
        pulls = wrong / np.array([error.value.standard_error for error in made.errors])
        left = [float(np.linalg.norm(wrong[part])) for part in (slice(0, 8), slice(8, 16), slice(16, 18))]
        yield number, *left, float(np.sqrt(np.mean(pulls**2))), made.chi_square


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("lenses", type=int, nargs="?", default=3)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--rays", type=int, default=2**19)
    options = parser.parse_args()
    done = []
    for row in rows(designed_lens(), range(options.first, options.first + options.lenses), options.rays):
        done.append(row)
        print(" ".join(f"{value:.3g}" for value in row), flush=True)
    print(table([[f"{value:.3g}" for value in row] for row in done], COLUMNS))
    print(f"pull over all: {np.sqrt(np.mean(np.square([row[4] for row in done]))):.3f}")


if __name__ == "__main__":
    main()
