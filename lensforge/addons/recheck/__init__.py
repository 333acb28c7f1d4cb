"""Does another program find the same light? A folder with the part, rays, detector, expected figures, and its programs.

- ``recheck_command``: the command
- ``kit``: the files of the folder
- ``kit_mesh``: the part as a mesh with normals
- ``averaged_polarisation``: the light as programs find it that do not follow the polarisation

The programs in ``scripts`` run in the folder, and do without this package.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from lensforge.addon import Addon

if TYPE_CHECKING:
    import click


def _commands() -> "Sequence[click.Command]":
    from lensforge.addons.recheck.recheck_command import recheck

    return (recheck,)


ADDON = Addon("recheck", commands=_commands, heading="The shop and the machined part")
