"""How the lens is searched for, and how it is judged."""

from typing import Annotated, Literal

from pydantic import Field, PositiveInt

from lensforge.spec.section import Millimetres, Section

Accuracy = Literal["draft", "standard", "reference"]


class OptimiseSection(Section):
    """How the design is searched for; what is left out comes from the accuracy preset.

    Without ``fresnel`` the search leaves out what both surfaces reflect; the finished lens is judged with it always.
    """

    steps_per_level: tuple[PositiveInt, ...] | None = None
    rays: Annotated[int, Field(ge=64, le=2**24)] | None = None
    pixels: Annotated[int, Field(ge=4, le=1024)] = 64
    learning_rate: Annotated[float, Field(gt=0.0, le=1.0)] = 0.004
    uniformity_steps: Annotated[int, Field(ge=0)] = 0
    fresnel: bool = True


class EvaluateSection(Section):
    """How the finished lens is judged. ``window_mm``: side of the square in which flux counts as detected."""

    rays: Annotated[int, Field(ge=1, le=2**28)] | None = None
    pixels: Annotated[int, Field(ge=1, le=2048)] = 128
    window_mm: Millimetres | None = None
    filter_variance: Annotated[float, Field(ge=0.0)] = 1.0
