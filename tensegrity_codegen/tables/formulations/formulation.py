"""The record of a formulation besides its expressions, readable without CasADi."""

from collections.abc import Mapping
from dataclasses import dataclass, field

ALL_EMITTERS = ("unrolled", "table")


@dataclass(frozen=True)
class Formulation:
    """One choice of coordinates with its equations of motion.

    A module of `formulations/` defines one as `FORMULATION`; the module of the same name in
    `symbolic/formulations/` has the function `build`, which returns its `SymbolicModel`.

    name: its name in scenes, requests and manifests: that of its module.
    order: place in lists of formulations.
    sentence: the meaning of the coordinates, for the documentation.
    options: its options with their allowed words; the first is the default.
    variants: options worth a try where another formulation does not serve a request.
    of_bodies: whether it models scenes of bodies and tendons, not of nodes and members.
    in_nodes: whether the coordinates are positions of free nodes [m].
    has_angles: whether some coordinates are angles, so that no one length is the scale of all.
    has_centres: whether some coordinates are centres of mass, which grow with the distance from the origin.
    has_rigid_bars: whether bars without stiffness keep their lengths; elsewhere every bar is a spring.
    has_statics: whether its models find equilibria.
    statics: the kind of static problem: "nodes", "bars" or "bodies".
    emitters: emitters that may write it.
    simulation_quantities, linear_quantities: what a simulation and a linear model need of it, besides what
        all formulations have.
    massless_tension: the tension that is wanted by default of a structure with massless nodes.
    """

    name: str
    order: int
    sentence: str
    options: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    variants: tuple[Mapping[str, str], ...] = ({},)
    of_bodies: bool = False
    in_nodes: bool = False
    has_angles: bool = False
    has_centres: bool = False
    has_rigid_bars: bool = False
    has_statics: bool = True
    statics: str = "nodes"
    emitters: tuple[str, ...] = ("unrolled",)
    simulation_quantities: tuple[str, ...] = ()
    linear_quantities: tuple[str, ...] = ()
    massless_tension: str = "member_tension"
