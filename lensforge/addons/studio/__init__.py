"""How does one write a spec and see its light at once? The studio: a page, its server, and the process that searches.

- ``studio.studio``: the verb
- ``command``: the command
- ``door``: a file for the browser, which leads to the page
- ``server``: requests of the page, and of nobody else
- ``connections``: how many there are, and how long they wait
- ``page_json``: JSON to the page and from it
- ``session``: what the page shows and does
- ``spec_text``: the text of a spec that is being written
- ``toml_edit``: edits that keep comments
- ``dropped_files``: files that are dropped in
- ``physics``: bounds and advice
- ``search_process``: searches and stages in a process of their own
- ``job_pipe``: jobs of that process, and the frames that answer them
- ``search_watch``: what the page sees of a search
- ``run_view``: what the page sees of a finished lens
- ``search_job``: record of a search that may go on
- ``cures``: what cures a verdict
- ``lens_view``: a lens to look at
- ``page_frames``: pictures as bytes
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from lensforge.addon import Addon

if TYPE_CHECKING:
    import click


def _names() -> Mapping[str, object]:
    from lensforge.addons.studio.studio import Studio, studio

    return {"Studio": Studio, "studio": studio}


def _commands() -> "Sequence[click.Command]":
    from lensforge.addons.studio.command import studio

    return (studio,)


ADDON = Addon("studio", _names, _commands, "Design")
