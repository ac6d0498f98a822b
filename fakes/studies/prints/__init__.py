"""Tags as they are printed and photographed: what the detector says of itself.

May import the studies' frame and the fake camera's foreign photographs.
"""
