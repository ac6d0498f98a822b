"""Command line of the fakes: one module per `python -m fakes NAME`, each with `main`.

May import every room of the fakes.
"""
