"""States of a lens that are mirror images of each other, such as the chips to the left and to the right of a bar.

A lens that has the mirror lights both alike, but for left and right: a search traces one of them for all.
"""
