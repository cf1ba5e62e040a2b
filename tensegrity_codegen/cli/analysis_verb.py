"""Verbs that are made from the records of analyses: options, files, results and exit codes stand there."""

import inspect
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Annotated, Any, get_origin

import typer

from tensegrity_codegen.analyses.cases.record import SAME, Option, Result, ResultFile, SceneAnalysis
from tensegrity_codegen.cli.options import (
    CompilerOption,
    FlagsOption,
    InputOption,
    OverwriteOption,
    PrintOptions,
    SceneArgument,
    StrictOptions,
    parse_loads,
    read_inputs,
)
from tensegrity_codegen.cli.output import Output, check_result
from tensegrity_codegen.cli.verb import Verb, name_options, quote_command

PACKAGE = "tensegrity_codegen.analyses"
LoadOption = Annotated[
    list[str] | None,
    typer.Option(
        "--load",
        help="Load NODE=fx,fy,fz [N] added to the scene's (planar scene: two numbers); NODE may be a pattern "
        "such as top*, each of whose nodes gets the load; may be repeated.",
    ),
]


def list_modules() -> list[str]:
    """Return the names of the modules of analyses."""
    return [module.name for module in iter_modules(import_module(PACKAGE).__path__) if not module.ispkg]


def read_verb(module: str) -> Verb | None:
    """Return the verb of an analysis, None if it has none of its own making."""
    record = import_module(f"{PACKAGE}.{module}").ANALYSIS
    return build_verb(record) if issubclass(record, SceneAnalysis) else None


def build_verb(record: type[SceneAnalysis]) -> Verb:
    """Return the verb of a record, from which Typer makes arguments and options."""
    parameters = _list_parameters(record)

    def run(**given: Any) -> None:
        _run(record, given)

    run.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, annotation=annotation, default=default)
            for name, (annotation, default) in parameters.items()
        ]
    )
    run.__annotations__ = {name: annotation for name, (annotation, _) in parameters.items()}
    run.__doc__, run.__name__ = record.__doc__, record.name.replace("-", "_")
    return Verb(run, record.verb_order, record.name)


def _list_parameters(record: type[SceneAnalysis]) -> Mapping[str, tuple[Any, Any]]:
    """Return annotation and default of each argument and option, in the order of the help."""
    parameters: dict[str, tuple[Any, Any]] = {"scene": (SceneArgument, inspect.Parameter.empty)}
    shared = {"load": LoadOption, "input": InputOption}
    options = [option for option in record.list_options() if option.in_verb]
    flags = [option for option in options if option.flag]
    for option in flags:
        parameters[option.parameter] = _declare(option)
    for option in options:
        parameters[option.parameter] = _declare(option)
    for name, annotation in shared.items():
        if name in record.takes:
            parameters[name] = (annotation, None)
    for file in record.files:
        names = [f"--{file.name.replace('_', '-')}", *(["-o"] if file.name == "out" else [])]
        kind: Any = list[Path] if file.is_list else Path
        parameters[file.name] = (Annotated[kind | None, typer.Option(*names, help=file.help)], None)
    if record.files:
        both = Annotated[bool, typer.Option("--overwrite/--no-overwrite", help="Replace files that exist.")]
        is_scene = any(file.may_be_scene for file in record.files)
        parameters["overwrite"] = (both if is_scene else OverwriteOption, False)
    parameters["compiler"] = (CompilerOption, None)
    if "flags" in record.takes:
        parameters["flags"] = (FlagsOption, None)
    parameters["printing"] = (StrictOptions if "strict" in record.takes else PrintOptions, ...)
    return parameters


def _declare(item: Option) -> tuple[Any, Any]:
    """Return annotation and default of an option; a flag stands for one value of its field."""
    help = item.help[0].upper() + item.help[1:]
    default = item.default if item.verb_default is SAME else item.verb_default
    short = len(str(default)) < 40  # a longer one would be broken in its words
    name = f"--{item.argument.replace('_', '-')}"
    option = typer.Option(name, help=help, min=item.minimum, show_default=short)
    if item.flag:
        return Annotated[bool, option], False
    kind: Any = item.type
    if get_origin(item.type) is tuple:
        kind, default = (list[str], ...) if default is ... else (list[str] | None, None)
    return Annotated[kind, option], inspect.Parameter.empty if default is ... else default


def _run(record: type[SceneAnalysis], given: dict[str, Any]) -> None:
    """Solve a scene by a record, print and write what it says, and exit with 3 where it is not good."""
    scene, printing = given["scene"], given["printing"]
    output = Output(printing.json, printing.all)
    with output.guard(scene):
        paths = {file: given[file.name] for file in record.files}
        files = {file.name: path for file, path in paths.items() if path}
        overwrite = given.get("overwrite", False)
        options = (given.get(option.parameter) for option in record.list_options())
        read = [value for value in options if isinstance(value, Path)]
        for file, path in paths.items():
            inputs = [*([] if file.may_be_scene and overwrite else [scene]), *read]
            for output_path in path or [None] if file.is_list else [path]:
                check_result(output_path, *file.endings, inputs=inputs, overwrite=overwrite, draws=file.draws)
        analysis = _build_record(record, given)
        analysis.check_files(files)
        result = analysis.solve(_read_case(analysis, scene, given, output, files))
        output.warn(*result.warnings)
        written = _write_files(result, paths, overwrite)
        output.result(result.as_dict() | written, *([] if output.as_json else result.describe()))
        if result.failure:
            output.warn(result.failure)
        is_refused = getattr(printing, "strict", False) and result.is_beyond
        if is_refused or not result.is_good:
            raise typer.Exit(3)


def _build_record(record: type[SceneAnalysis], given: Mapping[str, Any]) -> SceneAnalysis:
    """Return the record with the values of its options."""
    values: dict[str, Any] = {}
    for option in record.list_options():
        if not option.in_verb:
            continue
        value = given[option.parameter]
        if option.flag:
            value = option.flag[1] if value else option.default
        values[option.name] = tuple(value or ()) if get_origin(option.type) is tuple else value
    return record(**values)


def _read_case(
    analysis: SceneAnalysis,
    scene: Path,
    given: Mapping[str, Any],
    output: Output,
    files: Mapping[str, Any],
) -> Any:
    """Return the scene with the values of --load and --input."""
    from tensegrity_codegen.analyses.cases.scene_case import SceneCase

    subject, request = output.load(scene, settles=analysis.settles, sags=True)
    subject = analysis.prepare_structure(subject)
    texts = given.get("load") or ()
    case = SceneCase(
        subject,
        request,
        inputs=read_inputs(given.get("input"), subject, output),
        load=parse_loads(list(texts), subject),
        load_texts=tuple(texts),
        compiler=given["compiler"],
        warn=output.warn,
        command=quote_command(),
        whole=output.whole,
        flags=given.get("flags"),
        files=files,
        name_options=name_options,
    )
    case.warn_held_load(case.held_load)
    return case


def _write_files(result: Result, paths: Mapping[ResultFile, Any], overwrite: bool) -> dict[str, Any]:
    """Write what is asked for; return the path of each file by its key, None where there is none."""
    written: dict[str, Any] = {}
    for file, path in paths.items():
        targets = list(path or []) if file.is_list else [path] if path else []
        done = [str(target) for target in targets if result.write(file.name, target, overwrite=overwrite)]
        key = file.name if file.key is None else file.key
        if key:
            written[key] = done if file.is_list else done[0] if done else None
    return written
