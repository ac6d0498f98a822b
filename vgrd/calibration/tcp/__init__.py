"""The TCP from touches of a fixed point, a plane or a ball.

May import touches and observability.
"""
