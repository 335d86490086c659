"""Small faults: every mutant of the source files of a folder.

A number becomes one larger; an operator its opposite; a comparison moves its boundary, or is reversed; a sign
or a ``not`` goes; ``and`` and ``or``, min and max change places, and so do the first two of several results; a
condition is always or never met; a call for its effect, or an assignment to memory, is left out; a loop breaks
off or goes on. Texts, messages, annotations and decorators stay.
"""

import ast
import random
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ARITHMETIC = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Div,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
# The boundary, and the opposite.
COMPARISONS = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
PAIRS = [("min", "max"), ("minimum", "maximum"), ("argmin", "argmax"), ("any", "all"), ("floor", "ceil")]
NAMES = {name: other for a, b in PAIRS for name, other in ((a, b), (b, a))}


class Mutant(NamedTuple):
    """A place of a file, by line and byte, what stands there instead, and the lines whose tests can tell."""

    file: str
    start: tuple[int, int]
    end: tuple[int, int]
    code: str
    lines: range

    def applied(self, source: str) -> str:
        """The source of the mutated file."""
        rows = source.encode().splitlines(keepends=True)
        (first, left), (last, right) = self.start, self.end
        middle = rows[first - 1][:left] + self.code.encode() + rows[last - 1][right:]
        return b"".join([*rows[: first - 1], middle, *rows[last:]]).decode()

    def told(self, source: str) -> dict[str, str]:
        """The changed lines, before and after, and where they are."""
        was = source.splitlines()[self.start[0] - 1 : self.end[0]]
        becomes = self.applied(source).splitlines()[self.start[0] - 1 :][: 1 + self.code.count("\n")]
        texts = (" ".join(" ".join(part).split()) for part in (was, becomes))
        return dict(
            zip(("file", "line", "was", "becomes"), (self.file, str(self.start[0]), *texts), strict=True)
        )


def expressions(node: ast.expr) -> Iterator[ast.expr]:
    """What can stand in place of an expression."""
    match node:
        case ast.BinOp(left, op, right) if type(op) in ARITHMETIC:
            yield ast.BinOp(left, ARITHMETIC[type(op)](), right)
        case ast.BoolOp(op, values):
            yield ast.BoolOp(ast.Or() if isinstance(op, ast.And) else ast.And(), values)
        case ast.UnaryOp(ast.USub() | ast.Not(), operand):
            yield operand
        case ast.Compare(left, ops, comparators):
            for i, op in enumerate(ops):
                for other in COMPARISONS[type(op)]:
                    yield ast.Compare(left, [*ops[:i], other(), *ops[i + 1 :]], comparators)
        case ast.Constant(bool() as value):
            yield ast.Constant(not value)
        case ast.Constant(int() | float() as value):
            yield ast.Constant(value + 1)
        case ast.Name(name) if name in NAMES:
            yield ast.Name(NAMES[name])
        case ast.Attribute(value, name) if name in NAMES:
            yield ast.Attribute(value, NAMES[name])


def statements(node: ast.stmt) -> Iterator[ast.stmt]:
    """What can stand in place of a statement of one line."""
    match node:
        case ast.Expr(ast.Call()) | ast.Assign([ast.Subscript() | ast.Attribute()]):
            yield ast.Pass()
        case ast.AugAssign(target, op, value) if type(op) in ARITHMETIC:
            yield ast.Pass()
            yield ast.AugAssign(target, ARITHMETIC[type(op)](), value)
        case ast.Return(ast.Tuple([first, second, *rest])):
            yield ast.Return(ast.Tuple([second, first, *rest]))
        case ast.Break() | ast.Continue():
            yield ast.Continue() if isinstance(node, ast.Break) else ast.Break()


def is_left_out(node: ast.AST) -> bool:
    """Texts and messages, and what only the type checker reads."""
    match node:
        case (
            ast.Raise() | ast.JoinedStr() | ast.FunctionDef(name="__repr__") | ast.If(ast.Name("TYPE_CHECKING"))
        ):
            return True
    return False


def mutants_below(file: str, node: ast.AST, lines: range) -> Iterator[Mutant]:
    """All mutants of a part of a file."""
    for name, child in ((n, c) for n, v in ast.iter_fields(node) for c in (v if isinstance(v, list) else [v])):
        if not isinstance(child, ast.AST) or is_left_out(child):
            continue
        if name in ("annotation", "returns", "decorator_list"):
            continue
        within = lines
        if isinstance(child, ast.expr | ast.stmt):
            # A statement is told by its lines, the head of a block by its own.
            own = range(child.lineno, (child.end_lineno or child.lineno) + 1)
            within = own if isinstance(node, ast.stmt) and hasattr(node, "body") else lines or own
            found = [ast.unparse(s) for s in statements(child)] if isinstance(child, ast.stmt) else []
            if isinstance(child, ast.expr):
                found = [f"({ast.unparse(ast.fix_missing_locations(e))})" for e in expressions(child)]
                found += ["True", "False"] if name == "test" else []
            start, end = (child.lineno, child.col_offset), (child.end_lineno or 0, child.end_col_offset or 0)
            yield from (Mutant(file, start, end, code, within) for code in found)
        yield from mutants_below(file, child, within)


def shuffled_mutants(folder: Path, seed: int) -> list[Mutant]:
    """All mutants of the files of a folder in a random order."""
    found = []
    for path in sorted(folder.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        found += mutants_below(path.relative_to(folder.parent).as_posix(), tree, range(0))
    random.Random(seed).shuffle(found)
    return found
