"""Sections of the report on the lens and its part: search, sections, faces, verification, stray light, files."""

import hashlib
import os
from collections.abc import Collection
from dataclasses import dataclass
from heapq import nsmallest
from pathlib import Path
from urllib.parse import quote

import numpy as np
from jaxtyping import Float

from lensforge.cad.form_error import remember_fit
from lensforge.cad.part import Part
from lensforge.errors import refused
from lensforge.light.ray_lines import fan_tables
from lensforge.proof.proof_facts import stray_budget
from lensforge.proof.proof_result import Proof, ReceiverProof, StrayLight
from lensforge.report import lens_figures, light_figures, study_figures
from lensforge.report.light_section import top_of, unit_of_light
from lensforge.report.page import PagePicture, numbered, picture
from lensforge.report.results import REPORT_FILE, Results
from lensforge.results.files import MIB
from lensforge.results.numerals import number, size
from lensforge.results.record import printable
from lensforge.search.design_result import Design
from lensforge.shop import surface_figures
from lensforge.shop.check_facts import face_title
from lensforge.shop.check_measures import FaceResult
from lensforge.shop.check_result import Check
from lensforge.sources.build_source import build_source
from lensforge.spec.source_sections import SquareSource

_PURPOSES = {
    ".step": "solid for CAD and CAM",
    ".stl": "mesh",
    ".3mf": "mesh for printers",
    ".glb": "model for pages and renderers, glTF",
    ".gldf": "luminaire for DIALux and Relux, GLDF",
    ".ies": "intensity, IES LM-63",
    ".iesxml": "intensity, ANSI/IES TM-33",
    ".ldt": "intensity, EULUMDAT",
    ".tm25ray": "rays that leave the lens, ANSI/IES TM-25",
    ".dxf": "drawing for CAD",
    ".pdf": "drawing to print",
    ".html": "page",
    ".csv": "table",
}


_MOST_FILES = 200  # on the page; a folder of results has 40
_MOST_HASHED_BYTES = 1024 * MIB  # of a file; no reader takes a larger one


@dataclass(frozen=True)
class FileRow:
    """One file: its name, size and SHA-256; hash, ``purpose`` and ``link`` are empty if there is none."""

    name: str
    size: str
    sha256: str
    purpose: str
    link: str = ""


def history_pictures(results: Results) -> list[PagePicture]:
    """Merit function, pattern error, efficiency and constraints over the search."""
    design = results.find(Design)
    if design is None or not any(level.nmse for level in design.history):
        return []
    levels = design.history
    draw = lens_figures.history
    total = "Minimised by the optimiser: pattern error plus penalties for constraints and limits."
    free = "Numbers above: free basis functions of each surface."
    least = "Minimum margin over the lens of clearance, thickness and radius. Below 0 (red) a constraint is violated."
    by_pattern = results.spec.optimise.aim == "pattern"
    return [
        picture("loss", draw(levels, "loss"), "Merit function by level", total),
        *([picture("error", draw(levels, "nmse"), "Pattern error by level", free)] if by_pattern else []),
        picture("efficiency", draw(levels, "efficiency"), "Efficiency by level"),
        picture("margins", lens_figures.constraint_history(levels), "Constraints by level", least),
    ]


def section_pictures(results: Results) -> list[PagePicture]:
    """The lens in two sections."""
    lens = results.lens
    outline = source_outline(results)
    traced = fan_tables(results.lens)
    part = results.find(Part)
    if part is not None:
        remember_fit(lens, part.nodes)
    reach = lens_figures.reach_mm(lens)
    figures = {at: lens_figures.lens_section(lens, at, outline, reach, traced) for at in (0.0, 90.0)}
    return [picture(f"section{at:.0f}", figure, f"Section at φ = {at:.0f}°") for at, figure in figures.items()]


def source_outline(results: Results) -> Float[np.ndarray, "k 3"] | None:
    """A polygon (mm) around the emitting area: from the design's record, or from the spec where that says it."""
    source = results.spec.in_first_state.source
    design = results.find(Design)
    if design is not None and design.source_outline_mm:
        return np.array(design.source_outline_mm, dtype=np.float64)
    return build_source(source).outline() if isinstance(source, SquareSource) else None


def fault_pictures(results: Results) -> list[PagePicture]:
    """Maps of the faces that cannot be made as designed, by what is in the way."""
    check = results.find(Check)
    if check is None:
        return []
    title = "{}: where it cannot be made"
    return [
        picture(f"faults-{at.face}", surface_figures.fault_map(at.kinds), title.format(face_title(at.face)))
        for at in check.faults
    ]


def surface_pictures(results: Results) -> list[list[PagePicture]]:
    """Sag, curvature and uncut material, for each face."""
    check = results.find(Check)
    if check is None:
        return []
    return [_face_pictures(name, face) for name, face in check.faces.items()]


def _face_pictures(name: str, face: FaceResult) -> list[PagePicture]:
    face_name = face_title(name)
    pictures = []
    sag = face.sag_mm
    kappa = face.kappa_min
    left = face.residual_mm
    if np.isfinite(sag).any():
        title = f"{face_name}: departure from a sphere"
        pictures.append(picture(f"sag-{name}", surface_figures.sag_map(sag), title, "From the best-fit sphere."))
    if np.isfinite(kappa).any():
        drawn = surface_figures.curvature_map(kappa, None if face.cutter is None else face.cutter.radius_mm)
        caption = "Concave is negative." + ("" if face.cutter is None else f" Line: −1/R of the {face.cutter.tool}.")
        pictures.append(picture(f"curvature-{name}", drawn, f"{face_name}: curvature", caption))
    if (left > 0.0).any() and face.cutter is not None:
        tool = face.cutter.tool
        title = f"{face_name}: left uncut by the {tool}"
        pictures.append(
            picture(f"uncut-{name}", surface_figures.uncut_map(left), title, f"Grey: reached by the {tool}.")
        )
    return pictures


