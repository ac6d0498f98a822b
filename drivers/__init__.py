"""Adapters to real devices: one module each, with `open(settings, clock)`.

May import vgrd.devices' interface, geometry, errors and clock; no pydantic.
"""
