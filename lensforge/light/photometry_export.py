"""Export of the far field of the finished lens as IES, EULUMDAT, TM-33 and TM-25 files, verified by reading them back.

Only light that leaves the lens upwards is in the files: light that leaves it downwards meets the plane on which the
lens stands, and counts as missed_receiver. Gamma = 0 is the lens axis, C = 0 the x axis, C = 90 the -y axis, see
``sources.photometric.photometric_file``.
"""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.light.area_lamp import AreaLamp
from lensforge.light.by_intensities import judgements
from lensforge.light.exit_light import ExitLight
from lensforge.light.far_field import lamp_light, lamps_of_files, trace_far_field
from lensforge.light.luminaire_figures import LuminaireFigures, throw_of
from lensforge.light.luminous_opening import luminous_opening
from lensforge.light.photometry_result import (
    IES_FILE,
    LDT_FILE,
    LUMINAIRE_FILES,
    PLANES_DEG,
    TM25_FILE,
    TM33_FILE,
    CandelaTables,
    LostFlux,
    Photometry,
    WrittenFarFields,
    WrittenFile,
    WrittenFiles,
)
from lensforge.light.received_flux import named_flux
from lensforge.light.source_photometry import SourceLumens, figures_of_spectrum
from lensforge.results.estimates import scaled
from lensforge.scene.lens import Lens
from lensforge.sources.build_source import summarise
from lensforge.sources.joined_spectrum import spectrum_of_source
from lensforge.sources.photometric import PhotometricFile
from lensforge.sources.photometric.ies_labels import NEWEST, IesVersion
from lensforge.sources.photometric.photometric_file import LampSet
from lensforge.sources.photometric.photometric_io import encoded, photometric_of
from lensforge.sources.photometric.room_ratios import direct_ratios, flux_code
from lensforge.sources.ray_bundle import RayBundle, Source
from lensforge.sources.rayfiles.formats.tm25 import BINARY as TM25
from lensforge.sources.rayfiles.ray_file import HeaderValue, RayFile, shared_wavelength
from lensforge.sources.rayfiles.ray_file_io import decode
from lensforge.sources.rayfiles.ray_file_rows import FileImage
from lensforge.sources.source_spectrum import Spectrum
from lensforge.spec import Spec
from lensforge.spec.accuracy import Preset

_FAR_FIELDS = {"ies": IES_FILE, "ldt": LDT_FILE, "tm33": TM33_FILE}


def photometric_files(
    photometric: PhotometricFile,
    rays: RayBundle,
    rays_lm: float | None,
    spectrum: Spectrum | None,
    ies_version: IesVersion = NEWEST,
) -> dict[str, bytes]:
    """Bytes of the four files, by name; ``rays_lm``: flux of ``rays``, where it is known."""
    far_fields = {name: encoded(Path(name), photometric, ies_version) for name in _FAR_FIELDS.values()}
    return {**far_fields, TM25_FILE: b"".join(TM25.encode(_rayfile(photometric, rays, rays_lm, spectrum)))}


def _rayfile(
    photometric: PhotometricFile, rays: RayBundle, rays_lm: float | None, spectrum: Spectrum | None
) -> RayFile:
    """Rays in W, their lumens in the header, and the spectrum: a single wavelength, or one table for all rays."""
    header: dict[str, HeaderValue] = {
        "name": photometric.title,
        "creation_method": "simulated",
        "ray_file_creator": "lensforge",
        "date": photometric.issued,
        "additional_info": "; ".join(photometric.remarks),
    }
    waves = None
    if spectrum is not None and len(spectrum.wavelengths_nm) == 1:
        waves = shared_wavelength(float(spectrum.wavelengths_nm[0]), len(rays))
    elif spectrum is not None:
        nodes = spectrum.wavelengths_nm
        header["spectral_tables"] = [{"wavelength_nm": nodes.tolist(), "weight": spectrum.power_density.tolist()}]
        header |= {"wavelength_min_nm": float(nodes[0]), "wavelength_max_nm": float(nodes[-1])}
    watts = float(rays.flux.sum())
    return RayFile(
        rays.origins, rays.directions, rays.flux, "W", waves, header_flux_w=watts, header_flux_lm=rays_lm, header=header
    )


