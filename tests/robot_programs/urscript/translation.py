"""URScript, in a careful style, turned into Python line by line: one statement a line, nothing that differs.

Refused, because Python would do something else or hide it: `/` and `%` (not the same for whole numbers),
elements of lists that are assigned to (lists are values), a name that is assigned in a function and is
neither local nor marked `global`, locals that begin inside a block, names that nobody defines, and calls
with another number of arguments.
"""

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from tests.robot_programs.urscript.built_ins import BUILT_INS

_HEAD = re.compile(r"(def|thread) (\w+)\((.*)\):$")
_BLOCK = re.compile(r"(if|while) (.+):$")
_RUN = re.compile(r"\brun (\w+)\((.*)\)$")
_POSE = re.compile(r"\bp\[")
_STRING = re.compile(r'"[^"]*"')


@dataclass
class _Function:
    parameters: list[str]
    names: set[str] = field(default_factory=set)  # parameters and locals


def translate(text: str) -> str:
    """Python source with as many lines as `text`, and what Python needs before them. Raises SyntaxError."""
    functions = _functions(text)
    shared = sorted(
        {match for line in text.splitlines() for match in re.findall(r"^\s*global (\w+)", line)}
    )
    lines, blocks = [], []
    current: _Function | None = None
    for number, line in enumerate(text.splitlines(), 1):
        code = _without_comment(line).strip()
        indent = "    " * len(blocks)
        if code == "end":
            if not blocks:
                raise SyntaxError(f"line {number}: end of nothing")
            current = None if blocks.pop() in ("def", "thread") else current
            lines.append("")
        elif head := _HEAD.match(code):
            if blocks:
                raise SyntaxError(f"line {number}: a function inside a block")
            current = functions[head[2]]
            blocks.append(head[1])
            globals_ = [name for name in shared if name not in current.names]
            declared = f" global {', '.join(globals_)}" if globals_ else " pass"
            lines.append(f"def {head[2]}({head[3]}):\n{declared.replace(' ', '    ', 1)}")
        elif block := _BLOCK.match(code):
            lines.append(f"{indent}{block[1]} {_expression(block[2], number)}:")
            blocks.append(block[1])
        elif code in ("else:",) or code.startswith("elif "):
            lines.append("    " * (len(blocks) - 1) + _expression(code, number))
        else:
            if code.startswith("local ") and len(blocks) != 1:
                raise SyntaxError(f"line {number}: a local that begins inside a block")
            lines.append(indent + _statement(code, number, current))
    if blocks:
        raise SyntaxError(f"{len(blocks)} blocks are not ended")
    source = "\n".join(lines) + "\n"
    _check_names(ast.parse(source), functions, set(shared))
    return source


def _functions(text: str) -> dict[str, _Function]:
    """Functions and threads with their parameters and locals."""
    found: dict[str, _Function] = {}
    current: _Function | None = None
    for line in map(str.strip, map(_without_comment, text.splitlines())):
        if head := _HEAD.match(line):
            parameters = [name.strip() for name in head[3].split(",") if name.strip()]
            current = found[head[2]] = _Function(parameters, set(parameters))
        elif current and (name := re.match(r"local (\w+) =", line)):
            current.names.add(name[1])
    return found


def _without_comment(line: str) -> str:
    blanked = _STRING.sub(lambda match: "_" * len(match[0]), line)
    return line[: blanked.find("#")] if "#" in blanked else line


def _statement(code: str, number: int, current: _Function | None) -> str:
    for keyword, call in (("kill ", "kill_"), ("join ", "join_")):
        if code.startswith(keyword):
            return f"{call}({code.removeprefix(keyword)})"
    assigned = re.match(r"(?:(local|global) )?(\w+)(\[.*\])? = ", code)
    if assigned and assigned[3]:
        raise SyntaxError(f"line {number}: an element is assigned to")
    if assigned and current and assigned[1] is None and assigned[2] not in current.names:
        raise SyntaxError(f"line {number}: {assigned[2]} is neither local nor marked global")
    return _expression(re.sub(r"^(local|global) ", "", code), number)


def _expression(code: str, number: int) -> str:
    bare = _STRING.sub("", code)
    if "/" in bare or "%" in bare:
        raise SyntaxError(f"line {number}: / or %")
    code = _POSE.sub("pose_[", code)
    return _RUN.sub(r"run_(\1)", code)


def _check_names(tree: ast.Module, functions: dict[str, _Function], shared: set[str]) -> None:
    """Raises SyntaxError for a name that nobody defines, or a call with too few or too many arguments."""
    known = {*functions, *shared, *BUILT_INS, "pose_", "run_", "kill_", "join_"}
    for owner, node in _nodes(tree):
        names = functions[owner].names if owner else set()
        if isinstance(node, ast.Name) and node.id not in known | names:
            raise SyntaxError(f"nobody defines {node.id}")
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            name, given = node.func.id, len(node.args) + len(node.keywords)
            least, most = BUILT_INS.get(name, (1, 1))
            if name in functions:
                least = most = len(functions[name].parameters)
            if not least <= given <= most:
                raise SyntaxError(f"{name} takes {least} to {most} arguments, not {given}")


def _nodes(tree: ast.Module) -> Iterator[tuple[str | None, ast.AST]]:
    for statement in tree.body:
        owner = statement.name if isinstance(statement, ast.FunctionDef) else None
        for node in ast.walk(statement):
            yield owner, node
