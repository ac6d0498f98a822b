"""Hand-eye calibration from pairs of poses or from points, certified.

May import observability; `published` holds the methods of others, unrefined.
"""
