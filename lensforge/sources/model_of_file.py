"""The radiance fitted to a ray file: its picture beside the file's rays, and any number of rays drawn from it."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from lensforge.errors import shortened
from lensforge.results.files import replacing
from lensforge.sources.modelled_rays import ModelledRays, modelled
from lensforge.sources.ray_bundle import RayBundle
from lensforge.sources.ray_set import RaySetEmitter
from lensforge.sources.rayfiles.ray_file import RayFile, no_usable_ray
from lensforge.sources.stored_rays import StoredRays

_SEED = 0
_DRAWN = 2**20
_MOST_PIXELS = 48
_RAYS_IN_PIXEL = 100  # of all rays of the file
_CAP = np.cos(np.deg2rad(15.0))  # around each of five directions, from the axis and 45 degrees off it
_SIDES = {"+x": (1.0, 0.0), "+y": (0.0, 1.0), "-x": (-1.0, 0.0), "-y": (0.0, -1.0)}
_VIEWS = {"from the front": (0.0, 0.0), **{f"45° from {name}": side for name, side in _SIDES.items()}}


def model_of(rayfile: RayFile) -> ModelledRays:
    """The model of the rays of ``rayfile``, in its unit of flux. Raises :class:`InputError` if it has none."""
    stored = StoredRays.of(rayfile)
    if len(stored) == 0:
        raise no_usable_ray(rayfile, stored.dropped)
    model = modelled(RaySetEmitter(stored.loaded(), rayfile.total_flux()), "radiance")
    assert isinstance(model, ModelledRays)
    return model


def drawn_file(rayfile: RayFile, model: ModelledRays, count: int) -> RayFile:
    """``count`` rays of ``model`` as a file of the flux and common spectrum of ``rayfile``; its header says so."""
    rays = model.sample(count, _SEED)
    fields = ("manufacturer", "wavelength_min_nm", "wavelength_max_nm")
    header = {name: rayfile.header[name] for name in fields if name in rayfile.header}
    if len(rayfile.spectral_tables) == 1:
        header["spectral_tables"] = rayfile.header["spectral_tables"]
    header["name"] = str(rayfile.header.get("name") or Path(rayfile.path).stem)
    header["additional_info"] = f"drawn by lensforge from a {model.description}"
    return RayFile(
        rays.origins.astype(np.float32),
        rays.directions.astype(np.float32),
        rays.flux.astype(np.float32),
        rayfile.flux_unit,
        rays.wavelengths_nm,
        header_flux_w=rayfile.flux_in("W"),
        header_flux_lm=rayfile.flux_in("lm"),
        header=header,
        path=rayfile.path,
    )


def draw_model(rayfile: RayFile, model: ModelledRays, path: Path) -> None:
    """Write a picture to ``path``, PNG, SVG or PDF: the luminance from five directions and the far field.

    Rows: of the file, of the model, and their difference relative to the brightest.
    """
    import matplotlib.style
    from matplotlib.figure import Figure

    pairs = list(_pictures(model))
    with matplotlib.style.context("default"), replacing(path) as temporary:
        figure = Figure(figsize=(15.0, 7.5), layout="constrained")
        figure.suptitle(f"{shortened(Path(rayfile.path).name)}: {model.description}", parse_math=False, fontsize=10)
        axes = figure.subplots(3, len(pairs))
        for column, (title, extent, images) in enumerate(pairs):
            brightest = max(float(image.max()) for image in images) or 1.0
            rows = (*(image / brightest for image in images), (images[1] - images[0]) / brightest)
            for row, (image, name) in enumerate(zip(rows, ("file", "model", "model less file"), strict=True)):
                limits = (
                    {"vmin": -0.3, "vmax": 0.3, "cmap": "RdBu_r"}
                    if row == 2
                    else {"vmin": 0, "vmax": 1, "cmap": "inferno"}
                )
                axes[row, column].imshow(image.T, origin="lower", extent=extent, interpolation="nearest", **limits)
                axes[row, column].set(title=title if row == 0 else "", xlabel="", ylabel=name if column == 0 else "")
        figure.savefig(temporary, dpi=120)


_Picture = tuple[str, tuple[float, float, float, float], list[Float[np.ndarray, "p p"]]]


def _pictures(model: ModelledRays) -> Iterator[_Picture]:
    """Title, frame (mm, or direction cosines), and the pictures of file and model, each of all its flux."""
    surface = model.radiance.surface
    sets = [RayBundle.joined([model.lit, model.stray]), model.sample(_DRAWN, _SEED).seen_from(model.file.pose)]
    pixels = int(np.clip((len(sets[0]) / _RAYS_IN_PIXEL) ** 0.5, 8, _MOST_PIXELS))
    frame = [(float(low), float(high)) for low, high in zip(surface.low, surface.high, strict=True)]
    for title, (x, y) in _VIEWS.items():
        towards = np.array([x, y, 1.0]) / np.sqrt(1.0 + x * x + y * y)
        images = []
        for rays in sets:
            seen: Bool[np.ndarray, " n"] = rays.directions @ towards > _CAP
            places = surface.inward(rays)[0][seen]
            images.append(_binned(places, rays.flux[seen] / rays.flux.sum(), pixels, frame))
        yield title, (*frame[0], *frame[1]), images
    forward = [rays.take(rays.directions[:, 2] > 0.0) for rays in sets]
    cosines = [_binned(rays.directions, rays.flux / rays.flux.sum(), pixels, [(-1.0, 1.0)] * 2) for rays in forward]
    yield "far field, by kx and ky", (-1.0, 1.0, -1.0, 1.0), cosines


def _binned(
    points: Float[np.ndarray, "n _"], flux: Float[np.ndarray, " n"], pixels: int, frame: list[tuple[float, float]]
) -> Float[np.ndarray, "p p"]:
    return np.histogram2d(points[:, 0], points[:, 1], pixels, frame, weights=flux)[0]
