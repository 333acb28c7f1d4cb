"""What light does a lens make? Tracing, metrics, limits, far field and roads.

- ``lens_light.evaluate``: the light of a finished lens, the verb of the library
- ``evaluation_result.Light``: its result
- ``simulation.TracedLens``: a lens ready for rays
- ``table_trace.trace_tables``: rays through tables, by the kernels
- ``sequential_trace.trace_sequence``: rays through both faces in arrays: to read, and for devices
- ``exact_trace``: rays through exact surfaces, the reference
- ``receiver_light.ReceiverLight``: the figures of one receiver
- ``metrics.jackknife_error``: standard errors
- ``photometry_result.Photometry``: lumens, candela, beam angles
- ``luminaire_classes``: distribution type, BUG rating and glare of a lamp
- ``road_lighting``: light on a road, EN 13201
"""
