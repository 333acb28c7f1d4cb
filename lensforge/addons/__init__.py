"""What does one trade need beside the core? A package each, which nothing of the core imports; ``addon.py`` finds them.

- ``studio``: a page on which a spec is written and its light is seen
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # for those who check the types of scripts
    from lensforge.addons.studio.studio import Studio as Studio
    from lensforge.addons.studio.studio import studio as studio
