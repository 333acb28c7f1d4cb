"""Lenses with hidden errors, traced by their faces themselves, and the photographs of `examples/made_lens`.

The truth of that example stands here alone. `python tests/addons/measure/hidden_errors.py` takes the photographs again.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from photo_scenes import homography
from PIL import Image
from scipy.ndimage import gaussian_filter, map_coordinates

import lensforge as lf
from lensforge.light.lens_light import source_of
from lensforge.light.simulation import TracedLens, simulate
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.surfaces.surface import Surface

FORMS = ("power", "astigmatism 0°", "astigmatism 45°", "coma x", "coma y", "trefoil 0°", "trefoil 30°", "spherical")


def polynomials(u: np.ndarray) -> dict[str, np.ndarray]:
    """Noll's polynomials 4 to 11 in directions ``u``, in Cartesian coordinates of the equal-area disc."""
    x, y = (u[:, :2] / np.sqrt(1.0 + u[:, 2:])).T
    square = x * x + y * y
    shapes = (
        3**0.5 * (2 * square - 1),
        6**0.5 * (x * x - y * y),
        6**0.5 * 2 * x * y,
        8**0.5 * (3 * square - 2) * x,
        8**0.5 * (3 * square - 2) * y,
        8**0.5 * (x**3 - 3 * x * y * y),
        8**0.5 * (3 * x * x * y - y**3),
        5**0.5 * (6 * square**2 - 6 * square + 1),
    )
    return dict(zip(FORMS, shapes, strict=True))


@dataclass(frozen=True)
class MadeFace(Surface):
    """The face ``designed`` with errors (um along the normal) by the name of their form, displaced by ``shift_mm``."""

    designed: Surface
    errors_um: dict[str, float]
    shift_mm: np.ndarray

    @property
    def detail_rad(self) -> float:
        return self.designed.detail_rad

    def radius(self, directions: np.ndarray) -> np.ndarray:
        normals = self.designed.normal(directions)
        shapes = polynomials(directions)
        along = normals @ self.shift_mm + 1e-3 * sum(amount * shapes[form] for form, amount in self.errors_um.items())
        return self.designed.radius(directions) + along / (normals * directions).sum(axis=1)


def made_lens(lens: lf.Lens, errors_um: dict[str, float], accuracy: object) -> lf.Lens:
    """``lens`` with errors by the names of an inference: forms of both faces and the place of the outer one."""
    of = {
        face: {form: errors_um[f"{face} {form}"] for form in FORMS if f"{face} {form}" in errors_um}
        for face in ("inner", "outer")
    }
    shift = 1e-3 * np.array([errors_um.get(name, 0.0) for name in ("decentre x", "decentre y", "gap")])
    inner = MadeFace(lens.inner, of["inner"], np.zeros(3))
    return lf.Lens.double(inner, MadeFace(lens.outer, of["outer"], shift), lens.spec, 0, accuracy)


def light_of(made: lf.Lens, led_mm: Sequence[float], seed: int, rays: int = 2**21, nodes: float = 4.0) -> np.ndarray:
    """Light of a made lens with its LED at a place, on 128 pixels of its receiver, row 0 at the bottom."""
    source = made.spec.source.model_copy(update={"position_mm": tuple(led_mm)})
    lit = replace(made, spec=made.spec.model_copy(update={"source": source}))
    received = simulate(TracedLens._of_one(lit, nodes), source_of(lit.spec), receivers_of(lit.spec, 128), rays, seed)
    return received.received[0].images.mean(axis=0)


FOLDER = Path(__file__).parents[3] / "examples" / "made_lens"
LED_MM = 0.4 * np.array(
    [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 0.5],
     [0.0, 0.0, -0.5]]
)  # fmt: skip
HIDDEN = {
    "inner power": 1.6, "inner astigmatism 0°": -1.9, "inner coma y": 1.4, "inner trefoil 30°": -1.1,
    "inner spherical": 0.8, "outer power": -1.2, "outer astigmatism 45°": 2.6, "outer coma x": -2.1,
    "outer trefoil 0°": 1.3, "outer spherical": -1.5,
    "decentre x": 11.0, "decentre y": -7.0, "LED x": 14.0, "LED y": 9.0, "LED z": -12.0,
}  # fmt: skip
_CORNERS = np.array([[21.4, 17.8], [236.1, 24.9], [228.7, 239.2], [15.2, 230.6]])
_SIZE = 256
_WALL, _PANEL = 8 / 255, 30 / 255  # whole levels: the dark picture is the mean of many
_LED, _NOISE = 0.75, 0.007
_FINER = 4


def photographed(lens: lf.Lens, folder: Path) -> None:
    """Take the photographs of the example: a white panel in some light of the room, 8 bits, 1 % noise."""
    made = made_lens(lens, HIDDEN, "draft")
    off_mm = 1e-3 * np.array([HIDDEN[f"LED {axis}"] for axis in "xyz"])
    rng = np.random.default_rng(20261130)
    fine = (np.arange(_SIZE * _FINER) + 0.5) / _FINER - 0.5
    columns, rows = np.meshgrid(fine, fine)
    seen = np.stack([columns.ravel(), rows.ravel(), np.ones(columns.size)])
    side = lens.spec.target.receiver_mm
    x, y, w = np.linalg.inv(homography(_CORNERS, (side, side))) @ seen
    x, y = x / w / side + 0.5, y / w / side + 0.5
    panel = ((np.abs(x - 0.5) < 0.5) & (np.abs(y - 0.5) < 0.5)).astype(float)

    def write(name: str, light: np.ndarray, noise: float) -> None:
        sharp = (_WALL + panel * (_PANEL - _WALL + light)).reshape(columns.shape)
        pixels = gaussian_filter(sharp, 0.6 * _FINER).reshape(_SIZE, _FINER, _SIZE, _FINER).mean(axis=(1, 3))
        levels = 255.0 * (pixels + noise * rng.normal(size=pixels.shape))
        Image.fromarray(np.round(np.clip(levels, 0.0, 255.0)).astype(np.uint8)).save(folder / name, optimize=True)

    for number, place in enumerate(LED_MM):
        light = light_of(made, place + off_mm, 500 + number)
        places = [128.0 * y - 0.5, 128.0 * x - 0.5]
        write(f"led_{number}.png", _LED * map_coordinates(light / light.max(), places, order=1, mode="nearest"), _NOISE)
    write("off.png", np.zeros(len(x)), 0.0)
    np.savetxt(folder / "poses.csv", LED_MM, fmt="%.2f", delimiter=",", header="x_mm,y_mm,z_mm", comments="")


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    photographed(lf.design(lf.load_spec(FOLDER.with_suffix(".toml")), accuracy="draft").lens, FOLDER)
