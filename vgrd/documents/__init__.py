"""TOML that people write, and what is wrong with it: read, checked, every fault with key and remedy.

May import pydantic, the permissions and the errors. The gate and the drivers keep small parsers of their
own: they start without pydantic, and so does the cell process, which reads what was checked before.
"""
