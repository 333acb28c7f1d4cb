"""The finished lens as a luminaire: its far field as files for lighting and ray-tracing programs."""