def read_back(contents: dict[str, bytes], exit_w: float, lumens_per_watt: float) -> WrittenFiles:
    """Flux of each file as read back, and its relative error from ``exit_w``, the flux of the rays."""
    exit_lm = exit_w * lumens_per_watt
    files = {key: _read_back(contents[name], name, exit_lm) for key, name in _FAR_FIELDS.items()}
    rayfile = decode(FileImage(Path(TM25_FILE), np.frombuffer(contents[TM25_FILE], dtype=np.uint8)))
    watts = float(rayfile.ray_sum())
    lumens = rayfile.header_flux_lm
    error = float(np.abs(watts / exit_w - 1.0))
    tm25 = WrittenFile(rays=len(rayfile), watts=watts, lumens=lumens, relative_error=error)
    return WrittenFiles(**files, tm25ray=tm25)


def _read_back(content: bytes, name: str, exit_lm: float) -> WrittenFile:
    lumens = float(photometric_of(content, name).intensity.flux())
    return WrittenFile(lumens=lumens, relative_error=abs(lumens / exit_lm - 1.0))


def _of_luminaire(
    lens: PhotometricFile, lenses: int, remarks: tuple[str, ...], ies_version: IesVersion
) -> dict[str, bytes]:
    """The files of a lamp of ``lenses`` equal lenses, with ``remarks``, by format; empty for one lens."""
    if lenses == 1:
        return {}
    light = replace(lens.intensity, values=lenses * lens.intensity.values)
    led = lens.lamps[0]
    lamps = (replace(led, lumens=lenses * (led.lumens or 0.0), count=lenses * led.count),)
    remarks = (*remarks, f"{lenses} equal lenses; their places are not known, the opening is that of one")
    whole = replace(lens, intensity=light, lamps=lamps, title=f"{lens.title}, {lenses} lenses", remarks=remarks)
    return {key: encoded(Path(name), whole, ies_version) for key, name in LUMINAIRE_FILES.items()}


_BEYOND = 1e-3  # of the light of lamps that are aimed; above it the files say that they lack it
_NOISY = 0.05  # rms of the nodes, relative; above it the files say that they are noisy


def measure_photometry(
    lens: Lens,
    source: Source,
    preset: Preset,
    *,
    rays: int | None = None,
    seed: int | None = None,
    lumens: float | None = None,
    ies_version: IesVersion = NEWEST,
    led: str = "",
) -> Photometry:
    """Trace the light of ``lens`` to its far field, and make its files; ``lumens``: luminous flux of the source.

    By default the flux stated by the spec or the source's file, or else 1000 lm: then candela are cd/klm, and record
    and files say so. Without ``rays`` as many are traced as the noise of the table asks for. ``seed``: by default the
    lens's own. ``ies_version``: year of LM-63, ``led``: name of the LED, of several, in the files. Of several lamps
    they hold the light of all, as it is seen from afar; of an infinite lattice that of one. The date of the files is
    that of the spec, as in all files for others. Raises :class:`InputError` for lumens that are not above 0 and finite,
    and if no light leaves the lens upwards.
    """
    if lumens is not None and not 0.0 < lumens < np.inf:
        raise InputError(f"lumens = {lumens:g}: must be above 0 and finite; leave it out to take those of the spec")
    started = time.perf_counter()
    summary = summarise(source, lens.spec.source)
    bright = SourceLumens.of(lumens, summary)
    section = lens.spec.photometry
    bright.require_known(section)
    lamps = lamps_of_files(lens.spec)
    if not bright.per_1000_lm:
        bright = replace(bright, lumens=len(lamps) * bright.lumens)
    source_w = len(lamps) * source.flux_w
    light = trace_far_field(lens, source, preset, rays=rays, seed=lens.seed if seed is None else seed)
    per_watt = bright.lumens / source_w
    fitted = light.intensity
    tables = CandelaTables.of(fitted, per_watt)
    candela = tables.whole
    exit_lm = scaled(light.exit_w, per_watt, "lm")
    light_output_ratio = scaled(light.exit_w, 1.0 / source_w, "")
    peak_cd = scaled(fitted.peak, per_watt, "cd")
    errors = fitted.standard_errors
    warnings = tuple(_warnings(bright, source, light, lens.spec))
    photometric = PhotometricFile(
        candela,
        (LampSet(bright.lumens, count=len(lamps), kind="LED"),),
        title=", ".join(filter(None, (f"lensforge {lens.spec.name}", led))),
        opening=luminous_opening(lens, lamps),
        remarks=(*warnings, *_remarks(light, per_watt)),
        issued=lens.spec.manufacture.date or "",
    )
    lamp = lamp_light(fitted, per_watt, section.street_side_deg)
    lost_w = named_flux(light.by_fate_w)
    known_lm = None if bright.per_1000_lm else exit_lm.value
    spectrum = spectrum_of_source(lens.spec.source, summary)
    contents = photometric_files(photometric, light.sample, known_lm, spectrum, ies_version)
    files = read_back(contents, light.exit_w.value, per_watt)
    all_lenses = section.lenses
    of_all = _of_luminaire(photometric, all_lenses, (*warnings, *_remarks(light, all_lenses * per_watt)), ies_version)
    all_lm = all_lenses * exit_lm.value
    wholes = {key: _read_back(content, LUMINAIRE_FILES[key], all_lm) for key, content in of_all.items()}
    luminaire = WrittenFarFields(**wholes) if wholes else None
    return Photometry(
        inputs={"lens": lens.sha256},
        rays=light.rays,
        source_w=source_w,
        exit_w=light.exit_w,
        light_output_ratio=light_output_ratio,
        lost_w=LostFlux(**{name: lost_w[name] for name in LostFlux.model_fields}),
        reflected_w=max(source_w - float(light.by_fate_w.sum()), 0.0),
        source_lm=bright.lumens,
        source_lm_from=bright.origin,
        per_1000_lm=bright.per_1000_lm,
        exit_lm=exit_lm,
        axis_cd=tables.axis_cd,
        peak_cd=peak_cd,
        peak_direction=tables.peak_direction,
        beam_c0=tables.plane(PLANES_DEG[0]),
        beam_c90=tables.plane(PLANES_DEG[1]),
        figures=LuminaireFigures(
            throw=None if bright.per_1000_lm else throw_of(peak_cd),
            flux_code=(*tables.figures_in_doubt(flux_code), light_output_ratio),
            direct_ratios=tables.figures_in_doubt(direct_ratios),
        ),
        spectrum=None if spectrum is None else figures_of_spectrum(spectrum),
        road=AreaLamp.of(section, lamp, exit_lm, light.zones_w * per_watt),
        node_error=fitted.node_error,
        interpolation_error=fitted.interpolation_error,
        warnings=warnings,
        files=files,
        luminaire=luminaire,
        c_deg=candela.c_deg,
        gamma_deg=candela.gamma_deg,
        candela=candela.values,
        candela_standard_error=np.zeros_like(candela.values) if errors is None else _turned_over(errors) * per_watt,
        ies=contents[IES_FILE],
        ldt=contents[LDT_FILE],
        tm33=contents[TM33_FILE],
        tm25=contents[TM25_FILE],
        **{f"luminaire_{key}": content for key, content in of_all.items()},
        **judgements(lens.spec, lamp, bright.lumens),
        seconds=time.perf_counter() - started,
    )


