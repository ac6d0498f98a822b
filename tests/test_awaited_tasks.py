"""No task, callback or future that nobody awaits: what fails in one must end its process, or be told.

Read from the source of vgrd, drivers and fakes: a task is made by a TaskGroup (a name bound by
`async with asyncio.TaskGroup() as NAME`, also self.NAME, or a parameter of that type), and a future of an executor
is kept.
"""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SPAWNS = {"create_task", "ensure_future"}
CALLBACKS = {"add_done_callback"}
FUTURES = {"submit", "run_in_executor", "run_coroutine_threadsafe"}

# "file: function" of what is made otherwise, with the reason.
ALLOWED = {
    "vgrd/cell/recording/recorder.py: _queue": "a fault becomes the recorder's trouble, which status and replies tell",
    "vgrd/solving/advisor.py: _asked": "a task of the advisor's group; the callback only forgets it",
    "fakes/controllers/rtde.py: _serve": "awaited in the same function; kept to be cancelled from outside",
    "fakes/controllers/rtde.py: _answer": "a fake's stream of samples: it ends with its client",
}


class Finder(ast.NodeVisitor):
    """Collects "function, line" of every spawn outside a TaskGroup."""

    def __init__(self, tree: ast.Module) -> None:
        self.found: list[tuple[str, int]] = []
        self.functions: list[str] = []
        self.groups: list[set[str]] = [set()]
        for node in ast.walk(tree):
            if isinstance(node, ast.AsyncWith):
                self.groups[0] |= {name for name in groups_of(node) if "." in name}

    def visit_FunctionDef(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        arguments = [*node.args.args, *node.args.kwonlyargs, *node.args.posonlyargs]
        groups = {
            arg.arg
            for arg in arguments
            if arg.annotation and ast.unparse(arg.annotation).endswith("TaskGroup")
        }
        self.functions.append(node.name)
        self.groups.append(self.groups[-1] | groups)
        self.generic_visit(node)
        self.functions.pop()
        self.groups.pop()

    def visit_AsyncFunctionDef(self, node: ast.AsyncFunctionDef) -> None:
        self.visit_FunctionDef(node)

    def visit_AsyncWith(self, node: ast.AsyncWith) -> None:
        self.groups[-1] |= groups_of(node)
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        name = called(node)
        in_group = (
            isinstance(node.func, ast.Attribute)
            and ast.unparse(node.func.value) in self.groups[-1]
        )
        if name in CALLBACKS or (name in SPAWNS and not in_group):
            self.note(node)
        self.generic_visit(node)

    def visit_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Call) and called(node.value) in FUTURES:
            self.note(node.value)
        self.generic_visit(node)

    def note(self, node: ast.Call) -> None:
        self.found.append((self.functions[-1] if self.functions else "module", node.lineno))


def groups_of(node: ast.AsyncWith) -> set[str]:
    """Names of the task groups that a `with` opens; "self.tasks" holds in the whole module."""
    return {
        ast.unparse(item.optional_vars)
        for item in node.items
        if item.optional_vars and ast.unparse(item.context_expr).endswith("TaskGroup()")
    }


def called(node: ast.Call) -> str:
    if isinstance(node.func, ast.Attribute):
        return node.func.attr
    return node.func.id if isinstance(node.func, ast.Name) else ""


def find(source: str) -> list[tuple[str, int]]:
    tree = ast.parse(source)
    finder = Finder(tree)
    finder.visit(tree)
    return finder.found


def all_found() -> dict[str, int]:
    places = {}
    for folder in ("vgrd", "drivers", "fakes"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            for function, line in find(path.read_text(encoding="utf-8")):
                places[f"{path.relative_to(ROOT)}: {function}"] = line
    return places


def test_every_task_belongs_to_a_group() -> None:
    bad = {place: line for place, line in all_found().items() if place not in ALLOWED}
    assert not bad, "make it in an asyncio.TaskGroup, or await it: " + str(bad)


def test_the_list_of_exceptions_holds_nothing_that_is_gone() -> None:
    gone = ALLOWED.keys() - all_found().keys()
    assert not gone


@pytest.mark.parametrize(
    "source",
    [
        "def f(): asyncio.create_task(g())",
        "def f(): self._task = loop.create_task(g())",
        "async def f():\n async with asyncio.timeout(1) as tasks: tasks.create_task(g())",
        "def f(): asyncio.ensure_future(g())",
        "def f(): future.add_done_callback(g)",
        "def f(): self.pool.submit(g)",
        "async def f():\n async with asyncio.TaskGroup() as a: b.create_task(g())",
    ],
)
def test_a_task_that_nobody_awaits_is_found(source: str) -> None:
    assert [function for function, _ in find(source)] == ["f"]


@pytest.mark.parametrize(
    "source",
    [
        "async def f():\n async with asyncio.TaskGroup() as tasks: tasks.create_task(g())",
        "def f(tasks: asyncio.TaskGroup): tasks.create_task(g())",
        "async def f():\n await asyncio.gather(g(), h())",
        "async def f():\n async with asyncio.TaskGroup() as self.a: pass\n"
        "def g(): self.a.create_task(h())",
        "def f(): return self.pool.submit(g)",
        "async def f():\n await loop.run_in_executor(None, g)",
    ],
)
def test_a_task_of_a_group_is_good(source: str) -> None:
    assert find(source) == []
