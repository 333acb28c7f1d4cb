"""What the sequential design leaves out: reflections, the base, absorption. How much flux, and where it lands.

The part is followed with all that light does in it, and compared with the sequential cast of the same rays through the
same mesh. The board and the chip under the lens take all light that comes back to them: they are not modelled.
"""

from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.files import replacing, write_json
from lensforge.gates import Gate
from lensforge.sources.bundle import RayBundle
from lensforge.verification.casting import Grid
from lensforge.verification.nonsequential import Account, Base, Body, Cause, Landings, Limits, follow
from lensforge.verification.part import load_part
from lensforge.verification.passage import send_through
from lensforge.verification.picture import Receiver, nmse, within

BALANCE = 1e-9  # shares of flux add up to 1: nothing is drawn by lot
LEAK_SHARE = 1e-3  # light that slips through the mesh at an edge
DIM_SHARE = 1e-2  # light too weak to be followed: what it could still change


def trace_stray(
    stl: Path,
    directory: Path,
    *,
    rays: RayBundle,
    refractive_index: float,
    absorption_per_mm: float,
    distance_mm: float,
    receiver: Receiver,
    window_mm: float,
    base: Base = "polished",
    limits: Limits | None = None,
) -> dict[str, Any]:
    """Follow ``rays`` through the part in ``stl`` (mm) until all light has left it; write stray.json and stray.npz.

    Shares are of the emitted flux; "detected" is what lands in the centred square of ``window_mm``. Raises
    :class:`InputError` for a file that is no mesh.
    """
    start = perf_counter()
    limits = limits or Limits()
    part = load_part(stl)
    grid = Grid(part.mesh)
    account = follow(Body(part, grid, refractive_index, absorption_per_mm, base), rays, distance_mm, limits)
    passage = send_through(part, grid, rays, refractive_index, distance_mm)
    landed = account.landings()
    direct, stray = ~landed.stray, landed.stray
    images = {
        "sequential": receiver.irradiance(passage.landings, passage.flux),
        "direct": receiver.irradiance(landed.points[direct], landed.flux[direct]),
        "stray": receiver.irradiance(landed.points[stray], landed.flux[stray]),
    }
    emitted = float(rays.weights.sum())
    shares = _shares(account, landed, window_mm, emitted)
    content: dict[str, Any] = {
        "rays": len(rays),
        "base": base,
        "absorption_per_mm": absorption_per_mm,
        "cut_off": limits.cut_off,
        "depth": limits.depth,
        "flux": shares,
        "balance_error": abs(sum(shares.values()) - 1.0),
        "detected_stray_by_cause": _by_cause(landed, window_mm, emitted),
        **_against_sequential(images, receiver, emitted),
        "stray": _spread(landed, images, receiver),
        "efficiency": shares["detected_direct"] + shares["detected_stray"],
        "efficiency_sequential": float(passage.flux[within(passage.landings, window_mm)].sum()) / emitted,
    }
    content |= {"seconds": perf_counter() - start, "gates": [gate.to_json() for gate in _gates(content)]}
    with replacing(Path(directory) / "stray.npz") as temporary:
        np.savez_compressed(temporary, allow_pickle=False, **images)
    write_json(Path(directory) / "stray.json", content)
    return content


def _shares(account: Account, landed: Landings, window_mm: float, emitted: float) -> dict[str, float]:
    flux, inside, stray = landed.flux, within(landed.points, window_mm), landed.stray
    ends = {
        "detected_direct": flux[inside & ~stray].sum(),
        "detected_stray": flux[inside & stray].sum(),
        "outside_direct": flux[~inside & ~stray].sum(),
        "outside_stray": flux[~inside & stray].sum(),
        "backward": account.backward,
        "absorbed": account.absorbed,
        "base": account.base,
        "too_dim": account.cut_off,
        "leaked": account.leaked,
    }
    return {name: float(value) / emitted for name, value in ends.items()}


def _by_cause(landed: Landings, window_mm: float, emitted: float) -> dict[str, float]:
    inside = within(landed.points, window_mm)
    stray = [cause for cause in Cause if cause != Cause.SEQUENTIAL]
    return {
        cause.name.lower(): float(landed.flux[inside & (landed.causes == cause)].sum()) / emitted for cause in stray
    }


def _against_sequential(
    images: dict[str, Float[np.ndarray, "p p"]], receiver: Receiver, emitted: float
) -> dict[str, float | None]:
    """How far the whole picture is from the one that the sequential model makes of the same rays."""
    whole, sequential = images["direct"] + images["stray"], images["sequential"]
    pixel = (receiver.side_mm / receiver.pixels * 1e-3) ** 2
    return {
        "misjudged_flux": float(np.abs(whole - sequential).sum()) * pixel / emitted,
        "nmse_vs_sequential": nmse(whole, sequential) if sequential.any() else None,
    }


def _spread(landed: Landings, images: dict[str, Float[np.ndarray, "p p"]], receiver: Receiver) -> dict[str, Any]:
    """Where on the receiver the stray light lands (mm), and how bright it is there (W/m^2, and of the mean)."""
    inside = landed.stray & within(landed.points, receiver.side_mm)
    points, total = landed.points[inside], float(landed.flux[inside].sum())
    if total <= 0.0:
        return {"centroid_mm": None, "rms_radius_mm": None, "peak_w_m2": 0.0, "peak_of_mean": 0.0}
    weights = landed.flux[inside] / total
    centroid = weights @ points
    radius = np.sqrt(weights @ np.sum((points - centroid) ** 2, axis=1))
    peak, mean = float(images["stray"].max()), float(images["sequential"].mean())
    return {
        "centroid_mm": centroid.tolist(),
        "rms_radius_mm": float(radius),
        "peak_w_m2": peak,
        "peak_of_mean": peak / mean if mean > 0.0 else None,
    }


def _gates(content: dict[str, Any]) -> list[Gate]:
    finer = "export with a finer mesh"
    report = "do not trust this account, it does not close: please report it"
    return [
        Gate("stray_balance", content["balance_error"], "<=", BALANCE, "of the flux", report),
        Gate("stray_leaked", content["flux"]["leaked"], "<=", LEAK_SHARE, "of the flux", finer),
        Gate("stray_too_dim", content["flux"]["too_dim"], "<=", DIM_SHARE, "of the flux", "lower the cut-off"),
    ]
