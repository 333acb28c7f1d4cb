"""What a cutter leaves uncut: the height of material between the face and the nearest place that the ball sweeps.

The swept air is the union of the balls whose centres are at least R from the part (the opening of the air by the
ball). The boundary of those centres is the offset face ``P + R n`` over the points that the cutter reaches, so the
height left over an unreached point is its distance to the nearest such centre, less R.
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from lensforge.manufacturing.cutter import reachable
from lensforge.manufacturing.sampling import FaceSamples


def residual_height_mm(
    samples: FaceSamples, ball_mm: Float[np.ndarray, " k"], cutter_radius_mm: float
) -> Float[np.ndarray, " k"]:
    """Uncut height (mm) over each sample, 0 where the cutter reaches; all NaN when it reaches nothing at all.

    ``ball_mm`` is the map of ``cutter.largest_ball_mm``. The error is of second order in the sample spacing: the
    edge of the reached area, where balls rest on two points at once, is located between the samples.
    """
    reached = reachable(ball_mm, cutter_radius_mm)
    height = np.zeros(len(reached))
    if reached.all():
        return height
    if not reached.any():
        return np.full(len(reached), np.nan)
    centres = samples.points[reached] + cutter_radius_mm * samples.normals[reached]
    centres = np.concatenate([centres, _edge_centres(samples, ball_mm, cutter_radius_mm)])
    distance, _ = cKDTree(centres).query(samples.points[~reached])
    height[~reached] = np.maximum(distance - cutter_radius_mm, 0.0)
    return height


def _edge_centres(
    samples: FaceSamples, ball_mm: Float[np.ndarray, " k"], cutter_radius_mm: float
) -> Float[np.ndarray, "e 3"]:
    """Ball centres over the edge of the reached area: where a grid line's largest ball passes the cutter's radius."""
    tightness = samples.grid.to_map(1.0 / ball_mm - 1.0 / cutter_radius_mm)  # continuous where balls are unlimited
    nodes = samples.grid.to_map(samples.chart)
    crossings = []
    for field, chart in ((tightness, nodes), (tightness.T, nodes.transpose(1, 0, 2))):
        before, after = field[:-1], field[1:]
        crossed = before * after < 0.0
        part = (before[crossed] / (before[crossed] - after[crossed]))[:, None]
        crossings.append((1.0 - part) * chart[:-1][crossed] + part * chart[1:][crossed])
    jet = samples.face.jet(np.concatenate(crossings))
    return jet.point + cutter_radius_mm * samples.face.air_normal(jet)
