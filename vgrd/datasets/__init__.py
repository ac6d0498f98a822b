"""Hand-eye data that others recorded: a DATASET.toml in, a solution with a verdict out."""

from vgrd.datasets.loading import Dataset, load_dataset
from vgrd.datasets.solution import DatasetSolution
from vgrd.datasets.solving import solve_dataset

__all__ = ["Dataset", "DatasetSolution", "load_dataset", "solve_dataset"]
