"""Command line of the fakes: one module per `python -m fakes NAME`, each with `main`."""
