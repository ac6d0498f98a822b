"""The programs hold the numbers of the table, the map and the codes: nothing was copied wrongly."""

import re

import pytest

from tests.robot_programs import python_run
from tests.robot_programs.python_run import module_of
from tests.robot_programs.trying import RUNS, TEXTS
from tests.robot_programs.urscript.controller import Controller
from tests.robot_programs.world import Rest, When, World
from vgrd.registers import MAP_VERSION, REQUEST, RESPONSE, Command, Status
from vgrd.registers.decisions import DECISIONS, LIMITS, STATUS_REACTIONS, Reaction

WORDS = {row.word for row in DECISIONS}
ADDRESSES = {field.name: field.address for field in RESPONSE.fields}
CLIENT = module_of(python_run.FILE.read_text())
SCRIPT = TEXTS["urscript"]
PASSING = {
    code for code, (reaction, _) in STATUS_REACTIONS.items() if reaction is Reaction.ASK_AGAIN
}


@pytest.fixture
def script(tmp_path):
    run = RUNS["urscript"](World(tmp_path, When.START, lambda _: None), SCRIPT)
    yield run.names
    run.close()


@pytest.mark.parametrize("limit", LIMITS, ids=lambda limit: limit.word)
def test_the_limits_are_those_of_the_table(script, limit):
    assert getattr(CLIENT.Limits(), limit.word.lower()) == limit.value
    assert script[f"VGRD_{limit.word}"] == limit.value


def test_the_registers_are_those_of_the_map(script):
    assert {name: ADDRESSES[name] for name in CLIENT.WORDS} == CLIENT.WORDS
    indices = {
        name.removeprefix("VGRD_R_"): index + RESPONSE.start
        for name, index in script.items()
        if name.startswith("VGRD_R_")
    }
    assert indices == {name: ADDRESSES[name] for name in indices}
    assert set(CLIENT.WORDS) - {"EC32_CRC"} == set(indices)  # URScript has no CRC-32
    assert CLIENT.MAP_VERSION == script["VGRD_MAP_VERSION"] == MAP_VERSION
    assert REQUEST.end == CLIENT.REQUEST_WORDS
    assert CLIENT.CMD_FRESH == Command.EC_FRESH
    assert script["VGRD_BUSY"] == CLIENT.BUSY == Status.BUSY
    assert (CLIENT.OK, CLIENT.OK_DEGRADED) == (Status.OK, Status.OK_DEGRADED)


@pytest.mark.parametrize("status", [*Status, 305, 601, 777, 65535])
def test_the_same_status_passes_in_every_language(script, status):
    passes = status in PASSING
    assert (status in CLIENT.PASSING) == passes
    assert script["vgrd_passes"](int(status)) == passes


def test_only_words_of_the_table_are_told():
    told = set(re.findall(r'return "([A-Z0-9_]+)"|vgrd_word = "([A-Z0-9_]+)"', SCRIPT))
    assert {word for pair in told for word in pair if word} <= WORDS
    assert set(re.findall(r'Doubt\(\s*"([A-Z0-9_]+)"', TEXTS["python"])) <= WORDS


@pytest.mark.parametrize("language", TEXTS)
def test_every_word_of_the_table_stands_where_its_decision_is_taken(language):
    text = TEXTS[language]
    assert {word for word in WORDS if re.search(rf"\b{word}\b", text)} == WORDS


@pytest.mark.parametrize("language", TEXTS)
def test_five_places_are_named_before_anything_else(language):
    text = TEXTS[language]
    places = re.findall(r"^# --- (\d) [A-Z]+", text, re.MULTILINE)
    assert places == ["1", "2", "3", "4", "5"]
    assert "ot run on hardware" in text


def test_a_degraded_answer_is_used_where_the_user_allows_it(tmp_path):
    world = World(tmp_path, When.START, lambda world: setattr(world.cell, "degraded", True))
    run = RUNS["urscript"](world, SCRIPT)
    run.names["VGRD_DEGRADED_ALLOWED"] = True
    outcome = run.start()
    run.close()
    assert (outcome.word, outcome.rest) == ("", Rest.APPROACH)


def test_a_degraded_answer_is_used_by_the_client_too(tmp_path):
    world = World(tmp_path, When.START, lambda world: setattr(world.cell, "degraded", True))
    run = RUNS["python"](world, TEXTS["python"])
    run.program.request = CLIENT.Request(degraded_allowed=True)
    outcome = run.start()
    assert (outcome.word, outcome.rest) == ("", Rest.APPROACH)


PENDANT = """
def pendant():
  global went = ""
  if vgrd_begin():
    global went = "asked"
    movej(get_inverse_kin(vgrd_above_tcp, VGRD_TAUGHT_Q), 0.8, 0.5)
    if vgrd_confirm():
      global went = "confirmed"
      while vgrd_valid():
        sync()
      end
      global went = "stopped"
    end
  end
end
"""


def test_the_expression_of_until_becomes_true_within_a_poll(tmp_path):
    world = World(tmp_path, When.START, lambda _: None)
    run = RUNS["urscript"](world, SCRIPT + PENDANT)
    controller: Controller = run.controller
    task = controller.start(run.names["pendant"])
    while run.names.get("went") != "confirmed":
        controller.frame()
    for _ in range(20):
        controller.frame()
    assert run.names["went"] == "confirmed"
    ended_s = world.clock.monotonic()
    world.cell.end(Status.OBJECT_MOVED)
    while task.lives:
        controller.frame()
    run.close()
    assert run.names["went"] == "stopped"
    assert run.names["vgrd_word"] == "STATUS"
    assert world.clock.monotonic() - ended_s <= 0.05 + 0.02 + 2 * 0.008  # poll, publishing, frames
