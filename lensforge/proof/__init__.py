"""Casts through the exported files, with no tracing code of the design: does the part do what was designed?"""
