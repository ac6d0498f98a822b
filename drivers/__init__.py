"""Adapters to real devices: one module each, with `open(settings, clock)`."""
