"""Points of a whole face with their normals as plain text, for programs that read no table with a head.

Programs for five-axis milling, for turning with a slow tool and for measuring machines read such a file as a cloud:
``x y z i j k``, a line for each point, mm, no first lines. The points are the nodes of the polar table, rim included.
"""

import numpy as np

from lensforge.drawings.polar import Polar

_DIGITS = 9


def cloud_name(polar: Polar) -> str:
    """Name of the cloud's file."""
    return f"cloud_{polar.face.name}.xyz"


def cloud_text(polar: Polar) -> str:
    """The cloud as text: x, y, z (mm) and the unit normal from the material into the air."""
    rows = np.round(polar.cloud, _DIGITS) + 0.0  # no minus zero
    return "".join(" ".join(f"{value:.{_DIGITS}f}" for value in row) + "\n" for row in rows.tolist())


def cloud_facts(polar: Polar) -> str:
    """Words on the cloud, which has none in it."""
    offset = polar.face.offset_mm
    at = "on the face" if offset == 0.0 else f"{offset:g} mm off the face, into the air"
    return (
        f"{len(polar.cloud)} points {at}, the nodes of grid_polar_{polar.face.name}.csv up to the rim: x y z i j k, "
        "mm and the unit normal from the material into the air, coordinates of lens.step; no first lines"
    )
