"""The command that shows what the running daemon's camera sees."""

from pathlib import Path
from typing import Annotated

import typer

from vgrd.commands.asking import ConfigOption, SocketOption
from vgrd.commands.printing import JsonOption, Result, console, print_result, show_fields
from vgrd.commands.reloading import running_file, runtime_of_daemon
from vgrd.errors import InputError

_SUFFIXES = (".png", ".jpg", ".jpeg")


def register(app: typer.Typer) -> None:
    """Add snapshot."""
    app.command()(snapshot)


def snapshot(
    out: Annotated[Path, typer.Option(help="Where the picture is written.")] = Path(
        "snapshot.png"
    ),
    plain: Annotated[
        bool, typer.Option(help="As the camera sent it, for vgrd intrinsics: nothing is drawn.")
    ] = False,
    config: ConfigOption = None,
    socket: SocketOption = None,
    json_to: JsonOption = None,
) -> None:
    """Write the newest picture of the daemon's camera, with the tags in it, and what is wrong with them."""
    if out.suffix.lower() not in _SUFFIXES:
        raise InputError(f"--out {out}: name a file that ends with .png or .jpg")
    runtime = runtime_of_daemon(config, socket)
    from vgrd.checking.daemon_picture import newest_picture
    from vgrd.checking.sight import look_at
    from vgrd.clock import SystemClock
    from vgrd.vision.images.drawing import write_picture

    clock = SystemClock()
    image = newest_picture(runtime, clock)
    age_s = round(clock.monotonic() - image.stamp_s, 3)
    sight = look_at(image.pixels, running_file(runtime).config)
    if plain:
        write_picture(out, image.pixels)
    else:
        sight.draw(out)
    result = {"file": str(out), "age_s": age_s, **sight.to_json()}
    print_result(result, json_to, lambda told: show_sight(told, str(out)))


def show_sight(told: Result, title: str) -> None:
    """A table of what is seen, and the remarks below."""
    show_fields(title)({key: value for key, value in told.items() if key != "remarks"})
    for remark in told["remarks"]:
        console.print(remark, highlight=False, markup=False)
