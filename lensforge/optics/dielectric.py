"""Light at a dielectric surface, in NumPy or in torch: Snell's law, Fresnel's formulas, coatings, and polarisation.

``ratio`` is n_before / n_after, one for all rays or one for each. Normals have length 1 and point along the ray:
``c = d . n > 0``. Transmittances come as ``(t_s, t_p, excess)``, ``t_p - t_s`` being ``excess`` times the squared sine
before the face. :data:`Amplitudes` are a_s, across the plane of incidence, and ``a_p - a_s`` over the sines on both
sides; in total reflection they are complex.
"""

import numpy as np
from jaxtyping import Float, Inexact

from lensforge.optics.arrays import Array, lengths, like, module_of, whole

Ratio = float | Float[Array, " n"]
_DARK = 1e-12  # transmittance below which the slope of its root no longer counts
Transmittances = tuple[Float[Array, " n"], Float[Array, " n"], Float[Array, " n"]]
Amplitudes = tuple[Inexact[Array, " n"], Inexact[Array, " n"]]


def transmitted_cosine_squared(cosine: Float[Array, " n"], ratio: Ratio) -> Float[Array, " n"]:
    """Squared cosine behind the surface by Snell's law; 0 and below means total reflection.

    ``1 - ratio^2 (1 - c^2)`` without its cancellations: at a ratio of 1 even grazing rays are undeviated.
    """
    return (1.0 - ratio) * (1.0 + ratio) + (ratio * cosine) ** 2


def refract(directions: Float[Array, "n 3"], normals: Float[Array, "n 3"], ratio: Ratio) -> Float[Array, "n 3"]:
    """Unit directions behind the surface (vector form of Snell's law). Mask totally reflected rays first."""
    cosine = (directions * normals).sum(1)
    along = module_of(cosine).sqrt(transmitted_cosine_squared(cosine, ratio)) - ratio * cosine
    scale = like(directions, ratio).reshape(-1, 1)
    return scale * directions + along[:, None] * normals


def fresnel_transmittances(cosine: Float[Array, " n"], ratio: Ratio) -> Transmittances:
    """Transmitted shares (Born & Wolf, Principles of Optics, 1.5.2). Mask total reflection first."""
    behind = module_of(cosine).sqrt(transmitted_cosine_squared(cosine, ratio))
    r_s = (ratio * cosine - behind) / (ratio * cosine + behind)
    r_p = (cosine - ratio * behind) / (cosine + ratio * behind)
    t_p = 1.0 - r_p**2
    return 1.0 - r_s**2, t_p, t_p * (behind - ratio * cosine) ** 2  # t_s / t_p is the squared cosine of the turn


def coated_transmittances(
    cosine: Float[Array, " n"], ratio: Ratio, table: Float[Array, "k m 2"], rows: Float[Array, " j"]
) -> Transmittances:
    """Transmitted shares at a coated face. Mask total reflection first.

    ``table``: as in :mod:`~lensforge.optics.coatings`; ``rows``: place among its rows, of each ray or of all.
    """
    behind = module_of(cosine).sqrt(transmitted_cosine_squared(cosine, ratio))
    xp = module_of(cosine)
    into = like(cosine, ratio)
    denser = into < 1.0
    position = xp.where(denser, cosine, behind) * (table.shape[1] - 3)
    last = table.shape[1] - 4
    cell = whole(xp.where(position < last, position, last))  # NaN, which no light meets, is anything
    top = max(len(table) - 2, 0)
    low = whole(xp.where(rows < top, rows, top))
    high = xp.where(low < len(table) - 1, low + 1, low)
    share = rows - low
    lost = xp.zeros_like(cosine)[:, None] * xp.zeros_like(table[0, 0])
    for j in range(4):  # a uniform cubic B-spline by its truncated powers
        away = abs(position - cell - (j - 1))
        weight = _above(2.0 - away) ** 3 / 6.0 - _above(1.0 - away) ** 3 * (2.0 / 3.0)
        before = table[low, cell + j]
        after = table[high, cell + j]
        lost = lost + weight[:, None] * (before + share[:, None] * (after - before))
    excess = lost[:, 1] * xp.where(denser, 1.0, into**2)
    half = 0.5 * excess * (1.0 - cosine**2)
    return 1.0 - lost[:, 0] - half, 1.0 - lost[:, 0] + half, excess


