"""What light does a lens make? Tracing, metrics, limits, far field and applications.

- ``lens_light.evaluate``: the light of a finished lens, the verb of the library
- ``evaluation_result.Light``: its result
- ``simulation.TracedLens``: a lens ready for rays
- ``table_trace.trace_tables``: rays through tables, by the kernels
- ``ray_lines``: rays as lines for a drawing, with their ends
- ``reference_trace.trace_reference``: rays through any bodies in torch: to read, to test by, and for devices
- ``reference_hits``: the hits of rays on exact faces and on tables
- ``receiver_light.ReceiverLight``: the figures of one receiver
- ``photometry_result.Photometry``: lumens, candela, beam angles
- ``luminaire_classes``: distribution type, BUG rating and glare of a lamp
- ``area_lamp``: these of a whole lamp, with its lumens
- ``by_intensities``: figures and limits by the intensities of a lamp, and applications judged
"""
