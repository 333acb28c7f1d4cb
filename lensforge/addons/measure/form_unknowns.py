"""Unknowns of a made lens: low-order form errors of both faces, places of face, LED and lens, and the index.

The form error of a face is a sum of Zernike polynomials over the hemisphere, each of mean square 1 mm² there; their
radius is sqrt(1 - cos) of the angle to the axis, so that equal areas of the disc are equal solid angles. Piston counts
as the gap between the faces, tip and tilt as decentre.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.light.simulation import TracedLens
from lensforge.optics.pose import Pose, Vector
from lensforge.scene.lens import Lens
from lensforge.scene.made_part import AsMade, FaceNodes, MadePart
from lensforge.spec import Spec

FORMS = ("power", "astigmatism 0°", "astigmatism 45°", "coma x", "coma y", "trefoil 0°", "trefoil 30°", "spherical")
DECENTRE = ("decentre x", "decentre y", "gap")
TILT = ("tilt about x", "tilt about y")
_RIM = 1.1  # of the squared radius: the error goes on behind the hemisphere, where splines begin


@dataclass(frozen=True)
class Unknown:
    """One unknown: ``name``, ``unit``, and its prior standard deviation ``expected`` in that unit."""

    name: str
    unit: str
    expected: float


_PLACES = (
    *(Unknown(name, "µm", 10.0) for name in DECENTRE),
    *(Unknown(name, "mrad", 0.35) for name in TILT),
    Unknown("LED x", "µm", 20.0),
    Unknown("LED y", "µm", 20.0),
    Unknown("LED z", "µm", 20.0),
    Unknown("lens tilt about x", "mrad", 0.9),
    Unknown("lens tilt about y", "mrad", 0.9),
    Unknown("index", "1e-4", 2.0),
)
_MM = 1e-3  # of a µm
_RAD = 1e-3  # of a mrad
_OF_INDEX = 1e-4


@dataclass(frozen=True, eq=False)
class FormUnknowns:
    """All unknowns of a lens of two faces, and the tables of their form errors.

    ``tables``: of each face by name (mm per µm of the unknown). Numbers are in units of the prior standard deviations.
    """

    spec: Spec
    names: tuple[str, ...]
    unknowns: tuple[Unknown, ...]
    tables: Mapping[str, Float[np.ndarray, "k side side"]]

    @staticmethod
    def of(lens: Lens, traced: TracedLens, expected_um: float) -> "FormUnknowns":
        """Prepare the unknowns of ``lens``; ``expected_um``: rms over a face of all its form errors together."""
        amount = expected_um / len(FORMS) ** 0.5
        tables = {}
        unknowns = []
        for name, surface in lens.surfaces.items():
            nodes = FaceNodes.of(traced.scene.grid, surface)
            tables[name] = _MM * nodes.table(zernike(nodes.directions)).tables
            unknowns += [Unknown(f"{name} {form}", "µm", amount) for form in FORMS]
        return FormUnknowns(lens.spec, tuple(lens.surfaces), (*unknowns, *_PLACES), tables)

    def __len__(self) -> int:
        return len(self.unknowns)

    @property
    def expected(self) -> Float[np.ndarray, " k"]:
        """Prior standard deviation of each, in its unit."""
        return np.array([unknown.expected for unknown in self.unknowns])

    def of_face(self, face: str) -> slice:
        """Places of the form errors of ``face`` among the numbers."""
        start = self.names.index(face) * len(FORMS)
        return slice(start, start + len(FORMS))

    def part(self, numbers: Float[np.ndarray, " k"], led_mm: Vector) -> MadePart:
        """The lens with these ``numbers``, its LED moved by ``led_mm``."""
        amounts = numbers * self.expected
        errors = {face: np.tensordot(amounts[self.of_face(face)], table, 1) for face, table in self.tables.items()}
        amount = {unknown.name: float(value) for unknown, value in zip(self.unknowns, amounts, strict=True)}
        shift_mm = _MM * np.array([amount[name] for name in DECENTRE])
        tilt_rad = _RAD * np.array([*(amount[name] for name in TILT), 0.0])
        lens_tilt_rad = _RAD * amount["lens tilt about x"], _RAD * amount["lens tilt about y"], 0.0
        led_shift_mm = _MM * np.array([amount[f"LED {axis}"] for axis in "xyz"])
        made = AsMade(
            names=self.names,
            source=Pose.displaced(np.array(led_mm) + led_shift_mm),
            lens=Pose.displaced(rotation_rad=lens_tilt_rad),
            faces={self.names[-1]: Pose.displaced(shift_mm, tilt_rad)},
            seat_mm=self.spec.base.seat_mm,
        )
        return MadePart(errors, made, _OF_INDEX * amount["index"], 1.0).in_state(self.spec)


def zernike(directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n k"]:
    """:data:`FORMS` in unit directions (Noll, J. Opt. Soc. Am. 66, 207, 1976: numbers 4 to 11, in this order)."""
    square = np.clip(1.0 - directions[:, 2], 0.0, _RIM)
    radius = np.sqrt(square)
    azimuth = np.arctan2(directions[:, 1], directions[:, 0])
    coma = np.sqrt(8.0) * (3.0 * square - 2.0) * radius
    trefoil = np.sqrt(8.0) * radius**3
    astigmatism = np.sqrt(6.0) * square
    return np.stack(
        [
            np.sqrt(3.0) * (2.0 * square - 1.0),
            astigmatism * np.cos(2.0 * azimuth),
            astigmatism * np.sin(2.0 * azimuth),
            coma * np.cos(azimuth),
            coma * np.sin(azimuth),
            trefoil * np.cos(3.0 * azimuth),
            trefoil * np.sin(3.0 * azimuth),
            np.sqrt(5.0) * (6.0 * square**2 - 6.0 * square + 1.0),
        ],
        axis=1,
    )
