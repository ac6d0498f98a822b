"""A daemon that calibrates a vision-guided robot cell and serves expected coordinates."""

__version__ = "0.1.0"
