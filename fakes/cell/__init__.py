"""A fake cell with the real daemon: start, teach, serve, watch.

May import world, camera and controllers.
"""
