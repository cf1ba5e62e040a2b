"""The loop over free members four at a time, for vectors; the loop of single members takes what is left.

Forces are added member by member in the same order, by the same operations: the bits are those of the loop.
"""

import re
from typing import TYPE_CHECKING

import numpy as np

from tensegrity_codegen.codegen.lanes.kernel import AXES, RATES, DensityKernel, KernelKind
from tensegrity_codegen.codegen.table.members.access import MemberAccess
from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.structure.assembly import ABSENT, MemberClass
from tensegrity_codegen.tables.laws import MEMBER_VALUES

if TYPE_CHECKING:
    from tensegrity_codegen.codegen.table.members.access import AddToNodes


PULLS = {"pull": False, "static_pull": True}  # kernel -> whether it is without damping
LANES = range(4)
IN_A_ROW = re.compile(r"(\w+)\[((?:\d+ \+ )?)\(e \+ 0\)\]")


def write_fours(
    writer: Writer, access: MemberAccess, kernel_name: str, sink: "AddToNodes"
) -> list[str] | None:
    """Return the loop over fours of members that leaves `e` behind the last one; None where there is none."""
    entry = sink.index[access.model.ends[access.member]]
    in_a_row = bool((entry >= 0).all()) and np.array_equal(entry, entry[:, :, :1] + np.arange(entry.shape[2]))
    if kernel_name not in PULLS or not in_a_row or not is_served(writer, access):
        return None
    kernel = writer.density(kind_of(access.group.member_class, PULLS[kernel_name]))
    lines = [
        *read_vectors(writer, access, kernel),
        *read_values(writer, access, kernel),
        f"const lanes_four density = {kernel.name}_four({passed(kernel)});",
        *_additions(writer, access, sink, entry[:, :, 0]),
    ]
    return ["#if defined(TENSEGRITY_LANES)", *in_fours(access, lines), "#endif"]


STIFFNESSES = ("spring_constant", "axial_stiffness")  # those that mu replaces


def is_served(writer: Writer, access: MemberAccess) -> bool:
    """Return whether a loop's members can go by fours: free in space, in doubles, four at least."""
    is_space = access.group.is_interior and access.model.n_axes == 3
    return is_space and writer.precision.name == "double" and len(access.member) >= len(LANES)


def in_fours(access: MemberAccess, lines: list[str]) -> list[str]:
    """Return the loop of statements over fours of members."""
    head = f"for (; e + {len(LANES) - 1} < {len(access.member)}; e += {len(LANES)}) {{"
    return [head, *(f"  {line}" for line in lines), "}"]


def kind_of(cls: MemberClass, is_static: bool, result: str = "density") -> KernelKind:
    """Return the kind of kernel that gives `result` for members of a class."""
    values = tuple(name for name in MEMBER_VALUES if cls.source(name) != ABSENT)
    if cls.is_stiffness_constant:
        values = ("spring_constant", *(name for name in values if name not in STIFFNESSES))
    if is_static:
        values = tuple(name for name in values if name != "damping")
    return KernelKind(values, is_static, cls.tension_only, result=result)


def lane_counter(lane: int) -> str:
    """Return the C expression of the member in a lane."""
    return f"(e + {lane})"


def read_vectors(writer: Writer, access: MemberAccess, kernel: DensityKernel) -> list[str]:
    """Return statements that bring four member vectors, and their rates, into lanes."""
    lines = []
    for k in LANES:
        ends = [
            writer.index_at(f"{access.name}_{'ij'[end]}", access.place[:, end, 0], lane_counter(k))
            for end in (0, 1)
        ]
        lines.append(f"const int i{k} = {ends[0]}, j{k} = {ends[1]};")
    for what, array, axes in (("d", "coordinate", AXES), ("rate", "velocity", RATES)):
        if axes[0] not in kernel.parameters:
            continue
        for k in LANES:
            loads = [f"xyz_load_last({array} + {end}{k})" for end in "ij"]
            lines.append(f"const lanes_xyz {what}{k} = xyz_minus({', '.join(loads)});")
        lines.append(f"lanes_four {', '.join(axes)};")
        lines.append(f"four_split({', '.join(f'{what}{k}' for k in LANES)}, &{', &'.join(axes)});")
    return lines


def read_values(writer: Writer, access: MemberAccess, kernel: DensityKernel) -> list[str]:
    """Return statements that bring four members' values into lanes."""
    return [
        f"const lanes_four {name}_of_four = {_four(writer, access, name)};"
        for name in kernel.parameters
        if name in MEMBER_VALUES
    ]


def passed(kernel: DensityKernel) -> str:
    """Return what a kernel of four members is called with."""
    return ", ".join(f"{name}_of_four" if name in MEMBER_VALUES else name for name in kernel.parameters)


def _four(writer: Writer, access: MemberAccess, name: str) -> str:
    """Return one value of each of four members, loaded at once where they lie in a row."""
    is_mu = name == "spring_constant" and access.group.member_class.is_stiffness_constant
    texts = [access.value(writer, "mu" if is_mu else name, lane_counter(k)) for k in LANES]
    found = IN_A_ROW.fullmatch(texts[0])
    return f"four_load({found[1]} + {found[2]}e)" if found else f"four_of({', '.join(texts)})"


def _additions(writer: Writer, access: MemberAccess, sink: "AddToNodes", first: np.ndarray) -> list[str]:
    lines = []
    for k in LANES:
        lines.append(f"const lanes_xyz pull{k} = XYZ_TIMES(density, {k}, d{k});")
        for end, verb in ((0, "subtract"), (1, "add")):
            at = f"{'ij'[end]}{k}"
            if not np.array_equal(first[:, end], access.place[:, end, 0]):
                at = writer.index_at(
                    f"{access.name}_{sink.target}_{'ij'[end]}", first[:, end], lane_counter(k)
                )
            lines.append(f"xyz_{verb}({sink.target} + {at}, pull{k});")
    return lines
