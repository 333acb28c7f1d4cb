"""Views of limits beside receivers: the lens as eyes see it, and the surfaces of bodies."""

from lensforge.scene.body_view import LitBody, body_pictures, body_views
from lensforge.scene.eye_view import EyeView, eye_views
from lensforge.scene.housing_room import exit_radius_mm
from lensforge.spec import Spec

LimitView = EyeView | LitBody


def limit_views(spec: Spec, *, coarse: bool = False) -> tuple[LimitView, ...]:
    """Views of the limits of ``spec``, eyes first, then each measured body; ``coarse``: eyes as few rays need it."""
    return (*eye_views(spec, searched=coarse), *body_views(spec))


def searched_views(spec: Spec) -> tuple[LimitView, ...]:
    """Views as a search needs them, whose light has a gradient."""
    views: tuple[LimitView, ...] = (*eye_views(spec, searched=True), *body_pictures(spec))
    return tuple(view.searched(spec.optimise.rim_deg, exit_radius_mm(spec)) for view in views)
