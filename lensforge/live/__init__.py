"""How does one write a spec and see its light at once? The studio: a page, its server, and the process that searches.

- ``studio.studio``: the verb
- ``server``: requests of the page, and of nobody else
- ``session``: what the page shows and does
- ``spec_text``: the text of a spec that is being written
- ``toml_edit``: edits that keep comments
- ``physics``: bounds and advice
- ``search_process``: searches and stages in a process of their own
- ``lens_view``: a lens to look at
- ``page_frames``: pictures as bytes
"""
