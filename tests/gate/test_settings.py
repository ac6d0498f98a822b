"""The process table as `vgrd run` writes it is what the gate reads."""

from pathlib import Path

import pytest

from vgrd.config.cell_file import load_config
from vgrd.config.resolved import Resolved, save_resolved
from vgrd.config.setup import process_table
from vgrd.errors import ConfigError
from vgrd.gate.settings import load_settings, save_table
from vgrd.registers import Scale16

EXAMPLE = Path(__file__).parents[2] / "config" / "cell.example.toml"


@pytest.mark.parametrize("scale", Scale16)
def test_the_int16_scale_of_the_cell_file_reaches_the_gate(tmp_path, scale):
    config = load_config(EXAMPLE)
    serving = config.serving.model_copy(update={"int16_scale": scale.name.lower()})
    config = config.model_copy(update={"serving": serving})
    resolved = Resolved(config, str(EXAMPLE), 0.0)
    save_table(tmp_path, process_table(resolved, save_resolved(resolved, tmp_path)))
    assert load_settings(tmp_path / "processes.json").int16_scale is scale


@pytest.mark.parametrize("line_port", [None, 1503])
def test_the_line_port_of_the_cell_file_reaches_the_gate(tmp_path, line_port):
    text = EXAMPLE.read_text()
    assert "\n# line_port = 1503" in text
    path = tmp_path / "cell.toml"
    path.write_text(text.replace("\n# line_port", "\nline_port") if line_port else text)
    resolved = Resolved(load_config(path), str(path), 0.0)
    save_table(tmp_path, process_table(resolved, save_resolved(resolved, tmp_path)))
    assert load_settings(tmp_path / "processes.json").line_port == line_port


def test_the_ports_of_registers_and_lines_are_two(tmp_path):
    path = tmp_path / "cell.toml"
    path.write_text(EXAMPLE.read_text().replace("\n# line_port = 1503", "\nline_port = 1502"))
    with pytest.raises(
        ConfigError, match=r"line_port: 1502 is .serving. port already.*such as 1503"
    ):
        load_config(path)


def test_every_int16_scale_can_be_written_in_the_cell_file(tmp_path):
    text = EXAMPLE.read_text()
    for scale in Scale16:
        path = tmp_path / f"{scale.name}.toml"
        line = f'[serving]\nint16_scale = "{scale.name.lower()}"\n'
        path.write_text(text.replace("[serving]\n", line) if "[serving]" in text else text + line)
        assert load_config(path).serving.int16_scale == scale.name.lower()


@pytest.mark.parametrize(
    ("section", "told"),
    [
        ("", []),
        ("[metrics]\nport = 9502\n", ["127.0.0.1", "9502"]),
        ('[metrics]\nhost = "::1"\n', []),
    ],
)
def test_prometheus_is_told_where_a_port_is_named_for_it(tmp_path, section, told) -> None:
    text = EXAMPLE.read_text()
    (tmp_path / "cell.toml").write_text(f"{text}\n{section}")
    resolved = Resolved(load_config(tmp_path / "cell.toml"), "cell.toml", 1.7e9)
    save_table(tmp_path, process_table(resolved, save_resolved(resolved, tmp_path)))
    rows = load_settings(tmp_path / "processes.json").processes
    found = [[*row.argv[-2:]] for row in rows if row.name == "metrics"]
    assert found == ([told] if told else [])
