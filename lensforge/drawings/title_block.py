"""Frame and title block of the drawing."""

from dataclasses import dataclass

import numpy as np

from lensforge.drawings.marks import Marks, first_angle
from lensforge.drawings.sheet import Box, Stroke, Words
from lensforge.drawings.text_cells import cell, frame_of
from lensforge.geometry.part import STEP_FILE, Part
from lensforge.lens import Lens
from lensforge.spec import DrawingSection

WIDTH, ROW = 180.0, 5.6  # mm on A3
HEIGHT = 8.0 * ROW
_NONE = "not stated"


@dataclass(frozen=True)
class TitleBlock:
    """Words of the title block."""

    name: str
    number: str
    revision: str
    material: str
    mass: str
    author: str
    date: str
    checked: str
    organisation: str
    step: str
    general: str

    @property
    def title(self) -> str:
        """Name, number and revision in one line."""
        found = [self.name, *(text for text in (self.number,) if text != _NONE)]
        return ", ".join([*found, *(f"revision {text}" for text in (self.revision,) if text != _NONE)])


def title_block(lens: Lens, part: Part, words: DrawingSection) -> TitleBlock:
    """Words for the shop, and from the record of the part: author and date are those of its files."""
    spec, signature = lens.spec, part.signature
    stamp = part.files[STEP_FILE]
    return TitleBlock(
        name=words.part_name or spec.name,
        number=words.part_number or _NONE,
        revision=words.revision or _NONE,
        material=spec.lens.material or _NONE,
        mass=f"{part.volume_mm3:.1f} mm³" if part.mass_g is None else f"{part.mass_g:.3f} g",
        author=signature.author or _NONE,
        date=signature.date or _NONE,
        checked=words.checked_by or _NONE,
        organisation=signature.organisation or _NONE,
        step=f"{STEP_FILE}, SHA-256 {stamp.sha256[:16]}…",
        general=words.general_tolerances or f"{_NONE}, to be agreed",
    )


def scale_words(scale: float) -> str:
    """The scale as ISO 5455 writes it."""
    return f"{scale:g} : 1" if scale >= 1.0 else f"1 : {1.0 / scale:g}"


def draw_title_block(words: TitleBlock, corner: tuple[float, float], unit: float, scale: float, sheet: str) -> Marks:
    """The block, its lower right corner at ``corner``."""
    left, bottom = corner[0] - WIDTH * unit, corner[1]
    height = ROW * unit
    quantity = "Mass" if words.mass.endswith("g") else "Volume"
    rows = [
        [words.name],
        [f"Number: {words.number}", f"Revision: {words.revision}"],
        [f"Material: {words.material}", f"{quantity}: {words.mass}"],
        [f"Drawn: {words.author}", f"Date: {words.date}"],
        [f"Checked: {words.checked}", f"Organisation: {words.organisation}"],
        [f"Sizes “general”: {words.general}", "Units: mm, degrees"],
        [f"Scale: {scale_words(scale)}", f"First angle; {sheet}, sheet 1 of 1"],
        [f"Defined by: {words.step}"],
    ]
    top = bottom + HEIGHT * unit
    strokes: list[Stroke] = []
    texts: list[Words] = []
    for number, each in enumerate(rows):
        low, wide = top - (number + 1) * height, WIDTH * unit / len(each)
        for k, text in enumerate(each):
            more = cell((left + k * wide, low, left + (k + 1) * wide, low + height), text, unit)
            strokes, texts = [*strokes, *more[0]], [*texts, *more[1]]
    symbol = first_angle((corner[0] - 14.0 * unit, bottom + 1.5 * height), 0.7 * unit)
    outside = frame_of((left, bottom, corner[0], top), "outline")
    return [*strokes, *symbol[0], outside], texts


def sheet_frame(size: tuple[float, float], inside: Box) -> list[Stroke]:
    """The frame of the drawing, and the marks at the middle of its sides."""
    left, bottom, right, top = inside
    width, height = size
    found = [frame_of(inside, "outline")]
    for start, end in (
        ((width / 2.0, 0.0), (width / 2.0, bottom)),
        ((width / 2.0, top), (width / 2.0, height)),
        ((0.0, height / 2.0), (left, height / 2.0)),
        ((right, height / 2.0), (width, height / 2.0)),
    ):
        found.append(Stroke(np.array([start, end]), "outline"))
    return found
