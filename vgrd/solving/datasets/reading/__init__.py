"""From the tables of a DATASET.toml and the files that it names to poses, points and a camera.

May import documents, geometry and vision.
"""
