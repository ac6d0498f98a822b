"""Simulations and experiments of the paper, repeated by the thousand on data with known truth.

A study draws its data in closed form (no pictures, no processes) and solves it with the very functions
that the daemon uses. Results are bit-identical for any number of workers.
"""
