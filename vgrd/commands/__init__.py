"""What the command line can do: one module per group, each with `register(app)`."""