def _above(values: Float[Array, " n"]) -> Float[Array, " n"]:
    """``values``, with 0 for negative ones."""
    return module_of(values).where(values > 0.0, values, 0.0)


def unpolarised_fields(directions: Float[Array, "n 3"]) -> Float[Array, "n 2 3"]:
    """Two unit fields perpendicular to each ray and to each other, each with half of unpolarised light's flux."""
    xp = module_of(directions)
    sideways = abs(directions[:, 0]) < 0.9
    axes = like(directions, np.eye(3))
    first = xp.linalg.cross(directions, xp.where(sideways[:, None], axes[0], axes[1]))
    first = first / lengths(first)[:, None]
    return xp.stack([first, xp.linalg.cross(directions, first)], 1)


def passing_amplitudes(transmittances: Transmittances, ratio: Ratio) -> Amplitudes:
    """Transmitted amplitudes: roots of both shares, which differ by excess and both sines over their sum."""
    xp = module_of(transmittances[0])
    root_s, root_p = (
        xp.sqrt(xp.where(transmittance > _DARK, transmittance, _DARK)) for transmittance in transmittances[:2]
    )
    return root_s, transmittances[2] / (ratio * (root_s + root_p))


def reflecting_amplitudes(cosine: Float[Array, " n"], ratio: Ratio) -> Amplitudes:
    """Amplitudes in total reflection: ``a_s = (r c - q) / (r c + q)`` with q = i Q (Born and Wolf, 1.5.4)."""
    q = 1.0j * module_of(cosine).sqrt(-transmitted_cosine_squared(cosine, ratio))
    across = (ratio * cosine - q) / (ratio * cosine + q)
    return across, -2.0 * ratio * (ratio**2 - 1.0) / ((ratio * cosine + q) * (cosine + ratio * q))


def fields_behind(
    fields: Inexact[Array, "n 2 3"],
    before: Float[Array, "n 3"],
    behind: Float[Array, "n 3"],
    normals: Float[Array, "n 3"],
    amplitudes: Amplitudes,
    reflected: bool = False,
) -> Inexact[Array, "n 2 3"]:
    """Fields behind a face; their squared lengths are the remaining flux. ``before``, ``behind``: directions.

    Each is turned as the ray, or reflected, times the amplitude across the plane of incidence, and its part in this
    plane is stretched to the amplitude there (Yun, Crabtree and Chipman, Appl. Opt. 50, 2855, 2011), with no
    singularity at normal incidence, where the plane is none.
    """
    xp = module_of(fields)
    (across, more) = amplitudes

    def onto(vectors: Float[Array, "n 3"]) -> Inexact[Array, "n 2"]:
        return xp.einsum("nfi,ni->nf", fields, like(fields, vectors))

    cosine, inside = ((vectors * normals).sum(1)[:, None] for vectors in (before, behind))
    # in the plane, as long as the sines
    along_before = normals - cosine * before
    along_behind = normals - inside * behind
    if reflected:
        turned = fields - (2.0 * onto(normals))[:, :, None] * normals[:, None, :]
        along_behind = -along_behind
    else:
        turn = onto(behind) / (1.0 + (before * behind).sum(1))[:, None]
        turned = fields - turn[:, :, None] * (before + behind)[:, None, :]
    stretch = more[:, None] * onto(along_before)
    return across[:, None, None] * turned + stretch[:, :, None] * along_behind[:, None, :]
