"""lensforge: from an LED and a target light pattern to a lens that a machine shop can cut.

Units everywhere: mm, rad, nm, W; float64. The axis of the lens is +z, the source sits at the origin.
Tables over the chart of a face are indexed [X, Y], pictures of light [row y, column x]. A far field has no width in mm:
its chart has the radius 2 sin(gamma / 2) at the angle gamma from its axis.
A verb takes objects and returns a frozen result; only :func:`run` writes files, and :func:`load` reads them back.
All names come from :mod:`lensforge.verbs`, which is loaded when the first of them is used, and from add-ons, which are
loaded when the first of theirs is.
"""

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lensforge.addons import *  # noqa: F403
    from lensforge.spec.camera_target import *  # noqa: F403
    from lensforge.spec.far_field_targets import *  # noqa: F403
    from lensforge.spec.fixed_surface import *  # noqa: F403
    from lensforge.spec.housing_sections import *  # noqa: F403
    from lensforge.spec.picture_targets import *  # noqa: F403
    from lensforge.spec.receiver_sections import *  # noqa: F403
    from lensforge.spec.shape_targets import *  # noqa: F403
    from lensforge.spec.source_sections import *  # noqa: F403
    from lensforge.verbs import *  # noqa: F403
    from lensforge.verbs import __all__ as __all__
else:

    def __getattr__(name: str) -> object:
        """Load the whole library when its first name is used: NumPy and pydantic alone take 0.2 s."""
        path = os.path.join(os.path.dirname(__file__), name)  # noqa: PTH118, PTH120  pathlib would take time to load
        if os.path.exists(path) or os.path.exists(path + ".py"):  # noqa: PTH110
            raise AttributeError(name)  # a module of the package: it has to be imported explicitly
        try:
            from lensforge.verbs import NAMES, UNLISTED, public_names
        except ImportError as error:
            if error.name != "lensforge.verbs":
                raise
            raise AttributeError(name) from None  # it is being loaded, and looks for a module of the package
        if name == "__all__":
            return list(public_names())
        known = NAMES if name in NAMES or name in UNLISTED or name.startswith("_") else public_names()
        if name in known or name in UNLISTED:  # the latter for pickles, which find a class by its name
            return known.get(name) or UNLISTED[name]
        near = [] if name.startswith("_") else _near(name, known)
        meant = f"; did you mean {near[0]}?" if near else ""
        raise AttributeError(f"module 'lensforge' has no attribute {name!r}{meant}")

    def _near(name: str, known: dict[str, object]) -> list[str]:
        from difflib import get_close_matches

        return get_close_matches(name, known, n=1) or get_close_matches(name.lower(), known, n=1)

    def __dir__() -> list[str]:
        return __getattr__("__all__")
