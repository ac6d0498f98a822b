"""Robot programs made to run: RAPID, KRL, KAREL and SCL, line by line, as Python.

Only the style in which our programs are written is understood: one statement a line, no GOTO, every name used
once. What is not understood is refused. Variables are the attributes of `v`, built-ins those of `b`, the routines
of the program those of `f`; an argument that a built-in changes is handed over as a `Place`.
"""

import copy
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from types import CodeType, FunctionType, SimpleNamespace
from typing import Any

_TOKEN = re.compile(
    r"""(?P<text>"[^"]*"|'[^']*')
    |(?P<number>16\#[0-9A-Fa-f]+|T\#\d+m?s|\d+\.\d+|\d+)
    |(?P<name>[#$\\@]?[A-Za-z_]\w*(?:\#\d+m?s)?)
    |(?P<mark>:=|=>|<>|<=|>=|==|[-+*/=<>()\[\]{},.:;])
    |(?P<blank>\s+)""",
    re.VERBOSE,
)
_WORDS = {
    "and": "and",
    "or": "or",
    "not": "not",
    "mod": "%",
    "div": "//",
    "true": "True",
    "false": "False",
}
_MARKS = {"<>": "!=", "{": "[", "}": "]"}


class NotUnderstoodError(Exception):
    """A line that is not in the style of our programs."""


@dataclass(frozen=True)
class Place:
    """Where a built-in writes: an attribute, or an element, of `holder`."""

    holder: Any
    key: Any

    def put(self, value: Any) -> None:
        if isinstance(self.key, str):
            setattr(self.holder, self.key, value)
        else:
            self.holder[self.key] = value


@dataclass(frozen=True)
class Rule:
    """A line that matches becomes `python`, indented by what `before` and then `after` add.

    python: where it is text, the groups of the match stand in it as expressions.
    """

    pattern: str
    python: str | Callable[["Line", re.Match[str]], str] = ""
    before: int = 0
    after: int = 0


@dataclass(frozen=True, eq=False)
class Dialect:
    r"""What a language says otherwise than the others.

    builtins: name in small letters to its parameters: "in", "out", "cond" for what is looked at again and again;
    "in?" where it may be left out; "\name" for an option of RAPID, "\name=out" where it is written.
    """

    name: str
    comment: str
    routine: str
    end: str
    rules: tuple[Rule, ...]
    builtins: Mapping[str, str]
    equal: str = "="
    assign: str = ":="
    ignored: str = r"(?!)"
    marks: Mapping[str, str] = field(default_factory=dict)
    aliases: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Line:
    """Translates the expressions of a line of a program that has these routines."""

    dialect: Dialect
    routines: frozenset[str]

    def value(self, source: str) -> str:
        """Return the Python of an expression."""
        return self._expression(_tokens(source))

    def call(self, name: str, arguments: str) -> str:
        """Return the Python of a call; `arguments` as they stand between the brackets."""
        return self._call(name, _tokens(arguments))

    def _expression(self, tokens: list[tuple[str, str]]) -> str:
        out: list[str] = []
        i = 0
        while i < len(tokens):
            kind, text = tokens[i]
            following = tokens[i + 1][1] if i + 1 < len(tokens) else ""
            if kind == "name" and following == "(" and text.lower() not in _WORDS:
                close = _closing(tokens, i + 1)
                out.append(self._call(text, tokens[i + 2 : close]))
                i = close + 1
                continue
            out.append(self._atom(kind, text, out[-1] if out else ""))
            i += 1
        return " ".join(out).replace(" . ", ".")

    def _atom(self, kind: str, text: str, before: str) -> str:
        if kind == "text":
            return repr(text[1:-1].replace("\\0A", "\n"))
        if kind == "number":
            return _number(text)
        if kind == "mark":
            return (
                "=="
                if text == self.dialect.equal
                else {**_MARKS, **self.dialect.marks}.get(text, text)
            )
        small = text.lower()
        if before == ".":
            return small
        if small in _WORDS:
            return _WORDS[small]
        return repr(small[1:]) if small[0] == "#" else "v." + variable(small)

    def _call(self, name: str, tokens: list[tuple[str, str]]) -> str:
        small = self.dialect.aliases.get(name.lower(), name.lower())
        parts = _arguments(tokens)
        if small in self.routines:
            return (
                f"b.run({', '.join([f'f.{small}', *(self._expression(part) for part in parts)])})"
            )
        if small not in self.dialect.builtins:
            raise NotUnderstoodError(
                f"{self.dialect.name}: {name} is neither a routine nor in the table of built-ins"
            )
        ways = self.dialect.builtins[small].split()
        options = dict(way[1:].partition("=")[::2] for way in ways if way[0] == "\\")
        ways = [way for way in ways if way[0] != "\\"]
        needed = sum(not way.endswith("?") for way in ways)
        plain = [part for part in parts if part[0][1][0] != "\\"]
        if not needed <= len(plain) <= len(ways):
            raise NotUnderstoodError(
                f"{self.dialect.name}: {name} takes {needed} arguments, not {len(plain)}"
            )
        given = [self._argument(part, way) for part, way in zip(plain, ways, strict=False)]
        for part in (part for part in parts if part[0][1][0] == "\\"):
            option = part[0][1][1:].lower()
            if option not in options:
                raise NotUnderstoodError(f"{self.dialect.name}: {name} has no option {option}")
            value = self._argument(part[2:], options[option]) if part[2:] else "True"
            given.append(f"opt_{option}={value}")
        return f"b.{small}({', '.join(given)})"

    def _argument(self, part: list[tuple[str, str]], way: str) -> str:
        python = self._expression(part)
        if way.startswith("cond"):
            return f"lambda: {python}"
        if not way.startswith("out"):
            return python
        if element := re.fullmatch(r"(.*) \[ (.*) \]", python):
            return f"Place({element[1]}, {element[2]})"
        holder, _, key = python.rpartition(".")
        return f"Place({holder}, {key!r})"


