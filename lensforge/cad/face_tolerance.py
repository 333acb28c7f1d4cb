"""Tolerances on exported faces: as fine as a machine can cut, or light can tell, and no finer.

A face that is off along its normal moves light by as much; one whose normal is off turns it. A turn that is small
against the image of the LED changes no picture: a point of the pattern is the sum of images of the LED.
"""

from lensforge.optics.face_roles import BODY
from lensforge.results import Positive, Record
from lensforge.scene.lens import Lens
from lensforge.surfaces.profile import AXIS

FORM_NM = 50.0  # diamond turning leaves 100 nm to 1 um of form
NORMAL_MRAD = 0.2  # 5 nm of roughness
FINEST_NM = 1.0  # for point-like sources
FINEST_MRAD = 0.02  # whose image is no measure
_OF_IMAGE = 1.0 / 20.0
MAX_NODES = 320  # of a spline that keeps them, in each direction


class FaceTolerance(Record):
    """Largest errors of the optical faces of a STEP file, of form and of normals.

    ``image_mrad``: angle under which the LED is seen from the last face, the width of its image far off; None for a
    point, or if the size of the LED is not known. ``turn``: largest angle by which light is turned, over the error of
    the normals of all faces.
    """

    form_nm: Positive = FORM_NM
    normal_mrad: Positive = NORMAL_MRAD
    image_mrad: Positive | None = None
    turn: Positive = 1.0


FINEST = FaceTolerance(form_nm=FINEST_NM, normal_mrad=FINEST_MRAD)
CHECKED = FaceTolerance(form_nm=FINEST_NM / 2.0, normal_mrad=FINEST_MRAD / 2.0)  # curvatures of a cone are 0 to 1e-4/mm


def face_tolerance(lens: Lens, form_nm: float | None = None, normal_mrad: float | None = None) -> FaceTolerance:
    """The tolerance on the faces of ``lens``: as given here, by its spec, or by the effect on its light.

    By default 50 nm of form, and normals within 0.2 mrad, or as near as keeps light within a twentieth of the LED's
    image, down to 0.02 mrad. Raises :class:`InputError` for one that is out of range.
    """
    given = {"form_nm": form_nm, "normal_mrad": normal_mrad}
    shop = lens.spec.manufacture.changed(**{name: value for name, value in given.items() if value is not None})
    turn = _turn(lens)
    image = _image_mrad(lens)
    by_light = FINEST_MRAD if image is None else _OF_IMAGE * image / turn
    return FaceTolerance(
        form_nm=shop.form_nm or FORM_NM,
        normal_mrad=shop.normal_mrad or min(max(by_light, FINEST_MRAD), NORMAL_MRAD),
        image_mrad=image,
        turn=turn,
    )


def _turn(lens: Lens) -> float:
    """Sum over the faces met by a ray: for each the index step, for a reflecting face twice the index."""
    roles = lens.spec.lens.body_roles
    media = lens.media
    reflections = sum(
        2.0 * (media.body.refractive_index if role.before == BODY else 1.0) for role in roles if role.reflects
    )
    return reflections + (0.0 if lens.spec.lens.is_opaque else 2.0 * media.largest_turning_power)


def _image_mrad(lens: Lens) -> float | None:
    """Least angle subtended by an LED of the lens at the apex of its last face."""
    extents = [source.extent_mm for source in lens.spec.each_source]
    away_mm = float(lens.surfaces[lens.spec.lens.outward].radius(AXIS)[0])
    least = min((extent for extent in extents if extent is not None), default=0.0)
    return None if least == 0.0 or None in extents else 2e3 * least / away_mm
