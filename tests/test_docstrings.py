"""A "Parameters" section names the parameters of its function or dataclass: all of them, and nothing else."""

from __future__ import annotations

import ast
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
MODULES = sorted([*(ROOT / "flexdesign").rglob("*.py"), *(ROOT / "geometry").glob("*.py")])


def documented(docstring: str) -> list[str] | None:
    """Return the names in a "Parameters" section, in their order; None if there is none."""
    section = re.search(r"^Parameters\n-{3,}\n(.*?)(?=^\w[\w ]*\n-{3,}|^>>> |\Z)", docstring, re.M | re.S)
    if section is None:
        return None
    heads = [line for line in section.group(1).splitlines() if line and not line.startswith(" ")]
    return [name.strip().lstrip("*") for head in heads for name in head.partition(" : ")[0].split(",")]


def fields(node: ast.ClassDef) -> list[str]:
    """Return the fields of a class that its constructor takes; class variables and ``init=False`` left out."""
    found = []
    for each in node.body:
        if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name):
            value = ast.unparse(each.value) if each.value else ""
            if "ClassVar" not in ast.unparse(each.annotation) and "init=False" not in value:
                found.append(each.target.id)
    return found


def arguments(node: ast.FunctionDef, *, is_method: bool) -> list[str]:
    """Return the parameters of a function; of a method without the object or class."""
    given = node.args
    static = any(ast.unparse(each) == "staticmethod" for each in node.decorator_list)
    positional = [*given.posonlyargs, *given.args][1 if is_method and not static else 0 :]
    return [each.arg for each in [*positional, *given.kwonlyargs, given.vararg, given.kwarg] if each is not None]


def checked(tree: ast.Module) -> Iterator[tuple[str, list[str], list[str]]]:
    """Yield name, documented and actual parameters of everything public with a "Parameters" section."""
    public = [node for node in tree.body if isinstance(node, (ast.FunctionDef, ast.ClassDef))]
    for owner in public:
        inner = owner.body if isinstance(owner, ast.ClassDef) else []
        for node in [owner, *(each for each in inner if isinstance(each, ast.FunctionDef))]:
            assert isinstance(node, (ast.FunctionDef, ast.ClassDef))
            names = documented(ast.get_docstring(node) or "")
            if node.name.startswith("_") or owner.name.startswith("_") or names is None:
                continue
            if isinstance(node, ast.FunctionDef):
                yield (
                    f"{owner.name}.{node.name}" if node is not owner else node.name,
                    names,
                    arguments(node, is_method=node is not owner),
                )
            else:
                yield node.name, names, taken(node)


def taken(node: ast.ClassDef) -> list[str]:
    """Return the parameters of a class: of its `__init__` or `__new__`, else its fields."""
    for each in node.body:
        if isinstance(each, ast.FunctionDef) and each.name in ("__init__", "__new__"):
            return arguments(each, is_method=True)
    return fields(node)


def differences(documented: list[str], actual: list[str]) -> str:
    """Return in words what one has and the other lacks; empty if they agree."""
    missing = [name for name in actual if name not in documented and not name.startswith("_")]
    surplus = [name for name in documented if name not in actual]
    texts = [f"not documented: {', '.join(missing)}"] if missing else []
    return "; ".join([*texts, *([f"not in the signature: {', '.join(surplus)}"] if surplus else [])])


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_documented_parameters_are_those_of_the_signature(path: Path) -> None:
    found = {
        name: text
        for name, documented, actual in checked(ast.parse(path.read_text(encoding="utf-8")))
        if (text := differences(documented, actual))
    }
    assert not found


def test_many_are_checked() -> None:
    count = sum(len(list(checked(ast.parse(path.read_text(encoding="utf-8"))))) for path in MODULES)
    assert count > 400


def test_a_difference_is_found_in_both_directions() -> None:
    source = textwrap.dedent('''
        def f(a, b, *, c=0, **more):
            """Return a.

            Parameters
            ----------
            a, b
                Numbers.
            d
                Is gone.

            Returns
            -------
            float
            """


        @dataclass
        class Point:
            """A point.

            Parameters
            ----------
            x
                Its place [m].
            """

            x: float
            y: float
            count: ClassVar[int] = 0

            @property
            def z(self):
                """Not a parameter."""
    ''')
    found = {name: differences(names, actual) for name, names, actual in checked(ast.parse(source))}
    assert found["f"] == "not documented: c, more; not in the signature: d"
    assert found["Point"] == "not documented: y"
