"""What the command line can do: one module per group, each with `register(app)`.

Commands only take arguments and print. They import what they call when they are called, so that
`vgrd --help` and `vgrd status` load neither numpy nor pydantic; nothing of the cell process, ever.
"""
