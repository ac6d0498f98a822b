"""Hand-eye data that others recorded: a DATASET.toml in, a solution with a verdict out.

May import documents, vision, calibration and judging.
"""

from vgrd.solving.datasets.loading import Dataset, load_dataset
from vgrd.solving.datasets.solution import DatasetSolution
from vgrd.solving.datasets.solving import fit_dataset, solve_dataset

__all__ = ["Dataset", "DatasetSolution", "fit_dataset", "load_dataset", "solve_dataset"]
