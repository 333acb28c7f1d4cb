"""How is a run made, kept and shown? Its folder and verdict, its stages, its pages, and studies of several runs.

- ``pipeline.run``: every stage of a design, in its folder
- ``folder.Run``: results, verdict and lens of a folder
- ``folder.load``: a run, read from its folder
- ``results.Results``: results of one lens
- ``stored``: records and hashes of a folder
- ``lens_page``: report.html
- ``compare``: designs side by side
- ``sweep.Sweep``: a design for each value of a field
- ``tradeoff.Tradeoff``: accuracy against computing time
- ``light_figures``: plots of light
- ``lens_figures``: plots of lenses
"""
