"""lensforge: from an LED and a wanted light pattern to a lens that a machine shop can cut.

Units everywhere: mm, rad, nm, W; float64. The axis of the lens is +z, the source sits at the origin.
A verb takes objects and returns a frozen result; :func:`run` alone writes files, :func:`load` reads them back.
The names are those of :mod:`lensforge.api`, which loads with the first of them.

Import it before torch: the wait policy counts only if it is set before torch loads its OpenMP.
"""

import os
from typing import TYPE_CHECKING

# Threads of torch that wait for work sleep: by default they spin, on the cores that trace the rays at that moment.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

if TYPE_CHECKING:
    from lensforge.api import *  # noqa: F403
    from lensforge.api import __all__ as __all__
else:

    def __getattr__(name: str) -> object:
        """Load the library's names with the first that is used: NumPy and pydantic alone take 0.2 s."""
        own = os.path.join(os.path.dirname(__file__), name)  # noqa: PTH118, PTH120  pathlib would take time to load
        if os.path.exists(own) or os.path.exists(own + ".py"):  # noqa: PTH110
            raise AttributeError(name)  # a module of ours: whoever asks for it imports it himself
        try:
            from lensforge.api import NAMES
        except ImportError as error:
            if error.name != "lensforge.api":
                raise
            NAMES = {}  # it is loading at this moment, and asks for a module of ours
        if name in NAMES:
            return NAMES[name]
        if name == "__all__":
            return list(NAMES)
        raise AttributeError(f"module 'lensforge' has no attribute {name!r}")

    def __dir__() -> list[str]:
        return __getattr__("__all__")
