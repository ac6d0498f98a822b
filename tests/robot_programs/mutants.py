"""Robot programs with one decision taken out: each must fail a scenario of its row."""

import ast
import copy
import re
from collections.abc import Iterator
from dataclasses import dataclass

# What can never be doubted, by language: without it the program is the same one.
_NEVER = {
    "urscript": "not vgrd_is_whole",  # all registers come in one answer
    "urscript for CB3": "vgrd_link_",  # the age of a signal cannot be asked there
}
_MARKED = re.compile(r"^(\s*)(.+?) # ([A-Z0-9_]+)$")


@dataclass(frozen=True)
class Mutant:
    """A program without one decision."""

    row: str
    what: str
    source: str

    def __str__(self) -> str:
        return f"{self.row} {self.what}"


def urscript_mutants(text: str, language: str) -> Iterator[Mutant]:
    """Each line that a word marks: statements left out, conditions never, always, and partly."""
    lines = text.splitlines()
    for index, line in enumerate(lines):
        if marked := _MARKED.match(line):
            indent, code, row = marked.groups()
            for other in _others(code, _NEVER[language]):
                source = "\n".join([*lines[:index], indent + other, *lines[index + 1 :]])
                yield Mutant(row, f"{index + 1}: {other}", source)


def _others(code: str, never: str) -> Iterator[str]:
    if not code.startswith("if "):
        yield "sync()"
        return
    yield "if True:"
    parts = code.removeprefix("if ").removesuffix(":").split(" or ")
    doubted = [part for part in parts if never not in part]
    if doubted:
        yield "if False:"
    if len(parts) > 1:
        for left_out in doubted:
            yield f"if {' or '.join(part for part in parts if part != left_out)}:"


def python_mutants(text: str) -> Iterator[Mutant]:
    """Each doubt is not raised."""
    tree = ast.parse(text)
    for index, node in enumerate(ast.walk(tree)):
        match node:
            case ast.Raise(
                exc=ast.Call(func=ast.Name(id="Doubt"), args=[ast.Constant(value=str(row)), *_])
            ):
                mutated = copy.deepcopy(tree)
                raised = list(ast.walk(mutated))[index]
                source = ast.unparse(_WithoutRaise(raised).visit(mutated))
                yield Mutant(row, f"{node.lineno}: no doubt", source)


class _WithoutRaise(ast.NodeTransformer):
    def __init__(self, raised: ast.AST) -> None:
        self._raised = raised

    def visit_Raise(self, node: ast.Raise) -> ast.stmt:
        return ast.Pass() if node is self._raised else node


_STATEMENTS = (  # of the client: what stands there, and what is left of it
    ("LINK", 'self._react(Doubt("LINK", Reaction.STOP, str(lost)), now_s)', "pass"),
    ("TRIG", "self.trig % LAST_TRIG + 1", "self.trig + 1"),
    ("TRIG", "self.link.write([0] * REQUEST_WORDS)", "pass"),
    (
        "ASK_AGAIN",
        "self._at_approach, self._asked, self.state = True, 0, State.ASK",
        "self._at_approach, self._asked, self.state = True, 0, State.AT_POINT",
    ),
    ("STOP", "            self.arm.stop()\n", ""),
    (
        "RETREAT",
        "        if self._at_approach:\n            self._go_back()\n        else:\n",
        "        if True:\n",
    ),
    (
        "RESUME",
        "        if self.state is State.STOPPED:\n            self.start()",
        "        pass",
    ),
    (
        "POLL",
        "    def _last_leg(self, words: Sequence[int], _: float) -> None:\n        self._poll(words)\n",
        "    def _last_leg(self, words: Sequence[int], _: float) -> None:\n",
    ),
    (
        "POLL",
        "    def _to_approach(self, words: Sequence[int], _: float) -> None:\n        self._poll(words)\n",
        "    def _to_approach(self, words: Sequence[int], _: float) -> None:\n",
    ),
    ("APPROACH", "-self.limits.approach_mm", "0.0"),
)


def statement_mutants(text: str) -> Iterator[Mutant]:
    """Each action of the client is left out."""
    for row, there, left in _STATEMENTS:
        assert text.count(there) == 1, there
        yield Mutant(
            row, f"without {there.strip().splitlines()[-1].strip()}", text.replace(there, left)
        )
