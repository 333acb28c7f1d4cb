"""Which pictures the page shows of the results at hand, and what is written under each."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from lensforge.report import flux_figures, history_figures, irradiance_figures, section_figures, surface_figures
from lensforge.report.drawing import to_svg
from lensforge.report.numerals import number, percent
from lensforge.report.records import FaceRecord
from lensforge.report.results import Results
from lensforge.source_spec import SquareSource


@dataclass(frozen=True)
class Picture:
    """A figure as SVG, a short title and a caption."""

    svg: str
    title: str
    caption: str


def _picture(name: str, figure: Figure, title: str, caption: str = "") -> Picture:
    return Picture(to_svg(figure, name, title), title, caption)


def irradiance_pictures(results: Results) -> list[Picture]:
    """Target, simulated irradiance and their difference."""
    if results.evaluate is None or results.images is None:
        return []
    side, images = results.evaluate.receiver_mm, results.images
    target, reached = images["target"], images["irradiance"]
    top = float(max(target.max(), reached.max())) or 1.0
    draw = irradiance_figures.irradiance_map
    record = results.evaluate
    mask = results.lens.spec.target.uniform_mm
    dashed = f" Dashed: the mask of {mask:g} mm." if mask else ""
    simulated = f"{number(record.rays)} rays, {record.pixels} × {record.pixels} pixels. {record.filter}."
    if len(reached) > irradiance_figures.MOST_DRAWN:
        simulated += f" Drawn as means on {irradiance_figures.MOST_DRAWN} pixels a side."
    return [
        _picture("target", draw(target, side, top, target), "Target", "Scaled to the simulated flux. Line: half peak."),
        _picture(
            "simulated", draw(reached, side, top, target, mask), "Simulated", f"{simulated} Line: the target's.{dashed}"
        ),
        _picture(
            "difference",
            irradiance_figures.difference_map(reached - target, side),
            "Simulated less target",
            "Red: too bright. Blue: too dark.",
        ),
    ]


def line_pictures(results: Results) -> list[Picture]:
    """Cross-sections of target and simulation."""
    if results.evaluate is None or results.images is None:
        return []
    side, target, reached = results.evaluate.receiver_mm, results.images["target"], results.images["irradiance"]
    return [
        _picture(f"line{index}", irradiance_figures.line_comparison(line, target, reached, side), f"Along {name}")
        for index, (name, line) in enumerate(irradiance_figures.telling_lines(target, side))
    ]


def flux_pictures(results: Results) -> list[Picture]:
    """The flux account, and how the flux gathers around the axis."""
    if results.evaluate is None:
        return []
    record = results.evaluate
    account = flux_figures.flux_account(record.flux, record.missed_by_cause)
    pictures = [_picture("flux", account, "Flux account", f"Window: {record.window_mm:g} × {record.window_mm:g} mm.")]
    if results.images is not None:
        gathered = irradiance_figures.encircled_flux(
            results.images["target"], results.images["raw"], record.receiver_mm
        )
        pictures.append(_picture("encircled", gathered, "Encircled flux", "Around the axis, out to the corners."))
    return pictures


def history_pictures(results: Results) -> list[Picture]:
    """Loss and efficiency over the search."""
    if results.design is None or not any(level.nmse for level in results.design.history):
        return []
    levels = results.design.history
    caption = "Numbers above: functions of each surface that are free to move."
    return [
        _picture("loss", history_figures.history(levels, "nmse"), "Loss by level", caption),
        _picture("gain", history_figures.history(levels, "efficiency"), "Efficiency by level", caption),
    ]


def section_pictures(results: Results) -> list[Picture]:
    """The lens in two sections."""
    outline = source_outline(results)
    return [
        _picture(
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


def surface_pictures(results: Results) -> list[Picture]:
    """Sag, curvature and what the cutter leaves, face by face."""
    if results.check is None or results.maps is None:
        return []
    pictures = []
    for name, face in (("inner", results.check.inner), ("outer", results.check.outer)):
        pictures += _face_pictures(name, face, results.maps)
    return pictures


def _face_pictures(name: str, face: FaceRecord, maps: dict[str, Float[np.ndarray, "n n"]]) -> list[Picture]:
    sphere, cutter = face.best_fit_sphere, face.cutter
    sag, kappa, left = (maps[f"{name}_{key}"] for key in ("sag_mm", "kappa_min", "residual_mm"))
    pv, rms, radius = number(sphere.pv_mm, 4), number(sphere.rms_mm, 4), number(sphere.radius_mm, 5)
    pictures = [
        _picture(
            f"sag-{name}",
            surface_figures.sag_map(sag),
            f"{name.capitalize()} face: departure from a sphere",
            f"Best-fit sphere R = {radius} mm; PV {pv} mm, rms {rms} mm.",
        ),
        _picture(
            f"curvature-{name}",
            surface_figures.curvature_map(kappa, cutter.radius_mm),
            f"{name.capitalize()} face: curvature",
            f"Hollow is negative. Line: −1/R of the mill, R = {cutter.radius_mm:g} mm.",
        ),
    ]
    if (left > 0.0).any():
        caption = f"The mill reaches {percent(cutter.reachable_fraction, 2)} of the face (grey)."
        title = f"{name.capitalize()} face: left by the mill"
        pictures.append(_picture(f"uncut-{name}", surface_figures.uncut_map(left), title, caption))
    return pictures


def verification_pictures(results: Results) -> list[Picture]:
    """The design's picture, the part's, and their difference."""
    if results.verify is None or results.verified is None:
        return []
    side = results.lens.spec.target.receiver_mm
    design, part = results.verified["design_irradiance"], results.verified["irradiance"]
    top = float(max(design.max(), part.max())) or 1.0
    rays = f"{number(results.verify.rays)} rays cast through the exported mesh."
    return [
        _picture("design", irradiance_figures.irradiance_map(design, side, top), "Design"),
        _picture("part", irradiance_figures.irradiance_map(part, side, top), "Exported part", rays),
        _picture(
            "part-less-design",
            irradiance_figures.difference_map(part - design, side),
            "Part less design",
            "What is left where the two agree is the noise of the rays.",
        ),
    ]
