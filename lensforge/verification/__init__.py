"""Independent proof: the exported part is cast with rays again; no tracing code of the design stage is used."""
