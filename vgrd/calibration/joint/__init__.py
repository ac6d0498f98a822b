"""The joint estimate: all evidence of a session in one maximum-likelihood problem.

May import touches, hand_eye, universal and turntable.
"""
