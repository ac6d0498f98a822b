"""Tags in pictures: search, both poses of a plane, the observation with its covariance.

May import images, print and alignment.
"""
