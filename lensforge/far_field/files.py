"""IES, EULUMDAT, TM-33 and TM-25 files of the far field, and their flux as read back."""

import numpy as np

from lensforge.far_field.photometry import IES_FILE, LDT_FILE, TM25_FILE, TM33_FILE, WrittenFile, WrittenFiles
from lensforge.files import temporary_folder
from lensforge.sources.bundle import RayBundle
from lensforge.sources.photometric import PhotometricFile, read_photometric, write_photometric
from lensforge.sources.photometric.ies_labels import NEWEST, IesVersion
from lensforge.sources.rayfiles import RayFile, read_rayfile, write_rayfile
from lensforge.sources.rayfiles.rayfile import HeaderValue, shared_wavelength
from lensforge.sources.spectrum import Spectrum

_FAR_FIELDS = {"ies": IES_FILE, "ldt": LDT_FILE, "tm33": TM33_FILE}


def photometric_files(
    photometric: PhotometricFile,
    rays: RayBundle,
    rays_lm: float | None,
    spectrum: Spectrum | None,
    ies_version: IesVersion = NEWEST,
) -> dict[str, bytes]:
    """Bytes of the four files, by name; ``rays_lm``: flux of ``rays``, where it is known."""
    with temporary_folder(TM25_FILE) as folder:
        for name in _FAR_FIELDS.values():
            write_photometric(folder / name, photometric, ies_version=ies_version)
        write_rayfile(folder / TM25_FILE, _rayfile(photometric, rays, rays_lm, spectrum), "tm25")
        return {name: (folder / name).read_bytes() for name in (*_FAR_FIELDS.values(), TM25_FILE)}


def _rayfile(
    photometric: PhotometricFile, rays: RayBundle, rays_lm: float | None, spectrum: Spectrum | None
) -> RayFile:
    """Rays in W, with their lumens in the header, and the spectrum: one wavelength, or a table of all rays."""
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
    found = {}
    with temporary_folder(TM25_FILE) as folder:
        for name, content in contents.items():
            (folder / name).write_bytes(content)
        for key, name in _FAR_FIELDS.items():
            back = float(read_photometric(folder / name).intensity.flux())
            found[key] = WrittenFile(lumens=back, relative_error=abs(back / (exit_w * lumens_per_watt) - 1.0))
        rayfile = read_rayfile(folder / TM25_FILE)
        count, watts, lumens = len(rayfile), float(rayfile.ray_sum()), rayfile.header_flux_lm
        del rayfile  # it maps the file, which is deleted next
    error = float(np.abs(watts / exit_w - 1.0))
    tm25 = WrittenFile(rays=count, watts=watts, lumens=lumens, relative_error=error)
    return WrittenFiles(**found, tm25ray=tm25)
