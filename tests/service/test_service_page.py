"""What docs/service.md tells people to type is there, option by option, and does what it says."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import click
import pytest
import typer

from fakes.confinement.unit_file import read_section
from vgrd.cli import app
from vgrd.gate.supervisor import CONFIG_EXIT
from vgrd.installing import __main__ as installing
from vgrd.installing.places import Places

MAKE, NFT = shutil.which("make") or "make", shutil.which("nft")
ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "service.md").read_text(encoding="utf-8")
PROGRAMS = {
    *("adduser", "apt", "cd", "chronyc", "du", "ethtool", "git", "journalctl", "make", "nft"),
    *("ping", "sysctl", "systemctl", "tar", "vgrd"),
}


def blocks(kind: str) -> list[str]:
    """The blocks of one kind on the page."""
    return re.findall(rf"^```{kind}\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


def commands() -> list[list[str]]:
    """Each command to be typed, as words."""
    lines = [line[2:] for block in blocks("console") for line in block.splitlines()]
    return [shlex.split(part) for line in lines for part in line.split("&&")]


def of(program: str) -> list[list[str]]:
    return [words for words in commands() if words[0] == program]


def test_only_programs_that_are_known_are_typed() -> None:
    assert {words[0] for words in commands()} == PROGRAMS


@pytest.mark.parametrize("words", of("vgrd"), ids=" ".join)
def test_every_command_of_vgrd_takes_what_the_page_gives_it(words, monkeypatch) -> None:
    _, verb, *arguments = words
    if verb in ("install", "uninstall"):
        installing.parser().parse_args([verb, *arguments])
        return
    monkeypatch.setenv("VGRD_CONFIG", "/etc/vgrd/cell.toml")
    group = typer.main.get_command(app)
    assert isinstance(group, click.Group) or hasattr(group, "commands")
    group.commands[verb].make_context(verb, arguments)  # parses, and runs nothing


@pytest.mark.parametrize("words", of("make"), ids=" ".join)
def test_make_installs_with_what_the_page_gives_it(words) -> None:
    settings = dict(word.partition("=")[::2] for word in words[2:])
    assert words[1] == "install"
    installing.parser().parse_args(["install", *shlex.split(settings.get("ARGS", ""))])
    clean = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    said = subprocess.run(
        [MAKE, "--dry-run", *words[1:]],
        cwd=ROOT,
        env=clean,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert said.split() == [
        "python3",
        "-m",
        "vgrd.installing",
        "install",
        *shlex.split(settings.get("ARGS", "")),
    ]


def test_make_tells_every_step_and_does_none(tmp_path) -> None:
    words = [MAKE, "install", f"ARGS=--dry-run --root {tmp_path} --python {sys.executable}"]
    said = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert len([line for line in said.splitlines() if line.startswith("would ")]) > 10
    assert list(tmp_path.iterdir()) == []


def test_the_paths_of_the_page_are_those_of_an_installation() -> None:
    places = Places(Path("/"))
    for path in (
        places.current,
        places.source("current"),
        places.cell_file,
        places.units / "vgrd.service",
        places.command,
        places.profile,
        places.state,
        places.cache,
        places.backups,
    ):
        assert f"`{path}`" in PAGE, path


def test_units_of_the_page_are_ours_or_debians() -> None:
    known = {"vgrd", "vgrd.service", "vgrd.socket", "nftables", "systemd-networkd"}
    verbs = {"status", "stop", "start", "restart", "enable"}
    for _, verb, *units in of("systemctl"):
        assert verb in verbs
        assert {unit for unit in units if unit != "--now"} <= known


def test_exit_code_of_a_faulty_cell_file_is_as_told() -> None:
    assert f"(exit code {CONFIG_EXIT})" in PAGE


@pytest.mark.skipif(NFT is None, reason="nft is not installed")
def test_the_firewall_is_one(tmp_path) -> None:
    (rules,) = blocks("nft")
    (tmp_path / "rules").write_text(rules)
    done = subprocess.run(
        [str(NFT), "--check", "--file", str(tmp_path / "rules")],
        capture_output=True,
        text=True,
        check=False,
    )
    if "Operation not permitted" in done.stderr:
        pytest.skip("nft needs root")
    assert done.returncode == 0, done.stderr


def test_kernel_settings_of_the_page_are_there() -> None:
    (text,) = blocks("sysctl")
    for line in text.splitlines():
        name = line.partition(" =")[0]
        assert (Path("/proc/sys") / name.replace(".", "/")).exists() or name.startswith(
            "net.core."
        )


def test_drop_ins_of_the_page_change_the_service_only(tmp_path) -> None:
    for number, text in enumerate(blocks("ini")):
        path = tmp_path / f"{number}.conf"
        path.write_text(text)
        assert text.startswith("[Service]\n")
        assert read_section(path, "Service")