def _turned_over(values: Float[np.ndarray, "c g"]) -> Float[np.ndarray, "d g"]:
    """Values at equal steps of C, closed at 360 degrees, in the opposite sense of rotation."""
    return np.concatenate([values, values[:1]])[::-1]


def _warnings(bright: SourceLumens, source: Source, light: ExitLight, spec: Spec) -> Iterator[str]:
    if spec.all_lamps.period_mm is not None:
        yield "an infinite lattice has no far field: the files are those of one lamp"
    beyond = named_flux(light.by_fate_w)["missed_receiver"] / source.flux_w / len(spec.all_lamps)
    if spec.all_lamps.posed and beyond > _BEYOND:
        yield f"{beyond:.1%} of the light goes beyond 90 degrees from the z of the lamps, and is not in the files"
    if bright.per_1000_lm:
        yield (
            "luminous flux of the source not known: 1000 lm taken, so candela are per 1000 lm of the source; give "
            "--lumens, or source.flux_lm in the spec"
        )
    error = light.intensity.node_error
    if error is not None and error.rms > _NOISY:
        remedy = "take more rays" if source.ray_count is None else f"the source has {source.ray_count} rays"
        yield f"noise of the table {error.rms:.1%} rms where it is above a tenth of the peak; {remedy}"
    if error is None:
        yield f"{light.rays} ray: too few to state the noise of the table; take more rays"


def _remarks(light: ExitLight, per_watt: float) -> Iterator[str]:
    peak = light.intensity.peak
    error = light.intensity.node_error
    fitted = light.intensity
    if error is None:
        return
    yield (
        f"{light.rays} rays; standard error of the candela above a tenth of the peak {error.rms:.2%} rms, "
        f"{error.max:.2%} at most; interpolation error {fitted.interpolation_error or 0.0:.2%} of the peak, rms"
    )
    if peak.standard_error is not None:
        yield f"peak without noise {peak.value * per_watt:.5g} +- {peak.standard_error * per_watt:.2g} cd"
