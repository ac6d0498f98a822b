"""URScript is turned into Python only where both mean the same."""

import pytest

from tests.robot_programs.urscript.controller import Int32
from tests.robot_programs.urscript.translation import translate


def body(*lines: str) -> str:
    return "global seen = 0\ndef f(a):\n" + "".join(f"  {line}\n" for line in lines) + "end\n"


def run(text: str) -> dict[str, object]:
    names: dict[str, object] = {}
    exec(translate(text), names)  # noqa: S102
    return names


def test_blocks_globals_and_locals_are_those_of_urscript():
    names = run(
        body(
            "local n = 0  # counts",
            "while n < a:",
            "  if n == 1:",
            "    global seen = n",
            "  elif n == 2:",
            '    global seen = "# two"',
            "  else:",
            "    n = n",
            "  end",
            "  n = n + 1",
            "end",
            "return n",
        )
    )
    assert names["f"](2) == 2
    assert names["seen"] == 1
    assert names["f"](3) == 3
    assert names["seen"] == "# two"


@pytest.mark.parametrize(
    ("lines", "fault"),
    [
        (["return a / 2"], "/ or %"),
        (["return a % 2"], "/ or %"),
        (["a[0] = 2"], "an element"),
        (["seen = 2"], "neither local nor marked"),
        (["if a:", "  local b = 2", "end"], "begins inside a block"),
        (["return nobody"], "nobody defines nobody"),
        (["return sync(1)"], "sync takes 0 to 0"),
        (["return f()"], "f takes 1 to 1"),
        (["if a:"], "not ended"),
        (["end", "end"], "end of nothing"),
    ],
)
def test_what_would_differ_is_refused(lines, fault):
    with pytest.raises(SyntaxError, match=fault):
        translate(body(*lines))


def test_whole_numbers_have_32_bits():
    high = Int32(0xFFFE)
    with pytest.raises(OverflowError):
        high * 65536
    assert (high - 65536) * 65536 + Int32(5) == -131067
    assert high * 0.5 == 32767.0
