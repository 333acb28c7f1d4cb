"""lensforge: from an LED and a wanted light pattern to a lens that a machine shop can cut.

Units everywhere: mm, rad, nm, W; float64. The axis of the lens is +z, the source sits at the origin.
The names below load on first use, so that importing one part never pays for another.

Import it before torch: the wait policy counts only if it is set before torch loads its OpenMP.
"""

import os
from importlib import import_module
from typing import Any

from lensforge.errors import GateFailed, InputError, LensforgeError
from lensforge.version import __version__

# Threads of torch that wait for work sleep: by default they spin, on the cores that trace the rays at that moment.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

_LAZY = {
    "Spec": "lensforge.spec",
    "load_spec": "lensforge.spec",
    "Lens": "lensforge.lens",
    "load_lens": "lensforge.lens",
}

__all__ = ["GateFailed", "InputError", "Lens", "LensforgeError", "Spec", "__version__", "load_lens", "load_spec"]


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module 'lensforge' has no attribute {name!r}")
