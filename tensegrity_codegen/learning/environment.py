"""A scene as an environment of gymnasium."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from tensegrity_codegen.control.feedback.policy import Description
from tensegrity_codegen.learning.channels import POSITION, VELOCITY, Actions, Observations, choose_actions
from tensegrity_codegen.learning.episodes import SCENE, DrawnNumbers, SceneLike, find_starts
from tensegrity_codegen.learning.step import EnvironmentStep
from tensegrity_codegen.pipeline.analyses import Needs, want_analyses
from tensegrity_codegen.pipeline.build_library import MANY_CALLS, build_library
from tensegrity_codegen.runtime.trajectory.simulation_quantities import (
    CONTACT_QUANTITIES,
    simulation_quantities,
)
from tensegrity_codegen.system.checks import (
    check_callback,
    check_instance,
    check_mapping,
    check_names,
    check_positive,
    check_whole,
)
from tensegrity_codegen.system.errors import InvalidValueError, check_choice
from tensegrity_codegen.system.extras import LEARN, import_extra
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.integrators import INTEGRATORS, find_row

METHOD = "rk54"  # of the stepper
EXPLICIT = tuple(name for name in INTEGRATORS if find_row(name, False).kind != "implicit")
OPTIONS = ("method", "rtol", "stepping", "threads", "quantities")  # of it that may be stated
OF_STEPS = (POSITION, VELOCITY, "member_tension")  # what every `EnvironmentStep` has


def environment(
    scene: SceneLike,
    n: int | None = None,
    *,
    sample: float = 0.02,
    observe: Sequence[str] | str = (),
    act: Sequence[str] | Mapping[str, Sequence[float]] | None = None,
    reward: Callable[[EnvironmentStep], ArrayLike] | None = None,
    terminate: Callable[[EnvironmentStep], ArrayLike] | None = None,
    start: str | Path = "settled",
    randomise: Sequence[str] | str = (),
    seconds: float = 10.0,
    stepper: Mapping[str, Any] | None = None,
    autoreset: str = "next_step",
) -> Any:
    """Return a scene as an environment of gymnasium (extra ``learn``), one or many side by side.

    Parameters
    ----------
    scene : str, Path, mapping or Scene
        Scene file (TOML), or the scene itself, as for `read_scene`.
    n : int, optional
        Number of copies of a ``gymnasium.vector.VectorEnv``; None: one structure, a ``gymnasium.Env``.
    sample : float [s]
        Time between two actions.
    observe : sequence of str
        What is seen: ``"command"``, names of sensors of the scene (``"sensors[0]"`` of one without a name),
        and quantities and expressions over quantities as for `keep` of sweeps. By default all sensors and the
        commands; without sensors positions, axes of bodies, velocities and the commands.
    act : sequence of str or mapping, optional
        Actuators, by default all; or inputs with ranges, ``{"push": (-5, 5)}``, within those of the scene.
    reward, terminate : callable, optional
        Functions of an `EnvironmentStep` -> (n,): the reward, by default the progress along x, and whether an
        episode ends. ``lambda step: step.progress() - 0.1 * step.effort()`` is one,
        ``lambda step: step.is_outside(height=0.05)`` the other.
    start : str or Path
        ``"settled"``: at rest under the first commands; ``"facet"``: at rest on a facet of its convex hull,
        chosen at random; ``"scene"``: as stated; or a file (.npz) of states as for ``simulate --batch``, of
        which each episode takes one.
    randomise : sequence of str
        Keys of the scene with distributions as for sweeps, ``"ground.friction=uniform(0.3,1)"``, drawn anew
        for each episode; a draw that is no scene is drawn again.
    seconds : float [s]
        Length after which an episode is truncated.
    stepper : mapping, optional
        Options of a `Stepper`: ``method``, ``rtol``, ``stepping``, ``threads``, and ``quantities`` for
        rewards.
    autoreset : str
        When a copy whose episode has ended begins the next one: ``"next_step"``, ``"same_step"``,
        ``"disabled"``.

    Returns
    -------
    gymnasium.Env or gymnasium.vector.VectorEnv
        With `description`, a `Description` (``description.write("env.json")``), `save` and `load`,
        `record(policy)` -> `Trajectory` of an episode, and ``render()`` -> pictures.

    Raises
    ------
    MissingExtraError
        gymnasium is not installed.
    StructureError, InvalidValueError
        Nothing can act, an action without a range or beyond it, a key that cannot change, a wrong option.
    UnknownNameError
        An unknown observation, actuator or key.
    FormulationError
        Starts that this scene does not have.
    ConvergenceError
        The structure does not come to rest.

    Notes
    -----
    An action a asks for the input ``centre + half_range a`` of its actuator, which follows within its rate
    and after its delay. Where delays are drawn, all are rounded to quarters of the sample; else they are
    exact. The equations of motion limit the rate of a motor with a time constant.
    The library is compiled for this machine, flags ``"native"``: other machines have other last bits.
    A copy whose motion fails is terminated with a reward of 0, its last observation and
    ``info["status"]``; no other copy takes notice.

    Examples
    --------
    >>> from tensegrity_codegen import environment
    >>> env = environment("pinned_prism.toml", observe=["member_length", "command"])
    >>> observation, info = env.reset(seed=1)
    >>> env.action_space.shape, observation.shape
    ((9,), (18,))
    """
    import_extra("gymnasium", LEARN)
    from tensegrity_codegen.learning.vector_env import MODES, StructureEnv, StructureVectorEnv

    check_choice(autoreset, MODES, "autoreset", "autoreset")
    check_instance(start, (str, Path), "start", "a text or a Path")
    count = 1 if n is None else check_whole(n, "n", 1)
    check_positive(sample, "sample", "[s]")
    check_positive(seconds, "seconds", "[s]")
    check_callback(reward, "reward")
    check_callback(terminate, "terminate")
    draws = DrawnNumbers(scene, check_names(randomise, "randomise"), moves_start=start != SCENE)
    structure, request = draws.structure, draws.request
    observations, acted = Observations(structure, observe), choose_actions(structure, act)
    for action in acted:
        if any(text.startswith(f"input.{action.name}=") for text in draws.texts):
            problem, allowed = "an action decides on this input", "inputs that do not act"
            raise InvalidValueError(problem, where="randomise", given=f"input.{action.name}", allowed=allowed)
    # The library has what the stepper, observations, rewards and recorded episodes need.
    options = {"method": METHOD, **check_mapping(stepper, "stepper", "options of a Stepper by name")}
    for name in options:
        check_choice(name, OPTIONS, "option of a stepper", "stepper")
    check_choice(options["method"], EXPLICIT, "method of a stepper", "stepper: method")
    quantities = check_names(options.get("quantities", ()), "stepper: quantities")
    of_state = (POSITION, VELOCITY) if find_formulation(request.formulation).in_nodes else ()
    seen = dict.fromkeys((*OF_STEPS, *observations.list_quantities(request), *quantities))
    options["quantities"] = tuple(name for name in seen if name not in of_state)
    contacts = CONTACT_QUANTITIES if structure.ground is not None else ()
    needs = Needs((*simulation_quantities(request.formulation), *contacts, *options["quantities"]))
    request = want_analyses(structure, request, ("step",), method=options["method"], besides=needs)
    model = build_library(structure, replace(request, flags="native"), calls=MANY_CALLS).load()
    observed = observations.bind(model.manifest, acted)
    description = Description(structure.name, float(sample), observed, acted, draws.texts)
    # Inputs before commands arrive.
    commands = dict(zip([a.name for a in acted], Actions(acted, sample, 1, False).first, strict=True))
    inputs = [commands.get(source.name, 0.0) for source in structure.inputs]
    starts = find_starts(start, model, draws.request, inputs, options)
    copies = StructureVectorEnv(
        model.stepper(count, sample=float(sample), **options), description, draws, observations, starts,
        reward or EnvironmentStep.progress, terminate, float(seconds), "disabled" if n is None else autoreset,
    )  # fmt: skip
    return StructureEnv(copies) if n is None else copies
