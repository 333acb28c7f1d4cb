"""Stages in a result folder: reading, writing, the verdict, and studies of several designs."""
