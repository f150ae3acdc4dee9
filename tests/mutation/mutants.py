"""Small changes of a program, each of which a test should notice.

Nothing is changed that only says something to people or to the type checker (annotations, texts,
messages of errors), and no check that cannot fail in a program that is right (`assert`, the
`strict` of a zip, whether a class is frozen).
"""

import ast
import copy
import dataclasses
import re
from collections.abc import Iterator
from pathlib import Path

BINARY = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.MatMult: ast.Add,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.FloorDiv,
    ast.Pow: ast.Mult,
}

COMPARED = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}


@dataclasses.dataclass(frozen=True)
class Mutant:
    """A changed program.

    Parameters
    ----------
    file : Path
    line : int
    change : str
        In words.
    number : int
        Of the node, in the order in which they are walked; of C, of the match.
    kind : str
        What is done with it.
    """

    file: Path
    line: int
    change: str
    number: int
    kind: str


def mutants_of(file: Path) -> list[Mutant]:
    """Every mutant of a Python file; annotations, texts and messages of errors stay."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    silent = _silent(tree)
    found = []
    for number, node in enumerate(ast.walk(tree)):
        if node in silent:
            continue
        for kind, change in _changes(node):
            line = getattr(node, "lineno", 0)
            found.append(Mutant(file, line, change, number, kind))
    return found


def _silent(tree: ast.AST) -> set[ast.AST]:
    """Nodes that say something to people or to the type checker."""
    found: set[ast.AST] = set()
    for node in ast.walk(tree):
        inside: list[ast.AST | None] = []
        match node:
            case ast.AnnAssign():
                inside = [node.annotation]
            case ast.FunctionDef():
                inside = [node.returns, *node.decorator_list]
                inside += [a.annotation for a in ast.walk(node.args) if isinstance(a, ast.arg)]
            case ast.ClassDef():
                inside = [*node.decorator_list]
            case ast.keyword(arg="strict"):
                inside = [node]
            case ast.Raise() | ast.Assert():
                inside = [node]
            case ast.If(test=ast.Name(id="TYPE_CHECKING")):
                inside = [node]
            case ast.JoinedStr():
                inside = [node]
            case ast.Assign(value=ast.Subscript(value=ast.Name(id="Literal"))):
                inside = [node]
        for top in inside:
            found |= set(ast.walk(top)) if top is not None else set()
    return found


def _changes(node: ast.AST) -> Iterator[tuple[str, str]]:
    match node:
        case ast.BinOp(op=op) if type(op) in BINARY and not _is_text(node):
            yield "binary", f"{_name(op)} is {BINARY[type(op)].__name__}"
        case ast.Compare(ops=[op]) if type(op) in COMPARED:
            yield "compare", f"{_name(op)} is {COMPARED[type(op)].__name__}"
        case ast.BoolOp(op=op):
            yield "bool", "and is or" if isinstance(op, ast.And) else "or is and"
        case ast.UnaryOp(op=ast.USub()):
            yield "plus", "minus is gone"
        case ast.UnaryOp(op=ast.Not()):
            yield "plus", "not is gone"
        case ast.Constant(value=bool()):
            yield "flip", f"{node.value} is {not node.value}"
        case ast.Constant(value=(int() | float()) as value):
            yield "number", f"{value} is {_other(value)}"
        case ast.If() | ast.IfExp():
            yield "never", "the condition never holds"
            yield "always", "the condition always holds"
        case ast.Call(func=func, args=[first, *_]) if not isinstance(first, ast.Starred):
            if isinstance(func, ast.Attribute) and func.attr in FUNCTIONS:
                yield "argument", f"{func.attr} is its argument"
        case ast.Expr(value=ast.Call()):
            yield "pass", "a call is gone"


FUNCTIONS = {"sqrt", "fmax", "fmin", "fabs", "exp", "abs", "logic_not", "transpose", "diag",
             "symmetric", "tril", "triu", "cholesky", "maximum", "minimum"}  # fmt: skip


def _is_text(node: ast.BinOp) -> bool:
    return any(
        isinstance(side, ast.JoinedStr)
        or (isinstance(side, ast.Constant) and isinstance(side.value, str))
        for side in (node.left, node.right)
    )


def _name(op: ast.AST) -> str:
    return type(op).__name__


def _other(value: float) -> float:
    return value + 1 if isinstance(value, int) else 2 * value + (value == 0)


def changed_text(mutant: Mutant) -> str:
    """The changed program."""
    if mutant.file.suffix != ".py":
        return _changed_c(mutant)
    return ast.unparse(_changed(mutant)) + "\n"


def _changed(mutant: Mutant) -> ast.AST:
    """The changed program of a Python file."""
    tree = copy.deepcopy(ast.parse(mutant.file.read_text(encoding="utf-8")))
    target = next(n for k, n in enumerate(ast.walk(tree)) if k == mutant.number)

    class Change(ast.NodeTransformer):
        def visit(self, node: ast.AST) -> ast.AST:
            if node is target:
                return ast.copy_location(_new(node, mutant.kind), node)
            return self.generic_visit(node)

    return ast.fix_missing_locations(Change().visit(tree))


def _new(node: ast.AST, kind: str) -> ast.AST:
    match kind, node:
        case "binary", ast.BinOp():
            return ast.BinOp(node.left, BINARY[type(node.op)](), node.right)
        case "compare", ast.Compare():
            return ast.Compare(node.left, [COMPARED[type(node.ops[0])]()], node.comparators)
        case "bool", ast.BoolOp():
            return ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
        case "plus", ast.UnaryOp():
            return node.operand
        case "flip", ast.Constant():
            return ast.Constant(not node.value)
        case "number", ast.Constant():
            assert isinstance(node.value, int | float)
            return ast.Constant(_other(node.value))
        case (("never" | "always"), ast.If()):
            return ast.If(ast.Constant(kind == "always"), node.body, node.orelse)
        case (("never" | "always"), ast.IfExp()):
            return ast.IfExp(ast.Constant(kind == "always"), node.body, node.orelse)
        case "argument", ast.Call():
            return node.args[0]
        case "pass", _:
            return ast.Pass()
    raise ValueError(kind)


C_CHANGES = [
    (r" \+ ", " - "),
    (r" - ", " + "),
    (r" \* ", " / "),
    (r" / ", " * "),
    (r" < ", " <= "),
    (r" <= ", " < "),
    (r" > ", " >= "),
    (r" >= ", " > "),
    (r" == ", " != "),
    (r" != ", " == "),
    (r" && ", " || "),
    (r" \|\| ", " && "),
    (r"(?<![\w.])0(?![\w.])", "1"),
    (r"(?<![\w.])1(?![\w.])", "2"),
    (r"\breal_fabs\b", ""),
    (r"\+\+", "--"),
]

COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)


def mutants_of_c(file: Path) -> list[Mutant]:
    """Every mutant of a source in C; comments and lines of the preprocessor stay."""
    text = file.read_text(encoding="utf-8")
    code = COMMENT.sub(lambda m: re.sub(r"[^\n]", "~", m[0]), text)
    code = re.sub(r"^#.*$", lambda m: "~" * len(m[0]), code, flags=re.MULTILINE)
    found = []
    for k, (pattern, new) in enumerate(C_CHANGES):
        for match in re.finditer(pattern, code):
            line = code.count("\n", 0, match.start()) + 1
            change = f"'{match[0].strip()}' is '{new.strip()}'"
            found.append(Mutant(file, line, change, match.start(), str(k)))
    return found


def _changed_c(mutant: Mutant) -> str:
    """The changed program in C."""
    text = mutant.file.read_text(encoding="utf-8")
    pattern, new = C_CHANGES[int(mutant.kind)]
    match = re.compile(pattern).match(text, mutant.number)
    if match is None:  # a look behind needs what stands before
        match = next(m for m in re.finditer(pattern, text) if m.start() == mutant.number)
    return text[: match.start()] + new + text[match.end() :]
