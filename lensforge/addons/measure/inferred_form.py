"""The face of a first cut by an inference from pictures, in the place of one by measured points.

Errors that the pictures tell are its deviation. The others stay as they are: they are expected of the second cut, as is
what is wrong in any of them, by their covariance. Places of an even pattern stand for points.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from lensforge.addons.measure.areal_filter import ArealFilter, PointDeviations
from lensforge.addons.measure.first_cut import FilterRange, FirstCut, Request
from lensforge.addons.measure.form_unknowns import DECENTRE, FORMS, TILT, zernike
from lensforge.addons.measure.inference_result import Inference
from lensforge.addons.measure.measurement_result import InferredForm
from lensforge.addons.measure.nominal_face import NominalFace
from lensforge.addons.measure.registration import Registered, RigidMotion
from lensforge.errors import InputError
from lensforge.results import Metric
from lensforge.scene.lens import Lens
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.surfaces.surface import Surface

_PLACES = 4000
_SEED = 0  # of the errors that are drawn
_UNIT = 1e-3  # mm of a µm, rad of a mrad
_NAMES = (*DECENTRE, *TILT)
# Errors of the place that count as form, and those that are its pose.
_BY_REGISTRATION = {"rigid": ((), _NAMES), "shift": (TILT, DECENTRE), "none": (_NAMES, ())}


def inference_of(inferred: Inference | Path, lens: Lens) -> Inference:
    """The errors of the made ``lens``, or those that ``infer`` wrote to a JSON file or a result folder.

    Raises :class:`InputError` for another file, and for errors of another lens.
    """
    if isinstance(inferred, Path):
        if not inferred.is_dir() and inferred.suffix != ".json":
            raise InputError(f"{inferred}: no JSON file; give the infer.json that `lensforge infer` wrote")
        folder, stem = (inferred, None) if inferred.is_dir() else (inferred.parent, inferred.stem)
        inferred = Inference.read(folder, stem)
    if inferred.inputs["lens"] != lens.sha256:
        raise InputError("inferred: the errors of another lens; run `lensforge infer` in the folder of this one")
    return inferred


@dataclass(frozen=True)
class _Errors:
    """Errors of one face in units of their prior standard deviations, and the radial deviation (mm) of each unit.

    ``fields``: these deviations by direction. ``told``: True for errors that the pictures tell.
    """

    names: tuple[str, ...]
    amounts: Float[np.ndarray, " k"]
    covariance: Float[np.ndarray, "k k"]
    told: Bool[np.ndarray, " k"]
    fields: Float[np.ndarray, "n k"]

    @staticmethod
    def of(made: Inference, by_unit: Mapping[str, Float[np.ndarray, " n"]]) -> "_Errors":
        """Errors of ``made`` by name; ``by_unit``: radial deviation (mm) of a µm or a mrad of each that counts."""
        kept = [number for number, error in enumerate(made.errors) if error.name in by_unit]
        errors = [made.errors[number] for number in kept]
        return _Errors(
            names=tuple(error.name for error in errors),
            amounts=np.array([error.value.value / error.expected for error in errors]),
            covariance=made.covariance[np.ix_(kept, kept)],
            told=np.array([error.is_told for error in errors]),
            fields=np.stack([error.expected * by_unit[error.name] for error in errors], axis=1),
        )

    def kept(self, points: PointDeviations, gain: float) -> tuple[Float[np.ndarray, " n"], float]:
        """Radial deviations (mm) that a face corrected by ``gain`` may keep, and the rms (mm) of their uncertainty.

        The rms is along the normal, over the area. The uncertain part is drawn by the covariance of the errors,
        orthogonal to the deviation that is left on purpose, so that the squares of both add up as they do in the mean.
        """
        values, vectors = np.linalg.eigh(self.covariance)
        modes = self.fields @ (vectors * np.sqrt(np.maximum(values, 0.0)))
        rms = np.sqrt(len(values) * points.mean_square(modes))
        left = self.fields @ np.where(self.told, (1.0 - gain) * self.amounts, self.amounts)
        drawn = modes @ np.random.default_rng(_SEED).normal(size=len(values))
        if left.any():
            along = points.mean_square(drawn + left) - points.mean_square(drawn - left)
            drawn = drawn - 0.25 * along / points.mean_square(left) * left
        return left + drawn * rms / np.sqrt(points.mean_square(drawn)), float(rms)


def inferred_cut(made: Inference, lens: Lens, face: NominalFace, request: Request) -> FirstCut:
    """The ``face`` of ``lens`` with the errors that ``made`` tells of it.

    Its place, against the first face, counts as form as far as the registration of the ``request`` leaves it. Raises
    :class:`InputError` where the pictures tell no error of the face.
    """
    directions = face.domain.held(fibonacci_hemisphere(_PLACES))
    is_placed = face.name == [*lens.surfaces][-1]
    as_form, as_pose = _BY_REGISTRATION[request.registration] if is_placed else ((), ())
    by_unit = {f"{face.name} {form}": _UNIT * field for form, field in zip(FORMS, zernike(directions).T, strict=True)}
    by_unit |= {name: field for name, field in _moved(face.surface, directions).items() if name in as_form}
    empty = PointDeviations(face.surface, directions, np.zeros(len(directions)), face.domain)
    errors = _Errors.of(made, {name: field / empty.cosines for name, field in by_unit.items()})
    if not errors.told.any():
        raise InputError(
            f"inferred: the pictures tell no form error of the {face.name} face; take a further one with the "
            f"{made.further}, and infer again"
        )
    points = replace(empty, deviations=errors.fields @ np.where(errors.told, errors.amounts, 0.0))
    span = FilterRange.of(points)
    wavelength_mm = span.shortest_mm if request.wavelength_mm is None else request.wavelength_mm
    span.require(wavelength_mm)
    filtered = ArealFilter(points, wavelength_mm).solve()
    kept, rms_mm = errors.kept(points, request.gain)
    return FirstCut(
        placed=Registered(_motion(made, as_pose), directions, 1.0),
        points=points,
        covered=1.0,
        span=span,
        noise_mm=rms_mm,
        likeliest=filtered,
        chosen=filtered,
        again=(points.deviations - kept) / request.gain,
        inputs={made.stage: made.sha256},
        inferred=InferredForm(
            pictures=len(made.pictures),
            chi_square=made.chi_square,
            left=tuple(name for name, told in zip(errors.names, errors.told, strict=True) if not told),
        ),
    )


def _moved(surface: Surface, directions: Float[np.ndarray, "n 3"]) -> dict[str, Float[np.ndarray, " n"]]:
    """Deviations (mm) along the normal of a face that is out of place by a unit."""
    normals = surface.normal(directions)
    turned = np.cross(surface.radius(directions)[:, None] * directions, normals)
    return dict(zip(_NAMES, _UNIT * np.concatenate([normals, turned[:, :2]], axis=1).T, strict=True))


def _motion(made: Inference, as_pose: Collection[str]) -> RigidMotion:
    """The motion that brings a face to its place which is out of it by the errors ``as_pose``."""
    by_name = {error.name: error.value for error in made.errors if error.name in as_pose}
    metrics = [by_name.get(name, Metric(value=0.0)) for name in (*TILT, "turn", *DECENTRE)]
    values, errors = _UNIT * np.array([(-metric.value, metric.standard_error or 0.0) for metric in metrics]).T
    return RigidMotion(values[:3], values[3:], errors[:3], errors[3:])
