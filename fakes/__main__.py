"""Start a fake device: `python -m fakes NAME [OPTIONS]`; `--help` lists the names."""

import argparse
import importlib

import typer

# Name: (module with a function `main` that typer turns into a command line, what it is).
COMMANDS = {
    "camera": ("fakes.commands.camera", "GigE Vision camera, 12 MP, software trigger"),
    "cell": ("fakes.commands.cell", "fake robot, camera and daemon, calibrated, until Ctrl-C"),
    "demo": (
        "fakes.commands.demo",
        "the whole job of the daemon on a fake cell, with true errors",
    ),
    "layout": ("fakes.commands.layout", "the fake cell in words, and what its camera sees"),
    "modbus-robot": (
        "fakes.commands.modbus_robot",
        "robot that shows its pose over Modbus TCP or RTU",
    ),
    "paper": ("fakes.commands.paper", "the paper's data beside ours, one HTML page"),
    "rtde": ("fakes.commands.rtde", "Universal Robots controller, RTDE on port 30004"),
}


def main() -> None:
    """Run the command that is named first; imports only that command's module."""
    names = "\n".join(f"  {name:14} {purpose}" for name, (_, purpose) in COMMANDS.items())
    parser = argparse.ArgumentParser(
        prog="python -m fakes",
        description="Devices that do not exist, speaking the real protocols.",
        epilog=f"commands:\n{names}\n\npython -m fakes COMMAND --help tells its options.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("command", choices=COMMANDS, metavar="COMMAND")
    parser.add_argument("options", nargs=argparse.REMAINDER, metavar="OPTIONS")
    chosen = parser.parse_args()
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command()(importlib.import_module(COMMANDS[chosen.command][0]).main)
    app(args=chosen.options, prog_name=f"python -m fakes {chosen.command}")


if __name__ == "__main__":
    main()
