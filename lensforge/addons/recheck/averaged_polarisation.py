"""Light as programs find it that average the polarisation at every face, as most do: a little less than there is.

Light that has passed a face at an angle is polarised, and the next face transmits more of that than of unpolarised
light. The difference is that of one sample of rays traced with and without it.
"""

import numpy as np
from jaxtyping import Float

from lensforge.light.ray_lines import fan_tables
from lensforge.light.table_trace import TracedBundle
from lensforge.optics.dielectric import fresnel_transmittances
from lensforge.optics.face_roles import DOUBLE
from lensforge.proof.receiver_screen import Screen
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
    seen = np.flatnonzero(exits.left_lens & screen.in_window(screen.land(exits.points, exits.directions)))
    before = rays.directions[seen]
    within = exits.points[seen] - rays.origins[seen] - bundle.lengths[seen, :1] * before
    lengths = np.linalg.norm(within, axis=1)
    within /= lengths[:, None]
    body = lens.media.body
    averaged = np.exp(-body.absorption_per_mm * lengths)
    averaged *= transmittance(before, within, 1.0 / body.refractive_index)
    averaged *= transmittance(within, exits.directions[seen], body.refractive_index)
    change = np.zeros(len(rays))
    change[seen] = averaged - exits.flux[seen] / rays.flux[seen]
    error = float(np.hypot(efficiency.standard_error or 0.0, change.std() / np.sqrt(len(change))))
    return Metric(value=efficiency.value + float(change.mean()), unit=efficiency.unit, standard_error=error)


def transmittance(before: _Rows, behind: _Rows, ratio: float) -> Float[np.ndarray, " n"]:
    """Mean of Fresnel's transmittance for both polarisations, of light refracted from one direction to another.

    ``ratio``: index before the face over that behind. By Snell's law n k - n' k' is along the normal.
    """
    normal = ratio * before - behind
    cosine = np.abs(np.sum(normal * before, axis=1)) / np.linalg.norm(normal, axis=1)
    across, along, _ = fresnel_transmittances(cosine, ratio)
    return np.asarray(0.5 * (across + along))
