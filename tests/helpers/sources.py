"""The shape of a package, read from its sources: sizes, imports, circles, floors, the lines of its rooms.

Each rule takes the folder of a package and returns what breaks it, one sentence each.
"""

import ast
import re
from graphlib import CycleError, TopologicalSorter

MODULES_IN_A_FOLDER, LINES_OF_A_FILE, LINES_OF_A_FUNCTION, POSITIONAL_ARGUMENTS, FLOORS = 12, 300, 40, 7, 9


def crowded_folders(package):
    """Folders with too many modules."""
    folders = [package, *(path for path in package.rglob("*") if path.is_dir())]
    counts = {folder: sum(file.name != "__init__.py" for file in folder.glob("*.py")) for folder in folders}
    return [f"{folder}: {n} modules" for folder, n in counts.items() if n > MODULES_IN_A_FOLDER]


def long_files(package):
    """Files with too many lines."""
    lines = {file: file.read_text(encoding="utf-8").count("\n") for file in package.rglob("*.py")}
    return [f"{file}: {n} lines" for file, n in lines.items() if n > LINES_OF_A_FILE]


def long_functions(package):
    """Functions whose bodies, docstrings apart, have too many lines."""
    lines = {f"{file}::{function.name}": body_lines(function) for file, function in functions(package)}
    return [f"{name}: {n} lines" for name, n in lines.items() if n > LINES_OF_A_FUNCTION]


def many_arguments(package):
    """Functions that take too many arguments by position; self and cls do not count."""
    counts = {f"{file}::{function.name}": positional(function) for file, function in functions(package)}
    return [f"{name}: {n} positional arguments" for name, n in counts.items() if n > POSITIONAL_ARGUMENTS]


def circles(package):
    """A circle among the modules, imports inside functions included."""
    try:
        TopologicalSorter(imports(package, is_lazy_counted=True)).prepare()
    except CycleError as error:
        return [" -> ".join(error.args[1])]
    return []


def tall_chains(package):
    """The longest chain of modules that import one another when they are imported, if it is too long.

    An ``__init__`` is no floor: it shows what the floors below hold.
    """
    graph, chains = imports(package, is_lazy_counted=False), {}
    for name in TopologicalSorter(graph).static_order():
        below = max((chains[imported] for imported in graph[name]), key=len, default=[])
        is_room = package.parent.joinpath(*name.split(".")).is_dir()
        chains[name] = below if is_room else [name, *below]
    longest = max(chains.values(), key=len)
    return [" -> ".join(longest)] if len(longest) > FLOORS else []


def room_lines(package):
    """The package and its rooms, each with the first line of its docstring, as a picture shows them."""
    rooms = sorted(file.parent for file in package.glob("*/__init__.py"))
    return [
        f"{package.name}/  {first_line(package)}",
        *(f"  {room.name}/  {first_line(room)}" for room in rooms),
    ]


def rooms_in(text):
    """The lines of packages and rooms in a picture."""
    return [line for line in text.splitlines() if re.match(r"(  )?\w+/  \S", line)]


def first_line(folder):
    """First line of the docstring of a folder's ``__init__``."""
    return ast.get_docstring(parsed(folder / "__init__.py")).splitlines()[0]


def functions(package):
    """Every function of a package with its file, methods and inner functions too."""
    files = sorted(package.rglob("*.py"))
    kinds = ast.FunctionDef | ast.AsyncFunctionDef
    return [(file, node) for file in files for node in ast.walk(parsed(file)) if isinstance(node, kinds)]


def body_lines(function):
    """Number of lines from the first statement to the last; the docstring is none."""
    body = function.body[1:] if ast.get_docstring(function) and len(function.body) > 1 else function.body
    return body[-1].end_lineno - body[0].lineno + 1


def positional(function):
    """Number of arguments that can be given by position."""
    arguments = [*function.args.posonlyargs, *function.args.args]
    return sum(argument.arg not in ("self", "cls") for argument in arguments)


def imports(package, is_lazy_counted):
    """Of each module the modules of its package that it imports; an ``__init__`` is the package itself."""
    files = {module_name(package, file): file for file in package.rglob("*.py")}
    return {
        name: {
            found
            for node in import_nodes(parsed(file), is_lazy_counted)
            for found in named_modules(node, files)
            if found != name
        }
        for name, file in files.items()
    }


def module_name(package, file):
    """Dotted name of a file of a package."""
    return ".".join(file.relative_to(package.parent).with_suffix("").parts).removesuffix(".__init__")


def import_nodes(node, is_lazy_counted):
    """Every import below a node that is carried out, those for type checkers left out."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import | ast.ImportFrom):
            yield child
        is_for_types = isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test)
        is_lazy = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef)
        if not is_for_types and (is_lazy_counted or not is_lazy):
            yield from import_nodes(child, is_lazy_counted)


def named_modules(node, modules):
    """Which of the modules an import names: ``from room import module`` means the module."""
    if isinstance(node, ast.Import):
        return {alias.name for alias in node.names if alias.name in modules}
    names = {f"{node.module}.{alias.name}" for alias in node.names}
    return {name if name in modules else node.module for name in names} & modules.keys()


def parsed(file):
    """Syntax tree of a source file."""
    return ast.parse(file.read_text(encoding="utf-8"))
