"""Deliberate mistakes in Python sources: the kinds that a programmer makes and that change an answer.

The kinds are those of the usual tools (operators, conditions, numbers) and some that matter for bounds and proofs: a
summand or an argument is dropped, the first or last element is not visited, the smaller of two values replaces the
larger. Texts for people, annotations and declarations are left alone.
"""

from __future__ import annotations

import ast
import re

__all__ = ["Edit", "edits", "is_mistake"]

Edit = tuple[int, int, bytes]
"""Start and end in the source in bytes, and the text that replaces what is between them."""

FOR_PEOPLE = re.compile(
    r"__(repr|str|format|all|doc|slots|rich\w*)__|_repr_\w+|describe_\w+|\w*_(text|words|sentence|html|label|phrase|note|notes|message|title)"
    r"|(text|words|sentence|note|notes|message|title|summary|hint|label|table|rows|plot|show|display|explain\w*|suggest\w*|reasons?)"
)
"""Functions, variables and keyword arguments that hold text for people."""

COMPARISONS = {
    ast.Lt: ("<", ">="), ast.LtE: ("<=", ">"), ast.Gt: (">", "<="), ast.GtE: (">=", "<"), ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="), ast.In: ("in", "not in"), ast.NotIn: ("not in", "in"), ast.Is: ("is", "is not"),
    ast.IsNot: ("is not", "is"),
}  # fmt: skip
BOUNDARIES = {ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">"}
OPERATORS = {
    ast.Add: ("+", "-"), ast.Sub: ("-", "+"), ast.Mult: ("*", "/"), ast.Div: ("/", "*"), ast.FloorDiv: ("//", "*"),
    ast.Pow: ("**", "*"), ast.BitAnd: ("&", "|"), ast.BitOr: ("|", "&"), ast.Mod: ("%", ""), ast.MatMult: ("@", ""),
    ast.BitXor: ("^", "&"), ast.LShift: ("<<", ">>"), ast.RShift: (">>", "<<"),
}  # fmt: skip
OPPOSITES = (
    "min max",
    "any all",
    "minimum maximum",
    "floor ceil",
    "argmin argmax",
    "fmin fmax",
    "lower upper",
    "amin amax",
)
SWAPS = {a: b for pair in OPPOSITES for a, b in (pair.split(), pair.split()[::-1])}
TECHNICAL = {
    "strict",
    "dtype",
    "copy",
    "encoding",
    "slots",
    "frozen",
    "stacklevel",
    "kw_only",
    "repr",
    "maxsize",
    "casting",
}