def variable(name: str) -> str:
    """Return the attribute of `v` that holds a variable."""
    return name.lower().replace("$", "sys_").replace("\\", "opt_").replace("@", "at_")


def statements(source: str, comment: str) -> list[tuple[int, str]]:
    """Return number and text of each statement, comments left out, lines with open brackets joined."""
    found: list[tuple[int, str]] = []
    open_since, text = 0, ""
    for number, line in enumerate(source.splitlines()):
        bare = _without_comment(line, comment).strip()
        if not bare:
            continue
        open_since, text = (open_since, f"{text} {bare}") if text else (number, bare)
        outside = re.sub(r"\"[^\"]*\"|'[^']*'", "", text)
        if outside.count("(") <= outside.count(")"):
            found.append((open_since, text))
            text = ""
    return found


def translate(source: str, dialect: Dialect) -> str:
    """Return Python in which each routine of the program is a function of its name in small letters."""
    lines = [text for _, text in statements(source, dialect.comment)]
    heads = [re.match(dialect.routine, text, re.IGNORECASE) for text in lines]
    names = frozenset(head["name"].lower() for head in heads if head)
    line = Line(dialect, names)
    out: list[str] = []
    inside: re.Match[str] | None = None
    body: list[str] = []
    for text, head in zip(lines, heads, strict=True):
        if head:
            inside, body = head, []
        elif inside and re.match(dialect.end, text, re.IGNORECASE):
            out += _routine(line, inside, body)
            inside = None
        elif inside:
            body.append(text)
    return "\n".join(out)


def _routine(line: Line, head: re.Match[str], body: list[str]) -> list[str]:
    parameters = _parameters(head["parameters"] or "")
    out = [f"def {head['name'].lower()}({', '.join(parameters)}):"]
    out += [f"    v.{p} = copy({p})" for p in parameters]
    out += ["    try:", "        pass"]
    depth, handled = 2, False
    for text in body:
        if re.match(line.dialect.ignored, text, re.IGNORECASE):
            continue
        python, before, after = _statement(line, text)
        handled = handled or python.startswith("except")
        depth += before
        out += ["    " * depth + part for part in python.splitlines()]
        depth += after
        if depth < 1 or (depth == 1 and not handled):
            raise NotUnderstoodError(f"{line.dialect.name}: {text}: closes what was not opened")
        if after:
            out.append(
                "    " * depth + ("b.turn_of_loop()" if python.startswith("while") else "pass")
            )
    if depth != 2:
        raise NotUnderstoodError(f"{line.dialect.name}: {head[0]}: a block is not closed")
    return [
        *out,
        "    finally:",
        "        pass",
        *(f"        delattr(v, {p!r})" for p in parameters),
    ]


def load(
    source: str, dialect: Dialect, variables: SimpleNamespace, builtins: object
) -> SimpleNamespace:
    """Return the routines of a program, running on `variables` and `builtins`."""
    routines = SimpleNamespace()
    space: dict[str, Any] = {
        "v": variables,
        "b": builtins,
        "f": routines,
        "Place": Place,
        "ControllerError": ControllerError,
        "copy": _copy,
    }
    exec(_compiled(source, dialect), space)  # noqa: S102, our own programs
    for name, thing in space.items():
        if isinstance(thing, FunctionType) and thing.__code__.co_filename == dialect.name:
            setattr(routines, name, thing)
    return routines


