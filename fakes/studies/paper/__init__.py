"""Figures and tables of the paper, and its conventional methods."""
