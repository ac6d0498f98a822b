"""Simulated recordings without pictures or processes, as the studies draw them."""

from vgrd.studies.simulated_cell import COARSE, FINE, SimulatedCell, Vision, fixed_wrist

__all__ = ["COARSE", "FINE", "SimulatedCell", "Vision", "fixed_wrist"]
