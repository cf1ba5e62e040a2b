"""Values of members in loops over repeated modules: numbers, tables, arguments."""

import numpy as np

from tensegrity_codegen.codegen.lanes.kernel import DensityKernel
from tensegrity_codegen.codegen.table.members.access import MemberAccess
from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.codegen.table.modules.text import ModuleText
from tensegrity_codegen.structure.assembly import ARGUMENT, MemberGroup
from tensegrity_codegen.system.arrays import IntArray
from tensegrity_codegen.tables.laws import MEMBER_VALUES


class RowValues:
    """Statements that bring the values of members into rows: those of a whole strand, those of each row."""

    def __init__(
        self, text: ModuleText, writer: Writer, kernel: DensityKernel, kind: int, first: int, last: int
    ) -> None:
        self.text, self.writer = text, writer
        self.first, self.last = first, last
        self.member_class = text.model.plan.classes[kind]
        # The members of all modules, strand by strand, the last one repeated to fill a row.
        parts = []
        for module, length in zip(self.text.modules, self._padded().tolist(), strict=True):
            repetition = np.minimum(np.arange(length), module.n_repetitions - 1)
            parts.append(module.member[self.first : self.last, repetition].ravel())
        group = MemberGroup(self.member_class, np.concatenate(parts), is_interior=True, in_module=True)
        self.access = MemberAccess(text.model, f"{text.name}_{kind}", group, group.member)
        self.of_strand: list[str] = []
        self.of_row: list[str] = []
        self.reads_table = False
        for name in kernel.parameters:
            if name in MEMBER_VALUES:
                self._read(name)
        if self.reads_table:
            self.of_strand.insert(0, f"const int at = {self._start()};")

    def _padded(self) -> IntArray:
        return np.array([module.n_repetitions + self.writer.widest for module in self.text.modules])

    def _start(self) -> str:
        """Return the C expression of the place of repetition k of strand s among all members."""
        padded = self._padded()
        before = np.concatenate([[0], np.cumsum(padded * (self.last - self.first))[:-1]])
        begin = self.writer.index_at(f"{self.text.name}_begin{self.first}", before, "g")
        length = self.writer.index_at(f"{self.text.name}_padded", padded, "g")
        strand = f"(s - {self.first})" if self.first else "s"
        return f"{begin} + {length} * {strand} + k"

    def _read(self, name: str) -> None:
        """Return a value of a row's members: a number, one a strand, one a member, or worked out before."""
        access, cls = self.access, self.member_class
        value = "mu" if name == "spring_constant" and cls.is_stiffness_constant else name
        is_worked_out = value != "mu" and (
            cls.source(name) == ARGUMENT or (name == "rest_length" and cls.n_inputs > 0)
        )
        if is_worked_out:
            self.reads_table = True
            self.of_strand += [
                f"{self.writer.real} {name}_of_row[{self.text.chunk + self.writer.widest}];",
                f"for (c = 0; c < {self.text.chunk + self.writer.widest}; ++c) {{",
                "  const int e = at + (c < m ? c : m - 1);",
                f"  {name}_of_row[c] = {access.value(self.writer, value)};",
                "}",
            ]
            self.of_row.append(f"const lanes_row {name} = row_load({name}_of_row + c);")
            return
        constant = access.constant(value)
        blocks = np.split(constant, np.cumsum(self._padded() * (self.last - self.first))[:-1])
        by_strand = np.concatenate([block.reshape(self.last - self.first, -1)[:, 0] for block in blocks])
        lengths = np.repeat(self._padded(), self.last - self.first)
        if not np.array_equal(np.repeat(by_strand, lengths), constant):
            self.reads_table = True
            table = self.writer.reals(f"{access.name}_{value}", constant)
            self.of_row.append(f"const lanes_row {name} = row_load({table} + at + c);")
            return
        strand = f"s - {self.first}" if self.first else "s"
        if len(self.text.modules) > 1:
            strand = f"{self.last - self.first} * g + {strand}"
        text = self.writer.real_at(f"{access.name}_{value}", by_strand, strand)
        self.of_strand.append(f"const lanes_row {name} = row_all({text});")
