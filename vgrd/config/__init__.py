"""The cell file: from TOML to checked values, facts and the process table.

Nothing here imports pydantic but `cell_file` and `document`: the cell process starts from the resolved file.
May import the documents, the model and the geometry.
"""