class ControllerError(Exception):
    """What a built-in raises for an ERROR handler."""


@lru_cache(maxsize=4)
def _compiled(source: str, dialect: Dialect) -> CodeType:
    return compile(translate(source, dialect), dialect.name, "exec")


def _copy(value: Any) -> Any:
    """Return a value of its own: records are values in all these languages."""
    return copy.deepcopy(value) if isinstance(value, SimpleNamespace) else value


@lru_cache(maxsize=4096)
def _statement(line: Line, text: str) -> tuple[str, int, int]:
    for rule in line.dialect.rules:
        if match := re.fullmatch(rule.pattern, text, re.IGNORECASE):
            if callable(rule.python):
                return rule.python(line, match), rule.before, rule.after
            python = rule.python.format(*(line.value(group) for group in match.groups()))
            return python, rule.before, rule.after
    bare = text.rstrip(";").strip()
    if assigned := re.fullmatch(
        rf"([$\w.\[\]{{}}]+)\s*{re.escape(line.dialect.assign)}\s*(.+)", bare
    ):
        return f"{line.value(assigned[1])} = copy({line.value(assigned[2])})", 0, 0
    if called := re.fullmatch(r"(\w+)\s*\((.*)\)", bare):
        return line.call(called[1], called[2]), 0, 0
    raise NotUnderstoodError(f"{line.dialect.name}: {text}")


def _parameters(text: str) -> list[str]:
    names = [
        re.split(r"\s*:", part)[0].split()[-1] for part in re.split(r"[,;]", text) if part.strip()
    ]
    return [variable(name) for name in names]


def _tokens(source: str) -> list[tuple[str, str]]:
    tokens, at = [], 0
    while at < len(source):
        match = _TOKEN.match(source, at)
        if not match:
            raise NotUnderstoodError(f"{source[at:]!r} in {source!r}")
        at = match.end()
        if match.lastgroup != "blank":
            tokens.append((str(match.lastgroup), match[0]))
    return tokens


def _closing(tokens: list[tuple[str, str]], opening: int) -> int:
    depth = 0
    for i in range(opening, len(tokens)):
        depth += {"(": 1, ")": -1}.get(tokens[i][1], 0)
        if not depth:
            return i
    raise NotUnderstoodError(f"no closing bracket: {' '.join(text for _, text in tokens)}")


def _arguments(tokens: list[tuple[str, str]]) -> list[list[tuple[str, str]]]:
    parts: list[list[tuple[str, str]]] = [[]]
    depth = 0
    for kind, text in tokens:
        depth += {"(": 1, ")": -1, "[": 1, "]": -1}.get(text, 0)
        if depth == 0 and (text == "," or (text[0] == "\\" and parts[-1])):
            parts.append([])
        if not (depth == 0 and text == ","):
            parts[-1].append((kind, text))
    return [part for part in parts if part]


def _number(text: str) -> str:
    if text.startswith("16#"):
        return hex(int(text[3:], 16))
    if text.startswith("T#"):
        return str(int(text[2:-2]) / 1000 if text.endswith("ms") else float(text[2:-1]))
    return text


def _without_comment(line: str, comment: str) -> str:
    outside = re.compile(rf"(\"[^\"]*\"|'[^']*')|({comment}).*")
    return outside.sub(lambda m: m[1] or "", line)


def without_each_check(source: str, dialect: Dialect) -> Iterator[tuple[str, str]]:
    """Return each program in which one check is missing: the line that begins it, and the rest."""
    lines = source.splitlines()
    stack: list[int] = []
    for number, line in enumerate(lines):
        bare = re.sub(
            r"^ *\d+: *", "", _without_comment(line, dialect.comment)
        ).strip()  # lines of TP are numbered
        if re.match(r"IF .+ THEN$", bare, re.IGNORECASE):
            stack.append(number)
        elif re.match(r"IF ", bare, re.IGNORECASE):
            yield f"{number + 1}: {bare}", "\n".join(lines[:number] + lines[number + 1 :])
        elif re.match(r"END_?IF", bare, re.IGNORECASE):
            first = stack.pop()
            yield (
                f"{first + 1}: {lines[first].strip()}",
                "\n".join(lines[:first] + lines[number + 1 :]),
            )
