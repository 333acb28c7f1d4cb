"""A folder by which another program checks the light of an exported part: part, rays, detector and expected figures."""

import json
from hashlib import sha256
from io import BytesIO
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensforge import seeds
from lensforge.addons.recheck.averaged_polarisation import less_polarisation
from lensforge.addons.recheck.kit_mesh import obj_bytes
from lensforge.cad.part import STEP_FILE
from lensforge.errors import InputError
from lensforge.light.evaluation_result import Light
from lensforge.light.lens_light import judging_source
from lensforge.proof.part_mesh import read_part_mesh
from lensforge.proof.proof_inputs import independent_rays, optical_at_work, screens_of
from lensforge.proof.receiver_screen import Screen
from lensforge.report.results import Results
from lensforge.scene.lens import Lens
from lensforge.sources.ray_bundle import RayBundle
from lensforge.sources.rayfiles.formats.speos import BINARY as SPEOS
from lensforge.sources.rayfiles.formats.tm25 import BINARY as TM25
from lensforge.sources.rayfiles.formats.zemax import BINARY as ZEMAX
from lensforge.sources.rayfiles.ray_file import RayFile, shared_wavelength

KIT_FOLDER = "recheck"
KIT_FILE = "kit.json"
RAYS = 2**16
_SCRIPTS = Path(__file__).with_name("scripts")
_RAY_FILES = {"source.tm25ray": TM25, "source.dat": ZEMAX, "source.ray": SPEOS}
_MOST_ZONES = 8  # along each side of the detector
_KINDS = ("plane", "far_field")


def kit_files(run: Results, rays: int = RAYS) -> dict[str, bytes]:
    """Files of the kit by name, with ``rays`` of the source.

    Raises :class:`InputError` for a lens whose light the programs cannot repeat, such as one with coated faces.
    """
    lens = run.lens
    part = run.part
    light = run.light
    _require_plain(lens)
    source = judging_source(lens.spec)
    drawn = independent_rays(lens.spec, source, rays, seeds.of_own_rays(lens.seed))
    table = BytesIO()
    np.save(table, np.hstack([drawn.origins, drawn.directions]).astype(np.float64))
    files = {
        STEP_FILE: part.step,
        "lens.obj": obj_bytes(read_part_mesh(part.stl, optical_at_work(lens))),
        "source.npy": table.getvalue(),
        **{name: b"".join(layout.encode(_ray_file(lens, drawn))) for name, layout in _RAY_FILES.items()},
    }
    (screen, *_) = screens_of(lens.spec, light.pixels)
    figures = _figures(light)
    averaged = less_polarisation(light.first.efficiency, lens, screen, drawn)
    if averaged is not None:
        figures["efficiency_averaged_polarisation"] = averaged.model_dump(mode="json")
    shares = light.first.raw_map * (screen.pixel_measure / source.flux_w)
    record = {
        **_scene(lens, light, screen),
        "source_w": source.flux_w,
        "expected": figures,
        "zone_shares": _zone_shares(shares).tolist(),
    }
    record["sha256"] = {name: sha256(content).hexdigest() for name, content in files.items()}
    files[KIT_FILE] = json.dumps(record, indent=1).encode("utf-8")
    return files | {path.name: path.read_bytes() for path in sorted(_SCRIPTS.glob("*.py"))}


def _require_plain(lens: Lens) -> None:
    """Raise :class:`InputError` where the programs would have to know more than bare faces of one index."""
    spec = lens.spec
    media = lens.media
    not_in_kits = {
        "states": bool(spec.all_states),
        "several lamps": not spec.all_lamps.is_single,
        "coated faces or mirrors": bool(media.coatings),
        "faces that scatter": bool(media.scatter),
        "bodies behind the lens": bool(media.bodies),
        "a cover glass": media.cover_glass is not None,
        "a scene of opaque bodies": bool(spec.scene),
        "a material with dispersion": lens.dispersion is not None,
        "a lens that grows with its temperature": spec.lens.scale != 1.0,
        "surroundings other than air": (media.cavity_index, media.outside_index) != (1.0, 1.0),
        f"a receiver of kind {spec.all_receivers[0].kind}": spec.all_receivers[0].kind not in _KINDS,
    }
    reason = next((reason for reason, holds in not_in_kits.items() if holds), None)
    if reason is not None:
        raise InputError(
            f"{spec.name}: has {reason}; a kit is of one lens with bare polished faces in air, over one LED, on a "
            "plane or in the far field; `lensforge verify` checks others"
        )


def _ray_file(lens: Lens, drawn: RayBundle) -> RayFile:
    waves = shared_wavelength(lens.media.wavelength_nm, len(drawn))
    header = {"name": f"source of {lens.spec.name}", "ray_file_creator": "lensforge", "creation_method": "simulated"}
    watts = float(drawn.flux.sum())
    return RayFile(drawn.origins, drawn.directions, drawn.flux, "W", waves, header_flux_w=watts, header=header)


def _figures(light: Light) -> dict[str, object]:
    """Figures of the record of the evaluation, with their standard errors, and the number of its rays."""
    names = ("efficiency", "share_in_target", "nmse", "uniformity", "rsd")
    known = {name: metric for name in names if (metric := getattr(light.first, name)) is not None}
    return {"rays": light.rays, **{name: metric.model_dump(mode="json") for name, metric in known.items()}}


def _scene(lens: Lens, light: Light, screen: Screen) -> dict[str, object]:
    """Entries of ``kit.json`` on lens and detector."""
    lit = light.first
    return {
        "name": lens.spec.name,
        "lens_sha256": lens.sha256,
        "units": "mm, degrees, nm, W; z is the axis of the lens, along which it shines, z = 0 the plane of its rims",
        "refractive_index": lens.media.body.refractive_index,
        "absorption_per_mm": lens.media.body.absorption_per_mm,
        "wavelength_nm": lens.media.wavelength_nm,
        "detector": {
            "name": lit.name,
            "kind": lit.kind,
            "centre_mm": list(screen.centre_mm),
            "axes": screen.axes.tolist(),
            "width": lit.width,
            "height": lit.height,
            "window": list(screen.window),
        },
    }


def _zone_shares(shares: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "a b"]:
    """Shares of the light in equal zones of a map, each of whole pixels."""
    rows, columns = (max(n for n in range(1, _MOST_ZONES + 1) if pixels % n == 0) for pixels in shares.shape)
    height, width = shares.shape
    return np.asarray(shares.reshape(rows, height // rows, columns, width // columns).sum(axis=(1, 3)))
