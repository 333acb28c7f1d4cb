"""Place of an LED in the lens: the point of its ray file that became the lens origin, its turn, tilt and shift."""

from collections.abc import Iterator
from typing import Literal

from lensforge.results import Fact, Group, Number, Point, Positive, Record, Text
from lensforge.results.numerals import number, quantity
from lensforge.sources.source_summary import SourceSummary
from lensforge.spec.emitter_section import EmitterSection
from lensforge.spec.source_sections import Placement

Origin = Literal["file", "virtual_focus", "point"]
_FOUND: dict[Origin, str] = {
    "file": "the file’s own origin",
    "virtual_focus": "the virtual focus of its rays",
    "point": "the point that the spec states",
}


class FileOrigin(Record):
    """Point of a ray file (mm) that became the lens origin, and how it was ``found``.

    ``axis``: direction of the file that became +z; ``mirror``: axis of the file that was turned around, or "none".
    """

    found: Origin
    at_mm: Point
    axis: Text
    scale: Positive
    mirror: Text

    def steps(self) -> Iterator[str]:
        """Phrases for the transformations of the file's rays."""
        yield f"{_FOUND[self.found]} put at the lens origin, its {self.axis} along the lens’s +z"
        if self.scale != 1.0:
            yield f"scaled by {number(self.scale)}"
        if self.mirror != "none":
            yield f"mirrored in {self.mirror}"


class SourcePlace(Record):
    """Turn (deg) of a source about z, its tilt about x, then y, and its shift (mm); of a ray file its origin, too."""

    file: FileOrigin | None
    rotate_z_deg: Number
    tilt_deg: tuple[Number, Number]
    position_mm: Point

    @staticmethod
    def of(section: EmitterSection, summary: SourceSummary) -> "SourcePlace | None":
        """The place of the source of a spec; None for an emitting area without displacement."""
        file = None
        if isinstance(section, Placement) and summary.placement is not None:
            origin: Origin = section.origin if isinstance(section.origin, str) else "point"
            stated = {name: getattr(section, name) for name in ("axis", "scale", "mirror")}
            file = FileOrigin(found=origin, at_mm=summary.placement.origin_mm, **stated)
        elif not section.pose.moves:
            return None
        pose = {name: getattr(section, name) for name in ("rotate_z_deg", "tilt_deg", "position_mm")}
        return SourcePlace(file=file, **pose)

    def group(self) -> Group:
        """Its facts, with notes for a line of a screen."""
        facts = tuple(self._facts())
        return Group("place", "Place of the LED", facts, "; ".join(fact.note for fact in facts if fact.note))

    def _facts(self) -> Iterator[Fact]:
        if self.file is not None:
            done = ", ".join(self.file.steps())
            yield Fact("file_origin", "Origin in the file", _listed(self.file.at_mm, "mm"), note=done)
        turn = f", after a turn of {quantity(self.rotate_z_deg, '°')} about z" if self.rotate_z_deg else ""
        yield Fact("led_tilt", "Tilted by", _listed(self.tilt_deg, "°"), note=f"about x, then y{turn}")
        yield Fact("led_position", "Shifted by", _listed(self.position_mm, "mm"))


def _listed(values: tuple[float, ...], unit: str) -> str:
    return f"({', '.join(number(value) for value in values)}){'' if unit == '°' else ' '}{unit}"
