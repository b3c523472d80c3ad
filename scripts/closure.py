"""Import closures: for each module the lines of this package that it needs at import, and reading or testing it takes.

    python scripts/closure.py                       every module, the heaviest first
    python scripts/closure.py run.engine page.views these (of a package all its modules), and why: for each import of
                                                    theirs the lines behind it, and those that come by no other

Imports count where they are made at once: at the top of a file, also within ``try`` and ``if``. Those within functions
and under ``TYPE_CHECKING`` do not, and neither does what is not of this package.
"""

from __future__ import annotations

import argparse
import ast
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "verefine_viz"


@dataclass(frozen=True)
class ImportGraph:
    """The modules of the package, by their names without that of the package; its own is ""."""

    n_lines: dict[str, int]
    imports: dict[str, frozenset[str]]
    """What each imports, and the packages that Python imports with it."""

    @classmethod
    def of_package(cls, folder: Path = ROOT / PACKAGE) -> ImportGraph:
        """The graph of the sources below a folder."""
        sources = {_name_of(path.relative_to(folder)): path.read_text("utf-8") for path in folder.rglob("*.py")}
        imports = {
            name: frozenset(part for used in _imported(source, sources) for part in _with_packages(used))
            | frozenset(_with_packages(name)) - {name}
            for name, source in sources.items()
        }
        return cls({name: len(source.splitlines()) for name, source in sources.items()}, imports)

    def closure(self, name: str, without: str | None = None) -> set[str]:
        """A module and all that it needs; ``without`` one of its own imports.

        Raises:
            KeyError: there is no such module.
        """
        own = self.imports[name] - {without}
        needed, to_do = {name}, [*own]
        while to_do:
            if (one := to_do.pop()) not in needed:
                needed.add(one)
                to_do += self.imports[one]
        return needed

    def size(self, name: str, without: str | None = None) -> int:
        """Lines of :meth:`closure`."""
        return sum(self.n_lines[one] for one in self.closure(name, without))

    def modules_of(self, name: str) -> list[str]:
        """A module; of a package its modules as well."""
        return [name, *(one for one in sorted(self.imports) if one.startswith(f"{name}."))]


def _name_of(path: Path) -> str:
    parts = path.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _with_packages(name: str) -> Iterator[str]:
    """The package, those within it that hold the module, and the module: Python imports all of them."""
    yield ""
    parts = name.split(".")
    yield from (".".join(parts[: n + 1]) for n in range(len(parts)) if name)


def _imported(source: str, modules: Iterable[str]) -> Iterator[str]:
    """The modules of the package that a source imports at once."""
    for statement in _made_at_once(ast.parse(source).body):
        if isinstance(statement, ast.Import):
            names = [alias.name for alias in statement.names]
        else:
            # What is imported from a package may be a module of it.
            names = [str(statement.module), *(f"{statement.module}.{alias.name}" for alias in statement.names)]
        own = (name.removeprefix(f"{PACKAGE}.") for name in names if f"{name}.".startswith(f"{PACKAGE}."))
        yield from (name for name in own if name in modules)


def _made_at_once(body: Iterable[ast.stmt]) -> Iterator[ast.Import | ast.ImportFrom]:
    for statement in body:
        match statement:
            case ast.Import() | ast.ImportFrom():
                yield statement
            case ast.If(test=ast.Name("TYPE_CHECKING")):
                yield from _made_at_once(statement.orelse)
            case ast.If() | ast.ClassDef() | ast.With() | ast.Try():
                parts = [getattr(statement, part, []) for part in ("body", "orelse", "finalbody")]
                parts += [handler.body for handler in getattr(statement, "handlers", [])]
                yield from (one for part in parts for one in _made_at_once(part))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="MODULE", help="as run.engine; of a package all its modules")
    names = [name.removeprefix(f"{PACKAGE}.") for name in parser.parse_args().names]
    graph = ImportGraph.of_package()
    unknown = [name for name in names if name not in graph.imports]
    if unknown:
        parser.error(f"there is no module {unknown[0]}; expected a name as run.engine")
    asked = {module for name in names for module in graph.modules_of(name)} or graph.imports
    for name in sorted(asked, key=lambda one: (-graph.size(one), one)):
        print(f"{graph.size(name):7}  {len(graph.closure(name)):4} modules  {name or PACKAGE}")
        if names:
            _print_why(graph, name)


def _print_why(graph: ImportGraph, name: str) -> None:
    size = graph.size(name)
    print(f"{graph.n_lines[name]:15}  its own")
    for one in sorted(graph.imports[name], key=lambda one: (-graph.size(one), one)):
        print(f"{graph.size(one):15}  {size - graph.size(name, without=one):6} by it alone  {one or PACKAGE}")


if __name__ == "__main__":
    main()
