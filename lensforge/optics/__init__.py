"""What does matter do to light? Media, materials, coatings, the bounds set by étendue, and images of light.

- ``face_roles.FaceRole``: a face by the media on both sides, and by what it is there for
- ``pose.Pose``: where a thing stands and how it is turned
- ``media.Media``: index, absorption and coatings along a ray
- ``material.Material``: index and absorption by wavelength and temperature
- ``material.MATERIALS``: the materials that a spec may name
- ``material_files``: AGF and refractiveindex.info files
- ``coatings``: thin-film stacks and tables of reflectance
- ``dielectric``: the laws of Snell and Fresnel, for NumPy and torch
- ``exit_space``: the space that light leaves, and étendue from it
- ``fundamental_limits``: light that étendue and two refractions leave
- ``image_reading.read_light``: a picture as light
- ``colorimetry``: lumens from watts, and colours
"""
