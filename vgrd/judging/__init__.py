"""The one judge: every threshold once, every finding once, for sessions, datasets, touch files, pictures.

Imports the model only; calibration and solving use it. docs/checks.md is written from `findings`.
"""
