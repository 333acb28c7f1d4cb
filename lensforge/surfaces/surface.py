"""A surface as a radius over the sphere about the origin: its chart, its record, and surfaces scaled.

The stereographic chart of the hemisphere is one square patch, with no pole and no seam:
``(X, Y) = tan(theta/2) (cos phi, sin phi)``. The hemisphere is the unit disc and its rim the unit circle. Every surface
of a lens is a radius ``rho`` over this chart, star-shaped about the origin.

A kind of surface registers its record from its own file, in which ``lens.json`` and a spec keep it: one that is given
by numbers alone by :func:`recorded`, any other by a class that extends :class:`SurfaceRecord` and a function of
:func:`surface_record`.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property, singledispatch
from typing import Annotated, Any, ClassVar, Literal, TypeVar

import numpy as np
from jaxtyping import Float
from pydantic import Field, create_model

from lensforge.optics.media import Surface as Surface  # what stands behind the lens has faces, too
from lensforge.results import Number, Record
from lensforge.results.registered_kinds import OfSeveralKinds

# The chart's square reaches a little past the rim, so that the rim is inside the splines' domain.
HALF_WIDTH = 1.02


def to_sphere(chart: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 3"]:
    """Unit directions of chart points: ``u = (2X, 2Y, 1 - R^2) / (1 + R^2)``."""
    squared = np.sum(chart * chart, axis=-1, keepdims=True)
    return np.concatenate([2.0 * chart, 1.0 - squared], axis=-1) / (1.0 + squared)


def to_chart(directions: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 2"]:
    """Chart points of directions of any length: ``(X, Y) = (x, y) / (r + z)``; singular at -z only."""
    radius = np.linalg.norm(directions, axis=-1, keepdims=True)
    return directions[..., :2] / (radius + directions[..., 2:])


def gradient_on_sphere(chart: Float[np.ndarray, "n 2"], slopes: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
    """Tangential gradient on the unit sphere of a function from its slopes along X and Y.

    The chart is conformal, with the scale ``2/(1 + R^2)``; the unit tangents of its axes are the derivatives of
    ``u = (2X, 2Y, 1 - R^2) / (1 + R^2)`` over their length.
    """
    x, y = chart[:, 0], chart[:, 1]
    squared = 1.0 + x**2 + y**2
    along_x = np.stack([1.0 - x**2 + y**2, -2.0 * x * y, -2.0 * x], axis=1) / squared[:, None]
    along_y = np.stack([-2.0 * x * y, 1.0 + x**2 - y**2, -2.0 * y], axis=1) / squared[:, None]
    by_angle = 0.5 * squared[:, None] * slopes
    return by_angle[:, :1] * along_x + by_angle[:, 1:] * along_y


def grid(nodes: int, half_width: float = HALF_WIDTH) -> Float[np.ndarray, "n n 2"]:
    """A square grid of ``nodes`` x ``nodes`` chart points, first index X, second index Y."""
    axis = np.linspace(-half_width, half_width, nodes)
    return np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)


class ByContent:
    """A frozen dataclass compared and hashed by its fields, arrays by their bytes, so that caches can be keyed by it.

    Its decorator says ``eq=False``: the generated ``__eq__`` would compare arrays element by element.
    """

    @cached_property
    def _content(self) -> tuple[object, ...]:
        values = (getattr(self, field.name) for field in fields(self))  # type: ignore[arg-type]  # a dataclass
        return tuple((v.shape, v.dtype.str, v.tobytes()) if isinstance(v, np.ndarray) else v for v in values)

    def __eq__(self, other: object) -> bool:
        """True where all fields are equal, arrays to the bit."""
        return isinstance(other, ByContent) and type(self) is type(other) and self._content == other._content

    def __hash__(self) -> int:
        return hash((type(self).__name__, self._content))


@dataclass(frozen=True)
class ScaledSurface(Surface):
    """``surface`` times ``factor`` about the origin: radius and gradient scale, normals stay."""

    surface: Surface
    factor: float

    @property
    def detail_rad(self) -> float:
        """Sigma (rad) of the narrowest feature, as of the unscaled surface."""
        return self.surface.detail_rad

    @property
    def symmetry(self) -> str:
        """Largest mirror group, as of the surface."""
        return self.surface.symmetry

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """``rho`` (mm), the distance from the origin."""
        return self.factor * self.surface.radius(directions)

    def gradient(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Tangential gradient of ``rho`` on the unit sphere (mm/rad)."""
        return self.factor * self.surface.gradient(directions)

    def radius_on_grid(self, directions: Float[np.ndarray, "n n 3"]) -> Float[np.ndarray, "n n"]:
        """``rho`` (mm) on a square chart grid centred on the axis."""
        return self.factor * self.surface.radius_on_grid(directions)


def scaled(surface: Surface, factor: float) -> Surface:
    """``surface`` times ``factor``; unchanged for factor 1, so that nothing is rounded."""
    return surface if factor == 1.0 else ScaledSurface(surface, factor)


Length = Annotated[Number, Field(ge=1e-6, le=1e9)]  # mm; the ranges of the spec, strict as in all records
Place = Annotated[Number, Field(ge=-1e9, le=1e9)]  # mm
Axis = tuple[Place, Place, Place]

_Kind = TypeVar("_Kind", bound=type[Surface])


class SurfaceRecord(OfSeveralKinds, Record):
    """A surface, by its kind and its numbers."""

    of: ClassVar[Callable[..., Surface]]  # makes it of the other fields

    def surface(self) -> Surface:
        """The surface. Raises :class:`InputError` if the numbers describe none."""
        return type(self).of(**self.model_dump(exclude={"kind"}))


@singledispatch
def surface_record(surface: Surface) -> SurfaceRecord:
    """``surface`` as a record of ``lens.json``."""
    raise TypeError(f"{type(surface).__name__} cannot be written to a lens file")


def recorded(kind: str, description: str) -> Callable[[_Kind], _Kind]:
    """Register a dataclass of a surface as ``kind``: its record has the same fields, within the ranges of their types.

    ``description``: for the schema.
    """

    def register(made: Any) -> Any:
        types = {field.name: (field.type, ...) for field in fields(made)}
        tagged: dict[str, Any] = {"kind": (Literal[kind], ...), **types}
        record = create_model(f"{kind.capitalize()}Record", __base__=SurfaceRecord, __doc__=description, **tagged)
        record.of = made
        surface_record.register(made, lambda face: record(kind=kind, **{name: getattr(face, name) for name in types}))
        return made

    return register
