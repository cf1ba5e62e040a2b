"""The tree of NTRT structures: nodes, pairs and substructures, found by name as the toolkit finds them."""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.system.errors import StructureError, UnknownNameError, suggest


@dataclass(eq=False)
class NtrtNode:
    """A point; `path` is its name below the top structure, such as t1.front."""

    path: str
    position: NDArray[np.float64]  # (3,), replaced when its structure moves


@dataclass(frozen=True)
class NtrtPair:
    """Two nodes and the words that a builder is found by; `stem` names the members made of the group."""

    ends: tuple[NtrtNode, NtrtNode]
    tags: frozenset[str]
    stem: str
    where: str


@dataclass(eq=False)
class NtrtStructure:
    """One structure of the tree; its own name counts among the tags of its pairs."""

    name: str
    path: str
    nodes: dict[str, NtrtNode] = field(default_factory=dict)
    pairs: list[NtrtPair] = field(default_factory=list)
    children: "dict[str, NtrtStructure]" = field(default_factory=dict)
    _found: dict[str, NtrtNode] = field(default_factory=dict)

    def walk(self) -> "Iterator[NtrtStructure]":
        """Yield this structure and all below it, breadth first."""
        queue = deque([self])
        while queue:
            structure = queue.popleft()
            yield structure
            queue.extend(structure.children.values())

    def find_node(self, name: str, where: str) -> NtrtNode:
        """Return the node `name` or `child.name`; the nearest one below counts.

        Raises UnknownNameError.
        """
        *owners, last = name.split(".")
        structure = self
        for owner in owners:
            structure = structure.find_child(owner, where)
        if last in structure._found:  # pairs are many and name few nodes
            return structure._found[last]
        for candidate in structure.walk():
            if last in candidate.nodes:
                structure._found[last] = candidate.nodes[last]
                return candidate.nodes[last]
        known = {node for candidate in structure.walk() for node in candidate.nodes}
        problem = f"no node of this name in {structure.name or 'the structure'}"
        allowed = "the name of a node, or child.node"
        raise UnknownNameError(problem, where=where, given=name, allowed=allowed, hint=suggest(last, known))

    def find_child(self, name: str, where: str) -> "NtrtStructure":
        """Return the nearest substructure called `name`; raises UnknownNameError."""
        for candidate in self.walk():
            if name in candidate.children:
                return candidate.children[name]
        problem, allowed = "no substructure of this name", "the name of a substructure that has a path"
        hint = suggest(name, self.children)
        raise UnknownNameError(problem, where=where, given=name, allowed=allowed, hint=hint)

    def transform(self, change: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> None:
        """Replace every node position below by `change` of it."""
        for structure in self.walk():
            for node in structure.nodes.values():
                node.position = change(node.position)

    def centroid(self, where: str) -> NDArray[np.float64]:
        """Return the mean of all node positions below; raises StructureError where there is none."""
        points = [node.position for item in self.walk() for node in item.nodes.values()]
        if not points:
            raise StructureError("a structure without nodes has no centroid", where=where)
        mean: NDArray[np.float64] = np.mean(points, axis=0)
        return mean
