"""Where does the light begin? Emitters, measured ray files and photometric files, as rays with flux and wavelength.

- ``build_source.build_source``: a source from its section
- ``ray_bundle.RayBundle``: rays: origins, directions, flux, wavelengths
- ``ray_bundle.Source``: what a source answers
- ``planar_emitter``: squares, discs and rectangles with an intensity
- ``radiance_emitter``: a picture of an LED
- ``intensity.TabulatedIntensity``: intensity over angle
- ``rayfiles.ray_file_io.read_rayfile``: ray files of every format
- ``photometric.read_photometric``: IES, EULUMDAT and TM-33 files
- ``measured_rays.held_back``: rays that judge a search, and no others
- ``build_source.PlacedSource``: an LED at its place
- ``source_summary.SourceSummary``: flux, size and warnings of a source
"""