def verification_pictures(results: Results) -> list[list[PagePicture]]:
    """Light of the design, of the part, and their difference, for each receiver."""
    proof = results.find(Proof)
    rows = list[list[PagePicture]]()
    if proof is None:
        return rows
    for index, case in enumerate(proof.cases("receivers")):
        receiver = case.record
        chart = receiver.chart
        unit = unit_of_light(results, far_field=receiver.far_field, led=case.led)
        design = receiver.design_irradiance
        part = receiver.irradiance
        top = top_of([design, part])
        rays = f"{number(case.result.rays)} rays cast through the exported mesh."
        noise = "Where the two agree, only ray noise is left."
        draw = light_figures.irradiance_map
        difference = light_figures.difference_map(part - design, chart, unit)
        rows.append(
            [
                picture(numbered("design", index), draw(design, chart, top, unit=unit), case.title("Design")),
                picture(numbered("part", index), draw(part, chart, top, unit=unit), case.title("Exported part"), rays),
                picture(numbered("part-minus-design", index), difference, case.title("Part minus design"), noise),
            ]
        )
    return rows


def gap_pictures(results: Results) -> list[PagePicture]:
    """Distances between each referee's landings and the design's, as distributions, for each receiver."""
    proof = results.find(Proof)
    if proof is None:
        return []
    caption = "Cumulative distribution of the ray displacement."
    return [
        picture(
            numbered("gaps", index),
            study_figures.gap_figure(
                _quantiles(case.record), case.record.deviation_limit_mm, far_field=case.record.far_field
            ),
            case.title("Ray displacement"),
            caption,
        )
        for index, case in enumerate(proof.cases("receivers"))
    ]


def _quantiles(receiver: ReceiverProof) -> dict[str, Float[np.ndarray, " q"]]:
    named = {
        "exported mesh": receiver.gaps_mesh_mm,
        "STEP file": receiver.gaps_step_mm,
        "mesh, by Mitsuba": receiver.gaps_mitsuba_mm,
    }
    return {name: quantiles for name, quantiles in named.items() if quantiles is not None}


def stray_pictures(results: Results) -> list[list[PagePicture]]:
    """Flux budget with all reflections, stray light, and all light minus the design's model, for each receiver."""
    stray = results.find(StrayLight)
    rows = list[list[PagePicture]]()
    if stray is None:
        return rows
    for index, case in enumerate(stray.cases("receivers")):
        receiver = case.record
        chart = receiver.chart
        unit = unit_of_light(results, far_field=receiver.far_field, led=case.led)
        scattered = light_figures.irradiance_map(receiver.stray, chart, top_of([receiver.stray]), unit=unit)
        change = light_figures.difference_map(receiver.direct + receiver.stray - receiver.sequential, chart, unit)
        budget = light_figures.waterfall(*stray_budget(receiver))
        scale = "No stray light lands on the receiver." if not receiver.stray.any() else "On its own scale."
        detected = "Green: detected in the window."
        less = "Red: the design predicts too little."
        rows.append(
            [
                picture(
                    numbered("stray-budget", index), budget, case.title("Flux budget with all reflections"), detected
                ),
                picture(numbered("stray-light", index), scattered, case.title("Stray light on the receiver"), scale),
                picture(numbered("unmodelled", index), change, case.title("All light minus the design's model"), less),
            ]
        )
    return rows


def exported_files(results: Results) -> list[FileRow]:
    """Files of the part, as they were exported."""
    part = results.find(Part)
    stamps = {} if part is None else part.files
    return [FileRow(name, size(stamp.bytes), stamp.sha256, _purpose(name)) for name, stamp in stamps.items()]


def folder_files(folder: Path, part_files: Collection[str], linked: bool) -> list[FileRow]:
    """Files in ``folder`` but report and hidden ones, ``linked`` or not; those named in ``part_files`` with a hash.

    Nobody knows the others: they may have any size, and stand with it alone. A link is named and not followed, so that
    no file of another folder gets onto the page. Raises :class:`InputError` if unreadable.
    """
    with refused(folder, "cannot be read (…)", OSError), os.scandir(folder) as entries:
        files = (entry for entry in entries if entry.is_symlink() or entry.is_file(follow_symlinks=False))
        shown = (file for file in files if file.name != REPORT_FILE and not file.name.startswith("."))
        first = nsmallest(_MOST_FILES + 1, shown, key=lambda path: (path.name not in part_files, path.name))
    paths = sorted(Path(path) for path in first[:_MOST_FILES])
    rows = [_file_row(path, path.name in part_files, linked) for path in paths]
    return rows if len(first) <= _MOST_FILES else [*rows, FileRow("further files", "", "", "")]


def _file_row(path: Path, of_part: bool, linked: bool) -> FileRow:
    name = printable(os.fsencode(path.name).decode(errors="replace"))
    if path.is_symlink():
        return FileRow(name, "a link", "", "")
    with refused(path, "cannot be read (…)", OSError):
        length = path.stat(follow_symlinks=False).st_size
        digest = ""
        if of_part and length <= _MOST_HASHED_BYTES:
            with path.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
    return FileRow(name, size(length), digest, _purpose(name), quote(os.fsencode(path.name)) if linked else "")


def _purpose(name: str) -> str:
    return _PURPOSES.get(Path(name).suffix.lower(), "")
