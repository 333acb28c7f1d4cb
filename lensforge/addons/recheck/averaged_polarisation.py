"""Light as programs find it that average the polarisation at every face, as most do: a little less than there is.

Light that has passed a face at an angle is polarised, and the next face transmits more of that than of unpolarised
light. The difference is that of one sample of rays traced with and without it.
"""

import numpy as np
from jaxtyping import Float

from lensforge.light.table_trace import TracedBundle
from lensforge.optics.face_roles import DOUBLE
from lensforge.proof.receiver_screen import Screen
from lensforge.report.ray_fan import fan_tables
from lensforge.results import Metric
from lensforge.scene.lens import Lens
from lensforge.sources.ray_bundle import RayBundle

_Rows = Float[np.ndarray, "n 3"]


def less_polarisation(efficiency: Metric, lens: Lens, screen: Screen, rays: RayBundle) -> Metric | None:
    """The ``efficiency`` in the window of ``screen`` without it; None for a lens of more than two faces.

    Its error includes that of the difference by ``rays``.
    """
    if tuple(lens.surfaces) != DOUBLE:
        return None
    traced = fan_tables(lens)
    bundle = TracedBundle.of(traced.tables, traced.scene, rays)
    exits = bundle.exits
    first = rays.origins + bundle.lengths[:, :1] * rays.directions
    within = exits.points - first
    index = lens.media.body.refractive_index
    lengths = np.linalg.norm(within, axis=1)
    within /= lengths[:, None]
    averaged = np.exp(-lens.media.body.absorption_per_mm * lengths)
    averaged *= transmittance(rays.directions, within, 1.0, index)
    averaged *= transmittance(within, exits.directions, index, 1.0)
    seen = exits.left_lens & screen.in_window(screen.land(exits.points, exits.directions))
    change = np.where(seen, averaged - exits.flux / rays.flux, 0.0)
    error = float(np.hypot(efficiency.standard_error or 0.0, change.std() / np.sqrt(len(change))))
    return Metric(value=efficiency.value + float(change.mean()), unit=efficiency.unit, standard_error=error)


def transmittance(before: _Rows, behind: _Rows, index_before: float, index_behind: float) -> Float[np.ndarray, " n"]:
    """Mean of Fresnel's transmittance for both polarisations, of light refracted from one direction to another.

    By Snell's law n k - n' k' is along the normal.
    """
    normal = index_before * before - index_behind * behind
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    cosine, cosine_behind = (np.abs(np.sum(normal * along, axis=1)) for along in (before, behind))
    across = (index_before * cosine - index_behind * cosine_behind) / (
        index_before * cosine + index_behind * cosine_behind
    )
    along = (index_behind * cosine - index_before * cosine_behind) / (
        index_behind * cosine + index_before * cosine_behind
    )
    return np.asarray(1.0 - 0.5 * (across**2 + along**2))
