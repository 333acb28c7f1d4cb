"""Fused kernels, part 4: Snell and Fresnel at a dielectric surface, and their adjoints.

``ratio`` is n_before / n_after; normals point along the ray, ``c = d.n > 0``.
"""

from lensforge.tracing.jit import inline


@inline
def transmitted_cosine(c, ratio):
    """Square of the cosine behind the surface; not positive: total reflection.

    ``1 - ratio^2 (1 - c^2)`` without its cancellations: a body of air passes even grazing rays unbent.
    """
    return (1.0 - ratio) * (1.0 + ratio) + (ratio * c) * (ratio * c)


@inline
def transmittance(c, q, ratio):
    """Unpolarised Fresnel transmittance (Born & Wolf 1.5.2) and its derivative with respect to ``c``."""
    senkrecht = (ratio * c - q) / (ratio * c + q)
    parallel = (c - ratio * q) / (c + ratio * q)
    dq = ratio * ratio * c / q
    by_senkrecht = 2.0 * ratio * (q - c * dq) / ((ratio * c + q) * (ratio * c + q))
    by_parallel = 2.0 * ratio * (q - c * dq) / ((c + ratio * q) * (c + ratio * q))
    value = 1.0 - 0.5 * (senkrecht * senkrecht + parallel * parallel)
    return value, -(senkrecht * by_senkrecht + parallel * by_parallel)
