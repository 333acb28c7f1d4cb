"""Findings of a run: its folder and verdict, the stages that make it, its pages, and studies of several runs."""
