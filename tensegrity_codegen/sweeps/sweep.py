"""Many cases of one scene: plan them, compute them, store and open their results."""

import os
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tensegrity_codegen.analyses.cases.record import CaseAnalysis
from tensegrity_codegen.analyses.cases.registry import build_analysis
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.sweeps.cases.build_cases import Stated, build_cases
from tensegrity_codegen.sweeps.cases.cases import Cases
from tensegrity_codegen.sweeps.cases.sampled import Sampling
from tensegrity_codegen.sweeps.describe import SceneSource, describe_facts, identify_sweep
from tensegrity_codegen.sweeps.engines.dask_engine import Cluster, DaskEngine, check_workers
from tensegrity_codegen.sweeps.engines.engine import Engine, LocalEngine
from tensegrity_codegen.sweeps.plan_sweep import PlannedSweep, plan_sweep
from tensegrity_codegen.sweeps.run import ShowProgress, SweepOutcome, check_stop_after, check_zarr, run_sweep
from tensegrity_codegen.sweeps.store.folder import check_same_sweep, check_store_folder, open_sweep
from tensegrity_codegen.system.checks import check_callback, check_instance, check_switch
from tensegrity_codegen.system.forked import count_workers


@dataclass(frozen=True, eq=False)
class PreparedSweep:
    """A sweep that is planned and whose folder is known to be new, or to hold the same sweep.

    identity, facts: what the results follow from, and what else is kept with them.
    """

    planned: PlannedSweep  # cases, libraries, tasks, estimated time and size
    identity: Mapping[str, Any] = field(repr=False)
    facts: Mapping[str, Any] = field(repr=False)
    workers: int | Cluster  # number of processes on this machine, or a cluster

    def run(
        self, out: str | Path, *, stop_after: int | None = None, on_progress: ShowProgress | None = None
    ) -> SweepOutcome:
        """Compute the unfinished tasks of a folder (.zarr), with progress after every task."""
        engine: Engine = (
            DaskEngine(self.workers.address, self.workers.wait)
            if isinstance(self.workers, Cluster)
            else LocalEngine(self.workers, self.planned.libraries)
        )
        options: dict[str, Any] = {"stop_after": stop_after, "on_progress": on_progress}
        return run_sweep(self.planned.work, out, engine, identity=self.identity, facts=self.facts, **options)


def prepare_sweep(
    scene: SceneSource,
    cases: Cases,
    operation: CaseAnalysis,
    *,
    out: str | Path | None = None,
    workers: int | Cluster | None = None,
    task_size: int | None = None,
    yes: bool = False,
    option: str = "yes",
) -> PreparedSweep:
    """Plan a sweep, with the tasks of its folder if that holds a part of it."""
    resources = check_workers(workers)
    count = count_workers() if isinstance(resources, Cluster) else resources
    identity = identify_sweep(scene, cases, operation)
    stored = None
    if out is not None:
        check_zarr()
        stored = check_store_folder(out)
    if stored is not None:
        check_same_sweep(stored.path, stored.identity, identity)
        task_size = stored.task_size
    operation = operation.prepared(scene)
    planned = plan_sweep(scene, cases, operation, task_size=task_size, workers=count, yes=yes, option=option)
    return PreparedSweep(planned, identity, describe_facts(scene, planned.work.plan, operation), resources)


