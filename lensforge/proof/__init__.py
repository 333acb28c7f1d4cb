"""Does the exported part do what was designed: casts through its own files, with no tracing code of the design."""
