"""Accuracy against time, measured on one scene: each knob's study, with the error that every level leaves."""