def sweep(
    scene: SceneSource,
    *,
    do: str,
    over: Stated = (),
    sample: Sampling | None = None,
    table: str | Path | Mapping[str, Any] | None = None,
    keep: str | Sequence[str] = (),
    out: str | Path | None = None,
    workers: int | Cluster | None = None,
    task_size: int | None = None,
    stop_after: int | None = None,
    yes: bool = False,
    on_progress: ShowProgress | None = None,
    **options: Any,
) -> Any:
    """Compute many cases of one scene.

    Parameters
    ----------
    scene : str, Path, mapping or Scene
        As for `read_scene`.
    do : str
        An operation: ``"simulate"``, ``"equilibrium"``, ``"linearize"``, ``"analyse"``, ``"evaluate"`` or
        ``"control"``.
    over : mapping or sequence of str
        Axes of a grid: key -> values, ``"start:stop:n"`` or ``"start:stop:n:log"``; or ``"KEY=..."``.
    sample : Sampling, optional
        Random numbers: distributions of keys, number of samples, seed and method.
    table : str, Path or mapping, optional
        CSV file with a column a key and a row a case, or such columns.
    keep : str or sequence of str
        What is kept of each case, such as ``"member_tension"`` or ``"max(member_tension)"``; by default the
        usual results of the operation.
    out : str or Path, optional
        Folder of the results (.zarr). One that holds a part of this sweep goes on where it stopped. Without
        it results are kept in memory only.
    workers : int or Cluster, optional
        Number of processes on this machine, by default one a core; or the workers of a Dask scheduler.
    task_size : int, optional
        Most cases of a task; by default so many that a task takes about half a second.
    stop_after : int, optional
        Stop once so many cases have failed.
    yes : bool
        Whether more than 100,000 cases, or more than 50 libraries, are meant.
    on_progress : callable, optional
        Called with a `SweepProgress` after every task.
    **options : object
        Options of the operation, such as ``t_end``.

    Returns
    -------
    xarray.Dataset
        One variable a quantity, units and description in its attributes; ``status`` and ``message`` of every
        case. Dimensions are the axes of the grid, ``sample`` or ``case``, then those of the quantity. Results
        of cases that failed are NaN.

    Raises
    ------
    InvalidValueError, UnknownKeyError, UnknownNameError, SceneError
        A wrong key, range, distribution, table, quantity or option.
    OutputError
        The folder holds something else or another sweep, or the disk is full.
    ClusterError
        No scheduler, no workers, or workers with other versions.
    MissingExtraError
        Zarr, xarray or Dask is not installed.

    Examples
    --------
    >>> from tensegrity_codegen import sweep
    >>> found = sweep("two_nodes.toml", do="evaluate", over={"gravity[2]": "-10:0:3"}, workers=1)
    >>> found["member_tension"].dims, found["status"].values.tolist()
    (('gravity[2]', 'member'), [0, 0, 0])
    """
    check_workers(workers)
    check_stop_after(stop_after)
    check_callback(on_progress, "on_progress")
    check_switch(yes, "yes")
    allowed = "the name of a scene file, a dictionary, or a Scene"
    check_instance(scene, (str, os.PathLike, Mapping, Scene), "scene", allowed)
    check_instance(sample, (Sampling, type(None)), "sample", "Sampling(distributions, n)")
    check_zarr()
    drawn = sample or Sampling((), 1)
    n, seed, method = drawn.n if sample else None, drawn.seed, drawn.method
    cases = build_cases(over, drawn.distributions, table, n=n, seed=seed, method=method, yes=yes)
    operation = build_analysis(do, keep, **options)
    prepared = prepare_sweep(scene, cases, operation, out=out, workers=workers, task_size=task_size, yes=yes)
    run_options: dict[str, Any] = {"stop_after": stop_after, "on_progress": on_progress}
    # Without a folder the results are in memory only.
    if out is not None:
        try:
            return _open_outcome(prepared.run(out, **run_options))
        except KeyboardInterrupt as error:
            error.add_note(f"{out} keeps what is finished; the same call goes on where it stopped")
            raise
    with tempfile.TemporaryDirectory(prefix="tensegrity_codegen-") as folder:
        return _open_outcome(prepared.run(Path(folder) / "sweep.zarr", **run_options)).load()


def _open_outcome(outcome: SweepOutcome) -> Any:
    """Return the results of a run; warns of those that are NaN in every case."""
    if outcome.empty:
        warnings.warn(outcome.describe_empty(), stacklevel=3)
    return open_sweep(outcome.path)