class _Finder(ast.NodeVisitor):
    def __init__(self, source: bytes) -> None:
        self.source = source
        self.starts = [0]
        for line in source.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line))
        self.found: list[Edit] = []

    def span(self, node: ast.AST) -> tuple[int, int]:
        return (
            self.starts[node.lineno - 1] + node.col_offset,  # type: ignore[attr-defined]
            self.starts[node.end_lineno - 1] + node.end_col_offset,  # type: ignore[attr-defined]
        )

    def text(self, node: ast.AST) -> bytes:
        start, end = self.span(node)
        return self.source[start:end]

    def replace(self, node: ast.AST, *texts: bytes) -> None:
        """Replace a node; parentheses keep the precedence of what is around it."""
        self.found += [(*self.span(node), text) for text in texts]

    def between(self, left: ast.AST, right: ast.AST, old: str, new: str) -> None:
        """Replace the operator between two operands. The parentheses of the operands are between them too."""
        start, end = self.span(left)[1], self.span(right)[0]
        pattern = rb"(?<![\w*/<>=!])" + re.escape(old.encode()).replace(rb"\ ", rb"\s+") + rb"(?![\w*/<>=])"
        code = re.sub(rb"#[^\n]*", lambda comment: b" " * len(comment[0]), self.source[start:end])
        if match := re.search(pattern, code):
            self.found.append((start + match.start(), start + match.end(), new.encode()))

    # What is left alone.

    def visit_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Constant):
            return  # docstrings
        if isinstance(node.value, ast.Call):
            if re.match(rb"_?log(ger)?\.|logging\.|warnings\.", self.text(node)):
                return
            self.replace(node, b"pass")
        self.generic_visit(node)

    def leave(self, node: ast.AST) -> None:
        """Texts and errors."""

    visit_JoinedStr = visit_Raise = visit_Assert = leave

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        for statement in node.body:
            self.visit(statement)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        if FOR_PEOPLE.fullmatch(node.name):
            return
        for part in [*node.args.defaults, *node.args.kw_defaults, *node.body]:
            if part is not None:
                self.visit(part)

    def visit_Assign(self, node: ast.Assign) -> None:
        if not all(isinstance(target, ast.Name) and FOR_PEOPLE.fullmatch(target.id) for target in node.targets):
            self.generic_visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None and not (isinstance(node.target, ast.Name) and FOR_PEOPLE.fullmatch(node.target.id)):
            self.visit(node.value)

    # Conditions.

    def visit_Compare(self, node: ast.Compare) -> None:
        operands = [node.left, *node.comparators]
        for left, operator, right in zip(operands[:-1], node.ops, operands[1:], strict=True):
            old, new = COMPARISONS[type(operator)]
            counted = any(
                (isinstance(side, ast.Constant) and isinstance(side.value, int))
                or (isinstance(side, ast.Call) and isinstance(side.func, ast.Name) and side.func.id == "len")
                for side in (left, right)
            )
            if counted and type(operator) in BOUNDARIES:  # among real numbers the boundary itself hardly occurs
                self.between(left, right, old, BOUNDARIES[type(operator)])
            self.between(left, right, old, new)
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        word = b" and " if isinstance(node.op, ast.And) else b" or "
        for dropped in node.values:
            kept = [b"(" + self.text(value) + b")" for value in node.values if value is not dropped]
            self.replace(node, b"(" + word.join(kept) + b")")
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, (ast.Not, ast.USub)):
            self.replace(node, b"(" + self.text(node.operand) + b")")
        self.generic_visit(node)

    def visit_If(self, node: ast.If) -> None:
        if self.text(node.test) == b"TYPE_CHECKING":
            return
        refuses = len(node.body) == 1 and isinstance(node.body[0], ast.Raise)
        self.replace(node.test, *([b"False"] if refuses else [b"False", b"True"]))
        self.generic_visit(node)

    def visit_IfExp(self, node: ast.IfExp) -> None:
        values = node.body, node.orelse
        constant = all(isinstance(value, (ast.Constant, ast.JoinedStr)) for value in values)
        if constant and any(isinstance(value, ast.JoinedStr) for value in values):
            return  # texts
        if not constant:
            self.replace(node.test, b"False", b"True")
        self.generic_visit(node)

    # Arithmetic, numbers and calls.

    def visit_BinOp(self, node: ast.BinOp) -> None:
        texts = (ast.JoinedStr, ast.List, ast.Tuple, ast.ListComp)
        for side in (node.left, node.right):
            if isinstance(side, ast.JoinedStr) or (isinstance(side, ast.Constant) and isinstance(side.value, str)):
                return
        old, new = OPERATORS[type(node.op)]
        if new and not any(isinstance(side, texts) for side in (node.left, node.right)):
            self.between(node.left, node.right, old, new)
        self.replace(node, b"(" + self.text(node.left) + b")")
        if isinstance(node.op, (ast.Add, ast.Mult, ast.BitOr, ast.BitAnd)):
            self.replace(node, b"(" + self.text(node.right) + b")")
        if isinstance(node.op, ast.MatMult):
            self.replace(node, b"((" + self.text(node.right) + b") @ (" + self.text(node.left) + b"))")
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        old, new = OPERATORS[type(node.op)]
        if new and not isinstance(node.value, (ast.List, ast.ListComp, ast.JoinedStr)):
            self.between(node.target, node.value, old + "=", new + "=")
        self.replace(node, b"pass")
        self.visit(node.value)

    def visit_Constant(self, node: ast.Constant) -> None:
        if isinstance(node.value, bool):
            self.replace(node, repr(not node.value).encode())
        elif isinstance(node.value, int):
            self.replace(node, repr(node.value + 1).encode())
        elif isinstance(node.value, float) and node.value == node.value:
            wrong = 1.0 if node.value == 0 else node.value * (1000 if abs(node.value) < 1e-3 else 2)
            self.replace(node, repr(wrong).encode())

    def visit_Call(self, node: ast.Call) -> None:
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if name == "join" and isinstance(getattr(getattr(node.func, "value", None), "value", None), str):
            return  # names for people
        end = self.span(node.func)[1]
        if name in SWAPS:
            self.found.append((end - len(name.encode()), end, SWAPS[name].encode()))
        if name in ("abs", "sorted", "reversed", "round") and len(node.args) == 1:
            self.replace(node, b"(" + self.text(node.args[0]) + b")")
        # Without an argument, the constructor of a dataclass is mostly a TypeError.
        for keyword in [] if name[:1].isupper() or name == "cls" else node.keywords:
            if keyword.arg and keyword.arg not in TECHNICAL and not FOR_PEOPLE.fullmatch(keyword.arg):
                start, stop = self.span(keyword)
                comma = re.match(rb"\s*,\s*", self.source[stop:])
                self.found.append((start, stop + (comma.end() if comma else 0), b""))
        for child in [node.func, *node.args]:
            self.visit(child)
        for keyword in node.keywords:
            if not FOR_PEOPLE.fullmatch(keyword.arg or "") and keyword.arg not in TECHNICAL:
                self.visit(keyword.value)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        if isinstance(node.slice, ast.Slice):
            for bound in (node.slice.lower, node.slice.upper):
                if bound is not None:
                    self.replace(bound, b"")
        self.visit(node.value)
        if isinstance(node.slice, ast.UnaryOp) and isinstance(node.slice.op, ast.USub):
            self.replace(node.slice, b"0")  # the first instead of the last
        else:
            self.visit(node.slice)

    # Loops.

    def shorten(self, iterated: ast.expr) -> None:
        text = self.text(iterated)
        self.replace(iterated, b"list(" + text + b")[1:]", b"list(" + text + b")[:-1]")

    def visit_For(self, node: ast.For) -> None:
        self.shorten(node.iter)
        self.generic_visit(node)

    def visit_comprehension(self, node: ast.comprehension) -> None:
        self.shorten(node.iter)
        for condition in node.ifs:
            self.replace(condition, b"True")
        self.generic_visit(node)

    def visit_Continue(self, node: ast.Continue) -> None:
        self.replace(node, b"break", b"pass")

    def visit_Break(self, node: ast.Break) -> None:
        self.replace(node, b"continue", b"pass")


def edits(source: bytes) -> list[Edit]:
    """All single mistakes that are made in a source."""
    finder = _Finder(source)
    finder.visit(ast.parse(source))
    return sorted(set(finder.found))


def is_mistake(source: bytes, changed: bytes) -> bool:
    """Whether a changed source is a program, and another one."""
    try:
        return ast.dump(ast.parse(changed)) != ast.dump(ast.parse(source))
    except SyntaxError:
        return False
