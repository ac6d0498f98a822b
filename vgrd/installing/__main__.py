"""`vgrd install` and `vgrd uninstall`, also as `python3 -m vgrd.installing` where vgrd is not installed yet."""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from vgrd.errors import InputError, VgrdError
from vgrd.installing.execution import alone, carry_out, show
from vgrd.installing.looking import check_python, check_systemd, found_at, wish_of
from vgrd.installing.places import Places
from vgrd.installing.plans import Found, Plan, installation, removal, rollback
from vgrd.installing.steps import holds

PURGE = "everything"  # the word to be typed
_SOURCE = Path(__file__).parents[2]
_SYSTEM_PYTHON = "/usr/bin/python3"  # Debian's is new enough, and lies where the service sees it


def main(words: Sequence[str]) -> None:
    """Do what the words say. Raises VgrdError."""
    arguments = parser().parse_args(words)
    places = Places(arguments.root.resolve())
    if not places.is_trial and not arguments.dry_run and os.geteuid() != 0:
        raise InputError(
            "this changes the machine and needs root: sudo; or try it with --root DIR"
        )
    if arguments.dry_run:
        plan, _ = arguments.plan(places, arguments)
        show(plan, print)
        return
    check_systemd(places)
    before = os.umask(0o022)  # whatever root's is: the service reads what is written here
    try:
        with alone(places.versions):
            plan, found = arguments.plan(places, arguments)
            carry_out(plan, print)
    finally:
        os.umask(before)
    print(arguments.closing(places, found, arguments))


def parser() -> argparse.ArgumentParser:
    """Every option, once."""
    vgrd = argparse.ArgumentParser(prog="vgrd", description=__doc__)
    verbs = vgrd.add_subparsers(required=True, metavar="install | uninstall")
    install = verbs.add_parser("install", help="install, update, or go back to an older version")
    install.add_argument(
        "source", nargs="?", type=Path, default=_SOURCE, help="folder of the project"
    )
    install.add_argument(
        "--cell", type=Path, help="cell file to begin with; one that is there stays"
    )
    install.add_argument("--python", default=_SYSTEM_PYTHON, help="interpreter (%(default)s)")
    install.add_argument(
        "--extras", default="cameras", help="extras of pyproject.toml (%(default)s)"
    )
    install.add_argument("--wheels", type=Path, help="folder with all packages, for no network")
    install.add_argument(
        "--rollback",
        nargs="?",
        const="",
        metavar="VERSION",
        help="go back to the version before, or to VERSION; nothing is installed",
    )
    install.set_defaults(plan=_plan_of_install, closing=_words_after_install)
    uninstall = verbs.add_parser("uninstall", help="take it off; sessions and calibrations stay")
    uninstall.add_argument(
        "--purge",
        choices=[PURGE],
        help="remove sessions, calibrations, backups and the cell file too",
    )
    uninstall.set_defaults(plan=_plan_of_uninstall, closing=_words_after_uninstall)
    for verb in (install, uninstall):
        verb.add_argument(
            "--root", type=Path, default=Path("/"), help="a trial: all of it below DIR"
        )
        verb.add_argument("--dry-run", action="store_true", help="tell the steps and do nothing")
    return vgrd


def _plan_of_install(places: Places, arguments: argparse.Namespace) -> tuple[Plan, Found]:
    if arguments.rollback is not None:
        found = found_at(places)
        return rollback(places, found, arguments.rollback), found
    check_python(places, arguments.python)
    wish = wish_of(
        arguments.source, arguments.cell, arguments.python, arguments.extras, arguments.wheels
    )
    found = found_at(places, wish.cell_text)
    return installation(places, wish, found), found


def _words_after_install(places: Places, before: Found, arguments: argparse.Namespace) -> str:
    now = found_at(places)
    words = [
        f"{now.current} is in use"
        + (f", before it was {before.current}" if before.current else "")
    ]
    if arguments.cell is not None and not holds(places.cell_file, arguments.cell.read_text()):
        words.append(
            f"{places.cell_file} stays as it was and is in use; {arguments.cell} is another one: copy it there"
            " yourself if you mean it, then: vgrd reload"
        )
    if not before.has_cell_file and arguments.cell is None:
        words.append(
            f"{places.cell_file} is an example: describe your cell in it, then: vgrd check"
            f" {places.cell_file} && systemctl start vgrd"
        )
    elif not (now.is_running or places.is_trial):
        words.append("the service was stopped and stays so: systemctl start vgrd")
    words.append("operators: adduser NAME vgrd, then they log in anew")
    return "\n".join(words)


def _plan_of_uninstall(places: Places, arguments: argparse.Namespace) -> tuple[Plan, Found]:
    found = found_at(places)
    return removal(places, found, purge=arguments.purge == PURGE), found


def _words_after_uninstall(places: Places, found: Found, arguments: argparse.Namespace) -> str:
    if arguments.purge:
        rest = "" if found.state == places.state else f" and the state folder {found.state}"
        return f"all of it is gone; what stays is the user vgrd (deluser vgrd){rest}"
    return (
        f"kept: {found.state} (sessions, calibrations), {places.backups}, {places.cell_file};"
        f" they go with: vgrd uninstall --purge {PURGE}"
    )


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except VgrdError as error:
        print(f"vgrd: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
