"""lensforge: from an LED and a target light pattern to a lens that a machine shop can cut.

Units everywhere: mm, rad, nm, W; float64. The axis of the lens is +z, the source sits at the origin.
Tables over the chart of a face are indexed [X, Y], pictures of light [row y, column x]. A far field has no width in mm:
its chart has the radius 2 sin(gamma / 2) at the angle gamma from its axis.
A verb takes objects and returns a frozen result; only :func:`run` writes files, and :func:`load` reads them back.
All names come from :mod:`lensforge.verbs`, which is loaded when the first of them is used.

Import lensforge before torch: the wait policy below has no effect once torch has loaded its OpenMP.
"""

import os
import sys
from typing import TYPE_CHECKING

# Idle torch threads sleep; by default they spin, on the cores that are tracing the rays at that moment.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")


def _forget_unknown_backend() -> None:
    """Drop an MPLBACKEND that matplotlib does not know, and for which it would not load: no picture needs one."""
    name = os.environ.get("MPLBACKEND", "")
    if not name or name.startswith("module://") or "matplotlib" in sys.modules:
        return
    from importlib.metadata import entry_points
    from importlib.util import find_spec

    found = find_spec("matplotlib")
    folders = [] if found is None else found.submodule_search_locations or []
    files = (os.path.join(folder, "backends", f"backend_{name.lower()}.py") for folder in folders)  # noqa: PTH118
    if not any(map(os.path.exists, files)) and not entry_points(group="matplotlib.backend", name=name):
        del os.environ["MPLBACKEND"]


_forget_unknown_backend()

if TYPE_CHECKING:
    from lensforge.spec.far_field_targets import *  # noqa: F403
    from lensforge.spec.fixed_surface import *  # noqa: F403
    from lensforge.spec.picture_targets import *  # noqa: F403
    from lensforge.spec.receiver_sections import *  # noqa: F403
    from lensforge.spec.shape_targets import *  # noqa: F403
    from lensforge.spec.source_sections import *  # noqa: F403
    from lensforge.verbs import *  # noqa: F403
    from lensforge.verbs import __all__ as __all__
else:

    def __getattr__(name: str) -> object:
        """Load the whole library when its first name is used: NumPy and pydantic alone take 0.2 s."""
        own = os.path.join(os.path.dirname(__file__), name)  # noqa: PTH118, PTH120  pathlib would take time to load
        if os.path.exists(own) or os.path.exists(own + ".py"):  # noqa: PTH110
            raise AttributeError(name)  # a module of the package: it has to be imported explicitly
        try:
            from lensforge.verbs import NAMES
        except ImportError as error:
            if error.name != "lensforge.verbs":
                raise
            NAMES = {}  # lensforge.verbs is being loaded and looks for a module of the package
        if name in NAMES:
            return NAMES[name]
        if name == "__all__":
            return list(NAMES)
        raise AttributeError(f"module 'lensforge' has no attribute {name!r}")

    def __dir__() -> list[str]:
        return __getattr__("__all__")
