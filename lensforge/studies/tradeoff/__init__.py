"""Accuracy against time, measured on one scene: each knob's ladder, with the error that every rung leaves."""
