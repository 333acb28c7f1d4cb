"""Faces of a spec that scatter, those of its further bodies too, polished and frosted again."""

from collections.abc import Iterator

from lensforge.spec.bodies_section import BodySection, ShellFace
from lensforge.spec.design_spec import Spec
from lensforge.spec.face_section import FaceSection
from lensforge.spec.light_limits import LuminanceLimit


def scatters_about_the_light(spec: Spec) -> bool:
    """True where faces scatter, and none is opal: light behind that one has no direction that a lens had given it."""
    kinds = {face.scatter.kind for face in _faces(spec) if face.scatter is not None}
    return bool(kinds) and "lambertian" not in kinds


def polished(spec: Spec) -> Spec:
    """``spec`` without the scatter of any face, and without limits on luminance, which polished ones do not keep."""
    faces = {name: face.changed(scatter=None) for name, face in spec.lens.faces.items()}
    limits = tuple(limit for limit in spec.limits if not isinstance(limit, LuminanceLimit))
    bodies = tuple(map(_polished_body, spec.bodies))
    return spec.changed(lens=spec.lens.changed(**faces), bodies=bodies, limits=limits)


def frosted_as(spec: Spec, wanted: Spec) -> Spec:
    """``spec`` of a polished lens with all that :func:`polished` has taken from ``wanted``."""
    return spec.changed(lens=spec.lens.changed(**wanted.lens.faces), bodies=wanted.bodies, limits=wanted.limits)


def _polished_body(body: BodySection) -> BodySection:
    return body.changed(inner=body.inner.changed(scatter=None), outer=body.outer.changed(scatter=None))


def _faces(spec: Spec) -> Iterator[FaceSection | ShellFace]:
    yield from spec.lens.faces.values()
    for body in spec.bodies:
        yield from (body.inner, body.outer)
