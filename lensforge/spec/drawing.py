"""The drawing for the shop: ``[drawing]``, words of its title block and of its notes."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from lensforge.errors import InputError
from lensforge.spec.section import Label, Section
from lensforge.spec.toml_file import read_toml
from lensforge.spec.wrong_fields import spec_error


class DrawingSection(Section):
    """Title block and notes of the drawing that ``lensforge handover`` makes; author and date are of [manufacture].

    What is left out is "not stated" on the drawing: nothing is made up.
    """

    part_name: Label = ""
    """Name of the part; left out, the name of the design."""
    part_number: Label = ""
    """Number of the part or of the drawing."""
    revision: Label = ""
    """Revision of the drawing."""
    checked_by: Label = ""
    """Name of who has checked the drawing."""
    sheet: Literal["A3", "A4"] | None = None
    """Size of the sheet; left out, A3."""
    general_tolerances: Label = ""
    """Tolerances of dimensions without one of their own, such as "ISO 2768-m"."""
    edge_break_mm: Annotated[float, Field(ge=1e-3, le=10.0)] | None = None
    """Largest break of the edges outside the optical faces."""
    roughness_nm: Annotated[float, Field(ge=1e-3, le=1e5)] | None = None
    """Largest roughness of the optical faces, rms of height (Rq)."""
    imperfections: Label = ""
    """Imperfections allowed on the optical faces, such as "5 x 0.16": number and grade."""


def read_drawing(path: Path) -> DrawingSection:
    """The ``[drawing]`` of a TOML file, such as a spec. Raises :class:`InputError` where it has none."""
    content = read_toml(path, "give a TOML file with [drawing]").get("drawing")
    if not isinstance(content, dict):
        raise InputError(f"{path}: has no [drawing]; add one, or give another file")
    try:
        return DrawingSection.model_validate(content)
    except ValidationError as error:
        raise spec_error(error, f"{path}: drawing", DrawingSection) from None
