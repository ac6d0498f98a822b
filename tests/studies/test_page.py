"""The page of the paper: complete, of one piece, and with the numbers that the studies gave."""

import csv
import re

import pytest

from fakes.commands.paper import main
from fakes.studies.catalogue import STUDIES
from fakes.studies.page import CHAPTERS
from fakes.studies.page.markdown import html_of
from vgrd.errors import InputError

OF_THE_PAPER = ("fig4", "fig5", "fig10", "experiment-a", "table3", "table3-means", "table4")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A page by one trial of each case, and its folder."""
    folder = tmp_path_factory.mktemp("page")
    main(out=folder / "paper.html", share=0.0, seed=20, workers=1)
    return (folder / "paper.html").read_text(encoding="utf-8"), folder


def test_every_study_of_the_paper_is_on_the_page_with_the_command_that_makes_it(made):
    text, _ = made
    studies = [chapter.study for _, chapters in CHAPTERS for chapter in chapters]
    assert set(OF_THE_PAPER) <= set(studies)
    assert len(set(studies)) == len(studies)
    for name in studies:
        assert STUDIES[name].name == name
        assert f"vgrd study {name} --runs 1 --seed 20" in text


def test_nothing_on_the_page_comes_from_elsewhere(made):
    text, _ = made
    assert "http" not in text
    assert "<script" not in text
    sources = re.findall(r"src='([^']{0,22})", text)
    assert len(sources) == sum(len(chapters) for _, chapters in CHAPTERS)
    assert set(sources) == {"data:image/png;base64,"}


def test_its_numbers_are_those_of_the_trials(made):
    text, folder = made
    with (folder / "paper" / "table4.csv").open(encoding="utf-8") as file:
        row = next(csv.DictReader(file))
    minutes = {key: float(value) for key, value in row.items() if "total" in key}
    assert minutes
    section = text[text.index("id='table4'") :]
    section = section[: section.index("<h3")]
    for value in minutes.values():
        assert f"<td class='n'>{value:.4g}<" in section


def test_the_index_of_equations_is_a_table_of_its_own(made):
    text, _ = made
    index = text[text.index("Index of equations") :]
    for row in ("Eq. 1", "Eq. 19", "Eq. 28-30", "Figure 10", "Table 4"):
        assert f"<td>{row}<" in index


def test_marks_are_turned_and_text_is_kept():
    html = html_of(
        "# A *b*\n\ntext <x> with `a*b*` and [a page](other.md)\n\n| h |\n| --- |\n| **1** |\n"
    )
    assert "<h3>A <i>b</i></h3>" in html
    assert "text &lt;x&gt; with <code>a*b*</code> and a page" in html
    assert "<table><tr><th>h<tr><td><b>1</b></table>" in html


def test_a_page_that_cannot_be_written_is_told_before_any_work(tmp_path):
    (tmp_path / "file").write_text("where a folder should be", encoding="utf-8")
    with pytest.raises(InputError, match="--out"):
        main(out=tmp_path / "file" / "paper.html", share=0.0, seed=1, workers=1)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
