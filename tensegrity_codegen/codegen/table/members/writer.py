"""Stages of quantities, and the arrays, kernels and helpers of their bodies, each written once."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.codegen.print.printer import print_body, print_number, print_numbers
from tensegrity_codegen.codegen.print.render import render
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.structure.assembly import MemberClass
from tensegrity_codegen.symbolic.members.member_kernel import VECTORS, MemberKernel, build_member_kernel
from tensegrity_codegen.system.arrays import IntArray
from tensegrity_codegen.tables.manifest import Pattern
from tensegrity_codegen.tables.precision import Precision
from tensegrity_codegen.tables.quantities import ARGUMENTS
from tensegrity_codegen.tables.quantities.quantity import Quantity

Array = NDArray[Any]

# Operands of kernels with one component a modelled axis: of both ends of a member, and of a node.
IN_AXES = (*VECTORS, "position", "velocity", "load")


class Writer:
    """Collects the definitions before the bodies; equal arrays, kernels and helpers get one name.

    A uniform array is written as a number, and evenly spaced indices as an expression of the counter.
    """

    def __init__(self, model: TableModel, precision: Precision) -> None:
        self.model = model
        self.precision = precision
        self.real = precision.c_type
        self._arrays: dict[tuple[str, bytes], str] = {}
        self._values: dict[str, tuple[str, Array]] = {}
        self._texts: dict[str, str] = {}
        self._kernels: dict[tuple[str, MemberClass], str] = {}

    def number(self, value: float) -> str:
        """Return a number as an operand in C."""
        text = print_number(float(value), self.precision, f"{self.model.name}: a constant of a table")
        return f"({text})" if text.startswith("-") else text

    def size_of(self, value: str) -> str:
        """Return the C expression of the size of a number."""
        return f"fabs{self.precision.suffix}({value})"

    def integers(self, name: str, values: Array) -> str:
        """Return the C name of a constant array of integers."""
        return self._array(name, np.ascontiguousarray(values.reshape(-1), dtype=np.int64), "int")

    def reals(self, name: str, values: Array) -> str:
        """Return the C name of a constant array of numbers."""
        return self._array(name, np.ascontiguousarray(values.reshape(-1), dtype=np.float64), self.real)

    def index_at(self, name: str, values: Array, counter: str) -> str:
        """Return the C expression of entry `counter` of some integers."""
        text = index_text(values, counter)
        return f"{self.integers(name, values)}[{counter}]" if text is None else text

    def listed_at(self, name: str, values: Array, counter: str) -> str:
        """Return the same from a list in any case: of entries that a loop adds to, one after the other.

        A compiler that sees them evenly spaced would make vectors that wait for the sums before them.
        """
        return f"{self.integers(name, values)}[{counter}]"

    def real_at(self, name: str, values: Array, counter: str) -> str:
        """Return the C expression of entry `counter` of some numbers."""
        if np.array_equal(values, np.full_like(values, values[0])) and not np.signbit(values).any():
            return self.number(values[0])
        return f"{self.reals(name, values)}[{counter}]"

    def scaled(self, name: str, gains: Array, counter: str, text: str) -> str:
        """Return the C expression of `text` times entry `counter` of some gains, `text` where all are 1."""
        return text if (gains == 1.0).all() else f"{self.real_at(name, gains, counter)} * {text}"

    def kernel(self, name: str, member_class: MemberClass) -> tuple[str, MemberKernel]:
        """Return the C name of a member kernel, and the kernel."""
        kernel = build_member_kernel(name, member_class, self.model.n_axes)
        key = (name, member_class)
        if key not in self._kernels:
            self._kernels[key] = self._define(f"{name}_of_member", lambda symbol: self._print(symbol, kernel))
        return self._kernels[key], kernel

    def node_kernel(self, kernel: MemberKernel) -> str:
        """Return the C name of the kernel of a quantity of nodes."""
        return self._define(f"{kernel.name}_of_node", lambda symbol: self._print(symbol, kernel))

    def helper(self, name: str, template: str, **context: Any) -> str:
        """Return the C name of a helper function rendered from a template that takes its `symbol`."""
        return self._define(
            name, lambda symbol: render(template, {"symbol": symbol, "real": self.real, **context})
        )

    def preamble(self) -> list[str]:
        """Return the lines of all arrays, then of all helpers and kernels."""
        texts = [text.replace("@", name) for text, name in self._texts.items()]
        context = {"arrays": list(self._printed_arrays()), "texts": texts}
        return render("table_preamble.c", context).splitlines()

    def parameters(self, kernel: MemberKernel) -> list[str]:
        """Return the scalar arguments of a kernel, in order."""
        names: list[str] = []
        for name in kernel.inputs:
            names += [f"{name}{k}" for k in range(self.model.n_axes)] if name in IN_AXES else [name]
        return names

    def _print(self, symbol: str, kernel: MemberKernel) -> str:
        def place(name: str, k: int) -> str:
            return f"{name}{k}" if name in IN_AXES or name.startswith("*") else name

        body = print_body(kernel.function, kernel.inputs, ["*result"], self.precision, place)
        return render(
            "table_kernel.c",
            {
                "symbol": symbol,
                "real": self.real,
                "parameters": self.parameters(kernel),
                "results": [f"result{k}" for k in range(kernel.size)],
                "lines": body.lines,
            },
        )

    def _define(self, name: str, write: Any) -> str:
        """Return the name of the function that `write` writes, the present one if there is an equal one."""
        text = write("@")
        if text not in self._texts:
            self._texts[text] = self._free_name(name)
        return self._texts[text]

    def _array(self, name: str, values: Array, c_type: str) -> str:
        key = (c_type, values.tobytes())
        if key not in self._arrays:
            self._arrays[key] = self._free_name(name)
            self._values[self._arrays[key]] = (c_type, values)
        return self._arrays[key]

    def _free_name(self, name: str) -> str:
        used_names = {*self._values, *self._texts.values()}
        free_name, number = name, 1
        while free_name in used_names:
            number += 1
            free_name = f"{name}_{number}"
        return free_name

    def _printed_arrays(self) -> Any:
        for name, (c_type, values) in self._values.items():
            where = f"{self.model.name}: a constant of a table"
            texts = (
                [str(value) for value in values.tolist()]
                if c_type == "int"
                else print_numbers(values, self.precision, where)
            )
            yield {"name": name, "c_type": c_type, "values": texts}


def index_text(values: Array, counter: str) -> str | None:
    """Return evenly spaced indices as an expression of the counter, None if they are not."""
    start = int(values[0])
    if len(values) == 1:
        return str(start)
    step = int(values[1]) - start
    if not np.array_equal(values, start + step * np.arange(len(values))):
        return None
    if step == 0:
        return str(start)
    product = counter if step == 1 else f"{step} * {counter}"
    if start == 0:
        return product
    return f"{start} + {product}" if step > 0 else f"{start} - {-step} * {counter}"


class Stage(Protocol):
    """A step of a function. Arguments and operations are cheap to ask for, tables are made by `write`."""

    @property
    def arguments(self) -> frozenset[str]:
        """Names of the arguments that it reads."""

    @property
    def operations(self) -> int:
        """Floating-point operations in one evaluation."""

    @property
    def repeats(self) -> int:
        """How many times its statements run in one evaluation."""

    def write(self, writer: Writer) -> list[str]:
        """Return its statements."""


def loop(counter: str, count: int, statements: Sequence[str]) -> list[str]:
    """Return a loop over `count` values of a counter of its own."""
    return [
        "{",
        f"  int {counter};",
        f"  for ({counter} = 0; {counter} < {count}; ++{counter}) {{",
        *(f"    {line}" for line in statements),
        "  }",
        "}",
    ]


def in_axes(target: str, sign: str, results: Sequence[str]) -> list[str]:
    """Return the loop over axes that changes entries in a row by results in a row: compilers make vectors.

    target: begins with the first entry, without the bracket behind it.
    """
    if len(results) == 1:
        return [f"{target}] {sign}{results[0]};"]
    value = f"{results[0].removesuffix(']')} + k]"
    head = f"for (int k = 0; k < {len(results)}; ++k)"
    return [f"{head} {{ {target} + k] {sign}{value}; }}"]


def only_where(entries: IntArray, text: str, statement: str) -> list[str]:
    """Return a statement for those passes of a loop whose entry, `text` in C, is not negative."""
    is_there = entries >= 0
    if is_there.all():
        return [statement]
    return [f"if ({text} >= 0) {{ {statement} }}"] if is_there.any() else []


@dataclass(frozen=True)
class Statements:
    """C statements that need no table, in text with placeholders, see `in_precision`.

    list_lines: returns them, called when the function is written; arguments, operations, repeats: see
    `Stage`.
    """

    list_lines: Callable[[], Sequence[str]]
    arguments: frozenset[str] = frozenset()
    operations: int = 0
    repeats: int = 1

    @classmethod
    def loop(
        cls, counter: str, count: int, lines: Sequence[str], arguments: tuple[str, ...] = ()
    ) -> "Statements":
        """Return a loop over `count` values of a counter."""
        return cls(lambda: loop(counter, count, lines), frozenset(arguments))

    def write(self, writer: Writer) -> list[str]:
        """Return the statements."""
        return [in_precision(line, writer) for line in self.list_lines()]


def in_precision(line: str, writer: Writer) -> str:
    """Return a statement with its placeholders replaced.

    @REAL@: the type in C; @ZERO@, @ONE@: these numbers; @SAFE@: a bound of sums, far from overflow.
    """
    replacements = {"@REAL@": writer.real, "@ZERO@": writer.number(0.0), "@ONE@": writer.number(1.0)}
    replacements["@SAFE@"] = writer.number(1e-8 * writer.precision.largest)
    for placeholder, text in replacements.items():
        line = line.replace(placeholder, text)
    return line


@dataclass(frozen=True)
class Recipe:
    """How a quantity is made: shape as in CasADi, stages, statements before and after, pattern if sparse.

    is_empty: nothing in the structure enters it; is_checked: the stages end by returning whether all results
    are finite.
    """

    shape: tuple[int, int]
    stages: tuple[Stage, ...]
    before: tuple[str, ...] = ()
    after: tuple[str, ...] = ()
    find_pattern: Callable[[], Pattern] | None = None
    is_empty: bool = False
    is_checked: bool = False


@dataclass(frozen=True)
class TableFunction:
    """One wanted function, see codegen.emitter.WantedFunction."""

    quantity: Quantity
    recipe: Recipe

    @cached_property
    def arguments(self) -> tuple[str, ...]:
        """Names of the arguments, in the order of C signatures."""
        used = frozenset[str]().union(*(stage.arguments for stage in self.recipe.stages))
        return tuple(name for name in ARGUMENTS if name in used)

    @cached_property
    def operations(self) -> int:
        """Floating-point operations in one evaluation."""
        return sum(stage.operations for stage in self.recipe.stages)

    @cached_property
    def written_operations(self) -> int:
        """Floating-point operations in its text: those of a loop count once."""
        return sum(-(-stage.operations // max(stage.repeats, 1)) for stage in self.recipe.stages)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the result."""
        return self.recipe.shape

    @cached_property
    def pattern(self) -> Pattern | None:
        """Compressed columns of a sparse result."""
        return None if self.recipe.find_pattern is None else self.recipe.find_pattern()

    def write(self, writer: Writer) -> list[str]:
        """Return the statements of the C body."""
        recipe = self.recipe
        before = [in_precision(line, writer) for line in recipe.before]
        lines = [line for stage in recipe.stages for line in stage.write(writer)]
        return [*before, *lines, *recipe.after]
