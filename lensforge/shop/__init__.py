"""Can it be made, and with what? The check, the drawing, and tables of points.

- ``check.check_lens``: the check of a lens
- ``check_result.Check``: its result, with its judgements
- ``check_measures``: what it measures of faces, walls, edges and moulds
- ``face_check``: curvature and best-fit sphere of a face
- ``ball_cutter``: the largest ball that reaches a face
- ``ball_clearance``: room of a ball beside the base
- ``tool_reach``: which tools reach how much
- ``mould_halves.Moulding``: what the halves of a mould draw of a part, and where they part
- ``mould_facts``: what a moulder is told, and how long a plastic cools
- ``findings``: what the shop can do, and what to change
- ``drawing``: the sheet's content
- ``sheet_writers``: the sheet as SVG, PDF and DXF
- ``point_tables``: points for measuring and milling
- ``part_models``: the part as glTF, alone and with rays
- ``handover.Handover``: all files for the shop
"""
