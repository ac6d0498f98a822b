"""The programs of the brands, each with what runs it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from tests.robot_programs.brands.karel import DIALECT as KAREL
from tests.robot_programs.brands.karel import run_fanuc
from tests.robot_programs.brands.krl import DIALECT as KRL
from tests.robot_programs.brands.krl import run_krl
from tests.robot_programs.brands.outcome import Outcome, faults_of, faults_of_block
from tests.robot_programs.brands.rapid import DIALECT as RAPID
from tests.robot_programs.brands.rapid import run_rapid
from tests.robot_programs.brands.scenarios import DOCUMENTS, LINES, REGISTERS, Scenario
from tests.robot_programs.brands.scl import DIALECT as SCL
from tests.robot_programs.brands.scl import run_siemens
from tests.robot_programs.brands.translation import Dialect
from tests.robot_programs.brands.world import World

FOLDER = Path(__file__).parents[3] / "config/robot_programs"


@dataclass(frozen=True, eq=False)
class Program:
    """The files of a program, and the scenarios that its way of talking has."""

    paths: tuple[Path, ...]
    dialect: Dialect
    run: Callable[[str, World, Mapping[str, object]], Outcome]
    scenarios: list[Scenario]
    judge: Callable[[Scenario, Callable[[World, Mapping[str, object]], Outcome]], list[str]] = (
        faults_of
    )

    @property
    def moves(self) -> bool:
        return self.judge is faults_of

    @property
    def source(self) -> str:
        return "\n".join(path.read_text(encoding="ascii") for path in self.paths)

    @property
    def called(self) -> str:
        """The program in small letters, without blanks before brackets."""
        return self.source.lower().replace(" (", "(")

    def faults(self, scenario: Scenario, source: str) -> list[str]:
        """Return what `source` does otherwise than the decision table says."""
        return self.judge(scenario, lambda world, settings: self.run(source, world, settings))


def _files(brand: str, *names: str) -> tuple[Path, ...]:
    return tuple(FOLDER / brand / name for name in names)


PROGRAMS = {
    "abb": Program(_files("abb", "Vgrd.mod"), RAPID, run_rapid, LINES),
    "kuka": Program(
        _files("kuka", "vgrd.src", "vgrd.dat", "vgrdsub.src", "vgrdsub.dat"),
        KRL,
        run_krl,
        DOCUMENTS,
    ),
    "siemens": Program(
        _files("siemens", "FB_VgrdAsk.scl"), SCL, run_siemens, REGISTERS, judge=faults_of_block
    ),
    "fanuc": Program(_files("fanuc", "vgrd.kl", "vgrd_go.ls"), KAREL, run_fanuc, LINES),
}
CASES = [
    (brand, scenario) for brand, program in PROGRAMS.items() for scenario in program.scenarios
]
