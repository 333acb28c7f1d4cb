"""Which pictures the page shows of the results at hand, and what is written under each."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from lensforge.report import flux_figures, history_figures, irradiance_figures, section_figures, surface_figures
from lensforge.report.drawing import to_svg
from lensforge.figures.light_unit import light_unit
from lensforge.report.numerals import number, percent
from lensforge.report.records import FaceRecord
from lensforge.report.results import Results
from lensforge.report.snapshot_figure import snapshot_figure
from lensforge.report.snapshots import load_snapshots
from lensforge.spec.source import SquareSource

_FIRST = 4.6  # inches: half of the page


@dataclass(frozen=True)
class Picture:
    """A figure as SVG, a short title and a caption."""

    svg: str
    title: str
    caption: str


def picture(name: str, figure: Figure, title: str, caption: str = "") -> Picture:
    """``figure`` as it enters a page; ``name`` is unique on the page."""
    return Picture(to_svg(figure, name, title), title, caption)


def first_picture(results: Results) -> Picture | None:
    """The light, as the page opens with it."""
    if results.evaluate is None or results.images is None:
        return None
    side, reached, unit = results.evaluate.receiver_mm, results.images["irradiance"], light_unit(results.lens.spec)
    figure = irradiance_figures.irradiance_map(reached, side, float(reached.max()) or 1.0, unit=unit, width=_FIRST)
    distance = results.lens.spec.target.distance_mm
    return picture("first", figure, "The light", f"Simulated {unit.quantity} at {distance:g} mm.")


def irradiance_pictures(results: Results) -> list[Picture]:
    """Target, simulated irradiance and their difference."""
    if results.evaluate is None or results.images is None:
        return []
    side, images = results.evaluate.receiver_mm, results.images
    target, reached, unit = images["target"], images["irradiance"], light_unit(results.lens.spec)
    top = float(max(target.max(), reached.max())) or 1.0
    draw = irradiance_figures.irradiance_map
    record = results.evaluate
    mask = results.lens.spec.target.uniform_mm
    dashed = f" Dashed: the mask of {mask:g} mm." if mask else ""
    simulated = f"{number(record.rays)} rays, {record.pixels} × {record.pixels} pixels. {_typeset(record.filter)}."
    if len(reached) > irradiance_figures.MOST_DRAWN:
        simulated += f" Drawn as means on {irradiance_figures.MOST_DRAWN} pixels a side."
    wanted_map = draw(target, side, top, target, unit=unit)
    reached_map = draw(reached, side, top, target, mask, unit)
    difference = irradiance_figures.difference_map(reached - target, side, unit)
    return [
        picture("target", wanted_map, "Target", "Scaled to the simulated flux. Line: half peak."),
        picture("simulated", reached_map, "Simulated", f"{simulated} Line: the target's.{dashed}"),
        picture("difference", difference, "Simulated less target", "Red: too bright. Blue: too dark."),
    ]


def _typeset(text: str) -> str:
    return text.replace("pixel^2", "pixel²").replace("3x3", "3 × 3")


def line_pictures(results: Results) -> list[Picture]:
    """Cross-sections of target and simulation."""
    if results.evaluate is None or results.images is None:
        return []
    side, target, reached = results.evaluate.receiver_mm, results.images["target"], results.images["irradiance"]
    draw, unit = irradiance_figures.line_comparison, light_unit(results.lens.spec)
    return [
        picture(f"line{index}", draw(line, target, reached, side, unit), f"Along {name}")
        for index, (name, line) in enumerate(irradiance_figures.telling_lines(target, side))
    ]


def flux_pictures(results: Results) -> list[Picture]:
    """Isolines, how the flux gathers around the axis, and the flux account."""
    if results.evaluate is None:
        return []
    record, pictures = results.evaluate, []
    if results.images is not None:
        target, side = results.images["target"], record.receiver_mm
        level = float(target.max()) or 1.0
        lines = irradiance_figures.isolines(results.images["irradiance"], side, level, light_unit(results.lens.spec))
        gathered = irradiance_figures.encircled_energy(target, results.images["raw"], side)
        pictures = [
            picture("isolines", lines, "Isolines", "Of the simulation, in per cent of the target's peak."),
            picture("encircled", gathered, "Encircled energy", "Around the axis, out to the corners."),
        ]
    account = flux_figures.flux_account(record.flux, record.missed_by_cause)
    window = f"Window: {record.window_mm:g} × {record.window_mm:g} mm."
    return [*pictures, picture("flux", account, "Flux account", window)]


def history_pictures(results: Results) -> list[Picture]:
    """Loss, efficiency and constraints over the search."""
    if results.design is None or not any(level.nmse for level in results.design.history):
        return []
    levels = results.design.history
    caption = "Numbers above: functions of each surface that are free to move."
    pictures = [
        picture("error", history_figures.history(levels, "nmse"), "Pattern error by level", caption),
        picture("gain", history_figures.history(levels, "efficiency"), "Efficiency by level"),
    ]
    if all(len(level.loss) == len(level.nmse) for level in levels):
        total = "All that the optimiser lessens: the pattern's error and what constraints and bounds add to it."
        pictures.insert(0, picture("loss", history_figures.history(levels, "loss"), "Loss by level", total))
    if all(level.g1_mm and level.g2_mm and level.g3_mm for level in levels):
        margins = history_figures.constraint_history(levels)
        caption = "Least of g1, g2, g3 over the lens. Below 0 (red) the lens is not allowed."
        pictures.append(picture("margins", margins, "Constraints by level", caption))
    return pictures


def snapshot_pictures(results: Results) -> list[Picture]:
    """The levels of the search, all on one scale."""
    taken, unit = load_snapshots(results.directory, results.lens), light_unit(results.lens.spec)
    steepest = max((float(np.abs(each.slope).max()) for each in taken), default=None)
    top = max((float(each.irradiance.max()) for each in taken), default=None)
    return [
        picture(
            f"level{each.level}",
            snapshot_figure(
                each.surface_mm, each.slope, each.irradiance, each.receiver_mm, unit, steepest=steepest, top=top
            ),
            f"Level {each.level}: {each.functions} functions",
            f"After step {each.step}: NMSE {number(each.nmse, 3)}, efficiency {percent(each.efficiency)}.",
        )
        for each in taken
    ]


def section_pictures(results: Results) -> list[Picture]:
    """The lens in two sections."""
    outline = source_outline(results)
    return [
        picture(
            f"section{azimuth:.0f}",
            section_figures.lens_section(results.lens, azimuth, outline),
            f"Section at φ = {azimuth:.0f}°",
        )
        for azimuth in (0.0, 90.0)
    ]


def source_outline(results: Results) -> Float[np.ndarray, "k 3"] | None:
    """A polygon (mm) around the emitting area: of the spec, or as the design noted it of a ray file."""
    source = results.lens.spec.source
    if isinstance(source, SquareSource):
        corners = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
        return 0.5 * source.side_mm * corners
    noted = None if results.design is None else results.design.source_outline_mm
    return None if noted is None else np.array(noted, dtype=np.float64)


def surface_pictures(results: Results) -> list[list[Picture]]:
    """Sag, curvature and what the cutter leaves, for each face."""
    if results.check is None or results.maps is None:
        return []
    faces = {"inner": results.check.inner, "outer": results.check.outer}
    return [_face_pictures(name, face, results.maps) for name, face in faces.items()]


def _face_pictures(name: str, face: FaceRecord, maps: dict[str, Float[np.ndarray, "n n"]]) -> list[Picture]:
    sphere, cutter = face.best_fit_sphere, face.cutter
    sag, kappa, left = (maps[f"{name}_{key}"] for key in ("sag_mm", "kappa_min", "residual_mm"))
    pv, rms, radius = number(sphere.pv_mm, 4), number(sphere.rms_mm, 4), number(sphere.radius_mm, 5)
    pictures = [
        picture(
            f"sag-{name}",
            surface_figures.sag_map(sag),
            f"{name.capitalize()} face: departure from a sphere",
            f"Best-fit sphere R = {radius} mm; PV {pv} mm, rms {rms} mm.",
        ),
        picture(
            f"curvature-{name}",
            surface_figures.curvature_map(kappa, cutter.radius_mm),
            f"{name.capitalize()} face: curvature",
            f"Hollow is negative. Line: −1/R of the mill, R = {cutter.radius_mm:g} mm.",
        ),
    ]
    if (left > 0.0).any():
        caption = f"The mill reaches {percent(cutter.reachable_fraction, 2)} of the face (grey)."
        title = f"{name.capitalize()} face: left by the mill"
        pictures.append(picture(f"uncut-{name}", surface_figures.uncut_map(left), title, caption))
    return pictures
