"""Accuracy against time, measured on one scene: a convergence study of each setting, with the error of every level."""
