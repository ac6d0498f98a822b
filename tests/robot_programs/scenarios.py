"""What may happen to a robot program, by the rows of the decision table; the same for every language."""

from dataclasses import dataclass, replace

from tests.robot_programs.faults import (
    Fault,
    added,
    another_asks,
    damaged,
    earlier_program,
    ends,
    expires,
    found_at,
    half_good,
    last_trigs,
    nothing,
    of_cell,
    out_of_reach,
    pushed_each_time,
    shown,
    stuck,
)
from tests.robot_programs.world import COORDINATE, Outcome, Rest, When
from vgrd.registers import Status


@dataclass(frozen=True)
class Scenario:
    """A fault at a moment and what any program does then; `row` is the row of the table that it tries.

    languages: which programs can see it, all if empty.
    """

    row: str
    name: str
    fault: Fault
    outcome: Outcome
    when: When = When.START
    languages: tuple[str, ...] = ()

    def is_for(self, language: str) -> bool:
        """Whether a program in that language can see it."""
        return not self.languages or language in self.languages

    def __str__(self) -> str:
        return f"{self.row}: {self.name}"


def stopped(word: str, asks: int, rest: Rest = Rest.START, status: int = 0) -> Outcome:
    """The program stopped."""
    return Outcome(word, status, asks, rest)


def arrived(asks: int = 2) -> Outcome:
    """It went to the coordinate and came back from it."""
    return Outcome("", 0, asks, Rest.APPROACH)


def refused(status: Status, asks: int, rest: Rest = Rest.START) -> Outcome:
    """It stopped for a STATUS."""
    return stopped("STATUS", asks, rest, status)


SENTINEL32 = 0x80000000


