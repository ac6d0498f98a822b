"""The paper's plans, step by step: touches, rotation centre, verdict.

May import every method and checks.
"""
