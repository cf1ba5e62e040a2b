"""The functions of a scene as CasADi functions, for users who build optimal control problems without C."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.codegen.emitter import prune
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.structure.applied_inputs import actuate_members
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.system.checks import check_mapping, check_names


class SymbolicFunctions(dict[str, ca.Function]):
    """CasADi functions by the names of their quantities.

    Attributes
    ----------
    nominal : mapping of str to ndarray
        The scene's own value of each argument, in the shape that CasADi has it: (n, 1), or (n_axes, k) where
        the argument is a table of k vectors.
    coordinate_name, input_name : tuple of str
        Names of the coordinates and of the inputs, in their order.
    """

    def __init__(
        self,
        functions: Mapping[str, ca.Function],
        nominal: Mapping[str, NDArray[np.float64]],
        coordinate_name: tuple[str, ...],
        input_name: tuple[str, ...],
    ) -> None:
        super().__init__(functions)
        self.nominal = MappingProxyType(dict(nominal))
        self.coordinate_name = coordinate_name
        self.input_name = input_name


def symbolic_functions(
    path: str | Path | Mapping[str, Any] | Scene,
    *,
    quantities: Sequence[str] = (),
    parameters: Mapping[str, tuple[int, ...]] | None = None,
    actuate: Sequence[str] = (),
) -> SymbolicFunctions:
    """Read a scene and return its quantities as CasADi functions; nothing is generated or compiled.

    Parameters
    ----------
    path : str, Path, mapping or Scene
        Scene file (TOML), or the scene itself, as for `read_scene`.
    quantities : sequence of str
        Quantities in addition to those of the scene.
    parameters : mapping of str to tuple of int, optional
        Run-time parameters in addition to those of the scene: name -> indices of nodes or members.
    actuate : sequence of str
        Members that get an actuator each, of their names, beside the actuators of the scene.

    Returns
    -------
    SymbolicFunctions
        A dict: quantity -> ``casadi.Function`` (SX) of the arguments that the quantity depends on, with the
        names and in the order of the generated C function; vectors are columns. What depends on nothing, such
        as a constant mass matrix, is a function without arguments. The attribute ``nominal`` has
        the scene's values of all arguments.

    Raises
    ------
    SceneError
        The scene has an error.
    UnknownNameError
        An unknown quantity.
    FormulationError
        The formulation does not have a quantity, or nothing in the scene contributes to it.

    Notes
    -----
    The expressions are those from which the C functions are generated with the emitter ``unrolled``: with
    reference flags both return the same bits. ``casadi.external`` calls the compiled functions, with
    derivatives, if the scene has ``interfaces = ["casadi"]``.

    Examples
    --------
    >>> from tensegrity_codegen import symbolic_functions
    >>> functions = symbolic_functions("two_nodes.toml")
    >>> functions["member_tension"](functions.nominal["coordinate"])
    DM(0)
    """
    structure, request = load_scene(path)
    named = check_names(actuate, "actuate")
    if named:
        structure, _ = actuate_members(structure, named)
    requested = check_names(quantities, "quantities")
    parameters = check_mapping(parameters, "parameters", "indices of nodes or members by name")
    request = request.wanting(*request.quantities, *requested, parameters=parameters)
    model = build_model(structure, request)
    functions = {pruned.quantity.name: pruned.function for pruned in prune(model, request.quantities)}
    nominal = {name: _as_columns(argument.nominal) for name, argument in model.arguments.items()}
    return SymbolicFunctions(functions, nominal, model.frame.coordinate_name, model.frame.input_name)


def _as_columns(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values of an argument as CasADi has them, read-only."""
    columns = values.T.copy() if values.ndim == 2 else values.reshape(-1, 1).copy()
    columns.flags.writeable = False
    return columns
