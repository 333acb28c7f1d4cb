"""Numbers of the measured part that the report must show, by their label: photograph, surfaces, correction."""

from shown_numbers import shown, with_error
from wanted_light import ASKED

from lensforge.made.measurement_result import PhotoComparison

_PHOTO = "A photograph of its light"


def measured_numbers(results):
    """Entries of every measurement in the folder."""
    photo = results.find(PhotoComparison)
    if photo is not None:
        yield from _photo_card(photo)
        yield from _placed(photo_numbers(photo), _PHOTO)
        for axis in "xy":
            title = f"Along {axis} = 0"
            yield shown(f"The measured part / {_more(_PHOTO)} / {title} / title", title)
    for side, surface in results.surfaces.items():
        title = f"The {side} surface, measured"
        yield from _surface_card(side, surface)
        yield from _placed(surface_numbers(surface), title)
        caption = f"The measured part / {_more(title)} / Simulated light / figcaption"
        yield shown(caption, f"Simulated with the measured {side} surface, {{}} rays.", surface.rays)
    for side, made in results.corrections.items():
        title = f"The {side} surface, corrected for a second cut"
        yield from _placed(correction_numbers(made), title)


def _more(title):
    return f"More, with pictures: {title[:1].lower()}{title[1:]}"


def _placed(rows, title):
    """Entries of ``rows``: those of the first facts under ``title``, the others in its fold."""
    for each in rows:
        where = title if each.label in _SEEN else _more(title)
        yield shown(f"The measured part / {where} / {each.label}", each.words, *each.values)


# Facts that are seen at once; the others are folded away.
_SEEN = (
    "Similarity (SSIM) to the simulation", "NMSE against the simulation", "Displacement of the light along x",
    "Points", "Surface measured", "Form deviation, smooth", "Residual of the points after it",
    "File", "Deviation of the first cut", "Correction", "Expected deviation of the second cut",
)  # fmt: skip


def _photo_card(photo):
    yield shown(f"{ASKED} / card / Photograph", "{}", photo.ssim)
    yield shown(f"{ASKED} / card / Photograph / note", "SSIM, 1 is equal; NMSE {} between", photo.nmse)


def _surface_card(side, surface):
    form, card = surface.form_deviation_um, f"{ASKED} / card / {side.capitalize()} form"
    yield shown(card, "{} µm", form.pv)
    yield shown(f"{card} / note", "rms {} µm, by {} points", form.rms, surface.point_count)


def photo_numbers(photo):
    """Numbers of a photograph, by the name of their fact."""
    found = photo.alignment
    yield shown("Similarity (SSIM) to the simulation", "{}", photo.ssim)
    yield shown("NMSE against the simulation", "{}", photo.nmse)
    yield with_error("Displacement of the light along x", found.displacement_x_mm, " mm")
    yield with_error("Displacement of the light along y", found.displacement_y_mm, " mm")
    yield with_error("Size of the light over the simulated", found.scale)
    yield shown("SSIM and NMSE once aligned", "{}, {}", photo.aligned.ssim, photo.aligned.nmse)
    even = photo.measured_evenness.uniformity, photo.simulated_evenness.uniformity
    yield shown("Uniformity, measured", "{}, simulated {}", *even)
    yield with_error("Likely cause", found.scale).after("scale ")
    yield with_error("Likely cause", found.displacement_x_mm, " mm").after("along x ")
    yield shown("Clipped by the camera", "{}\u2009% of the target", 100.0 * photo.clipped)
    yield shown(
        "Target’s corners",
        "found in the photograph with the LED off, edges straight to {} pixel rms",
        photo.corners_located.edge_rms_px,
    )


def surface_numbers(surface):
    """Numbers of a measured surface, by the name of their fact."""
    form, design, part = surface.form_deviation_um, surface.design, surface.measured
    yield shown("Points", "{}, {}\u2009% of them on the surface", surface.point_count, 100.0 * surface.used_share)
    yield shown("Surface measured", "{}\u2009%", 100.0 * surface.covered_share)
    yield shown("Form deviation, smooth", "PV {} µm, rms {} µm", form.pv, form.rms)
    yield shown("Residual of the points after it", "{} µm rms", surface.residual_rms_um)
    shares = (100.0 * part.efficiency.value, 100.0 * design.efficiency.value)
    yield shown("Efficiency with this surface", "{}\u2009%, designed {}\u2009%", *shares)
    yield shown("NMSE of the pattern with this surface", "{}, designed {}", part.nmse.value, design.nmse.value)
    yield from _changes(surface.change)


def _changes(change):
    yield with_error("NMSE, change from the design", change.nmse)
    yield with_error("Efficiency, change from the design", change.efficiency)


def correction_numbers(made):
    """Numbers of a corrected face, by the name of their fact."""
    cutter, light = made.cutter, made.second_cut
    under = "" if made.conditions is None else f"_{made.conditions.name}"
    yield shown(
        "File",
        f"lens_corrected_{made.surface}{under}.step, AP214, form error {{}} nm as read back",
        made.form_error_nm.max,
    )
    extent = "{} µm rms, {} µm at most"
    yield shown("Deviation of the first cut", extent, made.deviation_um.rms, made.deviation_um.max)
    put = made.correction_um
    yield shown("Correction", f"{extent}, gain {{}}", put.rms, put.max, made.gain)
    yield shown("Expected deviation of the second cut", extent, made.expected_um.rms, made.expected_um.max)
    yield shown("Filter", "waves longer than {} mm", made.wavelength_mm)
    left = "{} µm rms; noise of the points {} µm"
    yield shown("Left out by the filter", left, made.residual_rms_um, made.noise_rms_um)
    radii = (cutter.concave_radius_mm, cutter.concave_radius_before_mm, cutter.cutter_radius_mm)
    yield shown("Smallest concave radius", "{} mm, designed {} mm, cutter {} mm", *radii)
    back = (cutter.cut_back_um.rms, cutter.cut_back_um.max, 100.0 * cutter.smoothed_more_share)
    yield shown("Cut back for the cutter", f"{extent} on {{}}\u2009% of the face", *back)
    yield shown("NMSE expected", "{}, designed {}", light.nmse.value, made.design.nmse.value)
    shares = (100.0 * light.efficiency.value, 100.0 * made.design.efficiency.value)
    yield shown("Efficiency expected", "{}\u2009%, designed {}\u2009%", *shares)
    yield from _changes(made.change)
