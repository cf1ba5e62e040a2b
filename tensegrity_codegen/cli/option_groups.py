"""Groups of options that a verb takes as one argument: dataclasses, or what is known only when it runs."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from functools import wraps
from typing import Annotated, Any, get_args, get_origin, get_type_hints


@dataclass(frozen=True)
class OptionGroup:
    """Options that a function lists when they are first needed, as fields; the verb takes a dictionary."""

    list_fields: Callable[[], "Mapping[str, tuple[Any, Any]]"]  # name -> (annotation, default or ...)


def expand_groups(run: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function with the options of all groups as its own arguments, from which Typer makes them.

    A group is an argument whose annotation is a dataclass of options, or `Annotated[dict, OptionGroup]`.
    """
    hints = get_type_hints(run, include_extras=True)
    groups: dict[str, tuple[Any, tuple[str, ...]]] = {}
    parameters: dict[str, inspect.Parameter] = {}
    for name, parameter in inspect.signature(run).parameters.items():
        listed = _list_fields(hints[name])
        if listed is None:
            parameters[name] = parameter.replace(annotation=hints[name])
            continue
        groups[name] = (hints[name] if is_dataclass(hints[name]) else dict, tuple(listed))
        for own, (annotation, default) in listed.items():
            kind = inspect.Parameter.KEYWORD_ONLY
            start = inspect.Parameter.empty if default is ... else default
            parameters[own] = inspect.Parameter(own, kind, annotation=annotation, default=start)
    if not groups:
        return run

    @wraps(run)
    def expanded(**given: Any) -> Any:
        for name, (build, names) in groups.items():
            given[name] = build(**{own: given.pop(own) for own in names})
        return run(**given)

    keyword = [item.replace(kind=inspect.Parameter.KEYWORD_ONLY) for item in parameters.values()]
    expanded.__signature__ = inspect.Signature(keyword)  # type: ignore[attr-defined]
    expanded.__annotations__ = {name: item.annotation for name, item in parameters.items()}
    return expanded


def _list_fields(annotation: Any) -> Mapping[str, tuple[Any, Any]] | None:
    """Return the options of a group, None for an annotation that is none."""
    if is_dataclass(annotation):
        hints = get_type_hints(annotation, include_extras=True)
        return {item.name: (hints[item.name], _find_default(item)) for item in fields(annotation)}
    if get_origin(annotation) is Annotated:
        group = next((item for item in get_args(annotation) if isinstance(item, OptionGroup)), None)
        return None if group is None else group.list_fields()
    return None


def _find_default(item: "Field[Any]") -> Any:
    return ... if item.default is MISSING else item.default
