"""Independent verification: rays are cast through the exported part, without any tracing code of the design stage."""
