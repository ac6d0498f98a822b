import numpy as np
import pytest

from fakes.studies.conducting import conduct


@pytest.mark.parametrize("name", ["conventions", "degenerate"])
def test_the_studies_of_checks_clear_every_bar_of_theirs(name, tmp_path):
    outcome = conduct(name, runs=1, workers=1, folder=tmp_path, plot=name == "degenerate")
    missed = [figure.name for figure in outcome.figures if figure.ok is False]
    assert missed == []
    assert all(np.isfinite(figure.value) for figure in outcome.figures)
