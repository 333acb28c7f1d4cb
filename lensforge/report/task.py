"""The task of a design in one line: source, lens, and what light is wanted where."""

from collections.abc import Sequence
from typing import assert_never

from lensforge.spec import (
    AnyReceiver,
    ArrayTarget,
    CrossTarget,
    FlatTopTarget,
    ImageTarget,
    LensSection,
    RectangleTarget,
    Spec,
    TableTarget,
    Target,
    TextTarget,
)
from lensforge.spec.shape_targets import DiscTarget, EllipseTarget, PolygonTarget, RingTarget, SpotsTarget
from lensforge.spec.target_sections import BatwingTarget, BeamTarget, PhotometricTarget

_MOST_NAMED = 3  # targets of one receiver; of more only the number is given


def task(spec: Spec) -> str:
    """Source, lens, and the targets of each receiver with its place."""
    lens = spec.lens
    body = f"double-freeform lens, {lens.material}, n = {lens.refractive_index:g}{_fixed(lens)}{_surroundings(lens)}"
    return f"{spec.source.title} · {body} · {'; '.join(map(_on_receiver, spec.all_receivers))}"


def _fixed(lens: LensSection) -> str:
    """Fixed surfaces in words."""
    both = (("inner", lens.fixed_inner), ("outer", lens.fixed_outer))
    return "".join(f", {name} face fixed ({face.title})" for name, face in both if face is not None)


def _surroundings(lens: LensSection) -> str:
    """Indices in the cavity and around the lens, where these are not air; coated faces."""
    around = (("the cavity", lens.cavity_index), ("the surroundings", lens.outside_index))
    indices = "".join(f", n = {index:g} in {where}" for where, index in around if index != 1.0)
    faces = (("inside", lens.inner_coating), ("outside", lens.outer_coating))
    coated = " and ".join(where for where, coating in faces if coating is not None)
    return f"{indices}, coated {coated}" if coated else indices


def _on_receiver(receiver: AnyReceiver) -> str:
    return f"{_targets(receiver.targets)} {receiver.place}"


def _targets(targets: Sequence[Target]) -> str:
    """The targets of one receiver."""
    if len(targets) > _MOST_NAMED:
        return f"{len(targets)} targets"
    names = list(map(_target, targets))
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def _target(target: Target) -> str:
    """A target in a few words."""
    match target:
        case BeamTarget():
            return f"{'' if target.profile == 'gaussian' else f'{target.profile} '}beam {_angles(target)}"
        case BatwingTarget():
            return f"batwing to {target.size('to'):g}°"
        case PhotometricTarget():
            return f"intensity of {target.file.name}"
        case TextTarget():
            return f"“{target.text}”, {_wide(target)}"
        case ArrayTarget():
            return f"given pattern, {_wide(target)}"
        case ImageTarget() | TableTarget():
            return f"{target.file.name}, {_wide(target)}"
        case _:
            return _shape(target)


def _shape(
    target: FlatTopTarget
    | RectangleTarget
    | DiscTarget
    | EllipseTarget
    | RingTarget
    | PolygonTarget
    | CrossTarget
    | SpotsTarget,
) -> str:
    """A target that is a shape, with its size."""
    unit = _unit(target)
    match target:
        case FlatTopTarget():
            width, height = target.widths
            equal = f"square flat top, {width:g}{unit} wide"
            return equal if width == height else f"flat top, {width:g} × {height:g}{unit}"
        case RectangleTarget():
            width, height = target.size("width"), target.size("height")
            return f"square, {width:g}{unit} wide" if width == height else f"rectangle, {width:g} × {height:g}{unit}"
        case DiscTarget():
            return f"disc, {target.size('diameter'):g}{unit} wide"
        case EllipseTarget():
            return f"ellipse, {target.size('width'):g} × {target.size('height'):g}{unit}"
        case RingTarget():
            return f"ring, {target.size('inner_diameter'):g} to {target.size('outer_diameter'):g}{unit} wide"
        case PolygonTarget():
            return f"polygon with {len(target.corners)} corners"
        case CrossTarget():
            return f"cross, {target.size('length'):g}{unit} long"
        case SpotsTarget():
            return f"{target.columns} × {target.rows} spots, {target.size('pitch'):g}{unit} apart"
        case _:
            assert_never(target)


def _wide(target: TextTarget | ArrayTarget | ImageTarget | TableTarget) -> str:
    return f"{target.size('width'):g}{_unit(target)} wide"


def _angles(target: BeamTarget) -> str:
    """Full width at half maximum of a beam; along x and y where they differ."""
    x, y = target.pair("fwhm") or (0.0, 0.0)
    return f"{x:g}°" if x == y else f"{x:g}° × {y:g}°"


def _unit(target: Target) -> str:
    return "°" if target.unit == "deg" else " mm"
