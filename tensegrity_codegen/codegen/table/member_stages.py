"""Stages that sum up what members do: repeated modules side by side, then loops over the others."""

from collections.abc import Callable

from tensegrity_codegen.codegen.table.fill_forces import FillForces
from tensegrity_codegen.codegen.table.members.blocks import AddBlocks
from tensegrity_codegen.codegen.table.members.external import ExternalForce
from tensegrity_codegen.codegen.table.members.member_loops import MemberLoop, member_loops
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.sinks import AddToNodes
from tensegrity_codegen.codegen.table.members.stage import Stage
from tensegrity_codegen.codegen.table.modules.blocks import ModuleBlocks
from tensegrity_codegen.codegen.table.modules.forces import ModuleForces
from tensegrity_codegen.structure.assembly import MemberGroup


def force_stages(model: TableModel, kernel: str, sink: AddToNodes) -> list[Stage]:
    """Return the stages that sum up external forces and a kernel's pulls: in modules, then in loops."""
    inside = member_loops(model, kernel, sink, lambda group: group.in_module)
    external = ExternalForce(model, sink.index)
    modules = ModuleForces(tuple(inside), kernel, sink, external) if inside else None
    others = member_loops(model, kernel, sink, lambda group: not group.in_module)
    return [FillForces(external, sink.target, modules), *([modules] if modules else []), *others]


def block_stages(
    model: TableModel, kernel: str, sink: AddBlocks, keep: Callable[[MemberGroup], bool] = lambda group: True
) -> tuple[ModuleBlocks, list[MemberLoop]]:
    """Return what writes a kernel's blocks to a matrix: first those in modules, then loops of the others."""
    inside = member_loops(model, kernel, sink, lambda group: group.in_module and keep(group))
    others = member_loops(model, kernel, sink, lambda group: not group.in_module and keep(group))
    return ModuleBlocks(tuple(inside), kernel, sink), others
