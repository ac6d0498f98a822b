"""What is wrong with prints, lenses, lamps and cameras, one thing at a time."""

from collections.abc import Mapping
from types import MappingProxyType

from fakes.camera.foreign.optics import disc, moffat, streak
from fakes.camera.foreign.photograph import Conditions
from fakes.camera.foreign.sensor import Light, Sensor
from fakes.camera.foreign.sheet import Printer


def _print(printer: Printer) -> Conditions:
    return Conditions(printer=printer)


FAULTS: Mapping[str, Conditions] = MappingProxyType(
    {
        "clean": Conditions(),
        "ink +0.01 mm": _print(Printer(ink_mm=(0.01, 0.01))),
        "ink -0.01 mm": _print(Printer(ink_mm=(-0.01, -0.01))),
        "ink +0.01 mm in x": _print(Printer(ink_mm=(0.01, 0.0))),
        "ink -0.01 mm in y": _print(Printer(ink_mm=(0.0, -0.01))),
        "ragged 0.003 mm": _print(Printer(ragged_mm=0.003, ragged_length_mm=0.3)),
        "ragged 0.01 mm, fine": _print(Printer(ragged_mm=0.01, ragged_length_mm=0.1)),
        "dots of 0.042 mm": _print(Printer(dot_mm=0.0423)),
        "grain": _print(Printer(grain=0.04)),
        "halftone": _print(Printer(screen=0.06)),
        "stretched 0.1 % in x": _print(Printer(stretch=(0.001, 0.0))),
        "stretched 0.15 % in y": _print(Printer(stretch=(0.0, 0.0015))),
        "0.1 % too large": _print(Printer(stretch=(0.001, 0.001))),
        "defocus, disc of 1.5 px": Conditions(spread=disc(1.5)),
        "defocus, disc of 3 px": Conditions(spread=disc(3.0)),
        "lens with wings": Conditions(spread=moffat(1.8, 2.5), reach_px=12.0),
        "sharper than its pixels": Conditions(spread=None, reach_px=0.0),
        "motion of 3 px": Conditions(spread=streak(3.0, 0.4, 0.7), reach_px=5.0),
        "gamma 1/2.2": Conditions(sensor=Sensor(gamma=1 / 2.2)),
        "gamma 0.8": Conditions(sensor=Sensor(gamma=0.8)),
        "clipped": Conditions(light=Light(exposure=1.5)),
        "a quarter of the light": Conditions(light=Light(exposure=0.2)),
        "an eighth of the light": Conditions(light=Light(exposure=0.1)),
        "gloss": Conditions(light=Light(exposure=0.7, gloss=0.15, gloss_px=40.0)),
        "JPEG 90": Conditions(sensor=Sensor(jpeg=90)),
        "JPEG 60": Conditions(sensor=Sensor(jpeg=60)),
        "Bayer": Conditions(sensor=Sensor(bayer=True)),
    }
)