SCENARIOS = (
    Scenario("LINK", "nobody answers", of_cell(link=False), stopped("LINK", 0)),
    Scenario(
        "LINK",
        "the cable is pulled on the way",
        of_cell(link=False),
        stopped("LINK", 1, Rest.BETWEEN),
        When.APPROACH,
    ),
    Scenario(
        "LINK",
        "the cable is pulled in the last leg",
        of_cell(link=False),
        stopped("LINK", 2, Rest.APPROACH),
        When.LAST_LEG,
    ),
    Scenario("MAP_VERSION", "another map", shown(MAPVER=0x0200), stopped("MAP_VERSION", 0)),
    Scenario("HEARTBEAT", "HB never moves", shown(HB=7), stopped("HEARTBEAT", 0)),
    Scenario("HEARTBEAT", "the cell is dead", of_cell(alive=False), stopped("HEARTBEAT", 0)),
    Scenario(
        "HEARTBEAT",
        "something goes on answering on the way",
        of_cell(impostor=True),
        stopped("HEARTBEAT", 1, Rest.BETWEEN),
        When.APPROACH,
    ),
    Scenario(
        "HEARTBEAT",
        "something goes on answering in the last leg",
        of_cell(impostor=True),
        stopped("HEARTBEAT", 2, Rest.APPROACH),
        When.LAST_LEG,
    ),
    Scenario("TRIG", "65535 is followed by 1", last_trigs, arrived()),
    Scenario("TRIG", "an earlier program asked the same", earlier_program, arrived()),
    Scenario("ECHO", "no answer", of_cell(answering=False), stopped("ECHO", 3)),
    Scenario("ECHO", "of another request", added(ECHO=7), stopped("ECHO", 3)),
    Scenario("ECHO", "TRIG 0 does not clear", shown(ECHO=5), stopped("ECHO", 0)),
    Scenario("POINT", "of another point", shown(POINT=9), stopped("POINT", 1)),
    Scenario("POINT", "of another object", shown(OBJECT=2), stopped("POINT", 1)),
    Scenario(
        "STATUS",
        "does not pass",
        of_cell(refuse_with=Status.UNKNOWN_POINT),
        refused(Status.UNKNOWN_POINT, 1),
    ),
    Scenario(
        "STATUS",
        "may pass, and does not",
        of_cell(refuse_with=Status.TAG_B_NOT_FOUND),
        refused(Status.TAG_B_NOT_FOUND, 3),
    ),
    Scenario("STATUS", "passes", half_good(Status.CAMERA_OFFLINE), arrived(3)),
    Scenario("STATUS", "degraded", of_cell(degraded=True), refused(Status.OK_DEGRADED, 1)),
    Scenario(
        "STATUS",
        "of the header alone",
        shown(STATUS=Status.CALIBRATION_DRIFT),
        refused(Status.CALIBRATION_DRIFT, 1),
    ),
    Scenario(
        "STATUS",
        "of the block alone",
        shown(EC32_STATUS=Status.ENCODING_OVERFLOW),
        refused(Status.ENCODING_OVERFLOW, 1),
    ),
    Scenario("FORMAT", "of the TCP", shown(FMT=0x10), stopped("FORMAT", 1)),
    Scenario("FORMAT", "in degrees", shown(FMT=0x01), stopped("FORMAT", 1)),
    Scenario("SEQ", "is odd", added(SEQ=1, EC32_SEQ=1), stopped("SEQ", 3)),
    Scenario("SEQ", "of the block is another", added(EC32_SEQ=2), stopped("SEQ", 3)),
    Scenario("SEQ", "the block echoes another", added(EC32_ECHO=1), stopped("SEQ", 3)),
    Scenario(
        "SEQ",
        "a word of the block is another",
        damaged(EC32_X=1),
        stopped("SEQ", 3),
        languages=("python",),
    ),
    Scenario("SENTINEL", "for X", shown(EC32_X=SENTINEL32), stopped("SENTINEL", 1)),
    Scenario("SENTINEL", "for RZ", shown(EC32_RZ=SENTINEL32), stopped("SENTINEL", 1)),
    Scenario("AGE", "an old picture", of_cell(picture_age_s=1.5), stopped("AGE", 3)),
    Scenario("U95", "too uncertain", of_cell(u95_um=1500), stopped("U95", 1)),
    Scenario("U95", "unknown", shown(U95P=0xFFFF), stopped("U95", 1)),
    Scenario("BOX", "too far out", found_at(36_000, 0, 0, 0, 0, 0), stopped("BOX", 1)),
    Scenario("BOX", "under the table", found_at(0, 0, -45_000, 0, 0, 0), stopped("BOX", 1)),
    Scenario("STEP", "too far", found_at(30_000, 35_000, 30_000, 0, 0, 0), stopped("STEP", 1)),
    Scenario("STEP", "turned too far", found_at(0, 0, 0, -450_000, 0, 0), stopped("STEP", 1)),
    Scenario(
        "STEP",
        "a rotation vector of the other sign",
        of_cell(coordinate=(*COORDINATE[:3], -3_140_000, 15_000, -10_000)),
        arrived(),
    ),
    Scenario("REACH", "not the coordinate", out_of_reach("coordinate"), stopped("REACH", 1)),
    Scenario("REACH", "not the approach point", out_of_reach("approach"), stopped("REACH", 1)),
    Scenario("APPROACH", "not reached", stuck, stopped("APPROACH", 1, Rest.BETWEEN)),
    Scenario(
        "APPROACH",
        "the coordinate is not reached",
        stuck,
        stopped("APPROACH", 2, Rest.APPROACH),
        When.AT_APPROACH,
    ),
    Scenario("ASK_AGAIN", "it is where it was", nothing, arrived()),
    Scenario(
        "ASK_AGAIN",
        "it was pushed while the arm came",
        found_at(3_000, 0, 0, 0, 0, 0),
        arrived(3),
        When.AT_APPROACH,
    ),
    Scenario(
        "ASK_AGAIN",
        "it was turned while the arm came",
        found_at(0, 0, 0, 0, 0, 20_000),
        arrived(3),
        When.AT_APPROACH,
    ),
    Scenario(
        "ASK_AGAIN",
        "it is elsewhere each time",
        pushed_each_time,
        stopped("ASK_AGAIN", 4, Rest.ELSEWHERE),
    ),
    Scenario(
        "ASK_AGAIN",
        "the arm hides the tag",
        of_cell(refuse_with=Status.TAG_B_NOT_FOUND),
        refused(Status.TAG_B_NOT_FOUND, 4, Rest.APPROACH),
        When.AT_APPROACH,
    ),
    *(
        Scenario(row, f"{name} {when}", fault, replace(outcome, asks=asks, rest=rest), when)
        for when, asks, rest in (
            (When.APPROACH, 1, Rest.BETWEEN),
            (When.LAST_LEG, 2, Rest.APPROACH),
        )
        for row, name, fault, outcome in (
            (
                "POLL",
                "the object moves",
                ends(Status.OBJECT_MOVED),
                refused(Status.OBJECT_MOVED, 0),
            ),
            (
                "POLL",
                "the tag is hidden",
                ends(Status.TAG_B_NOT_FOUND),
                refused(Status.TAG_B_NOT_FOUND, 0),
            ),
            ("POLL", "the answer expires", expires, refused(Status.IMAGE_TOO_OLD, 0)),
            ("POLL", "the cell dies", of_cell(alive=False), refused(Status.INTERNAL_ERROR, 0)),
            (
                "POLL",
                "another answer comes",
                lambda world: world.cell.answer_anew(),
                stopped("POLL", 0),
            ),
            (
                "STOP",
                "the robot stops for safety",
                ends(Status.ROBOT_SAFETY_STOP),
                refused(Status.ROBOT_SAFETY_STOP, 0),
            ),
        )
    ),
    Scenario(
        "POLL",
        "another client asks",
        another_asks,
        refused(Status.BUSY, 3, Rest.APPROACH),
        When.LAST_LEG,
    ),
    Scenario(
        "POLL",
        "the answer is another's",
        added(ECHO=1),
        stopped("POLL", 2, Rest.APPROACH),
        When.LAST_LEG,
    ),
    Scenario(
        "RETREAT",
        "the tag slips in the last leg",
        ends(Status.CALIBRATION_DRIFT),
        refused(Status.CALIBRATION_DRIFT, 2, Rest.APPROACH),
        When.LAST_LEG,
    ),
    Scenario(
        "RESUME",
        "somebody presses the key, and it is well again",
        ends(Status.TCP_OFFSET_CHANGED),
        refused(Status.TCP_OFFSET_CHANGED, 1, Rest.BETWEEN),
        When.APPROACH,
    ),
)
