"""`tensegrity-codegen stability`: stiff and extreme cases of some scenes, with every method and peer."""

from pathlib import Path
from typing import Annotated

import typer

from tensegrity_codegen.cli.options import (
    CompilerOption,
    FreshOption,
    JsonOption,
    OverwriteOption,
    PeersOption,
    ScenesArgument,
)
from tensegrity_codegen.cli.output import Output, list_files
from tensegrity_codegen.cli.verb import Verb
from tensegrity_codegen.system.errors import UnstableError
from tensegrity_codegen.system.output_folder import check_folder


def stability(
    scenes: ScenesArgument,
    t_end: Annotated[float, typer.Option("--t-end", help="End of each motion [s].")] = 0.5,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder for stability.html and stability.json.")
    ] = Path("stability"),
    peers: PeersOption = True,
    limit: Annotated[
        float,
        typer.Option("--limit", help="CPU time that one run may take [s]; a reference may take twice it."),
    ] = 2.0,
    budget: Annotated[
        float, typer.Option("--budget", help="Time by the clock for all cases of all scenes [s].")
    ] = 540.0,
    compiler: CompilerOption = None,
    flags: Annotated[str, typer.Option("--flags", help="reference or native.")] = "reference",
    fresh: FreshOption = False,
    overwrite: OverwriteOption = False,
    json: JsonOption = False,
) -> None:
    """Run stiff and extreme cases made from each scene, and check every result with status ok.

    Cases for which the time budget does not suffice are listed as not run; the same command with --overwrite
    runs them. After an interruption, the same command resumes. Exit code 3 if one of our methods has status
    ok for a wrong result.

    Example: tensegrity-codegen stability prism.toml --out stability
    """
    output = Output(json)
    with output.guard():
        from tensegrity_codegen.pipeline.compile_scene import load_nodes
        from tensegrity_codegen.structure.body_support import require_no_bodies
        from tensegrity_codegen.studies.stability.judge import NOT_RUN, RULES, VERDICTS, Limits
        from tensegrity_codegen.studies.stability.page import RULE_WORDS, WORDS
        from tensegrity_codegen.studies.stability.report import write_stability

        check_folder(out, ["stability.html", "stability.json"], inputs=scenes, overwrite=overwrite)
        structures = [load_nodes(path) for path in scenes]
        for structure in structures:
            require_no_bodies(structure, "cases of stability", "compare motions by `report`")
            output.warn_of(structure)
        limits = Limits(run=limit, reference=2 * limit, total=budget, peers=peers)
        with output.resumable(out) as notice, output.progress("running cases") as progress:
            made = write_stability(
                structures,
                out,
                t_end=t_end,
                limits=limits,
                compiler=compiler,
                flags=flags,
                progress=progress,
                fresh=fresh,
                overwrite=overwrite,
                notice=notice,
            )
        counts = {verdict: made.count(verdict, own=True) for verdict in VERDICTS}
        status = "unstable" if counts["wrong"] else "ok"
        shown = [f"{count} {WORDS[verdict]}" for verdict, count in counts.items() if count]
        summary = f"our runs: {', '.join(shown)}"
        rules = {rule: made.count_rule(rule) for rule in RULES}
        summary += "; certified " + ", ".join(
            f"{count} by {RULE_WORDS[rule]}" for rule, count in rules.items() if count
        )
        if made.cases_not_run:
            output.warn(
                f"{len(made.cases_not_run)} cases ({counts[NOT_RUN]} of our runs) were not run in time "
                "(see the page); the same command with --overwrite runs them (finished cases are kept)"
            )
        files = {"html": str(made.html), "data": str(made.data)}
        output.result(
            {"status": status, "files": files, "counts": counts, "resumed": output.resumed, **made.as_dict()},
            summary,
            list_files(files),
        )
        if counts["wrong"]:
            raise typer.Exit(UnstableError.exit_code)


VERB = Verb(stability, order=720)
