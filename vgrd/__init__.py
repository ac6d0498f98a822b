"""A daemon that calibrates a vision-guided robot cell and serves expected coordinates.

docs/architecture.md shows its rooms; pyproject.toml says who may import whom.
"""

__version__ = "0.1.0"
