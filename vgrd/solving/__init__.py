"""Offline work: a session, a dataset or a file of touches becomes a result with a verdict.

Never runs beside the deadline; may import documents, calibration, vision and store.
"""
