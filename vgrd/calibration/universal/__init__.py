"""The paper's universal method: TCP and object from touches with varied wrists, certified.

May import touches and observability.
"""
